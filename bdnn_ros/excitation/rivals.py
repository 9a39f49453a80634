"""The suspects of a diagnosis.json: each finding with the rivals it could not be told from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bdnn_ros.diagnosis.result import FORMAT
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.registry import variants
from bdnn_ros.errors import UsageError
from bdnn_ros.robot import Robot
from bdnn_ros.robot.entries import reading


@dataclass(frozen=True)
class Suspect:
    """An effect at its place; with values where the diagnosis has estimated them.

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
        """What a sentence calls it."""
        place = self.link or (robot.joints[self.target] if self.target >= 0 else "")
        return f"{self.effect.name}@{place}" if place else self.effect.name


@dataclass(frozen=True)
class Question:
    """A finding, and what else it could be."""

    finding: Suspect
    rivals: tuple[Suspect, ...]


@dataclass(frozen=True)
class Case:
    """What a diagnosis leaves open.

    Attributes:
        questions: every finding, also those without rivals.
        noise: noise of each joint's effort, (n,) [N·m].
        joints: the recording's joints.
    """

    questions: tuple[Question, ...]
    noise: np.ndarray
    joints: tuple[str, ...]


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
    """The joints of a diagnosis.json, and where its robot description came from.

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
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise UsageError(
            f"{path} cannot be read ({error}).", "Give the diagnosis.json of a diagnosis."
        ) from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UsageError(f"{path} is not a diagnosis.", "Give the diagnosis.json of a diagnosis.")
    return content


def _question(one: Mapping[str, Any], robot: Robot) -> Question:
    return Question(_suspect(one, robot), tuple(_suspect(rival, robot) for rival in one["rivals"]))


def _suspect(one: Mapping[str, Any], robot: Robot) -> Suspect:
    parameters = one.get("parameters")
    joint, link = one.get("joint"), one.get("link")
    where = "link" if link is not None else "joint" if joint is not None else "other"
    choices = [
        e
        for e in variants(str(one["effect"]))
        if e.variant == one.get("variant", e.variant) and _fits(e, where, parameters)
    ]
    if not choices:
        raise KeyError(str(one["effect"]))
    target = -1
    if link is not None:
        target = robot.body_of(str(link))[0]
    elif joint is not None:
        if joint not in robot.joints:
            raise UsageError(f"The robot has no joint {joint!r}.", "Give the URDF or model of the diagnosis.")
        target = robot.joints.index(str(joint))
    values = None
    if parameters is not None:
        found = {str(name): float(quantity["value"]) for name, quantity in parameters.items()}
        values = choices[0].with_defaults(found)
    return Suspect(choices[0], target, None if link is None else str(link), values, float(one["probability"]))


def _fits(effect: Effect, where: str, parameters: Mapping[str, Any] | None) -> bool:
    """Whether a variant can sit there and has these parameters, units included."""
    places = {effect.on, *effect.also_on}
    if not ({where} & places or (where == "other" and places & {"base", "all"})):
        return False
    units = {parameter.name: parameter.unit for parameter in effect.parameters}
    return parameters is None or all(
        units.get(name) == quantity.get("unit") for name, quantity in parameters.items()
    )
