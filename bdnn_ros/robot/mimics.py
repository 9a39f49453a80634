"""Joints that follow another one by a <mimic> tag of the URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import TYPE_CHECKING

from bdnn_ros.errors import listed

if TYPE_CHECKING:
    from bdnn_ros.robot.robot import Robot


def mimicking(urdf: str) -> dict[str, str]:
    """Joints of a URDF that mimic another, and which."""
    return {joint: str(tag.get("joint")) for joint, tag in _tags(urdf).items()}


def ratios(urdf: str) -> dict[str, tuple[float, float]]:
    """Of each joint that mimics another: multiplier and offset [rad] ([m]) by which it follows."""
    return {
        joint: (float(tag.get("multiplier", 1.0)), float(tag.get("offset", 0.0)))
        for joint, tag in _tags(urdf).items()
    }


def _tags(urdf: str) -> dict[str, ElementTree.Element]:
    joints = [(joint, joint.find("mimic")) for joint in ElementTree.fromstring(urdf).findall("joint")]
    return {
        str(joint.get("name")): tag
        for joint, tag in joints
        if tag is not None and joint.get("type") != "fixed"
    }


def held_mimics(robot: Robot) -> dict[str, str]:
    """Joints that mimic another but are not among the robot's, so they are held still, and the joints they mimic."""
    return {joint: leader for joint, leader in mimicking(robot.urdf).items() if joint not in robot.joints}


def with_mimics(robot: Robot) -> tuple[str, ...]:
    """The robot's joints, then those that mimic another and are not among them."""
    return (*robot.joints, *held_mimics(robot))


def standing_still(mimics: dict[str, str]) -> str:
    """Beginning of a sentence about held joints (keys) that mimic others (values)."""
    pairs = [f"{joint} mimics {leader}" for joint, leader in mimics.items()]
    return f"{listed(pairs)}: held still"
