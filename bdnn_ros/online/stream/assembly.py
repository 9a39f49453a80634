"""Merges messages that each hold only some of the joints, as from several controllers, into samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

MOST_KINDS = 64
"""Kinds of messages that are remembered; beyond that, all are learned anew."""
SMOOTHING = 8
"""The usual step between stamps follows the last about so many."""
BARE_LIMIT = 20
"""So many messages in a row without a stamp are of a driver that gives none, whatever came before."""


class Group:
    """Joints that are published together, in whatever order.

    Attributes:
        members: which of the joints in use they are, one bit each.
        messages: how many came.
        period: usual step between their stamps [ns]; 0 before there is one.
        latest: names and efforts of the last message.
        paired: messages of theirs have made samples together with others.
    """

    __slots__ = ("_bare", "_stamp", "_stamped", "latest", "members", "messages", "paired", "period")

    def __init__(self, members: int) -> None:
        self.members = members
        self.messages = 0
        self.period = 0.0
        self.latest: tuple[Sequence[str], Any] = ((), ())
        self.paired = False
        self._stamp = 0
        self._stamped = False
        self._bare = 0

    def bare(self) -> bool:
        """Count a message without a stamp; returns whether the messages of this group otherwise have one."""
        self._bare += 1
        return self._stamped and self._bare < BARE_LIMIT

    def stamped(self) -> None:
        """Note that a message with a stamp came."""
        self._stamped, self._bare = True, 0

    def came(self, names: Sequence[str], effort: Any, stamp: int) -> None:
        """Count a message with this stamp [ns]."""
        self.messages += 1
        self.latest = names, effort
        step = stamp - self._stamp
        if step > 0 and self._stamp:
            # a pause must not make the period long: stale values would be taken for simultaneous ones
            usual = self.period or step
            self.period = usual + (min(step, 2.0 * usual) - usual) / SMOOTHING
        self._stamp = stamp


class Kind:
    """Messages with the same names in the same order.

    Attributes:
        names: all names.
        group: what they are counted under.
        joints: places of the joints in use that they hold, in the order in use, (m,).
        index: places of these in the message, (m,).
        whole: they hold all joints in use.
        foreign: they hold none of them.
        unusable: a name is repeated, or there is none.
    """

    __slots__ = ("foreign", "group", "index", "joints", "names", "unusable", "whole")

    def __init__(self, names: Sequence[str], used: Sequence[str], group: Group) -> None:
        order = {name: k for k, name in enumerate(names)}
        self.names = list(names)
        self.group = group
        self.joints = np.array([k for k, name in enumerate(used) if name in order], int)
        self.index = np.array([order[used[k]] for k in self.joints], int)
        self.unusable = len(order) < len(names) or not names
        self.whole = len(self.joints) == len(used)
        self.foreign = len(self.joints) == 0 and len(names) > 0


class Kinds:
    """The kinds of messages that came, and their groups.

    Args:
        used: names of the joints in use.
    """

    def __init__(self, used: Sequence[str]) -> None:
        self._used = tuple(used)
        self._kinds: dict[tuple[str, ...], Kind] = {}
        self._groups: dict[frozenset[str], Group] = {}

    @property
    def groups(self) -> list[Group]:
        """All groups, also those without joints in use."""
        return list(self._groups.values())

    def of(self, names: Sequence[str]) -> Kind:
        """The kind of a message with these names."""
        key = tuple(names)
        kind = self._kinds.get(key)
        if kind is None:
            if len(self._kinds) >= MOST_KINDS:
                self._kinds.clear()
                self._groups.clear()
            members = sum(1 << k for k, name in enumerate(self._used) if name in names)
            group = self._groups.setdefault(frozenset(names), Group(members))
            kind = self._kinds[key] = Kind(names, self._used, group)
        return kind


class Assembly:
    """The parts of a sample that wait for the other joints.

    Parts belong together if their stamps differ by at most half the period of the slower group.

    Attributes:
        row: the newest values: position, velocity and effort of the n joints, (3, n).
        stamp: the newest stamp of what waits [ns].
    """

    def __init__(self, width: int) -> None:
        self.row = np.full((3, width), np.nan)
        self.stamp = 0
        self._all = (1 << width) - 1
        self._waiting: dict[Group, int] = {}

    def add(self, group: Group, stamp: int) -> dict[Group, int]:
        """Have a message of this group wait for the others.

        Returns:
            Those that waited and are given up, with their stamps [ns]: newer values of theirs have come, or their
            stamps are too far away.
        """
        waiting = self._waiting
        gone = {
            other: since
            for other, since in waiting.items()
            if other is group or abs(stamp - since) > 0.5 * max(group.period, other.period)
        }
        for other in gone:
            del waiting[other]
        waiting[group] = stamp
        return gone

    def take(self) -> bool:
        """Whether the sample is complete; if so, the parts are taken and nothing waits any more."""
        covered = 0
        for group in self._waiting:
            covered |= group.members
        if covered != self._all:
            return False
        self.stamp = max(self._waiting.values())
        for group in self._waiting:
            group.paired = True
        self._waiting.clear()
        return True

    def give_up(self) -> dict[Group, int]:
        """Discard what waits, and return it with the stamps [ns]."""
        waited, self._waiting = self._waiting, {}
        return waited
