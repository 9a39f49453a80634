"""Plans the next motion: one that distinguishes what a diagnosis could not."""
