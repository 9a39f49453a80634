"""effects.yaml: effects with their values, as the simulation reads them again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.errors import UsageError
from bdnn_ros.robot import Robot

FORMAT = "bdnn_ros/effects"
VERSION = 1
ALSO_IN = "also_in"
"""Key of an entry that says which other file carries the effect as well."""


def preamble(stem: str) -> str:
    """Which file carries what, as comments."""
    urdf, mjcf = f"{stem}.urdf", f"{stem}.mjcf.xml"
    wide = len(mjcf)
    return f"""\
# What {urdf} cannot say. Nothing is to be applied twice:
#   {urdf:{wide}}  carries the links' inertias, payloads, the base's tilt, damping and friction
#   {"this file":{wide}}  carries all the rest; with {urdf} it is the whole model:
#   {"":{wide}}  bdnn simulate --urdf {urdf} --effects effects.yaml
#   {mjcf}  stands alone: what {urdf} carries, and of this file what says so under {ALSO_IN}
# Effort that really acts(t) = scale * measured(t - delay) + offset. SI units and radians.
"""


def entry(effect: Installed, robot: Robot) -> dict[str, Any]:
    """An effect as in truth.yaml and effects.yaml; values that say nothing (an open end) are left out."""
    result: dict[str, Any] = dict(effect.as_truth(robot))
    result["parameters"] = {k: float(v) for k, v in effect.values.items() if np.isfinite(v)}
    return result


def from_entry(one: Mapping[str, Any], robot: Robot) -> Installed:
    """The effect of an entry, defaults filled in.

    Raises:
        UsageError: the robot has no such joint or link, there is no such effect, or a parameter is missing.
    """
    try:
        effect = get(str(one["effect"]), str(one.get("variant") or ""))
        joint, link = one.get("joint"), one.get("link")
        given = {str(key): float(value) for key, value in one["parameters"].items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UsageError(
            f"An entry of the effects is not complete ({error!r}).", "Each needs effect and parameters."
        ) from None
    target = -1
    if link is not None:
        target = robot.body_of(str(link))[0]
    elif joint is not None:
        if joint not in robot.joints:
            raise UsageError(f"{effect.name}: the robot has no joint {joint!r}.", "Give the robot it is for.")
        target = robot.joints.index(str(joint))
    values = effect.with_defaults(given)
    missing = [p.name for p in effect.parameters if p.name not in values]
    if missing:
        raise UsageError(f"{effect.name} lacks {', '.join(missing)}.", "Add it to its parameters.")
    return Installed(effect, target, None if link is None else str(link), values)


def effects_text(
    effects: Sequence[Installed], robot: Robot, in_mjcf: Sequence[Installed] = (), stem: str = "extended"
) -> str:
    """The text of an effects.yaml.

    Args:
        effects: what the extended URDF does not carry.
        in_mjcf: those of them that the MuJoCo model carries.
        stem: of the names of the URDF and the MuJoCo model.
    """
    entries = []
    for effect in effects:
        one = entry(effect, robot)
        if effect in in_mjcf:
            one[ALSO_IN] = [f"{stem}.mjcf.xml"]
        entries.append(one)
    document = {"format": FORMAT, "version": VERSION, "joints": list(robot.joints), "effects": entries}
    return preamble(stem) + yaml.safe_dump(document, sort_keys=False, allow_unicode=True)


def read_effects(path: str | Path, robot: Robot) -> list[Installed]:
    """The effects of an effects.yaml (or a truth.yaml), for a robot.

    Raises:
        UsageError: the file cannot be read, is of another format, or does not fit the robot.
    """
    try:
        document = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise UsageError(f"The effects file {path} cannot be read ({reason}).", "Check the path.") from None
    if not isinstance(document, dict) or not isinstance(document.get("effects"), list):
        raise UsageError(f"{path} is not an effects file: it has no list of effects.", "Give effects.yaml.")
    if document.get("format") == FORMAT and document.get("version") != VERSION:
        raise UsageError(
            f"{path} has version {document.get('version')}, this program reads version {VERSION}.",
            "Use the release that wrote it.",
        )
    return [from_entry(one, robot) for one in document["effects"]]
