"""Physical parameters: identified in seconds, physically consistent, with their uncertainty."""
