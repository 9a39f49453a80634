"""Search for pushes, and tests of what may be one: overlaps, pieces of others, and leftovers of other causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.aside import in_two
from bdnn_ros.diagnosis.pushes.between import between_rows, unbound
from bdnn_ros.diagnosis.pushes.contact import contact, distance
from bdnn_ros.diagnosis.pushes.windows import LONGEST_SHARE, best_window
from bdnn_ros.diagnosis.recorded.joining import stretches
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.gains import acting
from bdnn_ros.diagnosis.regression.term import Shape, Term, of_shapes
from bdnn_ros.effects.environment import EDGES
from bdnn_ros.robot import Robot

LONG = 3.0
"""Usable rows this many times further apart than usual have unusable ones between them."""
EDGE_REACH = 0.1
"""A push's time so near to a stretch without usable rows may lie anywhere in it [s]."""
TOUCHING = 0.3
"""Pushes separated by less than this may be one [s]."""
WORTH = 6.0
"""Evidence that a push's own point must bring beyond the points tried first [nats]."""
CONTENDS = 0.5
"""Pushes that explain less than this share of the best one are not refined."""
CROSSING = 0.5
"""Longest time to cross a gap [s]."""
OUTDONE = 0.05
"""A push below this share of another one at its time may be what a constant wrench leaves of that one."""
CREEPING = 0.1
"""Share of its usual speed below which a joint may have any dry friction, up to static friction."""
RESOLVED = 1.5
"""Shortest push in periods of the low-pass: of a shorter one only a bump is left, as of any brief fault."""
ENDS = 0.6
"""Time at a recording's ends in which zero-phase filtering before publication may have produced artefacts [s]."""


def best_push(pool: Pool, fit: Fit, term: Term, robot: Robot) -> tuple[float, Term]:
    """Log evidence that a push adds to a fit with its best window and point, and the push.

    A wrench that gains nothing at the points tried first is not tried at others. Terms of the fit that are at a bound may
    leave it.
    """
    fit = unbound(pool, fit)
    tried = [best_window(pool, fit, term.shaped(point)) for point in term.effect.points(robot, term.link)]
    gain, best = max(((pool.gain_of(fit, one)[0], one) for one in tried), key=_gain)
    touched = contact(pool, fit, best) if gain > 0.0 else None
    if touched is None:
        return gain, best
    touched = best_window(pool, fit, touched)
    more = pool.gain_of(fit, touched)[0]
    return (more, touched) if more > gain + max(WORTH, tie_margin(best, gain)) else (gain, best)


def refined_push(pool: Pool, fit: Fit, term: Term, robot: Robot) -> Term:
    """A push where it adds most evidence to a fit: searched anew, or refined from where it is."""
    starts = (best_push(pool, fit, term, robot)[1], term)
    return max((between_rows(pool, fit, start, robot) for start in starts), key=_gain)[1]


def reshaped(pool: Pool, rest: Sequence[int], robot: Robot, found: Sequence[int] = ()) -> Pool:
    """The pool with all pushes but those among the rest at their best times and points beside the rest.

    Args:
        found: pushes that are also refined from where they are.
    """
    fit = pool.fit(rest)

    def best_at(c: int) -> tuple[float, Shape]:
        gain, term = best_push(pool, fit, pool.terms[c], robot)
        return gain, term.shape

    def exactly(start: tuple[int, Shape]) -> tuple[float, Shape]:
        gain, term = between_rows(pool, fit, replace(pool.terms[start[0]], shape=start[1]), robot)
        return gain, term.shape

    others = [c for c, term in enumerate(pool.terms) if term.effect.timed and c not in rest]
    best = dict(zip(others, in_two(best_at, others), strict=True))
    most = max(map(_gain, best.values()), default=0.0)
    starts = [(c, shape) for c, (gain, shape) in best.items() if gain > CONTENDS * most]
    best |= {c: exact for (c, _), exact in zip(starts, in_two(exactly, starts), strict=True)}
    for c in found:
        best[c] = max(best[c], exactly((c, pool.terms[c].shape)), key=_gain)
    return pool.replacing(of_shapes(pool.terms, {c: shape for c, (_, shape) in best.items()}))


def pushes_but(pool: Pool, rest: Sequence[int], one: int) -> list[int]:
    """Pushes that are not among the rest; at the place of `one`, that one only."""
    spot = pool.terms[one].spot
    pushes = (c for c, term in enumerate(pool.terms) if term.effect.timed and c not in rest)
    return [c for c in pushes if c == one or pool.terms[c].spot != spot]


def _gain(found: tuple[float, Term | Shape]) -> float:
    return found[0]


def tie_margin(term: Term, worth: float) -> float:
    """Evidence of a push that does not tell its place, since no real push is exactly a constant wrench [nats]."""
    return term.effect.idealised**2 * max(worth, 0.0) if term.effect.timed else 0.0


def nearest(pool: Pool, scores: dict[int, float], without: float, robot: Robot) -> int:
    """The push of most evidence; among wrenches that tie with it, the one nearest to its own link's origin or centre of mass.

    A force on a joint's axis is the same on either link.

    Args:
        scores: of each push in place of the others.
        without: score without any push.
    """
    best = max(scores, key=lambda c: scores[c])
    close = scores[best] - tie_margin(pool.terms[best], scores[best] - without)
    same = [c for c in scores if pool.terms[c].effect is pool.terms[best].effect and scores[c] >= close]
    return min(same, key=lambda c: (distance(pool.terms[c], robot), -scores[c]))


def together(one: Term, other: Term) -> bool:
    """Whether two pushes overlap for more than half of the shorter one: one push may look like two."""
    if not (one.effect.timed and other.effect.timed):
        return False
    a, b = dict(one.shape), dict(other.shape)
    shorter = min(shape["end"] - shape["start"] for shape in (a, b))
    return min(a["end"], b["end"]) - max(a["start"], b["start"]) > 0.5 * shorter


def piece_of(small: Term, large: Term) -> bool:
    """Whether a push may be a piece of a longer one whose window is too short or whose point is not found yet."""
    if not (small.effect.timed and large.effect.timed):
        return False
    one, other = dict(small.shape), dict(large.shape)
    shorter = one["end"] - one["start"] < other["end"] - other["start"]
    touching = min(abs(one["end"] - other["start"]), abs(one["start"] - other["end"])) < TOUCHING
    inside = one["start"] > other["start"] - TOUCHING and one["end"] < other["end"] + TOUCHING
    return shorter and (touching or inside)


def within(small: Term, large: Term) -> bool:
    """Whether one push begins well after another begins, and ends well before that ends."""
    if not (small.effect.timed and large.effect.timed):
        return False
    (start, end), (begun, over) = edges(small), edges(large)
    return begun + TOUCHING < start and end < over - TOUCHING


def follows(one: Term, other: Term) -> bool:
    """Whether one push ends about where the other begins."""
    if one is other or not (one.effect.timed and other.effect.timed):
        return False
    (start, end), (begins, ends) = edges(one), edges(other)
    return abs(end - begins) < TOUCHING and start < begins and end < ends


def lasting(pool: Pool, rest: Sequence[int], pair: tuple[int, int], one: int, robot: Robot) -> Pool:
    """The pool with one of two consecutive pushes extended over both, and refined from there."""
    (start, _), (_, end) = (edges(pool.terms[c]) for c in pair)
    long = pool.terms[one].shaped({**dict(pool.terms[one].shape), "start": start, "end": end})
    return pool.replacing({one: between_rows(pool, pool.fit(rest), long, robot)[1]})


def leftover(pool: Pool, chosen: Sequence[int], one: int) -> bool:
    """Whether a push may be what another cause leaves: a larger push at its time, or a gap being crossed.

    No hand pushes as constantly as a wrench, and a crossing is known only as well as the motion. Nor is it a push if most of
    it is explained where joints creep, or if it is too short for the low-pass.
    """
    push = pool.terms[one]
    if not push.effect.timed:
        return False
    start, end = edges(push)
    if end - start < RESOLVED / pool.equations.motion.signals.cutoff:
        return True
    others = [c for c in chosen if c != one]
    motion, rows = pool.equations.motion, pool.equations.rows.samples
    creeping = np.abs(motion.velocity[rows]) < CREEPING * motion.usual_velocity
    if _mostly(creeping, pool, chosen, others):
        return True
    pushes = [c for c in others if together(push, pool.terms[c])]
    return any(_crossed(pool, chosen, c, push) for c in others) or any(
        _outdone(pool, chosen, one, other) for other in pushes
    )


def _outdone(pool: Pool, chosen: Sequence[int], one: int, other: int) -> bool:
    """Whether a simultaneous push explains far more than this one, or just more if both begin and end together."""
    less, more = (
        pool.fit(chosen).evidence - pool.fit([c for c in chosen if c != out]).evidence for out in (one, other)
    )
    apart = np.abs(np.subtract(edges(pool.terms[one]), edges(pool.terms[other]))).max()
    return bool(less < (1.0 if apart < TOUCHING else OUTDONE**2) * more)


def edges(push: Term) -> tuple[float, float]:
    """Start and end of a push [s]."""
    shape = dict(push.shape)
    start, end = (shape[edge] for edge in EDGES)
    return start, end


def pushing(terms: Sequence[Term], time: np.ndarray) -> np.ndarray:
    """Which of some times (R,) [s] lie within a push, (R,) bool."""
    result = np.zeros(len(time), bool)
    for start, end in (edges(term) for term in terms if term.effect.timed):
        result |= (start <= time) & (time <= end)
    return result


def at_an_end(pool: Pool, chosen: Sequence[int], one: int) -> bool:
    """Whether a push explains most at a recording's ends, where a filter may have produced it."""
    time = pool.equations.rows.time
    ends = np.zeros(len(time), bool)
    for first, last in stretches(time, pool.equations.motion.signals.begun):
        ends |= ((time >= first) & (time < first + ENDS)) | ((time > last - ENDS) & (time <= last))
    return pool.terms[one].effect.timed and _mostly(ends, pool, chosen, [c for c in chosen if c != one])


def throughout(pool: Pool, chosen: Sequence[int], one: int) -> bool:
    """Whether a push acts nearly always when the joint moves at which it explains most; it then is no push.

    At a joint that moves twice, the difference between the two moves may be anything.
    """
    if not pool.terms[one].effect.timed:
        return False
    joint = int(np.argmax(_better(pool, chosen, [c for c in chosen if c != one]).sum(axis=0)))
    start, end = edges(pool.terms[one])
    time = pool.equations.rows.time[pool.sure[:, joint]]
    return bool(np.mean((time >= start) & (time <= end)) > LONGEST_SHARE)


def _mostly(where: np.ndarray, pool: Pool, chosen: Sequence[int], others: Sequence[int]) -> bool:
    """Whether most of what a set explains better than a subset is in some rows, (R,) or (R, n) bool."""
    better = _better(pool, chosen, others)
    return bool(better[where].sum() > 0.5 * better.sum() > 0.0)


def _better(pool: Pool, chosen: Sequence[int], others: Sequence[int]) -> np.ndarray:
    """Reduction of each squared whitened residual by a set compared with a subset, (R, n)."""
    return np.asarray(pool.white_residual(pool.fit(others)) ** 2 - pool.white_residual(pool.fit(chosen)) ** 2)


def _crossed(pool: Pool, chosen: Sequence[int], gap: int, push: Term) -> bool:
    """Whether a push is short and coincides with the moments at which a brief effect acts, such as backlash."""
    start, end = edges(push)
    effect, equations = pool.terms[gap].effect, pool.equations
    if effect.timed or not effect.brief or end - start > CROSSING:
        return False
    time = equations.rows.time
    part = equations.columns.of(pool.terms[gap]) @ pool.coefficients(pool.fit(chosen), gap)
    return bool(acting(part)[(time >= start) & (time <= end)].any())


def unseen(pool: Pool, term: Term) -> dict[str, float]:
    """Duration about each of a push's times without usable rows, within which the time is undetermined [s]."""
    equations = pool.equations
    time = equations.rows.time
    joints = np.any(equations.columns.of(term), axis=(0, 2))
    counts = time[pool.sure[:, joints].any(axis=1)]
    gaps = np.diff(counts)
    long = gaps > LONG * float(np.median(np.diff(time)))
    ends = np.stack([counts[:-1], counts[1:]], axis=1)[long]
    result = {}
    for edge, at in zip(EDGES, edges(term), strict=True):
        about = (ends[:, 0] - EDGE_REACH <= at) & (at <= ends[:, 1] + EDGE_REACH)
        result[edge] = float(gaps[long][about].sum())
    return result
