"""Every effect by name, and specifications as users write them.

`ALL` holds every class once. Classes of the same contract name are variants (which parameter drifts; a wrench on a link or a
joint), each with its own columns and bounds: use `ALL` to try everything, `EFFECTS` to list the names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from bdnn_ros.effects import (
    actuation,
    backlash,
    bristles,
    drift,
    environment,
    friction,
    mounting,
    rigid,
    sensing,
    transmission,
)
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.checks import ROUNDED, as_found, checked, having, placed, placed_by_key, refuse_odd
from bdnn_ros.effects.plant import Plant
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.robot import Robot
from bdnn_ros.robot.links import link_inertial

ALL: tuple[Effect, ...] = (
    friction.CoulombFriction(),
    friction.ViscousFriction(),
    friction.StribeckFriction(),
    friction.AsymmetricFriction(),
    friction.LoadDependentFriction(),
    friction.QuadraticDrag(),
    bristles.Hysteresis(),
    rigid.Armature(),
    rigid.Payload(),
    rigid.LinkInertia(),
    mounting.BaseTilt(),
    actuation.JointSpring(),
    actuation.EffortOffset(),
    actuation.EffortScale(),
    actuation.EffortDelay(),
    actuation.Cogging(),
    backlash.Backlash(),
    transmission.JointElasticity(),
    sensing.PositionOffset(),
    sensing.VelocityFilter(),
    environment.ExternalWrench(),
    environment.ExternalTorque(),
    drift.DriftingCoulomb(),
    drift.DriftingViscous(),
    drift.DriftingOffset(),
)
"""Every effect; those of one name are variants of it."""

EFFECTS: dict[str, Effect] = {}
for _effect in ALL:
    EFFECTS.setdefault(_effect.name, _effect)
"""The first variant of every name, in the contract's order."""


def variants(name: str) -> tuple[Effect, ...]:
    """All effects of one name.

    Raises:
        UsageError: there is none.
    """
    found = tuple(effect for effect in ALL if effect.name == name)
    if not found:
        raise UsageError(f"No effect {name!r}.", f"There are {listed(EFFECTS, 40)}.")
    return found


def get(name: str, variant: str = "") -> Effect:
    """An effect by name, and by variant where a name has several.

    Raises:
        UsageError: there is none.
    """
    found = variants(name)
    if not variant:
        return found[0]
    for effect in found:
        if effect.variant == variant:
            return effect
    raise UsageError(
        f"Effect {name!r} has no variant {variant!r}.", f"It has {listed(e.variant for e in found)}."
    )


@dataclass(frozen=True)
class Installed:
    """An effect with its place and parameters, ready to be put into a simulated robot.

    Attributes:
        effect: the effect, without its numbers.
        target: index of the joint, or of the joint that moves the link; -1 for the base or all joints.
        link: the link, where the effect acts on one.
        values: parameters by name.
    """

    effect: Effect
    target: int
    link: str | None
    values: dict[str, float]

    def install(self, plant: Plant) -> None:
        """Put it into a plant."""
        self.effect.install(plant, self.target, self.values, self.link)

    def within(self, duration: float) -> Installed:
        """The same effect; a drift without an end ends with the recording."""
        if not math.isinf(self.values.get("end", 0.0)):
            return self
        return replace(self, values={**self.values, "end": duration})

    def place(self, robot: Robot) -> str:
        """The place's name in a sentence: the link, the joint, `base` or `all joints`."""
        if self.link is not None:
            return self.link
        if self.target >= 0:
            return robot.joints[self.target]
        return "base" if self.effect.on == "base" else "all joints"

    def sentence(self, robot: Robot) -> str:
        """The effect in words, with its numbers."""
        return self.effect.at(robot, self.target, self.link).sentence(self.place(robot), self.values)

    def as_truth(self, robot: Robot) -> dict[str, object]:
        """The entry of truth.yaml; fields as in diagnosis.json."""
        on_joint = self.link is None and self.target >= 0
        entry: dict[str, object] = {"effect": self.effect.name}
        if self.effect.variant:
            entry["variant"] = self.effect.variant
        entry["joint"] = robot.joints[self.target] if on_joint else None
        entry["link"] = self.link
        entry["parameters"] = {key: float(value) for key, value in self.values.items()}
        return entry


def parse_spec(spec: str, robot: Robot) -> Installed:
    """An effect from `effect[@joint or link][:key=value,...]`.

    Of several variants, the first that has all the parameters and fits the place; `of=` selects one by name.

    Raises:
        UsageError: the effect, place or a parameter is unknown, missing or out of bounds.
    """
    head, _, tail = spec.partition(":")
    name, _, place = head.partition("@")
    choices = variants(name.strip())
    given = _pairs(spec, tail)
    variant = given.pop("of", "")
    choices = (get(name.strip(), variant),) if variant else having(choices, given)
    effect, target, link = placed(spec, choices, place.strip(), robot)
    given_values = checked(spec, effect, given)
    values = completed(effect, given_values, robot, link)
    for parameter in effect.parameters:
        refuse_odd(spec, parameter, given_values, values)
    return Installed(effect, target, link, values)


def from_values(
    name: str,
    given: Mapping[str, object],
    robot: Robot,
    *,
    joint: str | None = None,
    link: str | None = None,
    variant: str = "",
) -> Installed:
    """An effect as stored in a file, checked like a specification.

    A fit may have found what nobody would specify: a negative amount as a change from an earlier model, and what `FOUND`
    allows. A scaled link keeps the nominal mass in the file: that of the robot before its links were corrected.

    Raises:
        UsageError: the effect, place or a parameter is unknown, missing or out of bounds.
    """
    place = link if joint is None else joint
    spec = name if place is None else f"{name}@{place}"
    choices = (get(name, variant),) if variant else having(variants(name), given)
    effect, target, link = placed_by_key(spec, choices, joint, link, robot)
    parameters = [as_found(effect, parameter) for parameter in effect.parameters]
    given_values = checked(spec, effect, given, parameters, ROUNDED)
    nominal = given_values.get("nominal_mass")
    values = _scaled(given_values, nominal) if nominal else completed(effect, given_values, robot, link)
    for parameter in parameters:
        refuse_odd(spec, parameter, given_values, values, ROUNDED)
    return Installed(effect, target, link, values)


def completed(effect: Effect, values: dict[str, float], robot: Robot, link: str | None) -> dict[str, float]:
    """Parameters completed with those that follow from the robot: the nominal mass of a scaled link."""
    if effect.name == "link_inertia" and link is not None:
        return _scaled(values, float(link_inertial(robot, link)[1][0]))
    return values


def _scaled(values: Mapping[str, float], nominal: float) -> dict[str, float]:
    """All parameters of a scaled link, from its nominal mass and either its mass or its scale."""
    scale = values["scale"] if "scale" in values else values["mass"] / nominal
    return {"mass": scale * nominal, "nominal_mass": nominal, "scale": scale}


def _pairs(spec: str, tail: str) -> dict[str, str]:
    """`key=value,...` as text."""
    pairs: dict[str, str] = {}
    for item in filter(None, (part.strip() for part in tail.split(","))):
        key, equals, value = item.partition("=")
        if not equals or not key.strip() or not value.strip():
            raise UsageError(
                f"{item!r} in {spec!r} is not key=value.", "Write effect@joint:key=value,key=value."
            )
        if key.strip() in pairs:
            raise UsageError(f"{key.strip()!r} is given twice in {spec!r}.", "Give it once.")
        pairs[key.strip()] = value.strip()
    return pairs
