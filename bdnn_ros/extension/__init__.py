"""The extended model of a diagnosis, and its files for other programs."""
