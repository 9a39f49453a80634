"""Collects serialized JointStates into arrays, from any number of publishers and in any order of joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from bdnn_ros.bags.cdr import Layout, MalformedMessage, joint_state_layout
from bdnn_ros.stamps import DENSER, FEW_TURNS, RESTART

BLOCK = 4096
"""Messages that are decoded together: large enough for NumPy, small enough for memory."""


class Block(NamedTuple):
    """Some messages: arrival, log, stamp (K,); position, velocity, effort (K, n), None for an empty field."""

    arrival: np.ndarray
    log: np.ndarray
    stamp: np.ndarray
    position: np.ndarray
    velocity: np.ndarray | None
    effort: np.ndarray | None


@dataclass(frozen=True)
class Samples:
    """Joint states in the order of arrival.

    Attributes:
        joints: n joint names.
        log, stamp: time of recording and of the header, (N,) int64 [ns].
        position, velocity, effort: (N, n), NaN where a message left it empty; None where all did.
        epoch: what the clock reads at time 0 of a recording that is made of them [ns].
    """

    joints: tuple[str, ...]
    log: np.ndarray
    stamp: np.ndarray
    position: np.ndarray
    velocity: np.ndarray | None
    effort: np.ndarray | None
    epoch: int = 0

    def __len__(self) -> int:
        return len(self.stamp)

    def part(self, rows: np.ndarray | slice) -> Samples:
        """The samples of these rows, (N,) bool, indices or a slice."""
        return replace(
            self,
            log=self.log[rows],
            stamp=self.stamp[rows],
            position=self.position[rows],
            velocity=None if self.velocity is None else self.velocity[rows],
            effort=None if self.effort is None else self.effort[rows],
        )


@dataclass
class _Group:
    """Messages with the same joints, in whatever order."""

    joints: tuple[str, ...]
    blocks: list[Block] = field(default_factory=list)

    def __len__(self) -> int:
        return sum(len(block.stamp) for block in self.blocks)


class JointStates:
    """The JointStates of a topic, grouped by the joints that they name.

    Attributes:
        count: messages so far.
        malformed: why messages are left out whose fields do not fit together, one each.
        nameless: messages left out because they name no joint or hold no position.
    """

    def __init__(self) -> None:
        self.count = 0
        self.malformed: list[MalformedMessage] = []
        self.nameless = 0
        self._pending: list[tuple[int, bytes]] = []
        self._layouts: dict[int, list[Layout]] = {}
        self._groups: dict[frozenset[str], _Group] = {}

    def add(self, log: int, data: bytes) -> None:
        """Add one message: its log time [ns] and its bytes."""
        self._pending.append((log, data))
        self.count += 1
        if len(self._pending) == BLOCK:
            self.flush()

    def flush(self) -> None:
        """Decode the pending messages."""
        pending, self._pending = self._pending, []
        first = self.count - len(pending)
        by_size: dict[int, list[int]] = {}
        for index, (_, data) in enumerate(pending):
            by_size.setdefault(len(data), []).append(index)
        for size, indices in by_size.items():
            rows = np.frombuffer(b"".join(pending[k][1] for k in indices), np.uint8).reshape(-1, size)
            logs = np.array([pending[k][0] for k in indices], np.int64)
            self._decode(rows, logs, first + np.array(indices))

    def _decode(self, rows: np.ndarray, logs: np.ndarray, arrival: np.ndarray) -> None:
        """Decode messages of one size: those of a known layout together; the first that fits none defines a new one."""
        known = self._layouts.setdefault(rows.shape[1], [])
        tried = 0
        while len(rows):
            if tried == len(known):
                try:
                    known.append(joint_state_layout(rows[0].tobytes()))
                except MalformedMessage as error:
                    self.malformed.append(error)
                    rows, logs, arrival = rows[1:], logs[1:], arrival[1:]
                    continue
            layout = known[tried]
            match = layout.matches(rows)
            if match.all():
                self._store(layout, rows, logs, arrival)
                return
            if match.any():
                self._store(layout, rows[match], logs[match], arrival[match])
                rows, logs, arrival = rows[~match], logs[~match], arrival[~match]
            tried += 1

    def _store(self, layout: Layout, rows: np.ndarray, logs: np.ndarray, arrival: np.ndarray) -> None:
        position = layout.values(rows, layout.position)
        if position is None:
            self.nameless += len(rows)
            return
        group = self._groups.setdefault(frozenset(layout.names), _Group(layout.names))
        order = [layout.names.index(name) for name in group.joints]

        def arranged(values: np.ndarray | None) -> np.ndarray | None:
            return None if values is None else values[:, order]

        velocity = arranged(layout.values(rows, layout.velocity))
        effort = arranged(layout.values(rows, layout.effort))
        stamps = layout.stamps(rows)
        group.blocks.append(Block(arrival, logs, stamps, position[:, order], velocity, effort))

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints, in the order of first appearance."""
        return tuple(dict.fromkeys(name for group in self._groups.values() for name in group.joints))

    @property
    def groups(self) -> list[tuple[str, ...]]:
        """The sets of joints that come together, those with the most data first."""
        groups = sorted(self._groups.values(), key=lambda group: len(group) * len(group.joints), reverse=True)
        return [group.joints for group in groups]

    @property
    def usable(self) -> int:
        """Number of messages with positions."""
        return self.count - len(self.malformed) - self.nameless

    def together(self, joints: Sequence[str]) -> list[tuple[str, ...]]:
        """The joints split into parts that come in the same messages, the largest part first."""
        left = [joint for joint in joints if any(joint in names for names in self._groups)]
        parts = []
        while left:
            held = max(self.groups, key=lambda names: len({*left} & {*names}))
            parts.append(tuple(joint for joint in left if joint in held))
            left = [joint for joint in left if joint not in held]
        return parts

    def samples(self, parts: Sequence[Sequence[str]]) -> list[Samples]:
        """For each part, the messages that contain all its joints, in this order; frees the collected data.

        Messages with further joints count as well, unless two publishers send the same joints: then only one of them is
        taken, the one that fills the effort, or else the velocity, or else sent most.
        """
        found = [self._samples(joints) for joints in parts]
        self._groups = {}
        return found

    def _samples(self, joints: Sequence[str]) -> Samples:
        wanted = frozenset(joints)
        held: dict[tuple[bool, bool, frozenset[str]], list[Block]] = {}
        for names, group in self._groups.items():
            for block in group.blocks if wanted <= names else ():
                holds = block.effort is not None, block.velocity is not None, names
                held.setdefault(holds, []).append(_columns(block, group.joints, joints))
        joined = [(holds[:2], _joined(blocks)) for holds, blocks in held.items()]
        joined.sort(key=lambda part: (part[0], len(part[1].stamp)), reverse=True)
        parts = [part for _, part in joined]
        kept = _joined(parts)
        if len(parts) > 1 and _twofold(parts):
            kept = parts[0]
        return Samples(tuple(joints), kept.log, kept.stamp, kept.position, kept.velocity, kept.effort)


def _twofold(parts: Sequence[Block]) -> bool:
    """Whether the stamps of blocks interleave, as from several publishers, instead of filling each other's gaps.

    The criterion is the step from one block to the other: within one publisher it is as long as any step, apart from stray
    stamps.

    Args:
        parts: messages that hold other joints or fields each.
    """
    order = np.argsort(np.concatenate([part.arrival for part in parts]))
    stamp = np.concatenate([part.stamp for part in parts])[order]
    source = np.repeat(range(len(parts)), [len(part.stamp) for part in parts])[order]
    most = max(parts, key=lambda part: len(part.stamp))
    own = most.stamp
    if not stamp.any():
        stamp, own = np.concatenate([part.log for part in parts])[order], most.log
    if len(own) < 2:
        return False
    usual = float(np.median(np.diff(own)))
    given = stamp != 0
    steps = np.diff(stamp[given])[np.diff(source[given]) != 0]
    if len(steps) < FEW_TURNS:  # parts that follow one another, but for a clock that is of another publisher
        return bool((steps < -RESTART * usual).any())
    return bool(np.mean(np.clip(steps, -usual, usual)) < DENSER * usual)


def _columns(block: Block, has: Sequence[str], wanted: Sequence[str]) -> Block:
    """The block with only the wanted joints."""
    order = [has.index(name) for name in wanted]
    return block._replace(
        position=block.position[:, order],
        velocity=None if block.velocity is None else block.velocity[:, order],
        effort=None if block.effort is None else block.effort[:, order],
    )


def _joined(blocks: Sequence[Block]) -> Block:
    """Blocks merged in the order of arrival; NaN for a field that some leave empty."""
    arrival = np.concatenate([block.arrival for block in blocks])
    order = slice(None) if (np.diff(arrival) > 0).all() else np.argsort(arrival)

    def column(values: Sequence[np.ndarray | None]) -> np.ndarray | None:
        if all(v is None for v in values):
            return None
        empty = (np.full_like(block.position, np.nan) for block in blocks)
        return np.concatenate([e if v is None else v for v, e in zip(values, empty, strict=True)])[order]

    return Block(
        arrival[order],
        np.concatenate([block.log for block in blocks])[order],
        np.concatenate([block.stamp for block in blocks])[order],
        np.concatenate([block.position for block in blocks])[order],
        column([block.velocity for block in blocks]),
        column([block.effort for block in blocks]),
    )
