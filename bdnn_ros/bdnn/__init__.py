"""Bidirectional dynamic neural networks: forward and inverse dynamics that stay readable as mechanics."""
