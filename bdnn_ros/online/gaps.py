"""How many samples of a stream never came, by the steps between the stamps of those that did."""

from __future__ import annotations

import numpy as np

BLOCK = 64
"""Steps between stamps that are looked at together."""
ENOUGH = 16
"""Steps of the first block that tell the period before it is full."""
GAP, SHORT = 1.5, 0.5
"""A step of more periods than this is a gap, one of fewer catches up with a step that was late."""


class Gaps:
    """Counts what is missing, without what came and was refused.

    A refused sample stands for the missing one of the gap that its stamp lies in; where its stamp says nothing,
    for one between the samples that were accepted before and after it.

    Attributes:
        period: median step of the last full block [ns]; 0 before there is one.
    """

    def __init__(self) -> None:
        self.period = 0.0
        self._steps = np.zeros(BLOCK, np.int64)
        self._refused = np.zeros(BLOCK, np.int64)
        self._filled = 0
        self._joined = 0  # steps before this one lie before a pause
        self._since = 0  # refused since the last accepted sample
        self._counted = 0
        self._owed = 0  # of a gap that ended the last block: the next samples may catch up

    @property
    def missing(self) -> int:
        """Samples missing so far; those of a gap once a sample after it shows that it was not just late."""
        steps, refused = self._steps[: self._filled].copy(), self._refused[: self._filled].copy()
        usual = self._usual()
        if usual == 0.0 or len(steps) == 0 or np.median(steps) > GAP * usual:
            return self._counted  # whether these are gaps or another rate, the whole block will tell
        return self._counted + _missing(steps, refused, usual, self._owed)[0]

    def add(self, step: int) -> None:
        """A sample was accepted so long after the one before [ns]."""
        self._steps[self._filled] = step
        self._refused[self._filled] = self._since
        self._since = 0
        self._filled += 1
        if self._filled == BLOCK:
            self.period = float(np.median(self._steps))
            found, self._owed = _missing(self._steps, self._refused, self.period, self._owed)
            self._counted += found
            self._filled = self._joined = 0

    def pause(self) -> None:
        """The next sample is not joined to those before."""
        self._since = 0
        self._joined = self._filled

    def refuse(self, back: int) -> None:
        """A sample was refused whose stamp lies so long before that of the last accepted one [ns]."""
        if back > 0:
            ends = np.cumsum(self._steps[self._joined : self._filled][::-1])
            place = int(np.searchsorted(ends, back))
            row = self._filled - 1 - place
            if place == len(ends):
                if self._owed:  # late for the gap that ended the last block
                    self._owed -= 1
                    return
            elif back != ends[place] and self._steps[row] > GAP * self._usual() > 0.0:
                self._refused[row] += 1
                return
        self._since += 1

    def _usual(self) -> float:
        """Usual step [ns]; 0 where nothing says yet."""
        if self.period or self._filled < ENOUGH:
            return self.period
        return float(np.median(self._steps[: self._filled]))


def _missing(steps: np.ndarray, refused: np.ndarray, period: float, owed: int) -> tuple[int, int]:
    """Samples missing in some steps, and those that the next ones may still make up for.

    Args:
        owed: the same, of the steps before.
    """
    if owed == 0 and steps.max() <= GAP * period:
        return 0, 0
    missing = 0
    for step, known in zip(steps.tolist(), refused.tolist(), strict=True):
        if step > GAP * period:
            missing += owed
            owed = max(round(step / period) - 1 - known, 0)
        elif step < SHORT * period and owed:  # late, not lost: the next ones catch up
            owed -= 1
        else:
            missing, owed = missing + owed, 0
    return missing, owed
