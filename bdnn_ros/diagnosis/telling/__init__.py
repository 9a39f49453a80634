"""Reporting a diagnosis: findings, verdict, gain, what is unexplained, notes and advice."""
