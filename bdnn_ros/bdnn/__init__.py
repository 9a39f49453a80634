"""Bidirectional dynamic neural networks: acceleration from effort, effort from acceleration, readable parts."""
