"""Joints of a bag that are not read."""

from __future__ import annotations

from collections.abc import Sequence

from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording


class LeftOver(str):
    """The note on a recording about joints in its bag that are left out; it carries their names.

    With the robot's joints at hand one can then check whether they are some of these under other names.
    """

    __slots__ = ("joints",)
    joints: tuple[str, ...]

    @classmethod
    def of(cls, name: str, joints: Sequence[str]) -> LeftOver:
        """The note for a recording's name and joints, by their names after renaming."""
        note = cls(f"{name}: {subject(joints)} in the bag, and left out.")
        note.joints = tuple(joints)
        return note


def subject(joints: Sequence[str]) -> str:
    """Joints as the subject of a sentence, with the verb."""
    return f"joint {joints[0]} is" if len(joints) == 1 else f"joints {listed(joints)} are"


def left_over(recordings: Sequence[Recording]) -> list[str]:
    """Joints left out of the recordings' bags, each once."""
    notes = [note for one in recordings for note in one.notes if isinstance(note, LeftOver)]
    return list(dict.fromkeys(joint for note in notes for joint in note.joints))
