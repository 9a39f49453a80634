"""Changes of the robot that were noticed in the stream, and which of them a later one supersedes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Noticed:
    """A change of the robot as a finding, and the stream time at which it was seen [s]."""

    seen: float
    finding: dict[str, Any]

    def taken_back(self, earlier: Sequence[Noticed]) -> list[Noticed]:
        """The earlier changes (oldest first) that this one supersedes.

        A drift supersedes earlier drifts of the same joint. A release supersedes earlier releases at the same link, and
        those grips whose total mass is nearest to the mass released: a single one, the last few, or none.
        """
        alike = [one for one in earlier if self._is_like(one)]
        if not alike or self.finding["effect"] == "drift":
            return alike
        if not self._lets_go:
            return []
        grips = [one for one in alike if not one._lets_go]
        single = [[one] for one in reversed(grips)]
        several = [grips[k:] for k in reversed(range(len(grips) - 1))]
        gone = min([*single, *several, []], key=lambda some: abs(sum(one._mass for one in some) - self._mass))
        return [*(one for one in alike if one._lets_go), *gone]

    def _is_like(self, other: Noticed) -> bool:
        return all(self.finding[key] == other.finding[key] for key in ("effect", "joint", "link"))

    @property
    def _lets_go(self) -> bool:
        return self.finding["effect"] == "payload" and "start" not in self.finding["parameters"]

    @property
    def _mass(self) -> float:
        """Mass gripped or released [kg]."""
        return float(self.finding["parameters"]["mass"]["value"])


def still_told(told: Sequence[Noticed], changes: Sequence[Noticed]) -> list[Noticed]:
    """Earlier and new changes, oldest first, without those that one of the new ones supersedes."""
    left = list(told)
    for change in changes:
        gone = {id(one) for one in change.taken_back(left)}
        left = [*(one for one in left if id(one) not in gone), change]
    return left
