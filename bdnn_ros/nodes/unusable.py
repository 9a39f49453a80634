"""Detects that most of the incoming joint states have to be left out, and says why."""

from __future__ import annotations

from collections import Counter

from bdnn_ros.online.stream.intake import (
    BACKWARDS,
    LENGTH,
    NO_EFFORT,
    NO_STAMP,
    NOT_FINITE,
    OUT_OF_RANGE,
    TWICE,
    Intake,
)
from bdnn_ros.readings import MOST

SHARE, LEAST = 0.5, 3
"""It is told where more than this share of what came since the last look is of no use, and so many messages at least."""
LEFT_OUT = "in most joint states, which are left out."
TOLD = {
    NOT_FINITE: "The {culprit} is not finite "
    + LEFT_OUT
    + " Let its driver fill it, or set the parameter joints to the others.",
    OUT_OF_RANGE: "The {culprit} is beyond " + f"{MOST:g} {LEFT_OUT}" + " Check its driver and its bus.",
    LENGTH: "Most joint states are left out, as their lists are not as long as their names. "
    "Let the driver fill in a number for every name, or leave a list empty.",
    TWICE: "Most joint states are left out, as they name {culprit} twice. "
    "Let whoever fills joint_states give each joint a name of its own.",
    BACKWARDS: "Most joint states are left out, as their stamps repeat or go back. "
    "Let one publisher fill joint_states, and stamp at measurement.",
    NO_STAMP: "Most joint states are left out, as they have no stamp while others have one. "
    "Let one publisher fill joint_states, and stamp at measurement.",
    NO_EFFORT: "Most joint states carry no effort, and nothing is learned from those. "
    "Set effort_source to command, or use a driver that fills it.",
}
"""By reason, one sentence and what to do. Parts that wait in vain are none: a slower part may set the pace."""


class Unusable:
    """Compares the messages rejected since the last call with those received."""

    def __init__(self) -> None:
        self._intake: Intake | None = None
        self._received = 0
        self._rejected: Counter[str] = Counter()

    def look(self, intake: Intake | None, learning: bool) -> str:
        """The complaint about most joint states since the last call; empty if there is none.

        Args:
            intake: of the stream, if there is one.
            learning: without, efforts are not missed.
        """
        if intake is not self._intake:
            self._intake, self._received, self._rejected = intake, 0, Counter()
        if intake is None:
            return ""
        received, rejected = intake.received, Counter(dict(intake.rejected))
        came, more = received - self._received, rejected - self._rejected
        self._received, self._rejected = received, rejected
        reason = max(TOLD, key=lambda each: more[each])
        if more[reason] < LEAST or more[reason] <= SHARE * came or (reason == NO_EFFORT and not learning):
            return ""
        return TOLD[reason].format(culprit=intake.culprit)
