"""How a robot is mounted: a tilted base."""

from __future__ import annotations

import math

import numpy as np

from bdnn_ros.effects.base import Effect, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot.mounting import tilt_of


class BaseTilt(Effect):
    """A base that is turned by Ry(pitch)·Rx(roll) from level: gravity comes from another direction.

    Linear in the angles [rad] near level; the shape is the tilt at which the columns, secants from level, are exact. On a
    base that is known to be tilted the angles count from that tilt.
    """

    name = "base_tilt"
    once = True
    title = "a tilted base"
    on = "base"
    parameters = (
        Parameter("roll_deg", "deg", -90.0, 90.0, plausible=(-6.0, 6.0), believed=3.0, default=0.0),
        Parameter("pitch_deg", "deg", -90.0, 90.0, plausible=(-6.0, 6.0), believed=3.0, default=0.0),
    )
    parts = ("roll_deg", "pitch_deg")
    equation = "g(q) under gravity turned by (Ry(pitch) * Rx(roll))' minus g(q)"
    confused_with = ("payload", "effort_offset", "link_inertia")
    shown_by = (
        "poses that turn the arm about every horizontal axis, among them ones that swing the first axis"
    )
    source = "Craig, Introduction to Robotics, ch. 6: gravity as an acceleration of the base"
    of_bodies = True
    linearised_at = ("roll_deg", "pitch_deg")
    coefficient_bounds = ((-math.pi / 2, math.pi / 2), (-math.pi / 2, math.pi / 2))
    coefficient_spread = 0.1

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.robot = plant.robot.tilted(math.radians(values["roll_deg"]), math.radians(values["pitch_deg"]))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        roll, pitch = (_secant(math.radians(shape[key])) for key in ("roll_deg", "pitch_deg"))
        known = np.array(tilt_of((motion.level or motion.robot).gravity_vector))
        angles = known + np.array(((0.0, 0.0), (roll, 0.0), (roll, pitch)))
        level, rolled, tilted = (motion.robot.tilted(*pair).gravity_vector for pair in angles.tolist())
        return motion.gravity_pulls @ np.stack([(rolled - level) / roll, (tilted - rolled) / pitch], axis=-1)

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [{"roll_deg": 0.0, "pitch_deg": 0.0}]

    def relinearised(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return self.values(coefficients, shape)

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"roll_deg": math.degrees(coefficients[0]), "pitch_deg": math.degrees(coefficients[1])}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        shape = {key: values[key] for key in ("roll_deg", "pitch_deg")}
        return np.radians([values["roll_deg"], values["pitch_deg"]]), shape

    def sentence(self, where: str, values: Values) -> str:
        roll, pitch = ("?" if math.isnan(values[key]) else f"{values[key]:.2f}°" for key in self.parts)
        return f"The base is tilted: roll {roll}, pitch {pitch} from the level that the model takes."


def _secant(angle: float) -> float:
    """An angle far enough from zero for a secant; the tangent near zero."""
    return angle if abs(angle) > 1e-4 else 1e-4
