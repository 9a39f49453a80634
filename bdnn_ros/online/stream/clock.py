"""Stream time: strictly increasing, whatever the stamps of the samples do."""

from __future__ import annotations

from bdnn_ros.online.stream.gaps import Gaps

PAUSE = 1_000_000_000
"""A step of the stamps longer than this [ns], either way, is a pause or a new clock, not a loss."""
LONGEST = 3600 * PAUSE
"""A pause moves stream time on by no more than this [ns], however far the stamps go on."""
BACKWARDS_LIMIT = 20
"""So many samples in a row that go back by less than a `PAUSE` are a new clock too."""
SINCE_ZERO = 100_000_000 * PAUSE
"""A clock that shows less than this [ns], three years, began at zero, as a simulation's does; it may show zero again."""
NONE = -1
"""No stream time: the sample is refused."""


class Clock:
    """Maps stamps that may jump to strictly increasing stream time, and counts the samples that gaps show as lost.

    Attributes:
        pauses: steps longer than `PAUSE`.
        restarts: times the clock jumped back.
    """

    def __init__(self) -> None:
        self.pauses = 0
        self.restarts = 0
        self._gaps = Gaps()
        self._stamp = self._latest = 0
        self._time = 0
        self._backwards = 0
        self._jumped = NONE

    @property
    def lost(self) -> int:
        """Number of samples that gaps between stamps show as missing and that were not refused."""
        return self._gaps.missing

    @property
    def period(self) -> float:
        """Usual step between stamps [ns]; 0 before it is known."""
        return self._gaps.period

    @property
    def since_zero(self) -> bool:
        """Whether the stamps come from a clock that started at zero, as in simulation."""
        return 0 < self._stamp < SINCE_ZERO

    def advance(self, stamp: int) -> int:
        """Stream time of a sample with this stamp [ns], or `NONE` if the stamp repeats or goes back without a clock reset."""
        step = stamp - self._stamp
        if self._time == 0:
            self._gaps.pause()
            self._stamp = self._latest = self._time = stamp
            return stamp
        if 0 < step <= PAUSE:
            self._gaps.add(step)
        elif step > PAUSE:
            self.pauses += 1
            self._gaps.pause()
            # up to the latest stamp an earlier clock is back, as of two publishers with one each
            step = min(max(stamp - self._latest, 2 * PAUSE), LONGEST)
        elif step == 0:
            return NONE  # the same message again, or a clock that stands still: none that goes back
        else:
            self._backwards += 1
            jumped, self._jumped = self._jumped, stamp if step <= -PAUSE else NONE
            # one alone may be a message that was held up: the next of a new clock goes on from it
            anew = NONE < jumped < self._jumped
            if not anew and self._backwards < BACKWARDS_LIMIT:
                return NONE
            self.restarts += 1
            self._gaps.pause()
            step = 2 * PAUSE  # what follows a new clock is never joined to what was before
        self._backwards, self._jumped = 0, NONE
        self._stamp, self._latest = stamp, max(stamp, self._latest)
        self._time += step
        return self._time

    def began_at_zero(self) -> None:
        """Note that the stamp of the first sample was truly zero, whatever was used in its place."""
        self._stamp = self._latest = 0

    def refuse(self, stamp: int) -> None:
        """Note a sample that came but was left out, with its stamp [ns] or `NONE`: it does not count as lost."""
        self._gaps.refuse(self._stamp - stamp if stamp > NONE else 0)
