"""Identification while the robot moves, and the models it hands over."""
