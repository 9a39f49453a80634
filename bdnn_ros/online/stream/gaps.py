"""Counts samples that never came, from the steps between the stamps of those that did."""

from __future__ import annotations

import threading
from typing import NamedTuple

import numpy as np

BLOCK = 64
"""Steps between stamps that are looked at together."""
ENOUGH = 16
"""Steps of the first block that tell the period before it is full."""
GAP, SHORT = 1.5, 0.75
"""A step of more periods than this is a gap, one of fewer catches up with a step that was late."""
SURE, PATIENCE = 0.2, 8
"""What is owed is missing once the stamps are ahead by as many periods within this, or after so many steps."""


class Late(NamedTuple):
    """A gap whose samples may still come, or that is due to jitter of the stamps.

    Attributes:
        owed: samples that may be missing.
        ahead: periods by which the stamps are ahead of the samples, since the one before the gap.
        waited: steps since the gap that did not catch up.
    """

    owed: int = 0
    ahead: float = 0.0
    waited: int = 0


NONE = Late()


class Gaps:
    """Counts missing samples, without those that came and were refused.

    A refused sample fills the gap in which its stamp lies, or if the stamp says nothing, a gap between the samples accepted
    before and after it. One thread counts while another may read.

    Attributes:
        period: median step of the last full block [ns]; 0 before there is one.
    """

    def __init__(self) -> None:
        self.period = 0.0
        self._turn = threading.Lock()
        self._steps = np.zeros(BLOCK, np.int64)
        self._refused = np.zeros(BLOCK, np.int64)
        self._filled = 0
        self._joined = 0  # steps before this one lie before a pause
        self._since = 0  # refused since the last accepted sample
        self._counted = 0
        self._late = NONE  # of a gap at the end of the last block: the next samples may catch up

    @property
    def missing(self) -> int:
        """Number of samples missing so far; a gap counts once a later sample shows that it was not only a delay."""
        with self._turn:
            steps, refused = self._steps[: self._filled].copy(), self._refused[: self._filled].copy()
            usual, counted, late = self._usual(), self._counted, self._late
        if usual == 0.0 or len(steps) == 0 or np.median(steps) > GAP * usual:
            return counted  # whether these are gaps or another rate, the whole block will tell
        return counted + _missing(steps, refused, usual, late)[0]

    def add(self, step: int) -> None:
        """A sample was accepted `step` [ns] after the one before."""
        with self._turn:
            self._steps[self._filled] = step
            self._refused[self._filled] = self._since
            self._since = 0
            self._filled += 1
            if self._filled == BLOCK:
                self.period = float(np.median(self._steps))
                found, self._late = _missing(self._steps, self._refused, self.period, self._late)
                self._counted += found
                self._filled = self._joined = 0

    def pause(self) -> None:
        """Ignore the step to the next sample."""
        with self._turn:
            self._since = 0
            self._joined = self._filled

    def refuse(self, back: int) -> None:
        """A sample was refused whose stamp lies `back` [ns] before the last accepted one."""
        with self._turn:
            if back <= 0 or not self._stands_for(back):
                self._since += 1

    def _stands_for(self, back: int) -> bool:
        """Whether the refused sample fills the gap that its stamp lies in."""
        ends = np.cumsum(self._steps[self._joined : self._filled][::-1])
        place = int(np.searchsorted(ends, back))
        row = self._filled - 1 - place
        if place == len(ends):
            owed, ahead, waited = self._late
            if owed:  # too late, for the gap at the end of the last block
                self._late = Late(owed - 1, ahead - 1.0, waited)
            return owed > 0
        inside = back != ends[place] and self._steps[row] > GAP * self._usual() > 0.0
        self._refused[row] += inside
        return bool(inside)

    def _usual(self) -> float:
        """Usual step [ns]; 0 while it is not known."""
        if self.period or self._filled < ENOUGH:
            return self.period
        return float(np.median(self._steps[: self._filled]))


def _missing(steps: np.ndarray, refused: np.ndarray, period: float, late: Late) -> tuple[int, Late]:
    """Number of samples missing in some steps, and the gap that later steps may still close.

    Args:
        late: the same, of the steps before.
    """
    if late.owed == 0 and steps.max() <= GAP * period:
        return 0, NONE
    missing = 0
    owed, ahead, waited = late
    for step, known in zip(steps.tolist(), refused.tolist(), strict=True):
        if step > GAP * period:
            ahead = (ahead if owed else 0.0) + step / period - 1 - known
            owed, waited = max(round(ahead), 0), 0
        elif owed:
            ahead += step / period - 1 - known
            owed = max(min(owed, round(ahead)), 0)
            if step >= SHORT * period:  # else the next ones catch up
                waited += 1
                if waited == PATIENCE or abs(ahead - owed) < SURE:
                    missing, owed = missing + owed, 0
    return missing, Late(owed, ahead, waited)
