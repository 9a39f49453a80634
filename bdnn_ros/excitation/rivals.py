"""The open questions of a diagnosis.json: each finding with the rivals that it could not be distinguished from.

Rivals that are less probable than a tie (`TIE`) are settled: no motion is spent on them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bdnn_ros.diagnosis.judging.identifiability import TIE
from bdnn_ros.diagnosis.result import FORMAT
from bdnn_ros.diagnosis.telling.alike import everywhere
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.registry import variants
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.robot import Robot
from bdnn_ros.robot.entries import reading


@dataclass(frozen=True)
class Suspect:
    """An effect at a place, with values if the diagnosis has estimated them.

    Attributes:
        target: index of the joint, or of the joint that moves the link; -1 for the base or all joints.
        values: parameters by name, or None for a rival.
        probability: by the diagnosis.
    """

    effect: Effect
    target: int
    link: str | None
    values: Mapping[str, float] | None
    probability: float

    def words(self, robot: Robot) -> str:
        """Its name in a sentence."""
        place = self.link or (robot.joints[self.target] if self.target >= 0 else "")
        return f"{self.effect.name}@{place}" if place else self.effect.name


@dataclass(frozen=True)
class Question:
    """A finding and its rivals."""

    finding: Suspect
    rivals: tuple[Suspect, ...]


@dataclass(frozen=True)
class Case:
    """The open questions of a diagnosis.

    Attributes:
        questions: every finding, also those without rivals that are open.
        noise: noise of each joint's effort, (n,) [N·m].
        joints: the recording's joints.
    """

    questions: tuple[Question, ...]
    noise: np.ndarray
    joints: tuple[str, ...]

    @property
    def open(self) -> bool:
        """Whether any finding has a rival."""
        return any(question.rivals for question in self.questions)


def read_case(path: Path, robot: Robot) -> Case:
    """The open questions of a diagnosis.json.

    Args:
        robot: the robot of the diagnosis; it may have more joints.

    Raises:
        UsageError: the file cannot be read, is no diagnosis, or belongs to another robot.
    """
    content = _content(path)
    with reading(str(path), "Diagnose again.", content, error=UsageError) as (content,):
        joints = tuple(str(joint) for joint in content["source"]["joints"])
        noise = np.array([float(value) for value in content["effort_rmse"]["noise_floor"]])
        questions = tuple(_question(one, robot) for one in content["findings"])
    missing = [joint for joint in joints if joint not in robot.joints]
    if missing or len(noise) != len(joints):
        raise UsageError(
            f"{path} is of a robot with the joints {', '.join(joints)}.", "Give that robot's URDF or model."
        )
    return Case(questions, noise, joints)


def joints_of(path: Path) -> tuple[tuple[str, ...], str]:
    """The joints of a diagnosis.json, and the source of its robot description.

    Raises:
        UsageError: the file cannot be read, or is no diagnosis.
    """
    source = _content(path).get("source")
    if not isinstance(source, dict) or not isinstance(source.get("joints"), list):
        raise UsageError(f"{path} is incomplete: it names no joints.", "Diagnose again.")
    return tuple(str(joint) for joint in source["joints"]), str(source.get("urdf", ""))


def _content(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(
            f"{path} cannot be read ({error}).", "Give the diagnosis.json of a diagnosis."
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UsageError(f"{path} is not a diagnosis.", "Give the diagnosis.json of a diagnosis.")
    return content


def _question(one: Mapping[str, Any], robot: Robot) -> Question:
    told = (rival for rival in one["rivals"] if not everywhere(rival["effect"], rival.get("joint")))
    rivals = [_suspect(rival, robot) for rival in told]
    return Question(_suspect(one, robot), tuple(rival for rival in rivals if rival.probability >= TIE))


def _suspect(one: Mapping[str, Any], robot: Robot) -> Suspect:
    parameters = one.get("parameters")
    target, link = _place(one, robot)
    effect = _effect(one, robot, target, link)
    values = None
    if parameters is not None:
        found = {str(name): float(quantity["value"]) for name, quantity in parameters.items()}
        values = effect.with_defaults(found)
        effect.coefficients(values)  # raises where one is missing, which is then told by name
    return Suspect(effect, target, link, values, float(one["probability"]))


def _place(one: Mapping[str, Any], robot: Robot) -> tuple[int, str | None]:
    joint, link = one.get("joint"), one.get("link")
    if link is not None:
        return robot.body_of(str(link))[0], str(link)
    if joint is not None and joint not in robot.joints:
        raise UsageError(f"The robot has no joint {joint!r}.", "Give the URDF or model of the diagnosis.")
    return -1 if joint is None else robot.joints.index(str(joint)), None


def _effect(one: Mapping[str, Any], robot: Robot, target: int, link: str | None) -> Effect:
    """The effect named in a diagnosis, in the variant that fits the place and the parameters, units included.

    Raises:
        UsageError: there is none.
    """
    name, variant = str(one["effect"]), one.get("variant")
    known = [effect for effect in variants(name) if variant is None or effect.variant == variant]
    if not known:
        raise UsageError(f"No {name} is known of the variant {variant!r}.", "Diagnose again.")
    place = link or one.get("joint") or "the base"
    where = "link" if link is not None else "joint" if target >= 0 else "other"
    sits = [effect.at(robot, target, link) for effect in known if _sits(effect, where)]
    if not sits:
        raise UsageError(f"No {name} is known that could be at {place}.", "Diagnose again.")
    odd = [_odd(effect, one.get("parameters")) for effect in sits]
    if all(odd):
        raise UsageError(
            f"The {name} at {place} has {listed(odd[0])}.",
            "Give the URDF or model of the diagnosis, or diagnose again.",
        )
    return sits[odd.index([])]


def _sits(effect: Effect, where: str) -> bool:
    places = {effect.on, *effect.also_on}
    return bool({where} & places) or (where == "other" and bool(places & {"base", "all"}))


def _odd(effect: Effect, parameters: Mapping[str, Any] | None) -> list[str]:
    """What is wrong with the parameters of a finding for its effect."""
    units = {parameter.name: parameter.unit_at(effect.slides) for parameter in effect.parameters}
    found = []
    for name, quantity in (parameters or {}).items():
        if name not in units:
            found.append(f"{name}, which is none of its parameters")
        elif quantity.get("unit") != units[name]:
            found.append(f"{name} in {quantity.get('unit')}, which is in {units[name]} on this robot")
    return found
