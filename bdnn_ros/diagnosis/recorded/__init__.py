"""Preparing recordings for a diagnosis: excerpts, low-passes, timing and sensors."""
