"""Simulation: a robot with chosen effects, its controller and its sensors, as a recording with its truth."""

from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.simulate import Simulated, simulate

__all__ = ["Scenario", "Simulated", "simulate"]
