"""Joints of a bag that are not read: what is said of them, and which they are."""

from __future__ import annotations

from collections.abc import Sequence

from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording


class LeftOver(str):
    """A note on a recording that joints of its bag are left out, which knows them.

    Whoever knows what joints the robot has can tell whether they may be some of it under other names.
    """

    __slots__ = ("joints",)
    joints: tuple[str, ...]

    @classmethod
    def of(cls, name: str, joints: Sequence[str]) -> LeftOver:
        """That of a recording's name and the joints, by the names that they are mapped to."""
        note = cls(f"{name}: {subject(joints)} in the bag, and left out.")
        note.joints = tuple(joints)
        return note


def subject(joints: Sequence[str]) -> str:
    """Joints as the subject of a sentence, with its verb."""
    return f"joint {joints[0]} is" if len(joints) == 1 else f"joints {listed(joints)} are"


def left_over(recordings: Sequence[Recording]) -> list[str]:
    """Joints of the recordings' bags that are left out, each once."""
    notes = [note for one in recordings for note in one.notes if isinstance(note, LeftOver)]
    return list(dict.fromkeys(joint for note in notes for joint in note.joints))
