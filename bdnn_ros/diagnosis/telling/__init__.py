"""What is said of what was found: findings, verdict, gain, what is left, notes and advice."""
