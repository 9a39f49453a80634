"""Notices that a robot has changed while it moves, and says what."""
