"""What a robot description says of its joints, by its text alone."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

MOVABLE = ("revolute", "continuous", "prismatic")


def movable_joints(urdf: str | None) -> tuple[str, ...]:
    """Names of the movable joints of a URDF, from the base outwards, one limb after another; none where it does not parse.

    Some descriptions list their joints from the tip. Those that mimic another are not among them, as they are none of
    the robot's.
    """
    try:
        root = ElementTree.fromstring(urdf or "<none/>")
    except ElementTree.ParseError:
        return ()
    below: dict[str, list[ElementTree.Element]] = {}
    for joint in root.findall("joint"):
        below.setdefault(_link(joint, "parent"), []).append(joint)
    moved = {_link(joint, "child") for joints in below.values() for joint in joints}
    found: list[str] = []
    waiting = [joint for link, joints in below.items() if link not in moved for joint in joints][::-1]
    while waiting:
        joint = waiting.pop()
        if joint.get("type") in MOVABLE and joint.find("mimic") is None:
            found.append(str(joint.get("name")))
        waiting += below.pop(_link(joint, "child"), [])[::-1]
    return tuple(found)


def _link(joint: ElementTree.Element, end: str) -> str:
    link = joint.find(end)
    return "" if link is None else str(link.get("link"))
