"""Judging what a search found: parameters with uncertainty, rivals, and held-out rows."""
