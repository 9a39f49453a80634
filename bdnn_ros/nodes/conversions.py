"""Between ROS messages and arrays: requests are validated with messages that name the field, responses are filled in."""

from __future__ import annotations

import array
from collections.abc import Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState

from bdnn_interfaces.msg import DynamicsEstimate, Finding, Findings
from bdnn_ros.effects.registry import get
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.online.estimate import Instant, Parts
from bdnn_ros.readings import credible


def stamp(nanoseconds: int) -> Time:
    """A ROS time from nanoseconds."""
    return Time(sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000)


def numbers(values: np.ndarray) -> array.array[float]:
    """Values in row-major order as an `array.array`, whose elements rclpy does not check one by one."""
    return array.array("d", np.ascontiguousarray(values, float).tobytes())


def requested(
    joints: Sequence[str], names: Sequence[str], fields: dict[str, Sequence[float]]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The fields of a service request, validated and put in the order of the model's joints.

    Args:
        joints: the model's n joints.
        names: the request's, any order; empty means the model's.
        fields: numbers by field name, in the order of the names.

    Returns:
        Index of each of the request's joints in the model's order, and the fields in the model's order.

    Raises:
        UsageError: a joint is unknown, missing or named twice; a field has the wrong size or numbers that no robot can have.
    """
    order = list(names) or list(joints)
    unknown = dict.fromkeys(name for name in order if name not in joints)
    if unknown:
        raise UsageError(f"Unknown joint {listed(map(_shown, unknown))}; the model has {listed(joints, 20)}.")
    twice = sorted({name for name in order if order.count(name) > 1})
    if twice:
        raise UsageError(f"Joint {listed(map(_shown, twice))} is named twice.")
    missing = [name for name in joints if name not in order]
    if missing:
        joint, is_ = ("Joint", "is") if len(missing) == 1 else ("Joints", "are")
        raise UsageError(
            f"{joint} {listed(missing)} {is_} missing; the model needs all of {listed(joints, 20)}."
        )
    index = np.array([list(joints).index(name) for name in order])
    arranged: dict[str, np.ndarray] = {}
    for field, values in fields.items():
        if len(values) != len(order):
            raise UsageError(f"{field} has {len(values)} values, the {len(order)} joints need {len(order)}.")
        given = np.asarray(values, float)
        wrong = ~credible(given)
        if wrong.any():
            one = int(np.argmax(wrong))
            said = f"{given[one]:.2g}, as no robot's can be" if np.isfinite(given[one]) else "not finite"
            raise UsageError(f"{field} of {order[one]} is {said}.")
        arranged[field] = np.empty(len(joints))
        arranged[field][index] = given
    return index, arranged


def _shown(name: str) -> str:
    """A joint name for a message: quoted if it is empty, not printable, or begins or ends with a blank."""
    return name if name.isprintable() and name.strip() == name and name else repr(name)


def estimate_message(joints: Sequence[str], instant: Instant, parts: Parts, version: int) -> DynamicsEstimate:
    """The estimate at one instant as a message; NaN marks an effort that was not measured, an empty list that none was."""
    message = DynamicsEstimate()
    message.header.stamp = stamp(instant.stamp)
    message.joint_names = list(joints)
    message.position = numbers(instant.position)
    message.velocity = numbers(instant.velocity)
    message.acceleration = numbers(instant.acceleration)
    message.effort_measured = numbers(instant.effort) if np.isfinite(instant.effort).any() else []
    message.effort_estimate = numbers(parts.effort)
    message.effort_std = numbers(parts.std)
    message.inertial = numbers(parts.inertial)
    message.coriolis = numbers(parts.coriolis)
    message.gravity = numbers(parts.gravity)
    message.friction = numbers(parts.friction)
    message.learned = numbers(parts.learned)
    message.mass_matrix = numbers(parts.mass_matrix)
    message.model_version = version
    return message


def effort_message(joints: Sequence[str], instant: Instant, parts: Parts) -> JointState:
    """The estimated effort as a JointState with the stamp of the instant."""
    message = JointState()
    message.header.stamp = stamp(instant.stamp)
    message.name = list(joints)
    message.position = numbers(instant.position)
    message.velocity = numbers(instant.velocity)
    message.effort = numbers(parts.effort)
    return message


def findings_message(diagnosis: dict[str, Any], now: Time) -> Findings:
    """A diagnosis (`Diagnosis.as_json`) as a message."""
    message = Findings()
    message.header.stamp = now
    message.verdict = diagnosis["verdict"]
    message.findings = [_finding(entry) for entry in diagnosis["findings"]]
    message.gain = float(diagnosis["gain"]["value"])
    message.gain_low, message.gain_high = (float(x) for x in diagnosis["gain"]["interval"])
    message.advice = list(diagnosis["advice"])
    return message


def nothing_yet_message(now: Time) -> Findings:
    """The message before the first diagnosis: no findings, because nothing was examined."""
    message = Findings()
    message.header.stamp = now
    message.verdict = "cannot_tell"
    message.advice = [
        "Nothing was diagnosed yet of what is being learned. Move the robot, or call ~/diagnose."
    ]
    return message


def _finding(entry: dict[str, Any]) -> Finding:
    message = Finding()
    message.effect = entry["effect"]
    message.joint = entry["joint"] or ""
    message.link = entry["link"] or ""
    message.parameter_names = list(entry["parameters"])
    message.values = [float(p["value"]) for p in entry["parameters"].values()]
    message.stds = [float(p["std"]) for p in entry["parameters"].values()]
    message.units = [p["unit"] for p in entry["parameters"].values()]
    message.share = float(entry["share"])
    message.probability = float(entry["probability"])
    message.rivals = [_rival(rival) for rival in entry["rivals"]]
    message.sentence = entry["sentence"]
    return message


def _rival(entry: dict[str, Any]) -> str:
    where = entry["link"] or entry["joint"] or get(entry["effect"]).on
    return f"{entry['effect']}@{where} ({entry['probability']:.2f})"
