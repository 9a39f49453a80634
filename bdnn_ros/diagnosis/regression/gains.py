"""Error that an extended model, and each of its effects, removes on held-out blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.effects.base import Effect

RESAMPLES = 1000
FEWEST_PIECES = 8
"""Fewer held-out blocks than this are cut into as many pieces: bootstrap draws from one block do not vary."""
MINIMUM_SHARE = 0.02
"""Removed error, as a share of the effort's spread at some joint, that is worth a name."""
OUTSTANDING_SHARE, BRIEF_SHARE = 0.01, 0.005
"""Removed error worth a name if it exceeds what remains: of a lasting effect, and (`BRIEF_SHARE`) of a brief one."""
OVERSHADOWED = 0.5
"""An effect that removes less than this share of what remains may be a part of that, and gets no name."""
ACTING = 0.25
"""An effect acts where its effort exceeds this share of its largest."""
LASTING = 0.5
"""A push that lasts this share of the recording is not brief."""
PASSING = 0.1
"""An effect with no more than this share of its energy in some rows is not there in them."""


@dataclass(frozen=True)
class Removal:
    """Error that an effect removes in some rows.

    Attributes:
        less: mean squared error removed at each joint, (n,) [(N·m)²].
        noticeable: whether that is worth a name.
        there: whether the effect acts in these rows at all.
        brief: whether it acts for moments only.
    """

    less: np.ndarray
    noticeable: bool
    there: bool
    brief: bool


def removed(
    equations: Equations, fitted: Pool, extended: np.ndarray, *stretches: np.ndarray
) -> list[tuple[Removal, ...]]:
    """Error that each term removes in each of several sets of rows, (R, n) bool each.

    Args:
        extended: residual of a fit that has not seen the held-out rows, (R, n) [N·m].
    """
    left, result = fitted.residual_of_all(), []
    for chosen, term in enumerate(fitted.terms):
        part = equations.columns.of(term) @ fitted.coefficients(fitted.whole, chosen)
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
    """Error that an effect of effort `part` removes where the residual with it is `left`, (R, n) [N·m] each."""
    less = rms(left + part, rows) ** 2 - rms(left, rows) ** 2
    moments = acting(part)
    # an effect of recurring moments is judged by what it does in those
    where = rows & moments if effect.brief and not effect.timed else rows
    then = rms(left + part, where) ** 2 - rms(left, where) ** 2
    brief = effect.brief and (not effect.timed or float(np.mean(part.any(axis=1))) < LASTING)
    return Removal(
        less,
        noticeable(brief, then, rms(extended, where), equations.rows.effort_scale),
        float(np.sum(part[rows & moments] ** 2)) > PASSING * float(np.sum(part[moments] ** 2)),
        brief,
    )


def share_of(part: np.ndarray, left: np.ndarray, before: np.ndarray, rows: np.ndarray) -> float:
    """Share of the squared error `before` in some rows that an effort `part` removes; residual with it `left`, (R, n) [N·m]."""
    total, without, now = (float(np.sum(values[rows] ** 2)) for values in (before, left + part, left))
    return max((without - now) / max(total, 1e-30), 0.0)


def by_links(equations: Equations, fitted: Pool, rows: np.ndarray) -> float:
    """Share of the simulation's squared error in some rows (R, n) that the link corrections remove."""
    part = equations.rigid @ fitted.whole.coefficients[: equations.rigid.shape[2]]
    return share_of(part, fitted.residual_of_all(), equations.rows.target, rows)


def squares(mean: np.ndarray, rows: np.ndarray) -> float:
    """Sum of squares over rows (R, n) bool, given each joint's mean square (n,)."""
    return float(mean @ rows.sum(axis=0))


def acting(part: np.ndarray) -> np.ndarray:
    """Rows at which an effect's effort (R, ...) exceeds a share of its largest."""
    size = np.abs(part)
    return np.asarray(size > ACTING * size.max(axis=0))


def noticeable(brief: bool, less: np.ndarray, after: np.ndarray, scale: np.ndarray) -> bool:
    """Whether the error that an effect removes is large enough for a name.

    Args:
        brief: whether it acts for moments only, so that the spread over the recording says little of its size.
        less: mean squared error removed, (n,) [(N·m)²].
        after: root mean square error left, (n,) [N·m].
        scale: the effort's spread, (n,) [N·m].
    """
    size = np.sqrt(np.maximum(less, 0.0))
    least = BRIEF_SHARE if brief else OUTSTANDING_SHARE
    outstanding = (size >= least * scale) & (size >= after)
    large = (size >= MINIMUM_SHARE * scale) & (size >= OVERSHADOWED * after)
    return bool((large | outstanding).any())


def held_out_gain(
    equations: Equations,
    extended: np.ndarray,
    held: np.ndarray,
    pushed: np.ndarray | None = None,
    before: np.ndarray | None = None,
) -> tuple[float, tuple[float, float]]:
    """1 - RMSE(extended) / RMSE(simulation) on held-out blocks, with a block-bootstrap 95 % interval.

    Blocks are drawn for each joint from those in which it moves, separately with and without a push. Otherwise, where joints
    move one after another, most draws would lack the one that errs.

    Args:
        pushed: rows at which something pushes, (R,) bool; None for none.
        before: reference error in place of the simulation's, (R, n) [N·m].
    """
    before = equations.rows.target if before is None else before
    squared = np.stack([extended**2, before**2], axis=-1)
    pushed = np.zeros(len(held), bool) if pushed is None else pushed
    total, sums = np.zeros(2), np.zeros((RESAMPLES, 2))
    for joint, own in enumerate(held.T):
        for rows in (np.flatnonzero(own & pushed), np.flatnonzero(own & ~pushed)):
            if len(rows):
                total += squared[rows, joint].sum(axis=0)
                sums += _drawn(squared[rows, joint], equations.rows.block[rows])
    gains = 1.0 - np.sqrt(sums[:, 0] / np.maximum(sums[:, 1], 1e-30))
    low, high = np.quantile(gains, [0.025, 0.975])
    return float(1.0 - np.sqrt(total[0] / max(total[1], 1e-30))), (float(low), float(high))


def _drawn(values: np.ndarray, block: np.ndarray) -> np.ndarray:
    """Sums of values (R, k) over bootstrap draws of their blocks, (`RESAMPLES`, k)."""
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    if len(starts) < FEWEST_PIECES:
        starts = np.unique(np.linspace(0, len(values), FEWEST_PIECES, endpoint=False).astype(int))
    pieces = np.add.reduceat(values, starts)
    # one seed for all joints, so that those that move in the same blocks draw the same: their errors are correlated
    draws = np.random.default_rng(0).integers(0, len(pieces), (RESAMPLES, len(pieces)))
    return np.asarray(pieces[draws].sum(axis=1))


def rms(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Root mean square of each joint's values in its rows, (n,)."""
    count = np.maximum(rows.sum(axis=0), 1)
    return np.asarray(np.sqrt(np.sum(np.where(rows, values, 0.0) ** 2, axis=0) / count))
