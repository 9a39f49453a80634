"""Pre-sliding friction: a bristle that bends (Dahl, A solid friction model, Aerospace Corporation TOR-0158, 1968)."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from bdnn_ros.effects.base import Effect, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.signals import Signals

KNOWN = 4.0
"""A bristle's force and travel must be this many standard deviations from 0 and from their bounds: creep looks like a bristle."""


def bristle(position: np.ndarray, breakaway: float) -> np.ndarray:
    """Deflection of a Dahl bristle along positions (N,), in [-1, 1], starting at 0; exact while the direction stays."""
    if len(position) < 2:
        return np.zeros(len(position))
    direction = np.sign(np.diff(position))
    turns = np.flatnonzero(np.diff(direction)) + 1
    starts, ends = np.array([0, *turns]), np.array([*turns, len(direction)])
    ways, counts = direction[starts], ends - starts
    fade = np.exp(-np.abs(position[1:] - np.repeat(position[starts], counts)) / breakaway)
    bends, bend = np.empty(len(starts)), 0.0
    for k, (way, last) in enumerate(zip(ways.tolist(), fade[ends - 1].tolist(), strict=True)):
        bends[k] = bend
        bend = way + (bend - way) * last if way else bend
    way = np.repeat(ways, counts)
    bent = way + (np.repeat(bends, counts) - way) * np.where(way, fade, 1.0)
    return np.concatenate([[0.0], bent])


def bristles(motion: Signals, joint: int, breakaway: float) -> np.ndarray:
    """Deflection of a joint's bristle along a motion, (N,); 0 at the start of each gap-free segment."""
    return np.concatenate([bristle(motion.position[rows, joint], breakaway) for rows in motion.segments])


class Hysteresis(Effect):
    """Pre-sliding friction: a bristle that bends over the distance `breakaway` before it slides (Dahl)."""

    name = "hysteresis"
    title = "pre-sliding friction"
    on = "joint"
    in_drive = True
    parameters = (
        Parameter("force", "N*m", 0.0, plausible=(0.05, 0.4), of_effort=True),
        Parameter("breakaway", "rad", 1e-4, 0.5, plausible=(0.01, 0.1)),
    )
    linear = ("force",)
    equation = "F with dF/dq = (force / breakaway) * (1 - sign(qd) * F / force)"
    confused_with = ("coulomb_friction", "joint_elasticity", "backlash", "stribeck_friction")
    shown_by = "many small reversals, of about the breakaway distance, beside large ones"
    source = "Dahl, A solid friction model, Aerospace Corporation TOR-0158, 1968"
    coefficient_bounds = ((0.0, np.inf),)
    settles_into = "coulomb_friction"
    idealised_shapes = frozenset({"breakaway"})
    shape_bounds = MappingProxyType({"breakaway": (1e-3, 0.3)})

    def shown(self, values: Values, stds: Values, most: float = math.inf) -> bool:
        # at the lower bound it is rather no bristle at all, at the upper bound a spring or a drift
        travel, (low, high) = values["breakaway"], self.shape_bounds["breakaway"]
        beyond = min(travel - low, high - travel)
        known = abs(values["force"]) > KNOWN * stds["force"] and beyond > KNOWN * stds["breakaway"]
        return known and values["force"] <= most

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        force, breakaway = values["force"], values["breakaway"]
        last = math.nan
        bend = 0.0

        def resist(time: float, position: float, velocity: float, load: float) -> float:
            nonlocal last, bend
            step = 0.0 if math.isnan(last) else position - last
            last = position
            if step:
                direction = math.copysign(1.0, step)
                bend = direction + (bend - direction) * math.exp(-abs(step) / breakaway)
            return force * bend

        plant.efforts.append((target, resist))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.sharp_column(target, bristles(motion.signals, target, shape["breakaway"]))

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [{"breakaway": float(b)} for b in np.geomspace(0.005, 0.12, 5)]
