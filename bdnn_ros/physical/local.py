"""The learned part of each joint's effort beside the rigid bodies: one small network per joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bdnn_ros.physical.dictionary import FEATURES, GROUPS, Scales, features, group_slices

ROWS = 4000
"""Samples whose features are held in memory at once."""


@dataclass(frozen=True)
class LocalResiduals:
    """Effort of each joint as a function of its position, velocity, load and its neighbours' velocities.

    Attributes:
        groups: groups of features that are switched on, of each joint.
        weights: of each joint's features, (n, FEATURES) [N·m]; zero where a group is off.
        straight: viscous and Coulomb friction and offset that the features hold but the joint's parameters
            stand for, so that they are taken away, (n, 3).
        scales: what the features are measured in.
    """

    groups: tuple[tuple[str, ...], ...]
    weights: np.ndarray
    straight: np.ndarray
    scales: Scales

    @property
    def active(self) -> bool:
        """Whether any joint has a group of features switched on."""
        return any(self.groups)

    @property
    def by_load(self) -> bool:
        """Whether that of any joint depends on the load."""
        return any("load" in names for names in self.groups)

    def effort(
        self,
        position: np.ndarray,
        velocity: np.ndarray,
        direction: np.ndarray,
        load: np.ndarray,
        own: np.ndarray | None = None,
    ) -> np.ndarray:
        """Learned effort, (..., n) [N·m].

        Args:
            position, velocity: (..., n).
            direction: state of dry friction, (..., n), -1 to 1.
            load: effort that the rigid bodies ask of each joint, (..., n) [N·m].
            own: the same direction by each joint's own breakaway, (..., n), where that differs.
        """
        if not self.active:
            return np.zeros(np.shape(position))
        width = len(self.weights)
        q, v, z, tau = (np.reshape(x, (-1, width)) for x in (position, velocity, direction, load))
        result = np.empty(q.shape)
        for start in range(0, len(q), ROWS):
            rows = slice(start, start + ROWS)
            phi = features(q[rows], v[rows], z[rows], tau[rows], self.scales)
            result[rows] = np.einsum("tjk,jk->tj", phi, self.weights)
        viscous, coulomb, offset = self.straight.T
        own = direction if own is None else own
        return result.reshape(np.shape(position)) - (viscous * velocity + coulomb * own + offset)

    def growth(self, velocity: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Learned effort per magnitude of the rigid bodies' load, (N, n).

        Args:
            velocity, direction: as of `effort`, (N, n).
        """
        dry, fluid = self.weights[:, group_slices()["load"]].T
        return np.asarray((dry * direction + fluid * velocity / self.scales.velocity) / self.scales.effort)

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest that make them again."""
        arrays = {
            "weights": self.weights,
            "straight": self.straight,
            "scale_effort": self.scales.effort,
            "scale_velocity": self.scales.velocity,
        }
        return arrays, {"groups": [list(names) for names in self.groups]}

    @classmethod
    def from_state(cls, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> LocalResiduals:
        """Those of `to_state`."""
        groups = tuple(tuple(str(name) for name in names) for names in info["groups"])
        if arrays["weights"].shape != (len(groups), FEATURES) or set().union(*groups) - set(GROUPS):
            raise ValueError("unknown features")
        scales = Scales(arrays["scale_effort"], arrays["scale_velocity"])
        return cls(groups, arrays["weights"], arrays["straight"], scales)


def spread_weights(groups: tuple[tuple[str, ...], ...], values: list[np.ndarray]) -> np.ndarray:
    """Weights of all features, (n, FEATURES), from those of the active groups, by `GROUPS`."""
    weights, where = np.zeros((len(groups), FEATURES)), group_slices()
    for row, names, given in zip(weights, groups, values, strict=True):
        start = 0
        for name in (name for name in GROUPS if name in names):
            row[where[name]] = given[start : start + GROUPS[name]]
            start += GROUPS[name]
    return weights
