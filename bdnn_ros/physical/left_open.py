"""Uncertainty that the motion left in an identified model beyond the covariance of its parameters.

Coulomb and viscous friction are an idealisation. Where the friction curve was learned, other speeds may show another one.
Where it was not worth learning, it still exists, and shows at slower or faster speeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from bdnn_ros.physical.dictionary import CURVE_FEATURES, FEATURES, GROUPS, Scales, features, group_slices
from bdnn_ros.physical.linear import inverse
from bdnn_ros.physical.local import ROWS, LocalResiduals
from bdnn_ros.physical.parameters import PER_JOINT
from bdnn_ros.physical.recursive import Posterior, Recursion
from bdnn_ros.physical.structure import Layout, Structure, layout
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.arrays import ReadOnlyArrays
from bdnn_ros.signals import Signals

ALWAYS = "curve"
"""The group of features that every joint has, whether its motion was worth learning it or not."""


@dataclass(frozen=True)
class LeftOpen(ReadOnlyArrays):
    """Joint uncertainty of the base parameters and of the weights of the terms beside them.

    Attributes:
        joints, places: of each weight, the joint and where it is among the features, (W,) each.
        covariance: of the P base parameters and the weights, whose features are taken as they are, (P + W, P + W).
        scale_effort, scale_velocity: what the features are measured in, (n,) each; see `Scales`.
    """

    READ_ONLY: ClassVar[tuple[str, ...]] = ("covariance", "scale_effort", "scale_velocity")

    joints: np.ndarray
    places: np.ndarray
    covariance: np.ndarray
    scale_effort: np.ndarray
    scale_velocity: np.ndarray

    @classmethod
    def plain(cls, covariance: np.ndarray) -> LeftOpen:
        """The uncertainty given by a covariance of base parameters, (P, P), alone."""
        none, width = np.empty(0, int), len(covariance) // (PER_LINK + PER_JOINT)
        return cls(none, none, covariance, np.ones(width), np.ones(width))

    @property
    def scales(self) -> Scales:
        """The units of the features."""
        return Scales(self.scale_effort, self.scale_velocity)

    def columns(self, robot: Robot, signals: Signals, load: np.ndarray | None = None) -> np.ndarray:
        """Effort of its joint per unit of each weight along a motion, low-passed as the effort is, (N, W).

        Args:
            load: what bodies ask of the joints, (N, n) [N·m], if not what the robot's do.
        """
        q, v, state = signals.position, signals.velocity, signals.direction
        load = robot.rigid_effort(q, v, signals.acceleration) if load is None else load
        result = np.empty((len(q), len(self.joints)))
        for start in range(0, len(q), ROWS):
            rows = slice(start, start + ROWS)
            every = features(q[rows], v[rows], state[rows], load[rows], self.scales)
            result[rows] = every[:, self.joints, self.places]
        return signals.soften(result)

    def moved(self, before: LocalResiduals | None, further: np.ndarray) -> LocalResiduals | None:
        """The residual networks with weights increased by `further`, (W,) [N·m]."""
        width = len(self.scale_effort)
        if not len(self.joints):
            return before
        if before is None:
            before = LocalResiduals(
                ((),) * width, np.zeros((width, FEATURES)), np.zeros((width, 3)), self.scales
            )
        weights = before.weights.copy()
        weights[self.joints, self.places] += further
        groups = (tuple(name for name in GROUPS if name == ALWAYS or name in on) for on in before.groups)
        return replace(before, groups=tuple(groups), weights=weights)

    def wider(self, added: np.ndarray) -> LeftOpen:
        """The same with a covariance (P, P) added to that of the base parameters."""
        beside = np.pad(added, (0, len(self.joints)))
        return replace(self, covariance=self.covariance + beside)

    def to_state(self) -> dict[str, np.ndarray]:
        """Arrays that make it again."""
        names = ("joints", "places", *self.READ_ONLY)
        return {name: getattr(self, name) for name in names}

    @classmethod
    def from_state(cls, arrays: dict[str, np.ndarray], width: int) -> LeftOpen:
        """That of `to_state`, of n = `width` joints."""
        joints, places = (arrays[name].astype(int) for name in ("joints", "places"))
        size = width * (PER_LINK + PER_JOINT) + len(joints)
        if joints.shape != places.shape or arrays["covariance"].shape != (size, size):
            raise ValueError("left_open")
        for values, most in ((joints, width), (places, FEATURES)):
            if len(values) and not 0 <= values.min() <= values.max() < most:
                raise ValueError("left_open")
        if any(arrays[name].shape != (width,) for name in ("scale_effort", "scale_velocity")):
            raise ValueError("left_open")
        return cls(joints, places, *(arrays[name] for name in cls.READ_ONLY))


def left_open(recursion: Recursion, structure: Structure, known: Posterior, scales: Scales) -> LeftOpen:
    """What all motion so far leaves open beside a model with this structure.

    A joint whose friction curve was not worth learning gets an uncertainty as large as the curve itself, which the model
    lacks.

    Args:
        known: what the model was made of.
    """
    groups = tuple(tuple(name for name in GROUPS if name == ALWAYS or name in on) for on in structure.groups)
    every = layout(replace(structure, groups=groups), recursion.belief)
    posterior = recursion.solve(every, 0)
    kept = np.concatenate([np.arange(every.base), np.arange(every.weights[0].start, every.size)])
    covariance = inverse(posterior.information)[np.ix_(kept, kept)]
    for joint, on in enumerate(structure.groups):
        if ALWAYS not in on:
            left_out = _left_out(posterior, known, joint)[kept]
            covariance += np.outer(left_out, left_out)
    joints = [np.full(w.stop - w.start, joint) for joint, w in enumerate(every.weights)]
    where = group_slices()
    places = [np.arange(where[name].start, where[name].stop) for names in groups for name in names]
    return LeftOpen(
        np.concatenate(joints), np.concatenate(places), covariance, scales.effort, scales.velocity
    )


def _left_out(posterior: Posterior, known: Posterior, joint: int) -> np.ndarray:
    """Change of the parameters, (P,), if a joint's friction curve were included."""
    result = np.zeros(posterior.layout.size)
    own, weights = _own(posterior.layout, joint), posterior.layout.weights[joint]
    before, learned = known.mean[own], known.mean[known.layout.weights[joint]]
    before[1:] -= learned @ known.layout.straight[joint]
    result[own], result[weights] = posterior.mean[own] - before, posterior.mean[weights]
    result[weights][CURVE_FEATURES:] -= learned  # the curve is the first of the groups
    return result


def _own(every: Layout, joint: int) -> np.ndarray:
    """Indices of a joint's `JOINT_NAMES` among all parameters, (PER_JOINT,)."""
    width = len(every.columns)
    return width * PER_LINK + np.arange(PER_JOINT) * width + joint
