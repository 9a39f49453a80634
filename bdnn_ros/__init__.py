"""Online identification of robot dynamics with Bidirectional Dynamic Neural Networks."""

__version__ = "0.1.0"
