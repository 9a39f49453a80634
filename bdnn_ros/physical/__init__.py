"""Parameters with meaning: identified in seconds, physically consistent, with their uncertainty."""
