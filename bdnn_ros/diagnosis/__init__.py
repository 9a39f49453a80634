"""Diagnosis: what the simulation gets wrong, what causes it, and what the data cannot tell apart."""
