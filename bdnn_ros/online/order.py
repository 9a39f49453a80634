"""Use of a model with its joints in another order: it computes in its own order.

Reordering its arrays would not do, since its terms may couple a joint to the next one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import ModelFileError, listed
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Prior, parameter_names, prior
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals


def places(names: Sequence[str], among: Sequence[str]) -> np.ndarray:
    """The index of each name among others, which contain all of them."""
    where = {name: k for k, name in enumerate(among)}
    return np.array([where[name] for name in names], int)


def require_joints(model: Dynamics, used: Sequence[str], known: Sequence[str], name: str) -> None:
    """Refuse a model whose joints are not those in use; their order does not matter.

    Args:
        known: all joints of the robot.
        name: the model's, for the message.

    Raises:
        ModelFileError: they are others.
    """
    if sorted(model.joints) == sorted(used):
        return
    remedy = "Load a model of this robot."
    if set(model.joints) <= set(known):
        remedy = f"Start the node with the parameter joints set to [{', '.join(model.joints)}]."
    raise ModelFileError(
        f"{name} is a model of {listed(model.joints, 20)}, in use are {listed(used, 20)}.", remedy
    )


def belief(model: PhysicalModel, robot: Robot) -> Prior:
    """A model's estimate of the parameters as a prior, in the robot's order of joints."""
    order = places(parameter_names(robot.joints), parameter_names(model.joints))
    mean, covariance = model.parameters.vector()[order], model.covariance[np.ix_(order, order)]
    return Prior(mean, covariance, prior(robot).effort_scale)


def predicted(model: Dynamics, signals: Signals) -> np.ndarray:
    """Effort along a motion, (N, n) [N·m], in the motion's order of joints; `model.predict` uses the model's order."""
    if tuple(model.joints) != signals.joints:
        there, back = places(model.joints, signals.joints), places(signals.joints, model.joints)
        return predicted(model, _arranged(signals, there))[:, back]
    return np.asarray(model.predict(signals))  # type: ignore[attr-defined]


def _arranged(signals: Signals, order: np.ndarray) -> Signals:
    """The same motion with its joints in another order."""

    def some(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else values[..., order]

    return replace(
        signals,
        joints=tuple(signals.joints[k] for k in order),
        position=signals.position[:, order],
        velocity=signals.velocity[:, order],
        acceleration=signals.acceleration[:, order],
        position_noise=signals.position_noise[order],
        effort=some(signals.effort),
        reported_velocity=some(signals.reported_velocity),
        effort_noise=some(signals.effort_noise),
        unmeasured=some(signals.unmeasured),
    )
