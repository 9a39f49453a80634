"""Friction of joints and drives. It resists the motion, so it adds to the measured effort with the sign of the velocity."""

from __future__ import annotations

import math
from types import MappingProxyType

import numpy as np

from bdnn_ros.effects.base import Effect, Held, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot

ARMSTRONG = (
    "Armstrong-Hélouvry, Dupont, Canudas de Wit, A survey of models, analysis tools and compensation methods "
    "for the control of machines with friction, Automatica 30(7), 1994"
)
BONA = "Bona, Indri, Friction compensation in robotics: an overview, CDC 2005"
RESOLVED = 0.25
"""A Stribeck velocity that the joint passes within this share of the low-pass's standard deviation looks like sticking."""
FALLING = 2.0
"""Least Stribeck velocity, per velocity at which dry friction has fully built up: it can only fall from there."""
SLIDING = {
    "coulomb_friction": ("coulomb", "coulomb"),
    "stribeck_friction": ("coulomb", "coulomb"),
    "asymmetric_friction": ("positive", "negative"),
    "hysteresis": ("force", "force"),
}
"""Dry friction effects, and the parameters that give their level forwards and backwards at any speed."""


class DryFriction(Effect):
    """An effect that accounts for all of a joint's dry friction, including that of the robot's description."""

    on = "joint"
    in_drive = True

    def had(self, robot: Robot, target: int) -> float:
        return float(robot.coulomb[target])

    def ways(self, robot: Robot, target: int, held: Held) -> np.ndarray:
        """All dry friction that an earlier model has at a joint, forwards and backwards, (2,) [N·m], of whatever effect."""
        each = ([one[p] for p in ways] for name, ways in SLIDING.items() for one in held.get(name, ()))
        return np.asarray(self.had(robot, target) + sum(map(np.array, each), np.zeros(2)))

    def holds(self, robot: Robot, target: int, held: Held) -> np.ndarray:
        return np.array([self.ways(robot, target, held).min(), *super().holds(robot, target, held)[1:]])


class CoulombFriction(DryFriction):
    """Constant dry friction: `coulomb` against the direction of motion, sticking at rest."""

    name = "coulomb_friction"
    title = "Coulomb friction"
    parameters = (Parameter("coulomb", "N*m", 0.0, plausible=(0.05, 0.4), of_effort=True),)
    linear = ("coulomb",)
    equation = "coulomb * sign(qd)"
    confused_with = ("asymmetric_friction", "stribeck_friction", "hysteresis", "viscous_friction", "backlash")
    shown_by = "reversals at several speeds, some of them slow"
    source = ARMSTRONG
    coefficient_bounds = ((0.0, np.inf),)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        coulomb = values["coulomb"]
        plant.dry.append((target, lambda time, speed, load, direction: coulomb))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.sharp_column(target, motion.direction[:, target])


class ViscousFriction(Effect):
    """Friction in proportion to the velocity."""

    name = "viscous_friction"
    title = "viscous friction"
    on = "joint"
    in_drive = True
    parameters = (Parameter("viscous", "N*m*s/rad", 0.0, plausible=(0.05, 0.5), of_effort=True),)
    linear = ("viscous",)
    equation = "viscous * qd"
    confused_with = ("quadratic_drag", "coulomb_friction", "effort_delay")
    shown_by = "constant velocities over the whole range of speed, slow and fast"
    source = ARMSTRONG
    coefficient_bounds = ((0.0, np.inf),)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        viscous = plant.robot.viscous.copy()
        viscous[target] += values["viscous"]
        plant.robot = plant.robot.with_joint_parameters(viscous=viscous)

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.joint_column(target, motion.velocity[:, target])

    def had(self, robot: Robot, target: int) -> float:
        return float(robot.viscous[target])


class StribeckFriction(DryFriction):
    """Dry friction that falls from `static` at rest to `coulomb` as the speed passes the Stribeck `velocity`."""

    name = "stribeck_friction"
    title = "Stribeck friction"
    parameters = (
        Parameter("coulomb", "N*m", 0.0, plausible=(0.05, 0.25), of_effort=True),
        Parameter("static", "N*m", 0.0, plausible=(0.15, 0.5), of_effort=True),
        Parameter("velocity", "rad/s", 1e-3, 2.0, plausible=(0.03, 0.2)),
    )
    equation = "(coulomb + (static - coulomb) * exp(-(qd / velocity)**2)) * sign(qd), static >= coulomb"
    confused_with = ("coulomb_friction", "hysteresis", "asymmetric_friction")
    shown_by = "long stretches slower than the Stribeck velocity, and fast ones"
    source = ARMSTRONG
    coefficient_bounds = ((0.0, np.inf), (0.0, np.inf))
    contains = ("coulomb_friction",)
    settles_into = "coulomb_friction"
    excess = np.array((0.0, 1.0))
    parts = ("static",)
    idealised_shapes = frozenset({"velocity"})
    shape_bounds = MappingProxyType({"velocity": (5e-3, 0.5)})

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        coulomb, extra, velocity = values["coulomb"], values["static"] - values["coulomb"], values["velocity"]

        def magnitude(time: float, speed: float, load: float, direction: float) -> float:
            return coulomb + extra * math.exp(-((speed / velocity) ** 2))

        plant.dry.append((target, magnitude))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        sign = motion.direction[:, target]
        fall = np.exp(-((motion.velocity[:, target] / shape["velocity"]) ** 2))
        return motion.sharp_column(target, sign, fall * sign)

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        tried = [{"velocity": float(v)} for v in np.geomspace(0.02, 0.3, 5)]
        return [shape for shape in tried if self.resolved(motion, target, shape)] or tried[-1:]

    def resolved(self, motion: Motion, target: int, shape: Values) -> bool:
        """Whether the motion can show this Stribeck velocity.

        The joint must take a good part of the low-pass's width to pass it, and dry friction must have fully built up by then.
        """
        usual, creep = motion.usual_acceleration[target], motion.signals.creep
        least = 0.0 if creep is None else FALLING * float(creep[target, :2].max())
        return bool(shape["velocity"] >= max(RESOLVED * usual * motion.signals.kernel_std, least))

    def shown(self, values: Values, stds: Values, most: float = math.inf) -> bool:
        # at the lower bound it is sticking rather than a Stribeck velocity, at the upper bound drag
        velocity, (low, high) = values["velocity"], self.shape_bounds["velocity"]
        inside = low + stds["velocity"] < velocity < high - stds["velocity"]
        # with few slow samples any static friction fits, even one beyond all measured efforts
        return inside and values["static"] <= most

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        coulomb, extra = (float(c) for c in coefficients)
        return {"coulomb": coulomb, "static": coulomb + extra, "velocity": float(shape["velocity"])}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        extra = values["static"] - values["coulomb"]
        return np.array([values["coulomb"], extra]), {"velocity": values["velocity"]}


class AsymmetricFriction(DryFriction):
    """Dry friction that differs between the two directions."""

    name = "asymmetric_friction"
    title = "asymmetric Coulomb friction"
    parameters = (
        Parameter("positive", "N*m", 0.0, plausible=(0.05, 0.4), of_effort=True),
        Parameter("negative", "N*m", 0.0, plausible=(0.0, 0.4), of_effort=True),
    )
    linear = ("positive", "negative")
    equation = "positive where qd > 0, -negative where qd < 0"
    confused_with = ("coulomb_friction", "effort_offset")
    shown_by = "both directions in equal parts, in several poses"
    source = BONA
    coefficient_bounds = ((0.0, np.inf), (0.0, np.inf))
    contains = ("coulomb_friction",)
    settles_into = "coulomb_friction"
    excess = np.array((1.0, -1.0))

    def holds(self, robot: Robot, target: int, held: Held) -> np.ndarray:
        return self.ways(robot, target, held)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        positive, negative = values["positive"], values["negative"]
        plant.dry.append(
            (target, lambda time, speed, load, direction: positive if direction > 0 else negative)
        )

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.sharp_column(target, *motion.ways(target))


class LoadDependentFriction(Effect):
    """Dry friction in proportion to the effort that the gear transmits."""

    name = "load_dependent_friction"
    title = "load-dependent friction"
    on = "joint"
    in_drive = True
    parameters = (Parameter("ratio", "-", 0.0, 0.9, plausible=(0.05, 0.3)),)
    linear = ("ratio",)
    equation = "ratio * abs(effort) * sign(qd)"
    confused_with = ("coulomb_friction", "effort_scale")
    shown_by = "both directions under small and under large load"
    source = (
        "Hamon, Gautier, Garrec, Dynamic identification of robots with a dry friction model "
        "depending on load and velocity, IROS 2010"
    )
    coefficient_bounds = ((0.0, 0.9),)
    coefficient_spread = 0.2
    of_load = True

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        ratio = values["ratio"]
        plant.dry.append((target, lambda time, speed, load, direction: ratio * abs(load)))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.sharp_column(target, np.abs(motion.load[:, target]) * motion.direction[:, target])


class QuadraticDrag(Effect):
    """Drag in proportion to the square of the velocity (churning grease, fans, fluids)."""

    name = "quadratic_drag"
    title = "quadratic drag"
    on = "joint"
    in_drive = True
    parameters = (Parameter("drag", "N*m*s^2/rad^2", 0.0, plausible=(0.05, 0.5), of_effort=True),)
    linear = ("drag",)
    equation = "drag * abs(qd) * qd"
    confused_with = ("viscous_friction",)
    shown_by = "the highest speeds beside slow ones"
    source = BONA
    coefficient_bounds = ((0.0, np.inf),)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        drag = values["drag"]
        plant.efforts.append((target, lambda time, position, velocity, load: drag * abs(velocity) * velocity))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        velocity = motion.velocity[:, target]
        return motion.joint_column(target, np.abs(velocity) * velocity)
