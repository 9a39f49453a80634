"""Merges joint states whose joints come in several messages, as from several controllers, by their stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.bags.joint_states import Samples
from bdnn_ros.errors import BagError, listed
from bdnn_ros.recording import GAP_FACTOR
from bdnn_ros.signals import usual_cutoff
from bdnn_ros.signals.wraps import between
from bdnn_ros.stamps import runs

COINCIDE = 0.02
"""Stamps closer than this share of the shorter period are of the same moment."""
LEAST_KNOWN = 0.5
"""A stream that is there for less than this share of the samples, or of those that others leave, is not put to them."""
RATE_PER_CUTOFF = 3.0
"""Nor is one with fewer samples to a period of the low-pass's cut-off: between them nothing is known."""


@dataclass(frozen=True)
class _Places:
    """Positions of stamps among those of another stream.

    Attributes:
        before, after: rows of the other stream, (N,).
        share: of the way from one to the other, (N,), 0 or 1 where a stamp coincides with theirs.
        known: where the other stream is there, (N,) bool.
    """

    before: np.ndarray
    after: np.ndarray
    share: np.ndarray
    known: np.ndarray

    def of(self, values: np.ndarray | None) -> np.ndarray | None:
        """The other stream's values (M, k) at these stamps, (N, k), interpolated linearly; NaN where it has no data."""
        if values is None:
            return None
        before, after = values[self.before], values[self.after]
        return self._found(before, after, before + self.share[:, None] * (after - before))

    def of_position(self, position: np.ndarray) -> np.ndarray:
        """The same for positions, taking care of wrapped angles: a jump by a turn is not interpolated."""
        before, after = position[self.before], position[self.after]
        return self._found(before, after, between(before, after, self.share[:, None], position))

    def _found(self, before: np.ndarray, after: np.ndarray, interpolated: np.ndarray) -> np.ndarray:
        share = self.share[:, None]
        values = np.where(share == 0.0, before, np.where(share == 1.0, after, interpolated))
        return np.where(self.known[:, None], values, np.nan)


def together(
    name: str,
    parts: Sequence[Samples],
    joints: Sequence[str],
    *,
    needed: bool,
    measured: bool,
    every: bool = False,
) -> tuple[Samples, list[str]]:
    """The samples of the first part, completed with the other parts.

    Where stamps do not coincide, the others' values are interpolated, except over gaps: there the samples of the first part
    are dropped.

    Args:
        parts: of different joints.
        joints: their order in the result.
        needed: all joints must be there; otherwise parts that do not fit are left out with a note.
        measured: parts without effort do not fit to a first part with effort.
        every: leave out no sample of the first part; the others' values are NaN where they are not there.

    Raises:
        BagError: joints that are needed cannot be put together.
    """
    first, *others = parts
    known = np.ones(len(first), bool)
    notes, found = list[str](), list[tuple[Samples, _Places]]()
    for other in others:
        places = _places(first.stamp, other.stamp)
        problem = _problem(first, other, places, needed, measured) or _apart(places, known, found)
        if problem and needed:
            raise BagError(
                f"{name}: no message holds {listed(joints, 20)} together, "
                f"and those that hold {listed(other.joints)} come {problem}.",
                "Choose joints of one message with --joints.",
            )
        if places is None or problem:
            notes.append(f"{name}: messages of their own hold {listed(other.joints)}, {problem}; left out.")
            continue
        known &= places.known
        found.append((other, places))
        notes.append(f"{name}: messages of their own hold {listed(other.joints)}; {_how(other, places)}.")
    if not known.all():
        notes.append(
            f"{name}: {np.count_nonzero(~known)} of {len(known)} joint states of {listed(first.joints)} "
            f"have no others beside them{'' if every else '; left out'}."
        )
    merged = _merged(first, found, joints)
    return merged if every else merged.part(known), notes


def _merged(first: Samples, others: Sequence[tuple[Samples, _Places]], joints: Sequence[str]) -> Samples:
    """All joints of the parts, in this order, at the stamps of the first part."""
    if not others:
        return first
    names = [*first.joints, *(joint for other, _ in others for joint in other.joints)]
    chosen = [joint for joint in joints if joint in names]
    order = [names.index(joint) for joint in chosen]

    def column(field: str) -> np.ndarray | None:
        values = [getattr(first, field), *(places.of(getattr(other, field)) for other, places in others)]
        if all(value is None for value in values):
            return None
        widths = [len(first.joints), *(len(other.joints) for other, _ in others)]
        empty = [np.full((len(first), width), np.nan) for width in widths]
        return np.concatenate([e if v is None else v for v, e in zip(values, empty, strict=True)], axis=1)[
            :, order
        ]

    positions = [first.position, *(places.of_position(other.position) for other, places in others)]
    position = np.concatenate(positions, axis=1)[:, order]
    return Samples(tuple(chosen), first.log, first.stamp, position, column("velocity"), column("effort"))


def _problem(
    first: Samples, other: Samples, places: _Places | None, needed: bool, measured: bool
) -> str | None:
    """Why a stream cannot be merged with the first one; empty if it can."""
    if places is None:
        return "by a clock that is set back at other times"
    if np.mean(places.known) < LEAST_KNOWN:
        return "at other times"
    if needed:
        return None
    if _rate(other) < RATE_PER_CUTOFF * usual_cutoff(_rate(first)):
        return f"too rarely ({_rate(other):.3g} Hz)"
    if measured and _has_effort(first) and not _has_effort(other):
        return "without effort"
    return None


def _apart(places: _Places | None, known: np.ndarray, found: Sequence[tuple[Samples, _Places]]) -> str | None:
    """Why a stream does not overlap with the samples that the streams merged so far leave, (N,) bool."""
    if places is None or not known.any() or np.mean(places.known[known]) >= LEAST_KNOWN:
        return None
    apart = [other for other, theirs in found if np.mean(places.known[theirs.known]) < LEAST_KNOWN]
    others = apart or [other for other, _ in found]
    return f"at other times than those of {listed(joint for other in others for joint in other.joints)}"


def _how(other: Samples, places: _Places) -> str:
    interpolated = places.known & (places.share > 0.0) & (places.share < 1.0)
    if 2 * np.count_nonzero(interpolated) < np.count_nonzero(places.known):
        return "they are put to the others of the same stamp"
    return f"from {_rate(other):.4g} Hz they are interpolated at the stamps of the others"


def _has_effort(samples: Samples) -> bool:
    return samples.effort is not None and bool(np.nan_to_num(samples.effort).any())


def _rate(samples: Samples) -> float:
    """Samples per second [Hz]; 0 with fewer than two."""
    steps = np.diff(samples.stamp)
    steps = steps[steps > 0]
    return 1e9 / float(np.median(steps)) if len(steps) else 0.0


def _places(stamps: np.ndarray, others: np.ndarray) -> _Places | None:
    """Positions of stamps among others, clock by clock; None if the clocks were not reset equally often."""
    rows, clocks = _clocks(stamps)
    other_rows, other_clocks = _clocks(others)
    if len(clocks) != len(other_clocks):
        return None
    parts = []
    for (start, stop), (other_start, other_stop) in zip(clocks, other_clocks, strict=True):
        own = slice(rows[start] if start else 0, rows[stop] if stop < len(rows) else len(stamps))
        parts.append(_among(stamps[own], others, other_rows[other_start:other_stop]))
    return _Places(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _clocks(stamps: np.ndarray) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Rows with increasing stamps, and the ranges of these that belong to one clock each."""
    fresh = np.flatnonzero(np.append(True, stamps[1:] != stamps[:-1])[: len(stamps)])
    kept, starts = runs(stamps[fresh])
    edges = [*np.searchsorted(np.flatnonzero(kept), starts).tolist(), np.count_nonzero(kept)]
    return fresh[kept], list(zip(edges[:-1], edges[1:], strict=True))


def _among(
    stamps: np.ndarray, others: np.ndarray, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The columns of `_Places` for stamps (N,) among the increasing ones of some rows of `others`."""
    if len(rows) < 2:
        nowhere = np.zeros(len(stamps), int)
        return nowhere, nowhere, np.zeros(len(stamps)), np.zeros(len(stamps), bool)
    increasing = others[rows]
    period = float(np.median(np.diff(increasing)))
    close = COINCIDE * min(period, float(np.median(np.abs(np.diff(stamps)))) if len(stamps) > 1 else period)
    after = np.clip(np.searchsorted(increasing, stamps), 1, len(rows) - 1)
    step = increasing[after] - increasing[after - 1]
    since = (stamps - increasing[after - 1]).astype(float)
    with_before = np.abs(since) <= close
    with_after = np.abs(since - step) <= close
    share = np.where(with_before, 0.0, np.where(with_after, 1.0, since / step))
    inside = (share >= 0.0) & (share <= 1.0)
    known = with_before | with_after | (inside & (step <= GAP_FACTOR * period))
    return rows[after - 1], rows[after], share, known
