"""The methods of the BDNN benchmark: what each is given, and how it learns."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from _bdnn_effort import least_squares, perceptron
from _bdnn_judging import Judged
from _bdnn_lagrangian import lagrangian
from _bdnn_ode import neural_ode
from _motion import Data

from bdnn_ros.bdnn.training import identify
from bdnn_ros.simulation.perturbation import wrong_robot

WRONG_BY = 0.2
"""Standard deviation of the bodies of the URDF that is given as prior, relative."""
MOTION = {"arm2": 120.0, "arm6": 600.0, "arm7": 600.0}
BUDGET = {"arm2": 60.0, "arm6": 60.0, "arm7": 120.0}
"""Seconds of motion, and of processor time, for a black box of each robot."""
LITTLE_MOTION, LITTLE_BUDGET = 30.0, 30.0
"""The same where the axes are known."""


@dataclass(frozen=True)
class Method:
    """One row of the table.

    Attributes:
        label: what it is called there.
        learn: from data, budget [s] and seed.
        knows_axes: whether it is given the URDF's axes, and then little motion and time.
    """

    label: str
    learn: Callable[[Data, float, int], Judged]
    knows_axes: bool = False

    def motion(self, robot: str) -> float:
        """Seconds of motion it learns from."""
        return LITTLE_MOTION if self.knows_axes else MOTION[robot]

    def budget(self, robot: str) -> float:
        """Seconds of processor time it may take."""
        return LITTLE_BUDGET if self.knows_axes else BUDGET[robot]


def chain(data: Data, budget: float, seed: int) -> Judged:
    """Our black box as it comes: a serial chain whose axes are learned, and networks for the rest."""
    return identify(data.train, data.validation, None, budget, seed, clock=time.process_time)


def networks(data: Data, budget: float, seed: int) -> Judged:
    """Our black box of H and R networks alone, as in the paper."""
    return identify(
        data.train,
        data.validation,
        None,
        budget,
        seed,
        architecture="networks",
        clock=time.process_time,
    )


def on_prior(data: Data, budget: float, seed: int) -> Judged:
    """Ours on a URDF whose bodies are wrong and that has neither rotors nor friction."""
    prior = wrong_robot(data.nominal, WRONG_BY, np.random.default_rng([seed, 1]))
    return identify(data.train, data.validation, prior, budget, seed, clock=time.process_time)


METHODS = {
    "chain": Method("ours, black box", chain),
    "networks": Method("ours, H and R nets alone", networks),
    "lagrangian": Method("DeLaN-type", lagrangian),
    "ode": Method("neural ODE, torchdiffeq", neural_ode),
    "perceptron": Method("inverse-dynamics MLP", perceptron),
    "prior": Method("ours, 20 % wrong URDF", on_prior, knows_axes=True),
    "squares": Method("least squares, true axes", least_squares, knows_axes=True),
}
GROUPS = {
    "ours": ["chain", "networks", "prior"],
    "peers": ["lagrangian", "ode", "perceptron", "squares"],
    "all": list(METHODS),
}
