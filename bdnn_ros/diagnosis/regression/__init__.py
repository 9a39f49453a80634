"""The regression of a recorded motion against a simulation, its noise model, and the evidence of sets of effects."""
