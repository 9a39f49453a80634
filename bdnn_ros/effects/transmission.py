"""Elastic transmissions: the measured position is the motor's; the link lags behind by the deflection under load.

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
"""Lowest natural frequency of a link on its gear [rad/s]: no position loop could hold a softer one."""
BELOW = 0.8
"""Cut-off of the load, as a share of the link's natural frequency on its gear."""
TRIED = 6
"""Number of cut-offs to try."""
TINY = 1e-12
SPONG = "Spong, Modeling and control of elastic joint robots, JDSMC 109(4), 1987"


class JointElasticity(Effect):
    """A spring between motor and link: link position = measured position - link load / stiffness.

    The load is taken from the measured effort: the motor's oscillation on its spring is in the measured position, and a load
    computed from that would contain it twice. It is low-passed below the link's natural frequency on its gear, which follows
    from the shape `compliance` [rad/N·m]: beyond, the noise of the effort would outweigh the deflection. What that noise seems
    to gain is not linear in the compliance, so it is evaluated at the shape `at` [rad/N·m], the estimate itself: the best
    low-pass may lie far below the natural frequency.
    """

    name = "joint_elasticity"
    title = "joint elasticity"
    on = "joint"
    parameters = (Parameter("stiffness", "N*m/rad", 1e-6, plausible=(100.0, 20000.0)),)
    equation = "rigid effort of (q - link load / stiffness) minus rigid effort of q"
    confused_with = ("backlash", "position_offset", "armature", "hysteresis")
    shown_by = "fast changes of load: high accelerations, and poses of very different gravity"
    source = SPONG
    linearised_at = ("at",)
    without = ("backlash",)
    of_bodies = True
    of_load = True
    idealised = 0.05
    coefficient_bounds = ((0.0, 1e6),)

    def echo(self, motion: Motion, target: int, shape: Values) -> tuple[float, float, float]:
        scale = 1.0 if motion.scale is None else motion.scale[target]
        inertia, cutoff = float(scale * motion.usual_inertia[target]), self._cutoff(motion, target, shape)
        # a kept shape is an earlier model's compliance, not this change's
        return inertia, shape.get("at", 0.0), cutoff

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.stiffness[target] = 1.0 / (1.0 / plant.stiffness[target] + 1.0 / values["stiffness"])

    def spread(self, typical: np.ndarray, motion: Motion, target: int) -> np.ndarray:
        return np.minimum(typical, 1.0 / (SOFTEST**2 * float(motion.usual_inertia[target])))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        load = motion.signals.passed(motion.carried(target), self._cutoff(motion, target, shape))
        return -motion.bent(target, load)[..., None]

    def _cutoff(self, motion: Motion, target: int, shape: Values) -> float:
        """Cut-off of the load's low-pass [Hz]: at least the motion's highest frequency, at most the signals' cut-off."""
        natural = (
            BELOW / np.sqrt(max(shape["compliance"] * motion.usual_inertia[target], TINY)) / (2.0 * np.pi)
        )
        return float(np.clip(natural, motion.calm, max(motion.calm, motion.signals.cutoff)))

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        cutoffs = np.geomspace(motion.calm, max(motion.calm, motion.signals.cutoff), TRIED)
        compliances = (BELOW / (2.0 * np.pi * cutoffs)) ** 2 / motion.usual_inertia[target]
        return [{"compliance": compliance, "at": compliance} for compliance in compliances.tolist()]

    def relinearised(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        if self.kept is not None:
            return dict(shape)
        return {**shape, "at": float(np.clip(coefficients[0], 0.0, shape["compliance"]))}

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        compliance = float(coefficients[0])
        return {"stiffness": 1.0 / (min(compliance, -1e-9) if compliance < 0.0 else max(compliance, 1e-9))}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        compliance = 1.0 / values["stiffness"]
        return np.array([compliance]), {"compliance": compliance, "at": compliance}

    def sentence(self, where: str, values: Values) -> str:
        unit = printed(along("N*m/rad", self.slides))
        if self.before or values["stiffness"] < 0.0:
            compliance, per = 1.0 / values["stiffness"], printed(along("rad/(N*m)", self.slides))
            than = "less" if compliance < 0.0 else "more"
            return f"{where} gives {than} than in the model, by {abs(compliance):.3g} {per}."
        return f"{where} gives: its transmission has a stiffness of {values['stiffness']:.3g} {unit}."
