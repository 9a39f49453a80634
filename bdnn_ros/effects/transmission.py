"""Transmissions that bend: the measured position is the motor's, the link lags behind by what the load bends.

The rigid effort belongs to the link's motion, `q - deflection`, so the measured effort changes by the rigid
effort's derivative along `-deflection` and its time derivatives.
"""

from __future__ import annotations

import numpy as np

from bdnn_ros.effects.base import Effect, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot.units import along, printed

SOFTEST = 25.0
"""A link rarely swings more slowly on its gear [rad/s]: no position loop could hold it."""
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
        return np.minimum(typical, 1.0 / (SOFTEST**2 * float(motion.usual_inertia[target])))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return -motion.shifted(target, motion.calmed(motion.gear_load[:, target]))[..., None]

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"stiffness": 1.0 / max(float(coefficients[0]), 1e-9)}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([1.0 / values["stiffness"]]), {}

    def sentence(self, where: str, values: Values) -> str:
        unit = printed(along("N*m/rad", self.slides))
        return f"{where} gives: its transmission has a stiffness of {values['stiffness']:.3g} {unit}."
