"""effects.yaml: effects with their values, in the format that the simulation reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bdnn_ros.effects.registry import Installed, from_values
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.left_out import unseen
from bdnn_ros.readings import credible
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import with_mimics

FORMAT = "bdnn_ros/effects"
VERSION = 1
ALSO_IN = "also_in"
"""Key of an entry that says which other file carries the effect as well."""
HELD = "held"
"""Key of where the joints stand that are not among `joints` [rad] ([m])."""
KEYS = ("effect", "variant", "joint", "link", "parameters", ALSO_IN)
"""Of an entry."""
THIS = "this file"


def preamble(urdf: str = "", mjcf: str = "", left_out: Sequence[str] = ()) -> str:
    """Comments on which file carries what, and what none of them carries."""
    lines = [f"What {urdf or mjcf} cannot say. Nothing is to be applied twice:"]
    wide = max(len(urdf), len(mjcf), len(THIS))
    carried = (
        "the links' inertias, payloads, zeros that were identified, the base's tilt, damping and friction"
    )
    if urdf:
        lines += [
            f"  {urdf:{wide}}  carries {carried}",
            f"  {THIS:{wide}}  carries all other effects{'' if left_out else f'; with {urdf} it is the whole model'}:",
            f"  {'':{wide}}  bdnn simulate --urdf {urdf} --effects effects.yaml",
        ]
    if urdf and mjcf:
        lines += [
            f"  {mjcf:{wide}}  stands alone: what {urdf} carries, and of this file what says so under {ALSO_IN}"
        ]
    elif mjcf:
        lines += [
            f"  {mjcf:{wide}}  carries the links, friction, rotors, springs, zeros, the base's tilt, scales and offsets",
            f"  {THIS:{wide}}  carries all other effects",
        ]
    if left_out:
        lines += ["Only the model itself (model.bdnn) has:", *(f"  {part}" for part in left_out)]
    lines += ["Effort that really acts(t) = scale * measured(t - delay) + offset. SI units and radians."]
    return "".join(f"# {line}\n" for line in lines)


def entry(effect: Installed, robot: Robot) -> dict[str, Any]:
    """An effect as in truth.yaml and effects.yaml, without meaningless values (an open end)."""
    result: dict[str, Any] = dict(effect.as_truth(robot))
    result["parameters"] = {k: float(v) for k, v in effect.values.items() if np.isfinite(v)}
    return result


def from_entry(one: object, robot: Robot) -> Installed:
    """The effect of an entry, with defaults filled in.

    Raises:
        UsageError: it is not complete, or place or numbers do not fit the effect and the robot.
    """
    if not isinstance(one, Mapping):
        raise UsageError("it is not complete: it has no keys.", "Each effect needs effect and parameters.")
    lacking = [key for key in ("effect", "parameters") if one.get(key) is None]
    if lacking:
        raise UsageError(f"it is not complete: it lacks {listed(lacking)}.", "Add what is missing.")
    unknown = [key for key in one if key not in KEYS]
    if unknown:
        raise UsageError(f"it has the unknown key {listed(unknown)}.", f"The keys are {listed(KEYS)}.")
    if not isinstance(one["parameters"], Mapping):
        raise UsageError("its parameters are not pairs of a name and a number.", "Write name: number.")
    joint, link = (None if one.get(key) is None else str(one[key]) for key in ("joint", "link"))
    given = {str(key): value for key, value in one["parameters"].items()}
    variant = str(one.get("variant") or "")
    return from_values(str(one["effect"]), given, robot, joint=joint, link=link, variant=variant)


def from_entries(entries: Sequence[object], robot: Robot) -> list[Installed]:
    """The effects of entries, in order.

    Raises:
        UsageError: one cannot be read; the sentence says which.
    """
    found = []
    for number, one in enumerate(entries, 1):
        try:
            found.append(from_entry(one, robot))
        except UsageError as error:
            raise UsageError(f"effect {number} of {len(entries)}: {error.problem}", error.remedy) from None
    return found


def effects_text(
    effects: Sequence[Installed],
    robot: Robot,
    in_mjcf: Sequence[Installed] = (),
    urdf: str = "extended.urdf",
    mjcf: str = "extended.mjcf.xml",
    left_out: Sequence[str] = (),
) -> str:
    """The text of an effects.yaml.

    Args:
        effects: what the files beside do not carry: the URDF, or the MuJoCo model where there is no URDF.
        in_mjcf: those of them that the MuJoCo model carries.
        urdf: name of the URDF beside, "" where there is none.
        mjcf: name of the MuJoCo model beside, "" where there is none.
        left_out: what none of these files carries, in words.
    """
    entries = []
    for effect in effects:
        one = entry(effect, robot)
        if mjcf and effect in in_mjcf:
            one[ALSO_IN] = [mjcf]
        entries.append(one)
    document: dict[str, Any] = {"format": FORMAT, "version": VERSION, "joints": list(robot.joints)}
    stands = _standing(robot)
    if stands:
        document[HELD] = stands
    document["effects"] = entries
    return preamble(urdf, mjcf, left_out) + yaml.safe_dump(document, sort_keys=False, allow_unicode=True)


def _standing(robot: Robot) -> dict[str, float]:
    """Positions of the URDF's movable joints that are not joints of the robot [rad] ([m])."""
    whole = Robot.from_urdf(robot.urdf, with_mimics(Robot.from_urdf(robot.urdf)))
    stands = dict(zip(whole.joints, unseen(whole, robot), strict=True))
    return {joint: at for joint, at in stands.items() if joint not in robot.joints}


@dataclass(frozen=True)
class EffectsFile:
    """An effects.yaml, or a truth.yaml.

    Attributes:
        path: where it was read, for sentences.
        content: as YAML has it.
    """

    path: Path
    content: Mapping[str, Any]

    @classmethod
    def read(cls, path: str | Path) -> EffectsFile:
        """The file at a path.

        Raises:
            UsageError: it cannot be read, or is of another format.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
            content = yaml.safe_load(text)
        except OSError as error:
            raise UsageError(
                f"The effects file {path} cannot be read ({error}).", "Check the path."
            ) from None
        except Exception as error:
            # of dates, numbers and depth that cannot be, YAML raises errors of every kind
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise UsageError(
                f"The effects file {path} cannot be read ({reason}).", "Give it as it was written."
            ) from None
        if not isinstance(content, dict) or not isinstance(content.get("effects"), list):
            raise UsageError(
                f"{path} is not an effects file: it has no list of effects.", "Give effects.yaml."
            )
        if content.get("format") == FORMAT and content.get("version") != VERSION:
            raise UsageError(
                f"{path} has version {content.get('version')}, this program reads version {VERSION}.",
                "Use the release that wrote it.",
            )
        return cls(Path(path), content)

    def robot(self, described: Robot) -> Robot:
        """The described robot with the joints of the file, if it names them; the others held as they were.

        Raises:
            UsageError: the file's joints and where others are held cannot be understood, or do not fit together.
            RobotError: the file names joints that the robot does not have.
        """
        held, joints = self.content.get(HELD) or {}, self.content.get("joints")
        if not held and joints is None:
            return described
        if not isinstance(held, dict) or not isinstance(joints, list) or not joints:
            raise self._unlike("joints and where others are held cannot be read")
        names = [str(joint) for joint in joints]
        if len(set(names)) != len(names):
            raise self._unlike(f"a joint is named twice in {listed(names, 20)}")
        try:
            stands = {str(joint): float(at) for joint, at in held.items()}
        except (TypeError, ValueError, OverflowError):
            raise self._unlike("where joints are held is no number") from None
        for joint, at in stands.items():
            if not credible(np.array(at)):
                raise self._unlike(f"{joint} is held at {at:g}, where no joint can stand")
            if joint in names:
                raise self._unlike(f"{joint} is held, and one of the joints that move")
        return Robot.from_urdf(described.urdf, names, stands)

    @property
    def identified(self) -> bool:
        """Whether it was written for a model, not by a simulation."""
        return self.content.get("format") == FORMAT

    def _unlike(self, problem: str) -> UsageError:
        return UsageError(f"{self.path}: {problem}.", "Give it as it was written.")

    def effects(self, robot: Robot) -> list[Installed]:
        """The effects of the file, for a robot.

        Raises:
            UsageError: something in it is not complete, or does not fit the robot.
        """
        try:
            return from_entries(self.content["effects"], robot)
        except UsageError as error:
            raise UsageError(f"{self.path}: {error.problem}", error.remedy) from None
