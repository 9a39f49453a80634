"""Detects changes of the robot while it moves, and names them."""
