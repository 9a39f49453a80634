"""Samples from messages as they come: checked, put together, timed, and kept for who learns from them."""
