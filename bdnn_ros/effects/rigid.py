"""Bodies that differ from the description: payload, scaled link, rotor inertia.

All of them change rigid-body effort, so their columns are the regressor times inertial parameters.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from copy import copy

import numpy as np

from bdnn_ros.effects.base import NONE_HELD, Effect, Held, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.axes import spins
from bdnn_ros.robot.links import described_inertial, described_mass, link_inertial, link_mass, needed_link
from bdnn_ros.robot.units import shown_as

SHAPE = ("com_x", "com_y", "com_z")
POINT = 1 + len(SHAPE)
"""Number of inertial parameters of a point mass (mass and first moments); a body's inertia comes after them."""
ANY, NONE_LESS = (-np.inf, np.inf), (0.0, np.inf)
CARRIED, OFF_CENTRE = 0.1, 0.1
"""Prior of a payload: its mass per mass of the arm, and its distance from the link's origin [m]."""
HEAVY = 3.0
"""Light arms carry up to this many times that mass, but not more inertia: much inertia with little mass is a rotor's."""
GYRATION = 0.1
"""Prior radius of gyration of a payload about its own centre [m]: that of a box of 25 cm."""
REACH = 1.0
"""Largest distance of a payload's centre from its link's origin [m]."""
WEIGHED = 1.5
"""A payload is reported if its mass is this many standard deviations from 0: a first moment without a mass is a wrongly
described centre of mass, and one so wrong is rarer than a payload."""
CERTAIN = 2.0
"""A payload is rejected only if its centre is out of `REACH` even with its mass raised by this many standard deviations."""


class Armature(Effect):
    """Rotor inertia, reflected through the gear onto its joint."""

    name = "armature"
    title = "rotor inertia"
    on = "joint"
    in_drive = True
    parameters = (Parameter("armature", "kg*m^2", 0.0, plausible=(0.05, 0.5), of_effort=True),)
    linear = ("armature",)
    equation = "armature * qdd"
    confused_with = ("link_inertia", "effort_delay", "effort_scale")
    shown_by = "high accelerations in poses of different gravity and inertia"
    source = "Khalil, Dombre, Modeling, Identification and Control of Robots, 2002, ch. 9"
    coefficient_bounds = ((0.0, np.inf),)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        armature = plant.robot.armature.copy()
        armature[target] += values["armature"]
        plant.robot = plant.robot.with_joint_parameters(armature=armature)

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.joint_column(target, motion.acceleration[:, target])

    def had(self, robot: Robot, target: int) -> float:
        return float(robot.armature[target])


class OnBody(Effect):
    """An effect that changes one body's inertial parameters: its columns are that body's part of the regressor."""

    on = "link"
    on_body = True

    @abstractmethod
    def inertials(self, robot: Robot, shape: Values, link: str) -> tuple[int, np.ndarray]: ...

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        coefficients, shape = self.coefficients(values)
        body, added = self.inertials(plant.robot, shape, needed_link(link))
        inertials = plant.robot.inertials.copy()
        inertials[body] += added @ coefficients
        plant.robot = plant.robot.with_inertials(inertials)

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        body, added = self.inertials(motion.robot, shape, needed_link(link))
        return motion.regressor[:, :, slots(body)] @ added


class Payload(OnBody):
    """A mass fixed to a link; its inertia about its own centre of mass is fitted as well, but not reported.

    Linear in mass and first moments; the second moments m·c·cᵀ are linearised at the centre of mass that the shape names:
    exact there, and each fit gives a better centre (Newton). The first centre comes from a body with arbitrary second
    moments, as a light link's own inertia would leave no room for a mass. The last coefficients are the payload's inertia
    about its own centre: without them the link takes it, and some of the mass with it, or the payload's position is
    distorted. They may be negligible; an inertia that the data show does not speak against a payload.
    """

    name = "payload"
    title = "a payload"
    parameters = (
        Parameter("mass", "kg", 0.0, plausible=(0.2, 3.0)),
        Parameter("com_x", "m", -1.0, 1.0, plausible=(-0.05, 0.05), believed=OFF_CENTRE / 2.0, default=0.0),
        Parameter("com_y", "m", -1.0, 1.0, plausible=(-0.05, 0.05), believed=OFF_CENTRE / 2.0, default=0.0),
        Parameter("com_z", "m", -1.0, 1.0, plausible=(0.0, 0.12), believed=OFF_CENTRE / 2.0, default=0.0),
    )
    parts = SHAPE
    equation = "Y_link(q, qd, qdd) * (mass, mass * com, mass * (com.com * 1 - com * com'))"
    confused_with = ("link_inertia", "base_tilt", "effort_scale")
    shown_by = "poses in which the link points in all directions, and its accelerations"
    source = "Khalil, Gautier, Lemoine, Identification of the payload inertial parameters, ICRA 2007"
    linearised_at = SHAPE
    coefficient_bounds = (NONE_LESS, ANY, ANY, ANY, NONE_LESS, ANY, NONE_LESS, ANY, ANY, NONE_LESS)

    def inertials(self, robot: Robot, shape: Values, link: str) -> tuple[int, np.ndarray]:
        body, parameters = payload_parameters(robot.body_of(link), shape)
        return body, np.hstack([parameters, np.eye(PER_LINK)[:, POINT:]])

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [dict.fromkeys(SHAPE, 0.0)]

    def relinearised(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        found = self.values(coefficients, shape)
        return {name: found[name] for name in SHAPE}

    def general(self, robot: Robot, link: str) -> tuple[int, np.ndarray]:
        body, parameters = self.inertials(robot, dict.fromkeys(SHAPE, 0.0), link)
        # about the link's origin its inertia includes that of its centre's distance (parallel axes)
        parameters[:, POINT:] *= 1.0 + (OFF_CENTRE / GYRATION) ** 2
        return body, parameters

    def spread(self, typical: np.ndarray, motion: Motion, target: int) -> np.ndarray:
        # masses of the description: a fit may have made those of the motion's robot negative
        mass = CARRIED * described_mass(motion.robot)
        own = GYRATION**2 * np.array([1.0, 0.5, 1.0, 0.5, 0.5, 1.0])
        return mass * np.array([1.0, OFF_CENTRE, OFF_CENTRE, OFF_CENTRE, *own])

    @property
    def kinds(self) -> np.ndarray:
        own = np.arange(PER_LINK) >= POINT
        return np.array([np.where(own, body, size) for size in (1.0, HEAVY) for body in (1.0, 0.0)])

    def believable(self, coefficients: np.ndarray, std: np.ndarray | None = None) -> bool:
        mass = abs(coefficients[0]) + (0.0 if std is None else CERTAIN * std[0])
        return bool(np.linalg.norm(coefficients[1:POINT]) <= REACH * mass)

    def shown(self, values: Values, stds: Values, most: float = math.inf) -> bool:
        return abs(values["mass"]) > WEIGHED * stds["mass"]

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        moments = np.asarray(coefficients[1:POINT])
        least = float(np.linalg.norm(moments)) / REACH
        mass = math.copysign(max(abs(float(coefficients[0])), least), coefficients[0])
        centre = moments / mass if abs(mass) > 1e-9 else np.zeros(3)
        return {"mass": mass, **dict(zip(SHAPE, centre.tolist(), strict=True))}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        shape = {name: values[name] for name in SHAPE}
        return values["mass"] * np.array([1.0, *shape.values(), *np.zeros(PER_LINK - POINT)]), shape

    def since(self, robot: Robot, target: int, link: str | None, held: Held = NONE_HELD) -> Effect:
        changed = copy(self.with_less(float(robot.inertials[target, 0])))
        own = (ANY,) * (PER_LINK - POINT)
        changed.coefficient_bounds = (*changed.coefficient_bounds[:POINT], *own)  # type: ignore[misc]
        return changed

    def sentence(self, where: str, values: Values) -> str:
        if values["mass"] >= 0.0:
            return super().sentence(where, values)
        centre = ", ".join(shown_as(values[name]) for name in SHAPE)
        return (
            f"{where} carries {-values['mass']:.3g} kg less than in the model, at ({centre}) m of its frame."
        )


class LinkInertia(OnBody):
    """A link whose mass and inertia are `scale` times those of the model, its centre of mass unchanged.

    The model's are the described ones, scaled to `nominal_mass`, as an earlier model may have another mass. The mass of a
    link that only spins (a rotor) does not affect any effort, so only the `scale` of its inertia is reported.
    """

    name = "link_inertia"
    once = True
    title = "wrong mass and inertia"
    parameters = (
        Parameter("mass", "kg", 0.0),
        Parameter("nominal_mass", "kg", 0.0),
        Parameter("scale", "-", 0.05, 10.0, plausible=(0.6, 1.6)),
    )
    equation = "(scale - 1) * Y_link(q, qd, qdd) * inertial parameters of the link"
    confused_with = ("payload", "armature", "base_tilt")
    shown_by = "poses in which the link points in all directions, and its accelerations"
    source = (
        "Atkeson, An, Hollerbach, Estimation of inertial parameters of manipulator loads and "
        "links, IJRR 5(3), 1986"
    )
    coefficient_bounds = ((-0.95, 9.0),)
    coefficient_spread = 0.2
    spins: bool = False
    """Whether the link only spins about its own axis; see `at`."""

    def places(self, robot: Robot) -> list[tuple[int, str | None]]:
        return [
            (target, link)
            for target, link in super().places(robot)
            if described_inertial(robot, needed_link(link))[1][0] > 0.0
        ]

    def inertials(self, robot: Robot, shape: Values, link: str) -> tuple[int, np.ndarray]:
        body, described = link_inertial(robot, link)
        return body, (described * (shape["nominal_mass"] / described[0]))[:, None]

    def since(self, robot: Robot, target: int, link: str | None, held: Held = NONE_HELD) -> Effect:
        changed = copy(self)
        carried = sum(payload["mass"] for payload in held.get(Payload.name, ()))
        changed.kept = {"nominal_mass": link_mass(robot, needed_link(link), carried)}
        return changed

    def at(self, robot: Robot, target: int, link: str | None) -> Effect:
        if not spins(robot, target):
            return self
        spinning = copy(self)
        spinning.spins = True
        return spinning

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [{"nominal_mass": float(link_inertial(motion.robot, needed_link(link))[1][0])}]

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        scale, nominal = 1.0 + float(coefficients[0]), float(shape["nominal_mass"])
        return {"mass": scale * nominal, "nominal_mass": nominal, "scale": scale}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([values["scale"] - 1.0]), {"nominal_mass": values["nominal_mass"]}

    def sentence(self, where: str, values: Values) -> str:
        if self.spins:
            return f"{where} turns with {values['scale']:.3g} times the inertia about its axis that the model has."
        return (
            f"{where} weighs {values['mass']:.3g} kg, not {values['nominal_mass']:.3g} kg: its mass and "
            f"inertia are {values['scale']:.3g} times those of the model."
        )


def payload_parameters(place: tuple[int, np.ndarray, np.ndarray], shape: Values) -> tuple[int, np.ndarray]:
    """Body, and its inertial parameters per unit of (m, m·cx, m·cy, m·cz) in the link frame, (PER_LINK, 4)."""
    body, rotation, translation = place
    at = rotation @ np.array([shape[name] for name in SHAPE]) + translation
    moments = np.column_stack([translation, rotation])
    parameters = np.zeros((PER_LINK, 4))
    parameters[0, 0] = 1.0
    parameters[1:4] = moments
    for column, moment in enumerate(moments.T):
        second = np.outer(moment, at) + np.outer(at, moment)
        if column == 0:
            second -= np.outer(at, at)
        inertia = np.trace(second) * np.eye(3) - second
        parameters[4:, column] = inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
    return body, parameters


def slots(body: int) -> slice:
    """The body's columns of the regressor."""
    return slice(body * PER_LINK, (body + 1) * PER_LINK)
