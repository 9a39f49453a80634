"""Pushes and contacts: where and when something pushed, searched for in the residual."""
