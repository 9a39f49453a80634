"""Remarks on the data for the user."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Remark:
    """A remark on the data for the user.

    Attributes:
        about: joint or joints, or empty for the whole recording.
        problem: one sentence.
        remedy: what to do about it, one sentence.
    """

    about: str
    problem: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.problem} {self.remedy}"
