"""Parameters that drift slowly during a recording."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np

from bdnn_ros.effects.actuation import EffortOffset
from bdnn_ros.effects.base import Change, Effect, Held, Parameter, Values
from bdnn_ros.effects.friction import CoulombFriction, ViscousFriction
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import printed


class Drift(Effect):
    """A parameter that changes linearly between two times, those of the recording by default (warm-up, wear).

    Before them it is at its first value, after them at its last.
    """

    name = "drift"
    on = "joint"
    of: ClassVar[Effect]
    """The effect whose parameter drifts."""
    linear = ("start_value", "end_value")
    changing = True
    excess = np.array((-1.0, 1.0))
    shown_by = "the same motion early and late in a long recording"
    source = (
        "Carvalho Bittencourt, Axelsson, Modeling and experiment design for identification of wear in a "
        "robot joint under load and temperature uncertainties, IEEE/ASME TMech 19(5), 2014"
    )

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [{"start": float(motion.time[0]), "end": float(motion.time[-1])}]

    def had(self, robot: Robot, target: int) -> float:
        return self.of.had(robot, target)

    def holds(self, robot: Robot, target: int, held: Held) -> np.ndarray:
        return np.full(2, self.of.holds(robot, target, held)[0])

    def change(self, values: Values) -> Change:
        return "more"  # no model has a drift

    def sentence(self, where: str, values: Values) -> str:
        unit = printed(self.parameters[0].unit_at(self.slides))
        known = self.before[0] if self.before else 0.0
        first, last = (known + values[end] for end in ("start_value", "end_value"))
        on_top = f"; start_value and end_value count from the model's {known:.3g} {unit}" if known else ""
        return f"{where} drifts: its {self.title} goes from {first:.3g} to {last:.3g} {unit} over the recording{on_top}."


TIMES = (Parameter("start", "s", default=0.0), Parameter("end", "s", default=np.inf))


class DriftingCoulomb(Drift):
    """Coulomb friction that changes over the recording.

    Its values count from the model's constant value, negative where there is less; its sentence gives the total.
    """

    variant = "coulomb"
    of = CoulombFriction()
    in_drive = True
    title = "Coulomb friction"
    parameters = (
        Parameter("start_value", "N*m", 0.0, plausible=(0.0, 0.4), of_effort=True),
        Parameter("end_value", "N*m", 0.0, plausible=(0.1, 0.6), of_effort=True),
        *TIMES,
    )
    equation = (
        "(start_value + (end_value - start_value) * p) * sign(qd), p = (t - start) / (end - start) in 0 to 1"
    )
    confused_with = ("coulomb_friction", "external_wrench")
    coefficient_bounds = ((0.0, np.inf), (0.0, np.inf))
    contains = ("coulomb_friction",)
    settles_into = "coulomb_friction"

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        level = ramp(values, plant.duration)
        plant.dry.append((target, lambda time, speed, load, direction: level(time)))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.sharp_column(target, *_ramped(motion, shape, motion.direction[:, target]))


class DriftingViscous(Drift):
    """Viscous friction that changes over the recording.

    Its values count from the model's constant value, negative where there is less; its sentence gives the total.
    """

    variant = "viscous"
    of = ViscousFriction()
    in_drive = True
    title = "viscous friction"
    parameters = (
        Parameter("start_value", "N*m*s/rad", 0.0, plausible=(0.0, 0.4), of_effort=True),
        Parameter("end_value", "N*m*s/rad", 0.0, plausible=(0.1, 0.6), of_effort=True),
        *TIMES,
    )
    equation = "(start_value + (end_value - start_value) * p) * qd, p = (t - start) / (end - start) in 0 to 1"
    confused_with = ("viscous_friction",)
    coefficient_bounds = ((0.0, np.inf), (0.0, np.inf))
    contains = ("viscous_friction",)
    settles_into = "viscous_friction"

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        level = ramp(values, plant.duration)
        plant.efforts.append((target, lambda time, position, velocity, load: level(time) * velocity))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.joint_column(target, *_ramped(motion, shape, motion.velocity[:, target]))


class DriftingOffset(Drift):
    """An effort offset that changes over the recording; effort that acts = measured + offset.

    Its values count from the model's constant value; its sentence gives the total.
    """

    variant = "offset"
    of = EffortOffset()
    constant = True
    title = "effort offset"
    parameters = (
        Parameter("start_value", "N*m", plausible=(-0.4, 0.4), of_effort=True),
        Parameter("end_value", "N*m", plausible=(-0.4, 0.4), of_effort=True),
        *TIMES,
    )
    equation = "-(start_value + (end_value - start_value) * p), p = (t - start) / (end - start) in 0 to 1"
    confused_with = ("effort_offset", "external_wrench")
    coefficient_bounds = ((-np.inf, np.inf), (-np.inf, np.inf))
    contains = ("effort_offset",)
    settles_into = "effort_offset"

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        level = ramp(values, plant.duration)
        plant.efforts.append((target, lambda time, position, velocity, load: -level(time)))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.joint_column(target, *_ramped(motion, shape, -np.ones(len(motion.time))))


def ramp(values: Values, duration: float) -> Callable[[float], float]:
    """The drifting parameter against time [s], constant outside `start` to `end` (by default the recording's)."""
    first, last = values["start_value"], values["end_value"]
    start, end = values["start"], values["end"] if np.isfinite(values["end"]) else duration
    slope = (last - first) / max(end - start, 1e-9)
    return lambda time: first + slope * (min(max(time, start), end) - start)


def _ramped(motion: Motion, shape: Values, column: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A column weighted towards the start and towards the end of the ramp, which is constant outside."""
    progress = (motion.time - shape["start"]) / max(shape["end"] - shape["start"], 1e-9)
    progress = np.clip(progress, 0.0, 1.0)
    return (1.0 - progress) * column, progress * column
