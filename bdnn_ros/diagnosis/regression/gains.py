"""What an extended model gains on held-out blocks, all of it and each effect by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.effects.base import Effect

RESAMPLES = 1000
FEWEST_PIECES = 8
"""Fewer held-out blocks than this are cut into as many pieces: a draw from one block has no width."""
MINIMUM_SHARE = 0.02
"""An effect that removes an error of this share of the effort's spread at some joint is worth a name."""
OUTSTANDING_SHARE, BRIEF_SHARE = 0.01, 0.005
"""A smaller effect, one that lasts or a brief one, is worth a name if it removes more error than is left."""
OVERSHADOWED = 0.5
"""Less than this share of what is left could as well be a part of that, and earns no name."""
ACTING = 0.25
"""Share of an effect's largest effort that says when it acts."""
LASTING = 0.5
"""A push that lasts this share of the recording is not brief."""
PASSING = 0.1
"""An effect with no more than this share of its energy in some rows acted elsewhere."""


@dataclass(frozen=True)
class Removal:
    """What an effect removes of the error at some rows.

    Attributes:
        less: mean squared error of each joint, (n,) [(N·m)²].
        noticeable: whether that is worth a name.
        there: whether it acts at these rows at all.
        brief: whether it acts for moments only.
    """

    less: np.ndarray
    noticeable: bool
    there: bool
    brief: bool


def removed(
    equations: Equations, fitted: Pool, extended: np.ndarray, *stretches: np.ndarray
) -> list[tuple[Removal, ...]]:
    """What each chosen term removes in each of some sets of rows, (R, n) bool each.

    Args:
        extended: what is left without any say of the rows that were held out, (R, n) [N·m].
    """
    left, result = fitted.left(), []
    for chosen, term in enumerate(fitted.terms):
        part = equations.columns(term) @ fitted.coefficients(fitted.whole, chosen)
        result.append(
            tuple(_removal(equations, term.effect, left, part, extended, rows) for rows in stretches)
        )
    return result


def _removal(
    equations: Equations,
    effect: Effect,
    left: np.ndarray,
    part: np.ndarray,
    extended: np.ndarray,
    rows: np.ndarray,
) -> Removal:
    """What an effect whose effort is `part` removes where `left` is left, (R, n) [N·m] each."""
    less = rms(left + part, rows) ** 2 - rms(left, rows) ** 2
    moments = acting(part)
    # what lasts moments, again and again, is worth a name by what it does in those
    where = rows & moments if effect.brief and not effect.timed else rows
    then = rms(left + part, where) ** 2 - rms(left, where) ** 2
    brief = effect.brief and (not effect.timed or float(np.mean(part.any(axis=1))) < LASTING)
    return Removal(
        less,
        noticeable(brief, then, rms(extended, where), equations.effort_scale),
        float(np.sum(part[rows & moments] ** 2)) > PASSING * float(np.sum(part[moments] ** 2)),
        brief,
    )


def share_of(part: np.ndarray, left: np.ndarray, before: np.ndarray, rows: np.ndarray) -> float:
    """Part of the squared error `before` in some rows that an effort removes where `left` is left, (R, n) each [N·m]."""
    total, without, now = (float(np.sum(values[rows] ** 2)) for values in (before, left + part, left))
    return max((without - now) / max(total, 1e-30), 0.0)


def by_links(equations: Equations, fitted: Pool, rows: np.ndarray) -> float:
    """Part of the simulation's squared error in some rows (R, n) that the links' corrections remove."""
    part = equations.rigid @ fitted.whole.coefficients[: equations.rigid.shape[2]]
    return share_of(part, fitted.left(), equations.target, rows)


def squares(mean: np.ndarray, rows: np.ndarray) -> float:
    """Sum of squares in some rows, (R, n) bool, of which each joint's mean is known, (n,): no row counts more than another."""
    return float(mean @ rows.sum(axis=0))


def acting(part: np.ndarray) -> np.ndarray:
    """Rows at which an effect's effort (R, ...) is more than a share of its largest."""
    size = np.abs(part)
    return np.asarray(size > ACTING * size.max(axis=0))


def noticeable(brief: bool, less: np.ndarray, after: np.ndarray, scale: np.ndarray) -> bool:
    """Whether what an effect removes is worth a name.

    Args:
        brief: whether it acts for moments only, so that the whole recording says little of its size.
        less: mean squared error removed, (n,) [(N·m)²].
        after: root mean square error left, (n,) [N·m].
        scale: the effort's spread, (n,) [N·m].
    """
    size = np.sqrt(np.maximum(less, 0.0))
    least = BRIEF_SHARE if brief else OUTSTANDING_SHARE
    outstanding = (size >= least * scale) & (size >= after)
    large = (size >= MINIMUM_SHARE * scale) & (size >= OVERSHADOWED * after)
    return bool((large | outstanding).any())


def gain_of(
    equations: Equations,
    extended: np.ndarray,
    held: np.ndarray,
    pushed: np.ndarray | None = None,
    before: np.ndarray | None = None,
) -> tuple[float, tuple[float, float]]:
    """1 - RMSE(extended) / RMSE(simulation) on held-out blocks, with a block-bootstrap 95 % interval.

    What moved and what was pushed is known: of each joint those blocks are drawn in which it moves, apart from those in which
    something pushes. Else most draws of a motion of one joint after another would lack the one that errs.

    Args:
        pushed: rows at which something pushes, (R,) bool; None for nowhere.
        before: error that takes the place of the simulation's, (R, n) [N·m].
    """
    before = equations.target if before is None else before
    squared = np.stack([extended**2, before**2], axis=-1)
    pushed = np.zeros(len(held), bool) if pushed is None else pushed
    total, sums = np.zeros(2), np.zeros((RESAMPLES, 2))
    for joint, own in enumerate(held.T):
        for rows in (np.flatnonzero(own & pushed), np.flatnonzero(own & ~pushed)):
            if len(rows):
                total += squared[rows, joint].sum(axis=0)
                sums += _drawn(squared[rows, joint], equations.block[rows])
    gains = 1.0 - np.sqrt(sums[:, 0] / np.maximum(sums[:, 1], 1e-30))
    low, high = np.quantile(gains, [0.025, 0.975])
    return float(1.0 - np.sqrt(total[0] / max(total[1], 1e-30))), (float(low), float(high))


def _drawn(values: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Sums of values (R, k) of as many of their blocks as there are, drawn again and again, (`RESAMPLES`, k)."""
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    if len(starts) < FEWEST_PIECES:
        starts = np.unique(np.linspace(0, len(values), FEWEST_PIECES, endpoint=False).astype(int))
    pieces = np.add.reduceat(values, starts)
    # of joints that move in the same blocks the same are drawn: what pushes one errs at others, too
    draws = np.random.default_rng(0).integers(0, len(pieces), (RESAMPLES, len(pieces)))
    return np.asarray(pieces[draws].sum(axis=1))


def rms(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Root mean square of each joint's values at its rows, (n,)."""
    count = np.maximum(rows.sum(axis=0), 1)
    return np.asarray(np.sqrt(np.sum(np.where(rows, values, 0.0) ** 2, axis=0) / count))
