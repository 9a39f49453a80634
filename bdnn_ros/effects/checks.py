"""Whether an effect can act at its stated place with its stated numbers: for specifications and files alike."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from bdnn_ros.effects.base import Effect, Parameter, Where
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.robot import Robot

FOUND = {
    "rest": (-math.inf, math.inf),
    "roll_deg": (-360.0, 360.0),
    "pitch_deg": (-360.0, 360.0),
    "cutoff": (1e-3, math.inf),
    "scale": (1e-3, 1e3),
    "delay": (-math.inf, math.inf),
}
"""Wider bounds for what successive fits may find: the rest of a weak spring, a tilt, a filter at a high rate."""
LESS = ("payload", "effort_delay")
"""Effects that a file may have a negative amount of, as a change, besides those that a robot is described with."""
ROUNDED = 1e-6
"""Rounding by which a fitted value may exceed its bound."""


def having(choices: tuple[Effect, ...], given: Iterable[str]) -> tuple[Effect, ...]:
    """The variants that have all these parameters; all variants if none has."""
    given = set(given)
    return tuple(c for c in choices if given <= {p.name for p in c.parameters}) or choices


def as_found(effect: Effect, parameter: Parameter) -> Parameter:
    """A parameter with the bounds that a fit's result may have: it may be negative where it changes an existing amount."""
    lower, upper = FOUND.get(parameter.name, (parameter.lower, parameter.upper))
    first = effect.parameters[0]
    described = type(effect).had is not Effect.had and parameter.unit == first.unit
    if described or (parameter is first and effect.name in LESS):
        lower = -math.inf
    return replace(parameter, lower=lower, upper=upper)


def placed(spec: str, choices: Sequence[Effect], place: str, robot: Robot) -> tuple[Effect, int, str | None]:
    """The variant that acts at a place, the joint's index and the link."""
    kinds = _kinds(choices)
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


def _kinds(choices: Sequence[Effect]) -> dict[Where, Effect]:
    """The kinds of places on which the variants act, each with the first variant that does."""
    kinds: dict[Where, Effect] = {}
    for effect in choices:
        for where in (effect.on, *effect.also_on):
            kinds.setdefault(where, effect)
    return kinds


def placed_by_key(
    spec: str, choices: Sequence[Effect], joint: str | None, link: str | None, robot: Robot
) -> tuple[Effect, int, str | None]:
    """As `placed`, where a key states whether the place is a joint or a link."""
    name, kinds = choices[0].name, _kinds(choices)
    if joint is not None and link is not None:
        raise UsageError(f"{name} is given a joint and a link.", "Leave one of them out.")
    if joint is not None and joint not in robot.joints:
        raise UsageError(f"{name}: the robot has no joint {joint!r}.", "Give the robot it is for.")
    if link is not None and "link" in kinds:
        return kinds["link"], robot.body_of(link)[0], link
    if link is not None or (joint is None and not {"base", "all"} & kinds.keys()):
        lacks = "does not say where" if link is None else "cannot act on a link"
        raise UsageError(f"{name} {lacks}.", f"It acts on {_places(kinds, robot)}.")
    return placed(spec, choices, joint or "", robot)


def _places(kinds: dict[Where, Effect], robot: Robot) -> str:
    """The places where an effect may act, for a message."""
    places = {
        "joint": f"a joint ({listed(robot.joints, 20)})",
        "link": f"a link ({listed(robot.links, 20)})",
        "base": "base",
        "all": "all",
    }
    return " or ".join(places[kind] for kind in kinds)


def checked(
    spec: str,
    effect: Effect,
    given: Mapping[str, object],
    parameters: Sequence[Parameter] = (),
    slack: float = 0.0,
) -> dict[str, float]:
    """Numbers checked against the bounds of the effect (or of other `parameters`), with defaults filled in."""
    known = {parameter.name: parameter for parameter in parameters or effect.parameters}
    unknown = [key for key in given if key not in known]
    if unknown:
        raise UsageError(
            f"{effect.name} has no parameter {listed(unknown)} ({spec!r}).", f"It has {listed(known, 20)}."
        )
    values: dict[str, float] = {}
    for key, text in given.items():
        try:
            values[key] = float(text)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            raise UsageError(f"{key}={text} in {spec!r} is not a number.", "Give a number.") from None
        _refuse_outside(spec, known[key], values[key], slack)
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


def refuse_odd(
    spec: str,
    parameter: Parameter,
    given: Mapping[str, float],
    values: Mapping[str, float],
    slack: float = 0.0,
) -> None:
    """Refuses a value that is out of bounds or contradicts the given ones."""
    value = values[parameter.name]
    _refuse_outside(spec, parameter, value, slack, None if parameter.name in given else given)
    if abs(given.get(parameter.name, value) - value) > 1e-6:
        raise UsageError(
            f"{spec!r} contradicts itself or the robot.", "Leave out all but one of mass and scale."
        )


def _refuse_outside(
    spec: str,
    parameter: Parameter,
    value: float,
    slack: float = 0.0,
    given: Mapping[str, float] | None = None,
) -> None:
    """Refuses a value that is out of bounds; if it was computed, the message names the `given` values that it follows from."""
    if parameter.lower - slack <= value <= parameter.upper + slack and not math.isnan(value):
        return
    if given is None:
        problem = f"{parameter.name}={value:g} in {spec!r} is out of bounds."
    else:
        by = listed(f"{key}={number:g}" for key, number in given.items())
        problem = f"{by} in {spec!r} makes {parameter.name} {value:g}, which is out of bounds."
    raise UsageError(problem, f"It {_range(parameter)}.")


def _range(parameter: Parameter) -> str:
    """A parameter's range, for a message."""
    lower, upper = parameter.lower, parameter.upper
    unit = "" if parameter.unit == "-" else " " + parameter.unit.replace("*", "·")
    if math.isfinite(lower) and math.isfinite(upper):
        return f"lies between {lower:g} and {upper:g}{unit}"
    if math.isfinite(lower):
        return f"is {lower:g}{unit} or more"
    return f"is {upper:g}{unit} or less" if math.isfinite(upper) else "is a number"
