"""The robot description in a bag, and its joints, from the text alone."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

from bdnn_ros.bags.cdr import MalformedMessage, decode_string
from bdnn_ros.bags.storage import STRING, Storage, Topic

MOVABLE = ("revolute", "continuous", "prismatic")


class Descriptions:
    """The robot descriptions in a bag.

    Attributes:
        topics: those that have one, that beside the joint states first: of several robots' in one bag it is theirs.
    """

    def __init__(self, joint_states: str, available: Sequence[Topic]) -> None:
        names = [joint_states.rpartition("/")[0] + "/robot_description", "/robot_description"]
        there = {topic.name for topic in available if topic.type == STRING}
        self.topics = [name for name in names if name in there]
        self._found: dict[str, str] = {}
        self._malformed: dict[str, MalformedMessage] = {}

    def add(self, topic: str, data: bytes) -> None:
        """Add one message; the last one counts that is not empty and can be decoded."""
        try:
            text = decode_string(data)
        except MalformedMessage as error:
            self._malformed[topic] = error
        else:
            self._found[topic] = text or self._found.get(topic, "")

    def notes(self, name: str) -> list[str]:
        """Notes on messages that could not be decoded, a sentence for each topic with some.

        Args:
            name: the bag's.
        """
        return [
            f"{name}: a robot description on {topic} cannot be decoded ({error.problem.rstrip('.')}); left out."
            for topic, error in self._malformed.items()
        ]

    @property
    def theirs(self) -> str | None:
        """The description that belongs to the joint states, or else another; empty if all are empty; None without any."""
        found = [self._found[topic] for topic in self.topics if topic in self._found]
        return next(filter(None, found), "" if found else None)


def read_description(path: str | Path, joint_states: str = "/joint_states") -> str | None:
    """The robot description that `read` would find, without reading joint states.

    Raises:
        UsageError, BagError: as `read`.
    """
    with Storage(Path(path)) as storage:
        descriptions = Descriptions(joint_states, storage.topics)
        for topic, _, data in storage.messages(descriptions.topics):
            descriptions.add(topic, data)
    return descriptions.theirs


def movable_joints(urdf: str | None) -> tuple[str, ...]:
    """Names of the movable joints of a URDF, from the base outwards, limb by limb; empty if it does not parse.

    The order in the text is not used: some descriptions list joints from the tip. Mimic joints are left out, as in `Robot`.
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
