"""Where and when something pushed: the point of a link and the times at which a constant wrench explains most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.equations import Term
from bdnn_ros.diagnosis.evidence import Fit, Pool
from bdnn_ros.diagnosis.gains import acting
from bdnn_ros.diagnosis.windows import best_window
from bdnn_ros.effects.environment import POINT, SAME_POINT, ExternalWrench, Push, window
from bdnn_ros.effects.motion import Motion
from bdnn_ros.robot import Robot

EDGES = ("start", "end")
STEPS = 5
"""Gauss-Newton steps, towards a point of contact or the times of a push."""
NEAR = 0.1
"""Times found between rows are nearer than this to where the search for them starts [s]."""
EXACT = 1e-3
"""A step of the times that is small enough [s]."""
TOUCHING = 0.3
"""Pushes with less time between their ends may be one [s]."""
FARTHEST = 1.0
"""No hand reaches further from its link's origin [m]."""
WORTH = 6.0
"""Evidence that a point of its own must bring beyond those that are tried first."""
CROSSING = 0.5
"""Hardly a gap takes longer to cross [s]."""
OUTDONE = 0.05
"""A push that does less than this share of another at its time is what a constant wrench leaves of that one."""


def best_push(pool: Pool, fit: Fit, term: Term, robot: Robot) -> Term:
    """A push with the times, and a wrench with the point of its link, that add most evidence to a fit."""
    tried = [best_window(pool, fit, term.shaped(point)) for point in term.effect.points(robot, term.link)]
    best = max(tried, key=lambda one: pool.gain_of(fit, one)[0])
    contact = _contact(pool, fit, best)
    if contact is None:
        return best
    contact = best_window(pool, fit, contact)
    return contact if pool.gain_of(fit, contact)[0] > pool.gain_of(fit, best)[0] + WORTH else best


def reshaped(pool: Pool, rest: Sequence[int], robot: Robot) -> Pool:
    """The pool with all pushes but those among the rest where each explains most beside the rest."""
    fit = pool.fit(rest)
    for one, term in enumerate(pool.terms):
        if term.effect.timed and one not in rest:
            pool = pool.replacing(one, between_rows(pool, fit, best_push(pool, fit, term, robot)))
    return pool


def together(one: Term, other: Term) -> bool:
    """Whether two pushes last over each other for half of the shorter one: what pushes one link may look like two."""
    if not (one.effect.timed and other.effect.timed):
        return False
    a, b = dict(one.shape), dict(other.shape)
    shorter = min(shape["end"] - shape["start"] for shape in (a, b))
    return min(a["end"], b["end"]) - max(a["start"], b["start"]) > 0.5 * shorter


def piece_of(small: Term, large: Term) -> bool:
    """Whether a push may be a piece of a longer one whose window was cut too short, or whose point is not found yet."""
    if not (small.effect.timed and large.effect.timed):
        return False
    one, other = dict(small.shape), dict(large.shape)
    shorter = one["end"] - one["start"] < other["end"] - other["start"]
    touching = min(abs(one["end"] - other["start"]), abs(one["start"] - other["end"])) < TOUCHING
    inside = one["start"] > other["start"] - TOUCHING and one["end"] < other["end"] + TOUCHING
    return shorter and (touching or inside)


def leftovers(pool: Pool) -> list[bool]:
    """Which terms are pushes that may be what another leaves of itself: of a push at their time, or of a gap being crossed.

    No hand pushes as constantly as a wrench with a start and an end, and a crossing is known only as well as the motion.
    """
    equations = pool.equations
    time = equations.motion.time[equations.rows]
    parts = [
        equations.columns(term) @ pool.coefficients(pool.whole, c) / equations.effort_scale
        for c, term in enumerate(pool.terms)
    ]
    pairs = list(zip(pool.terms, parts, strict=True))
    return [
        term.effect.timed
        and any(_left_of(term, part, *other, time) for other in pairs if other[0] is not term)
        for term, part in pairs
    ]


def _left_of(push: Term, part: np.ndarray, other: Term, more: np.ndarray, time: np.ndarray) -> bool:
    """Whether a push that does `part` may be left of another term that does `more`, (R, n) each."""
    if other.effect.timed:
        return together(push, other) and bool(np.linalg.norm(part) < OUTDONE * np.linalg.norm(more))
    start, end = _edges(push)
    during = (time >= start) & (time <= end)
    return other.effect.brief and end - start < CROSSING and bool(acting(more)[during].any())


def between_rows(pool: Pool, fit: Fit, term: Term) -> Term:
    """A push with its times between rows, where they add most evidence to a fit, by Gauss-Newton."""
    effect, motion = term.effect, pool.equations.motion
    if not isinstance(effect, Push):
        return term
    gain, coefficients = pool.gain_of(fit, term)
    always = effect.always(motion, term.target, dict(term.shape), term.link)
    for _ in range(STEPS):
        edges = always @ coefficients * _edge_rates(motion, dict(term.shape)).T[..., None]
        columns = [pool.equations.made(term), pool.equations.reduced(np.moveaxis(edges, 0, 2))]
        by = np.clip(pool.gain_of(fit, term, np.concatenate(columns, axis=2))[1][-2:], -NEAR, NEAR)
        ends = {edge: at + float(b) for edge, at, b in zip(EDGES, _edges(term), by, strict=True)}
        moved = term.shaped({**dict(term.shape), **ends})
        if not effect.shape_allowed(dict(moved.shape)):
            break
        better, found = pool.gain_of(fit, moved)
        if better <= gain:
            break
        term, gain, coefficients = moved, better, found
        if np.abs(by).max() < EXACT:
            break
    return term


def _edge_rates(motion: Motion, shape: dict[str, float]) -> np.ndarray:
    """Change of a push's window per second that its start, and its end, come later, (N, 2) [1/s]."""
    step = 1.0 / motion.signals.rate
    later, earlier = (
        np.stack([window(motion, {**shape, edge: shape[edge] + by}) for edge in EDGES], axis=1)
        for by in (step, -step)
    )
    return (later - earlier) / (2.0 * step)


def _edges(term: Term) -> list[float]:
    shape = dict(term.shape)
    return [shape[edge] for edge in EDGES]


def _contact(pool: Pool, fit: Fit, term: Term) -> Term | None:
    """The wrench at the point where a force alone explains most, by Gauss-Newton; None where there is no such point.

    A force F at the point p of a link that has turned by R pulls with (R p) x F about the link's origin, which is linear in
    p for a given F: while the link turns, that is not one torque.
    """
    effect, link, equations = term.effect, term.link, pool.equations
    if not isinstance(effect, ExternalWrench) or link is None:
        return None
    first = point = _point(term)
    force = pool.gain_of(fit, term)[1][:3]
    for _ in range(STEPS):
        arms = equations.reduced(effect.displaced(equations.motion, dict(term.shape), link, force))
        columns = np.concatenate([equations.made(term)[..., :3], arms], axis=2)
        found = pool.gain_of(fit, term, columns)[1]
        force, step = found[:3], found[3:]
        point = point + step
        if np.linalg.norm(point) > FARTHEST:
            return None
        term = term.shaped({**dict(term.shape), **dict(zip(POINT, point.tolist(), strict=True))})
        if np.linalg.norm(step) < SAME_POINT:
            break
    return term if np.linalg.norm(point - first) > SAME_POINT else None


def _point(term: Term) -> np.ndarray:
    shape = dict(term.shape)
    return np.array([shape[axis] for axis in POINT])
