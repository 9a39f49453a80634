"""What a diagnosis is worth once the truth is known.

A finding is right when effect and place are the hidden one's. What is physically the same counts only where
the finding lists it as a rival. On a worn robot Coulomb and viscous friction and rotor inertia of every joint
are true, too; a link's inertia is true without being hidden where that link really is off by about as much.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.registry import get
from bdnn_ros.robot import Robot

WORN = {"coulomb_friction": "coulomb", "viscous_friction": "viscous", "armature": "armature"}
HALVES = {"coulomb_friction", "effort_offset"}
GIVEN = {
    "link_inertia": ("nominal_mass",),
    "drift": ("start", "end"),
    "backlash": ("crossing",),
    "external_wrench": ("point_x", "point_y", "point_z"),
}
"""Parameters that are inputs, not results."""
SMALLEST = {"com": 0.05, "phase": 1.0, "rest": 1.0, "roll": 1.0, "pitch": 1.0}
"""Smallest magnitude that an error is counted against: a share of nearly nothing says nothing."""
LEVER = 0.1
"""A torque that is nothing is counted against what the force does at this distance [m]."""
LINK_ERROR = 0.5
"""A link named without being hidden is true where its mass error is found to within this share."""
ON_AXIS = 0.005
"""So near an axis a force has hardly a moment about it [m]."""
ON_ONE_SIDE = 0.1
"""A gap that is never crossed is a wrong zero of half of it, to within this share of the gap."""
CONFIDENCE = 1.96

Json = Mapping[str, Any]


@dataclass(frozen=True)
class Truth:
    """Something true of the real robot: an effect at its place with its parameters; hidden, or only worn."""

    effect: Effect
    target: int
    values: Mapping[str, float]
    hidden: bool

    @property
    def name(self) -> str:
        """The effect's name in the contract."""
        return self.effect.name


def judge(truth: Json, found: Sequence[Json], robot: Robot) -> dict[str, Any]:
    """The outcome of one draw.

    Returns:
        `hidden`: for each hidden effect its name and joint, whether it was `named`, `first` (before everything but
        wear), `abstained` (not named, and nothing false either), what was named in its place (`as`), and its
        `parameters` with error and coverage. `false`: names of the false findings. `true`: of the others.
    """
    truths = combined(truth, robot)
    by_finding = [_explained_by(finding, found, truths, robot) for finding in found]
    link_errors = [_is_link_error(finding, truth) for finding in found]
    false = [
        f for f, hit, link in zip(found, by_finding, link_errors, strict=True) if hit is None and not link
    ]
    hidden = []
    for one in (t for t in truths if t.hidden):
        hits = [k for k, hit in enumerate(by_finding) if hit is one or _other_half(found[k], hit, one)]
        before = [k for k in range(hits[0]) if not _is_wear(by_finding[k])] if hits else []
        hidden.append(
            {
                "effect": one.name,
                "target": one.target,
                "named": bool(hits),
                "first": bool(hits) and not before,
                "abstained": not hits and not false,
                "as": one.name if hits else _instead(one, false, robot),
                "parameters": _compared(one, found[hits[0]]) if hits else {},
            }
        )
    return {
        "hidden": hidden,
        "false": [f["effect"] for f in false],
        "true": [f["effect"] for f, hit in zip(found, by_finding, strict=True) if hit is not None],
        "links": [
            f["effect"]
            for f, hit, link in zip(found, by_finding, link_errors, strict=True)
            if link and hit is None
        ],
    }


def combined(truth: Json, robot: Robot) -> list[Truth]:
    """What is true of the robot, with effects that contain others at their joint holding both.

    A worn joint that also has a hidden Stribeck effect has one friction curve, not two.
    """
    truths = [
        Truth(get(t["effect"], t.get("variant", "")), _target(t, robot), dict(t["parameters"]), True)
        for t in truth["effects"]
    ]
    for joint, worn in (truth.get("worn") or {}).items():
        for name, key in WORN.items():
            truths.append(Truth(get(name), robot.joints.index(joint), {key: worn[key]}, False))
    merged: list[Truth] = []
    for one in sorted(truths, key=lambda t: not t.effect.contains):  # what contains others comes first
        for k, other in enumerate(merged):
            if other.target == one.target and (one.name == other.name or one.name in other.effect.contains):
                both = _added(other, one)
                if both is not None:
                    merged[k] = both
                    break
        else:
            merged.append(one)
    return merged


def _added(larger: Truth, smaller: Truth) -> Truth | None:
    """Both as one effect; None where they do not add up."""
    values = dict(larger.values)
    if smaller.name in ("coulomb_friction", "viscous_friction", "effort_offset", "armature"):
        amount = next(iter(smaller.values.values()))
        for key in values:
            if key not in ("start", "end", "velocity"):
                values[key] += amount
        return Truth(larger.effect, larger.target, values, larger.hidden or smaller.hidden)
    return None


def _explained_by(
    finding: Json, found: Sequence[Json], truths: Sequence[Truth], robot: Robot
) -> Truth | None:
    """The truth that a finding names, if any."""
    target = _target(finding, robot)
    for one in truths:
        if (finding["effect"], target) == (one.name, one.target):
            return one
    for one in truths:
        said = _together(finding, found, robot)
        partners = {r["effect"] for f in said for r in f["rivals"] if _target(r, robot) == one.target}
        if one.name in partners and _same_physics(finding, found, one, truths, target, robot):
            return one
    return None


def _together(finding: Json, found: Sequence[Json], robot: Robot) -> list[Json]:
    """What says one thing: Coulomb friction and an offset of one joint are uneven friction only both together."""
    if finding["effect"] not in HALVES:
        return [finding]
    return [f for f in found if f["effect"] in HALVES and _target(f, robot) == _target(finding, robot)]


def _other_half(finding: Json, hit: Truth | None, one: Truth) -> bool:
    """Whether a finding that is right about Coulomb friction or an offset says both: uneven friction."""
    if hit is None or finding["effect"] != "asymmetric_friction":
        return False
    return {hit.name, one.name} == HALVES and hit.target == one.target


def _same_physics(
    finding: Json, found: Sequence[Json], one: Truth, truths: Sequence[Truth], target: int, robot: Robot
) -> bool:
    """Whether a finding says in other words what is true."""
    if {finding["effect"], one.name} == {"base_tilt", "position_offset"}:
        return max(target, one.target) == 0 and _turns_gravity(robot)
    if finding["effect"] == one.name == "external_wrench":
        return target == one.target - 1 and _on_axis(one, robot)
    if target != one.target:
        return False
    if {finding["effect"], one.name} == {"payload", "link_inertia"}:
        return True
    if (finding["effect"], one.name) == ("position_offset", "backlash"):
        side = abs(finding["parameters"]["offset"]["value"]) / one.values["gap"]
        return abs(side - 0.5) < ON_ONE_SIDE
    true = {t.name for t in truths if t.target == target}
    if one.name == "asymmetric_friction":
        there = {f["effect"] for f in found if _target(f, robot) == target}
        dry = {"coulomb_friction"} | ({"stribeck_friction"} & true)
        return finding["effect"] in HALVES and "effort_offset" in there and bool(there & dry)
    return finding["effect"] == "asymmetric_friction" and one.name in HALVES and true >= HALVES


def _turns_gravity(robot: Robot) -> bool:
    """Whether the first joint's axis is not vertical, so that its zero and the base's tilt are one angle."""
    poses = np.random.default_rng(0).uniform(-1.0, 1.0, (20, robot.width))
    return bool(np.ptp(robot.rigid_effort(poses, 0.0 * poses, 0.0 * poses)[:, 0]) > 1e-6)


def _on_axis(push: Truth, robot: Robot) -> bool:
    """Whether a force acts on the axis of its link's joint, so that the link before feels the same of it."""
    point = np.array([push.values.get(axis, 0.0) for axis in GIVEN["external_wrench"]])
    torque = math.hypot(*(push.values.get(f"torque_{axis}", 0.0) for axis in "xyz"))
    link, pose = robot.moving_link(robot.joints[push.target]), np.zeros((1, robot.width))
    jacobian, rotation = robot.link_motion(pose, link)
    arm = np.cross(rotation[0].T @ jacobian[0, 3:, push.target], point)
    return bool(torque == 0.0 and np.linalg.norm(arm) < ON_AXIS)


def _is_link_error(finding: Json, truth: Json) -> bool:
    """Whether a named link's mass is really off by about as much as the finding says."""
    if finding["effect"] != "link_inertia":
        return False
    mass, nominal = (finding["parameters"][key]["value"] for key in ("mass", "nominal_mass"))
    for link in truth["links"].values():
        described, real = link["described"][0], link["real"][0]
        if math.isclose(described, nominal, rel_tol=1e-3):
            return abs(mass - real) <= LINK_ERROR * abs(real - described)
    return False


def _is_wear(one: Truth | None) -> bool:
    return one is not None and not one.hidden


def _instead(one: Truth, false: Sequence[Json], robot: Robot) -> str:
    """What was named in its place: the first false finding there, else elsewhere, else nothing."""
    here = [f for f in false if _target(f, robot) == one.target]
    if here:
        return str(here[0]["effect"])
    return f"{false[0]['effect']} elsewhere" if false else "nothing"


def _target(entry: Json, robot: Robot) -> int:
    """Index of the joint, or of the joint that moves the link; -1 for the base or all joints."""
    if entry.get("link") is not None:
        return robot.body_of(str(entry["link"]))[0]
    return -1 if entry.get("joint") is None else robot.joints.index(str(entry["joint"]))


def _compared(one: Truth, finding: Json) -> dict[str, dict[str, Any]]:
    """Each parameter's error as a share of its magnitude, and whether the 95 % interval holds the truth."""
    if finding["effect"] != one.name:
        return {}
    result = {}
    for name, quantity in finding["parameters"].items():
        if name not in one.values or name in GIVEN.get(one.name, ()):
            continue
        error = float(quantity["value"]) - float(one.values[name])
        if name == "phase":
            error = math.remainder(error, 2.0 * math.pi)
        result[name] = {
            "truth": float(one.values[name]),
            "error": abs(error) / _magnitude(one, name),
            "covered": abs(error) <= CONFIDENCE * float(quantity["std"]),
        }
    return result


def _magnitude(one: Truth, name: str) -> float:
    """What an error is counted against: the vector's length, the window's, the larger of a drift's ends."""
    kind, values = name.split("_")[0], one.values
    group = [v for key, v in values.items() if key.split("_")[0] == kind and key not in ("start", "end")]
    if name in ("start", "end"):
        return max(values["end"] - values["start"], 1e-9)
    if name in ("start_value", "end_value"):
        return max(abs(values["start_value"]), abs(values["end_value"]), 1e-9)
    if kind in ("roll", "pitch"):
        group = [values["roll_deg"], values["pitch_deg"]]
    elif kind not in ("com", "force", "torque"):
        group = [values[name]]
    if kind == "torque" and not any(group):
        group = [LEVER * v for key, v in values.items() if key.startswith("force")]
    return max(math.hypot(*group), SMALLEST.get(kind, 1e-9))
