"""Transmissions that give: the measured position is the motor's, the link lags behind by what the load bends.

The rigid effort belongs to the link's motion, `q - deflection`, so the measured effort changes by the rigid
effort's derivative along `-deflection` and its time derivatives.
"""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from bdnn_ros.effects.base import Effect, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant

TRANSIT = 0.025
"""How long a motor takes to cross the gap where nothing else is known [s]."""
SLOWEST = 2.0
"""No crossing is taken as more than so many times as long, or as short, as the usual one."""
SOFTEST = 25.0
"""A link rarely swings more slowly on its gear [rad/s]: no position loop could hold it."""
LIGHTEST = 1e-9
"""Some descriptions give their last links no inertia at all [kg·m²]."""
SPONG = "Spong, Modeling and control of elastic joint robots, JDSMC 109(4), 1987"


class JointElasticity(Effect):
    """A spring between motor and link: link position = measured position - link load / stiffness.

    The load is the measured effort's: the motor's oscillation on its spring is in the measured position, and
    a load computed from that would hold it twice. It is taken as slow as the motion: near the resonance the noise of
    the effort would bend the spring more than the load does.
    """

    name = "joint_elasticity"
    title = "joint elasticity"
    on = "joint"
    parameters = (Parameter("stiffness", "N*m/rad", 1.0, plausible=(100.0, 20000.0)),)
    equation = "rigid effort of (q - link load / stiffness) minus rigid effort of q"
    confused_with = ("backlash", "position_offset", "armature", "hysteresis")
    shown_by = "fast changes of load: high accelerations, and poses of very different gravity"
    source = SPONG
    of_bodies = True
    of_load = True
    idealised = 0.02
    coefficient_bounds = ((0.0, 1.0),)

    def echo(self, motion: Motion, target: int) -> float:
        return -float(motion.usual_inertia[target])

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.stiffness[target] = 1.0 / (1.0 / plant.stiffness[target] + 1.0 / values["stiffness"])

    def spread(self, typical: np.ndarray, motion: Motion, target: int) -> np.ndarray:
        inertia = max(float(motion.usual_inertia[target]), LIGHTEST)
        return np.minimum(typical, 1.0 / (SOFTEST**2 * inertia))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        deflection = np.zeros(motion.position.shape)
        deflection[:, target] = motion.calmed(motion.gear_load[:, target])
        return -motion.shifted(deflection)[..., None]

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"stiffness": 1.0 / max(float(coefficients[0]), 1e-9)}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([1.0 / values["stiffness"]]), {}

    def sentence(self, where: str, values: Values) -> str:
        return f"{where} gives: its transmission has a stiffness of {values['stiffness']:.3g} N·m/rad."


class Backlash(Effect):
    """Play between motor and link: the link lies half the gap behind, on the side the load pushes it to.

    When the load changes its sign the motor, free of the link, crosses the gap; the measured effort tells when, because
    the motor's jump is in the measured position. A load that goes on at its rate r drives a rotor of inertia I over
    r t³ / (6 I): the crossing is cubic in time and takes as r^(-1/3), the shape's `transit` [s] at the usual rate.
    """

    name = "backlash"
    title = "backlash"
    on = "joint"
    brief = True
    parameters = (
        Parameter("gap", "rad", 0.0, 0.5, plausible=(0.002, 0.03)),
        Parameter("transit", "s", 1e-3, 0.06, plausible=(0.01, 0.06), default=TRANSIT),
    )
    equation = "rigid effort of (q - gap / 2 * side(link load)) minus rigid effort of q, side from -1 to 1"
    confused_with = ("joint_elasticity", "position_offset", "coulomb_friction", "hysteresis")
    shown_by = "motion in which the load of the joint changes its sign often, in poses of small gravity load"
    source = (
        "Nordin, Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38(10), 2002"
    )
    of_bodies = True
    idealised = 0.04
    coefficient_bounds = ((0.0, 0.5),)
    shape_bounds = MappingProxyType({"transit": (1e-3, 0.06)})

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.gap[target] += values["gap"]

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        side = np.zeros(motion.position.shape)
        side[:, target] = motion.signals.soften(_side(motion, target, shape["transit"]))
        return -0.5 * motion.shifted(side)[..., None]

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [{"transit": transit} for transit in (0.01, 0.025, 0.06)]

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"gap": float(coefficients[0]), "transit": float(shape["transit"])}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([values["gap"]]), {"transit": values["transit"]}


def _side(motion: Motion, target: int, transit: float) -> np.ndarray:
    """Where in its gap a motor is, from -1 to 1, (N,); crossings begin where the load is nothing, between samples too.

    Args:
        transit: duration of a crossing while the load changes at its usual (root mean square) rate [s].
    """
    load = motion.gear_load[:, target]
    rate = motion.derivative(load)
    usual, side = float(np.sqrt(np.mean(rate**2))), np.sign(load)
    for rows in motion.signals.segments:
        time, here = motion.time[rows], load[rows]
        last = np.flatnonzero(here[:-1] * here[1:] < 0.0)
        begun = time[last] - here[last] * (time[last + 1] - time[last]) / (here[last + 1] - here[last])
        slow = (usual / np.maximum(np.abs(rate[rows][last]), 1e-3 * usual)) ** (1.0 / 3.0)
        spans = transit * np.clip(slow, 1.0 / SLOWEST, SLOWEST)
        after = last[:, None] + 1 + np.arange(int(np.ceil(SLOWEST * transit * motion.signals.rate)) + 1)
        within = after < len(time)
        after = np.minimum(after, len(time) - 1)
        crossed = np.clip((time[after] - begun[:, None]) / spans[:, None], 0.0, 1.0) ** 3
        missing = np.where(within, 2.0 * np.sign(here[last + 1])[:, None] * (1.0 - crossed), 0.0)
        np.subtract.at(side[rows], after, missing)
    return np.asarray(side)
