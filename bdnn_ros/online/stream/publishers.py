"""Two publishers on one topic: tells them apart by fields and stamps, and takes only one of them."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import NamedTuple

from bdnn_ros.errors import listed
from bdnn_ros.online.stream.assembly import Group
from bdnn_ros.stamps import DENSER, FEW_TURNS

PATIENCE = 1_000_000_000
"""Where nothing came for so long [ns] of what is taken, something else is."""
RECENT = 15
"""Steps between stamps whose median is the usual one."""
TURNS = 16
"""Steps from one publisher's stamp to another's follow the last about so many."""
FASTER = 1.5
"""Of two that hold the same fields, the one that sends so many times as often is taken."""
MOST = 16
"""Kinds of messages that are remembered; beyond that, all but the one that is taken are learned anew."""


class Holding(NamedTuple):
    """What the messages of one publisher have in common.

    Attributes:
        group: their joints; None of those that were put together.
        effort, velocity: whether these are filled.
    """

    group: Group | None
    effort: bool
    velocity: bool

    def beside(self, taken: Holding) -> str:
        """The words that distinguish the messages left out from those taken."""
        for field in ("effort", "velocity"):
            if getattr(taken, field) and not getattr(self, field):
                return f"without {field}"
        if self.group is not None and taken.group is not None:
            more = sorted({*self.group.latest[0]} - {*taken.group.latest[0]})
            if more:
                return f"that hold {listed(more)}, too,"
        return "that come less often or began later"


class _Stream:
    """The messages with one set of fields.

    Attributes:
        stamp, sent: of the latest [ns].
        turns: steps between a stamp of this stream and one of the stream that is taken.
        share: mean of these steps over the usual one: 1 of one publisher, half of two.
        open: nothing that is taken came since the latest.
    """

    __slots__ = ("_spans", "_steps", "holding", "open", "sent", "share", "stamp", "turns")

    def __init__(self, holding: Holding) -> None:
        self.holding = holding
        self.stamp = self.sent = self.turns = 0
        self.share = 1.0
        self.open = False
        self._steps: deque[int] = deque(maxlen=RECENT)
        self._spans: deque[int] = deque(maxlen=RECENT)

    @property
    def period(self) -> float:
        """Usual step between its stamps [ns]; infinite before there is one."""
        steps = self._steps or self._spans
        return median(steps) if steps else float("inf")

    def came(self, stamp: int, sent: int, since: bool) -> None:
        """Count a message; `since`: others came after the last one, and a stream that fills gaps has longer steps."""
        if self.stamp < stamp and self.sent:
            (self._spans if since else self._steps).append(stamp - self.stamp)
        self.stamp, self.sent = stamp, sent

    def turn(self, step: int, usual: float) -> None:
        """Record a step [ns] between this stream and the other one."""
        if usual < float("inf"):
            self.turns += 1
            self.share += (min(max(step / usual, -1.0), 1.0) - self.share) / min(self.turns, TURNS)

    def better(self, other: _Stream) -> bool:
        """Whether this stream is to be preferred: a driver fills more fields than a republisher or a made-up stream."""
        mine, theirs = self.holding[1:], other.holding[1:]
        return mine > theirs or (mine == theirs and FASTER * self.period < other.period)


class Publishers:
    """Takes the samples of one publisher, whatever fields its messages have, and leaves out those of a second one.

    A publisher that sometimes omits a field fills gaps in its own stamps; the stamps of a second one lie in between.

    Attributes:
        complaint: who is left out, and what to do; empty if nobody ever was.
    """

    def __init__(self) -> None:
        self.complaint = ""
        self._streams: dict[Holding, _Stream] = {}
        self._taken: _Stream | None = None

    def takes(self, holding: Holding, stamp: int, sent: int) -> bool:
        """Whether to take a sample with these fields, stamp [ns] and time of sending [ns]."""
        stream = self._streams.get(holding) or self._new(holding)
        taken = self._taken = self._taken or stream
        if stream is taken:
            beside = [other for other in self._streams.values() if other.open]
            for other in beside:
                other.turn(stamp - other.stamp, min(other.period, taken.period))
                other.open = False
            since, joins = bool(beside), True
        else:
            since, joins = not stream.open, self._joins(stream, taken, stamp, sent)
        stream.came(stamp, sent, since)
        return joins

    def _joins(self, stream: _Stream, taken: _Stream, stamp: int, sent: int) -> bool:
        """Whether another stream comes from the same publisher, or is to be taken instead."""
        if not stream.open:
            stream.turn(stamp - taken.stamp, min(stream.period, taken.period))
            stream.open = True
        single = stream.share >= DENSER
        if sent - taken.sent > PATIENCE or (not single and stream.better(taken)):
            taken.share, taken.turns = stream.share, stream.turns
            stream.open = taken.open = False
            self._taken = stream
            return True
        if not single and stream.turns >= FEW_TURNS:
            self.complaint = (
                f"Two publishers send the same joints: joint states {stream.holding.beside(taken.holding)} are left "
                "out. Stop their publisher, as a joint_state_publisher beside the driver, or remap its topic."
            )
        return single

    def _new(self, holding: Holding) -> _Stream:
        if len(self._streams) >= MOST:
            self._streams = {kept.holding: kept for kept in [self._taken] if kept is not None}
        stream = self._streams[holding] = _Stream(holding)
        return stream
