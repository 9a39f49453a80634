"""Sensors that report something other than the true motion."""

from __future__ import annotations

import math

import numpy as np

from bdnn_ros.effects.base import Effect, Held, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import along, printed

HARDLY_TURNED = 1e-4
"""Offsets below this are linearised by the tangent instead of the secant [rad]."""


class PositionOffset(Effect):
    """An encoder whose zero is off: measured position = true position + offset.

    The rigid effort belongs to the true position, so the measured effort is the model's at `q - offset`. A spring's rest and
    the phase of cogging refer to the reported position, whatever its offset. The shape `at` [rad] is the offset at which the
    column, a secant from none, is exact.
    """

    name = "position_offset"
    title = "a position offset"
    on = "joint"
    parameters = (Parameter("offset", "rad", -1.0, 1.0, plausible=(-0.1, 0.1)),)
    equation = "rigid effort at (q - offset) minus rigid effort at q (measured q = true q + offset)"
    confused_with = ("base_tilt", "link_inertia", "payload", "effort_offset")
    shown_by = "poses of different gravity, the joints beyond this one stretched out and folded"
    source = "Hollerbach, Khalil, Gautier, Model identification, Springer Handbook of Robotics, ch. 6"
    of_bodies = True
    linearised_at = ("at",)
    coefficient_bounds = ((-1.0, 1.0),)
    coefficient_spread = 0.1

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.position_offset[target] += values["offset"]

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        at = shape["at"]
        if abs(at) < HARDLY_TURNED:
            return -motion.shifted(target, np.ones(len(motion.time)))[..., None]
        return (motion.turned(target, -at) / at)[..., None]

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [{"at": 0.0}]

    def relinearised(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"at": float(np.clip(coefficients[0], -1.0, 1.0))}

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"offset": float(coefficients[0])}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([values["offset"]]), {"at": values["offset"]}

    def holds(self, robot: Robot, target: int, held: Held) -> np.ndarray:
        return robot.zeros[[target]]  # a model has its offsets there

    def sentence(self, where: str, values: Values) -> str:
        off = f"{values['offset']:+.3g} {printed(along('rad', self.slides))}"
        true = "the one that the model takes for true" if self.before else "the true one"
        return f"{where} reports its position {off} off {true}."


class VelocityFilter(Effect):
    """A reported velocity that has passed a first-order low-pass.

    It does not affect the effort. With the time constant T = 1 / (2π cutoff), the reported velocity v_r obeys
    v_r = qd - T · dv_r/dt, which is linear in T.
    """

    name = "velocity_filter"
    once = True
    title = "a low-pass on the reported velocity"
    on = "joint"
    kinematic = True
    parameters = (Parameter("cutoff", "Hz", 0.2, 1000.0, plausible=(3.0, 20.0)),)
    equation = "reported velocity = qd - 1 / (2 * pi * cutoff) * d(reported velocity)/dt"
    confused_with = ("effort_delay",)
    shown_by = "fast changes of velocity"
    source = (
        "Bélanger, Estimation of angular velocity and acceleration from shaft encoder measurements, ICRA 1992"
    )
    coefficient_bounds = ((0.0, 1.0),)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.velocity_cutoff[target] = min(plant.velocity_cutoff[target], values["cutoff"])

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return np.zeros((*motion.position.shape, 1))

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"cutoff": 1.0 / (2.0 * math.pi * max(float(coefficients[0]), 1e-6))}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([1.0 / (2.0 * math.pi * values["cutoff"])]), {}

    def sentence(self, where: str, values: Values) -> str:
        return f"{where} reports a velocity that has passed a low-pass of {values['cutoff']:.3g} Hz."
