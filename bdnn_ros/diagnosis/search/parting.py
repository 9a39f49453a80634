"""Splitting of pushes: a push that recurs may be found as one long push and another against it in between."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bdnn_ros.diagnosis.pushes.between import between_rows
from bdnn_ros.diagnosis.pushes.pushes import edges, within
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.search.moves import BETTER
from bdnn_ros.robot import Robot

ROUNDS = 2
"""Alternations in which the two parts are refined."""


def split_recurring(
    pool: Pool, chosen: list[int], robot: Robot, score: Callable[[Pool, Sequence[int]], float]
) -> tuple[Pool, list[int]]:
    """Replace a push, and those within its time, by one before and one after them, where that scores better.

    Args:
        score: of a set of a pool's terms, see `Moves.score`.
    """
    for inner, long in [(a, b) for a in chosen for b in chosen if within(pool.terms[a], pool.terms[b])]:
        other = _another(pool, chosen, long)
        if other is None or not {inner, long} <= set(chosen):
            continue
        kept = [c for c in chosen if c == long or not _meanwhile(pool, c, inner, long)]
        two = [*kept, other]
        trial = _parts(pool, two, (long, other), inner, robot)
        if score(trial, two) > score(pool, chosen) + BETTER:
            pool, chosen = trial, two
    return pool, chosen


def _another(pool: Pool, chosen: Sequence[int], push: int) -> int | None:
    """Another occurrence of a push at its place that is not chosen yet; None without."""
    spot = pool.terms[push].spot
    return next((c for c, term in enumerate(pool.terms) if term.spot == spot and c not in chosen), None)


def _meanwhile(pool: Pool, one: int, inner: int, long: int) -> bool:
    """Whether a push lies within the time of a long one and overlaps an inner one."""
    term = pool.terms[one]
    if not within(term, pool.terms[long]):
        return False
    (start, end), (first, last) = edges(term), edges(pool.terms[inner])
    return start < last and first < end


def _parts(pool: Pool, two: Sequence[int], parts: tuple[int, int], inner: int, robot: Robot) -> Pool:
    """The pool with a long push cut into the parts before and after an inner one, each refined from there.

    Args:
        two: the chosen with both parts.
        parts: the long push, which becomes the part before, and the part after.
    """
    push, (start, end), (first, last) = (
        pool.terms[parts[0]],
        edges(pool.terms[parts[0]]),
        edges(pool.terms[inner]),
    )
    times = (start, first), (last, end)
    each = zip(parts, times, strict=True)
    pool = pool.replacing(
        {c: pool.terms[c].shaped({**dict(push.shape), "start": a, "end": b}) for c, (a, b) in each}
    )
    for _ in range(ROUNDS):
        for part in parts:
            beside = pool.fit([c for c in two if c != part])
            pool = pool.replacing({part: between_rows(pool, beside, pool.terms[part], robot)[1]})
    return pool
