"""Every effect by name, and specifications as users write them.

`ALL` holds every class once. Those of one contract name are variants (what drifts; a wrench on a link or a
joint), each with its own columns and bounds: go through `ALL` to try everything, through `EFFECTS` to list
the names.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from bdnn_ros.effects import actuation, backlash, drift, environment, friction, rigid, sensing, transmission
from bdnn_ros.effects.base import Effect, Parameter, Where
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
    friction.Hysteresis(),
    rigid.Armature(),
    rigid.Payload(),
    rigid.LinkInertia(),
    rigid.BaseTilt(),
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
        effect: what.
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
        """The same, a drift that is to last as long as the recording ending with it."""
        if not math.isinf(self.values.get("end", 0.0)):
            return self
        return replace(self, values={**self.values, "end": duration})

    def place(self, robot: Robot) -> str:
        """What a sentence calls the place: the link, the joint, `base` or `all joints`."""
        if self.link is not None:
            return self.link
        if self.target >= 0:
            return robot.joints[self.target]
        return "base" if self.effect.on == "base" else "all joints"

    def sentence(self, robot: Robot) -> str:
        """It in words, with its numbers."""
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

    Of the variants of an effect the first that has all the parameters and can be there; `of=` takes another.

    Raises:
        UsageError: the effect, place or a parameter is unknown, missing or out of bounds.
    """
    head, _, tail = spec.partition(":")
    name, _, place = head.partition("@")
    choices = variants(name.strip())
    given = _pairs(spec, tail)
    variant = given.pop("of", "")
    choices = (get(name.strip(), variant),) if variant else _having(choices, given)
    effect, target, link = _placed(spec, choices, place.strip(), robot)
    given_values = _checked(spec, effect, given)
    values = completed(effect, given_values, robot, link)
    for parameter in effect.parameters:
        _refuse_outside(spec, parameter, values[parameter.name])
        if abs(given_values.get(parameter.name, values[parameter.name]) - values[parameter.name]) > 1e-6:
            raise UsageError(
                f"{spec!r} contradicts itself or the robot.", "Leave out all but one of mass and scale."
            )
    return Installed(effect, target, link, values)


def completed(effect: Effect, values: dict[str, float], robot: Robot, link: str | None) -> dict[str, float]:
    """Parameters with those that follow from the robot: the nominal mass of a scaled link."""
    if effect.name == "link_inertia" and link is not None:
        nominal = float(link_inertial(robot, link)[1][0])
        scale = values["scale"] if "scale" in values else values["mass"] / nominal
        return {"mass": scale * nominal, "nominal_mass": nominal, "scale": scale}
    return values


def _having(choices: tuple[Effect, ...], given: Iterable[str]) -> tuple[Effect, ...]:
    """The variants that have all these parameters; all where none has."""
    having = [c for c in choices if set(given) <= {p.name for p in c.parameters}]
    return tuple(having) or choices


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


def _placed(spec: str, choices: Sequence[Effect], place: str, robot: Robot) -> tuple[Effect, int, str | None]:
    """Which of the variants acts there, the joint's index and the link."""
    kinds: dict[Where, Effect] = {}
    for effect in choices:
        for where in (effect.on, *effect.also_on):
            kinds.setdefault(where, effect)
    if place in ("", "base", "all"):
        anywhere = kinds.get("base") or kinds.get("all")
        if anywhere is not None:
            return anywhere, -1, None
        raise UsageError(f"{spec!r} does not say where.", f"Write {choices[0].name}@{_places(kinds, robot)}.")
    if place in robot.joints and "joint" in kinds:
        return kinds["joint"], robot.joints.index(place), None
    if place in robot.joints and "link" in kinds:
        link = robot.moving_link(place)
        return kinds["link"], robot.joints.index(place), link
    if "link" in kinds and place in robot.links:
        return kinds["link"], robot.body_of(place)[0], place
    raise UsageError(
        f"{spec!r}: {choices[0].name} cannot act on {place!r}.", f"It acts on {_places(kinds, robot)}."
    )


def _places(kinds: dict[Where, Effect], robot: Robot) -> str:
    """Where an effect may act, for a message."""
    places = {
        "joint": f"a joint ({listed(robot.joints, 20)})",
        "link": f"a link ({listed(robot.links, 20)})",
        "base": "base",
        "all": "all",
    }
    return " or ".join(places[kind] for kind in kinds)


def _checked(spec: str, effect: Effect, given: dict[str, str]) -> dict[str, float]:
    """Numbers within their bounds, defaults filled in."""
    known = {parameter.name: parameter for parameter in effect.parameters}
    unknown = [key for key in given if key not in known]
    if unknown:
        raise UsageError(
            f"{effect.name} has no parameter {listed(unknown)} ({spec!r}).", f"It has {listed(known, 20)}."
        )
    values: dict[str, float] = {}
    for key, text in given.items():
        try:
            values[key] = float(text)
        except ValueError:
            raise UsageError(f"{key}={text} in {spec!r} is not a number.", "Give a number.") from None
        _refuse_outside(spec, known[key], values[key])
    values = effect.with_defaults(values)
    missing = [key for key in known if key not in values]
    if effect.name == "link_inertia" and {"mass", "scale"} & set(values):
        missing = []
    if missing:
        raise UsageError(
            f"{spec!r} leaves out {listed(missing)}.", f"{effect.name} needs {listed(known, 20)}."
        )
    if effect.name == "stribeck_friction" and values["static"] < values["coulomb"]:
        raise UsageError(f"{spec!r}: static friction is below Coulomb friction.", "Give static >= coulomb.")
    return values


def _refuse_outside(spec: str, parameter: Parameter, value: float) -> None:
    if not (parameter.lower <= value <= parameter.upper) or math.isnan(value):
        raise UsageError(
            f"{parameter.name}={value:g} in {spec!r} is out of bounds.",
            f"It lies between {parameter.lower:g} and {parameter.upper:g} {parameter.unit}.",
        )
