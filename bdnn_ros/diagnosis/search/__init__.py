"""The search for the set of effects that the data support."""
