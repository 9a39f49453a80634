"""The regression of a recorded motion against a simulation, its noise, and the evidence for sets of effects."""
