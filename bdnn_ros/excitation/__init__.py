"""The next motion: the one that tells apart what a diagnosis could not."""
