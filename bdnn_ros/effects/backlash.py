"""Loose transmissions: the measured position is the motor's; the link rests on one side of the gap or is on its way across.

A motor leaves its side when the load there vanishes. From then on the link coasts, and the two part with the acceleration
that the link would have needed to follow the motor: the rigid-body effort along the motor's motion, divided by the inertia.
That is known from the motion alone, whatever the rotor inertia and the controller.
"""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from bdnn_ros.effects.base import Effect, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot.units import along, printed

CROSSINGS = (5e-4, 0.5)
"""Shortest and longest crossing that is considered [rad]."""
TRIED = (0.001, 0.002, 0.0045, 0.01, 0.022, 0.05)
EARLY = 2.0
"""The low-passed motion shows a motor's jump this many standard deviations of the low-pass before it begins."""
FIRST_LOOK = 0.25
"""Most crossings take less than this [s]; the search is extended for longer ones."""


class Backlash(Effect):
    """Play between motor and link: the link lies half the gap behind, on the side the load pushes it to.

    When the load changes its sign the motor, free of the link, crosses the gap: the two part with the acceleration that the
    link would need to follow the motor, until they are `crossing` apart, which is the gap plus the elastic deflection of the
    teeth. The motor's jumps are in the measured position; the measured effort tells when they begin.
    """

    name = "backlash"
    title = "backlash"
    on = "joint"
    brief = True
    settles_into = "position_offset"
    parameters = (
        Parameter("gap", "rad", 0.0, 0.5, plausible=(0.002, 0.03)),
        Parameter("crossing", "rad", 0.0, CROSSINGS[1], plausible=(0.002, 0.03), default="gap"),
    )
    linear = ("gap",)
    equation = "rigid effort of (q - gap / 2 * side(q, link load)) minus rigid effort of q, side from -1 to 1"
    confused_with = ("joint_elasticity", "position_offset", "coulomb_friction", "hysteresis")
    shown_by = "motion in which the load of the joint changes its sign often, in poses of small gravity load"
    source = (
        "Nordin, Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38(10), 2002"
    )
    without = ("joint_elasticity",)
    of_bodies = True
    idealised = 0.04
    coefficient_bounds = ((0.0, 0.5),)
    shape_bounds = MappingProxyType({"crossing": CROSSINGS})

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.gap[target] += values["gap"]

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return -0.5 * motion.bent(target, side(motion, target, shape["crossing"]))[..., None]

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [{"crossing": crossing} for crossing in TRIED]

    def shown(self, values: Values, stds: Values, most: float = math.inf) -> bool:
        # a crossing at the upper bound is rather one that is never completed
        return values["crossing"] + stds["crossing"] < CROSSINGS[1]

    def sentence(self, where: str, values: Values) -> str:
        gap = f"{abs(values['gap']):.3g} {printed(along('rad', self.slides))}"
        if not self.before and values["gap"] >= 0.0:
            return f"{where} is loose: its transmission has a gap of {gap}."
        loose, larger = ("less loose", "smaller") if values["gap"] < 0.0 else ("looser", "larger")
        return f"{where} is {loose} than in the model: its transmission's gap is {gap} {larger}."


def side(motion: Motion, target: int, crossing: float) -> np.ndarray:
    """Where in its gap a motor is along a motion, from -1 to 1, (N,).

    Args:
        crossing: distance from one side to the other [rad].
    """
    signals, load = motion.signals, motion.gear_load[:, target]
    parting = motion.link_load[:, target] / motion.inertia[:, target]
    early, result = round(EARLY * signals.motion_std * signals.rate), np.empty(len(load))
    for rows in signals.segments:
        result[rows] = _sides(load[rows], parting[rows], crossing, early, 1.0 / signals.rate)
    return result


def _sides(load: np.ndarray, parting: np.ndarray, crossing: float, early: int, period: float) -> np.ndarray:
    """Where a motor is in its gap, from -1 to 1, (M,), in one gap-free stretch.

    Args:
        load: on the gear, by the measured effort, (M,) [N·m].
        parting: acceleration with which the motor leaves a coasting link, (M,) [rad/s²].
        crossing: distance from one side to the other [rad].
        early: samples by which the low-passed motion may show the jump before the load vanishes.
        period: of the samples [s].
    """
    count, result = len(load), np.empty(len(load))
    gone = {at: np.flatnonzero(at * load < 0.0) for at in (1.0, -1.0)}
    leaving = {at: np.flatnonzero(at * parting < 0.0) for at in (1.0, -1.0)}
    at, k = 1.0 if load[0] >= 0.0 else -1.0, 0
    while k < count:
        unloaded = _next(gone[at], k, count)
        begin = _next(leaving[at], max(unloaded - early, k), count) if unloaded < count else count
        result[k : begin + 1] = at
        way = _way(parting[begin:], at, 0.5 * crossing, period)
        k = begin + 1 + len(way)
        result[begin + 1 : k] = way[: count - begin - 1]
        at = float(np.sign(way[-1])) if len(way) else at
    return result


def _way(parting: np.ndarray, at: float, half: float, period: float) -> np.ndarray:
    """A motor's positions in its gap after it left side `at`, until it meets a side, in units of half the gap, (K,)."""
    look = max(round(FIRST_LOOK / period), 2)
    while True:
        way = at + period**2 / half * parting[:look].cumsum().cumsum()
        met = np.abs(way) >= 1.0
        if met.any():
            first = int(met.argmax())
            way[first] = np.sign(way[first])
            return way[: first + 1]
        if look >= len(parting):
            return way
        look *= 2


def _next(samples: np.ndarray, first: int, none: int) -> int:
    """The first of ascending sample indices that is not less than `first`; `none` if there is none."""
    where = int(samples.searchsorted(first))
    return int(samples[where]) if where < len(samples) else none
