"""Whether simultaneous pushes are constant wrenches, or one changing push that they stand for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.diagnosis.judging.identifiability import Judgement, judged
from bdnn_ros.diagnosis.pushes.pushes import CONTENDS, TOUCHING, edges, nearest, pushes_but, pushing, reshaped
from bdnn_ros.diagnosis.regression.coloring import LEAST_ROWS, noise_of
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.search import Search
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.effects.environment import ExternalWrench, Push, window
from bdnn_ros.effects.motion import Motion

BETTER = 0.003
"""A changing push must explain this share more than the constant one in its place; smaller gains do not tell places apart."""
AROUND = 0.25
"""Time that a push may swell before and fade after the constant one in its place, relative to that one's duration."""
KNOTS = 0.4
"""Approximate spacing of the times between which the size of a push is linear [s]."""
REVERSED = -0.25
"""Smallest size, relative to the largest: what pulls back further than this is no push."""
ROUNDS = 3
"""Alternations between a push's size over time and its wrench."""


def steadied(search: Search, selection: Selection) -> tuple[Selection, dict[int, Judgement]]:
    """The selection with one push in place of simultaneous ones that are a single changing push, and a judgement of each such.

    Unchanged without any. Otherwise its noise is that of times without a push, since the residual of constant pushes in place
    of a changing one passes for slow noise.
    """
    found, crowds = dict[int, Judgement](), _crowds(selection)
    now = _at_quiet_noise(search, selection) if crowds else None
    if now is None:
        return selection, found
    for crowd in crowds:
        single = _single(search, now, crowd)
        if single is not None:
            one, term, found[one] = single
            pool, chosen = now.pool.replacing({one: term}), (*_without(now, crowd), one)
            now = Selection(pool, chosen, pool.fit(chosen))
    return (now if found else selection), found


def _crowds(selection: Selection) -> list[list[int]]:
    """The chosen pushes, grouped by overlapping or nearly touching in time."""
    pool, result, until = selection.pool, list[list[int]](), -np.inf
    pushes = [c for c in selection.chosen if pool.terms[c].effect.timed]
    for one in sorted(pushes, key=lambda c: edges(pool.terms[c])):
        start, end = edges(pool.terms[one])
        if start > until + TOUCHING:
            result.append([])
        result[-1].append(one)
        until = max(until, end)
    return result


def _without(selection: Selection, crowd: Sequence[int]) -> list[int]:
    return [c for c in selection.chosen if c not in crowd]


def _at_quiet_noise(search: Search, selection: Selection) -> Selection | None:
    """The selection at the noise of times without a push; None where too few of them show it at each joint."""
    equations, pool = search.equations, selection.pool
    counted, time = equations.usable, equations.rows.time
    equations.use_rows(counted & ~pushing([_longer(term) for term in selection.terms], time)[:, None])
    told = bool((~counted.any(axis=0) | (equations.whitening.full().sum(axis=0) >= LEAST_ROWS)).all())
    if told:
        others = [term for term in selection.terms if not term.effect.timed]
        calm = Pool(equations, pool.noise, others, pool.link_error)
        noise = noise_of(equations, calm.residual(calm.whole), search.floor)
    equations.use_rows(counted)
    if not told:
        return None
    pool = Pool(equations, noise, pool.terms, pool.link_error)
    return Selection(pool, selection.chosen, pool.fit(selection.chosen))


def _single(search: Search, selection: Selection, crowd: Sequence[int]) -> tuple[int, Term, Judgement] | None:
    """The constant push that comes nearest to one changing push in place of some simultaneous ones; None if they are not one.

    That it changes costs as much as another push.
    """
    pool, rest = selection.pool, _without(selection, crowd)
    fit, costs = pool.fit(rest), 2.0 * search.moves.costs(pool, rest, range(len(pool.terms)))
    whole = _joined([pool.terms[c] for c in crowd])
    if len(crowd) == 1:
        (one,) = crowd
        gain = (1.0 + BETTER) * pool.gain_of(fit, pool.terms[one])[0]
        if _swelling(pool, fit, pool.terms[one], whole) - costs[one] < gain:
            return None
    constant = search.moves.score(pool, selection.chosen) - search.moves.score(pool, rest)
    pool = reshaped(pool, rest, search.candidates.robot)
    pushes = pushes_but(pool, rest, crowd[0])
    gains = dict(zip(pushes, pool.gains(fit, pushes), strict=True))
    near = [c for c in pushes if gains[c] > CONTENDS * max(gains.values())]
    scores = {c: _swelling(pool, fit, pool.terms[c], whole) - costs[c] for c in near}
    best = nearest(pool, scores, 0.0, search.candidates.robot)
    if scores[best] < max(constant, (1.0 + BETTER) * gains[best]):
        return None
    rivals = {c: score for c, score in scores.items() if c != best}
    judgement = judged(
        dict(enumerate(pool.terms)), pool.terms[best], scores[best], 0.0, rivals, BETTER * scores[best]
    )
    return best, pool.terms[best], replace(judgement, changing=True)


def _swelling(pool: Pool, fit: Fit, term: Term, whole: Term) -> float:
    """Log evidence that a push adds to a fit if the size of its wrench varies and its point may move.

    If the size would reverse, the evidence of the constant push.

    Args:
        whole: a push over the time of all simultaneous ones.
    """
    equations, effect, motion, shape = pool.equations, term.effect, pool.equations.motion, dict(term.shape)
    assert isinstance(effect, Push)
    mixing, acting = effect.mixing(shape), window(motion, shape)
    sizes = np.vstack([acting, _hats(motion, *edges(_longer(_joined([term, whole]))))])
    moving = acting * (motion.time - np.mean(edges(term)))
    constant, wrench = pool.gain_of(fit, term)
    for _ in range(ROUNDS):
        on = (
            [equations.columns.pushed(term, moving, effect.displaced(wrench[:3]))]
            if isinstance(effect, ExternalWrench)
            else []
        )
        swelling = [equations.columns.pushed(term, size, mixing @ wrench[:, None]) for size in sizes]
        gain, found = pool.gain_of(fit, term, np.concatenate([*swelling, *on], axis=2))
        size = found[: len(sizes)] @ sizes
        size /= max(float(size.max()), 1e-12)
        own = equations.columns.pushed(term, size, mixing)
        wrench = pool.gain_of(fit, term, np.concatenate([own, *on], axis=2))[1][: len(wrench)]
    return gain if size.min() > REVERSED else constant


def _hats(motion: Motion, start: float, end: float) -> np.ndarray:
    """Hat functions: basis of a piecewise-linear size that is zero before the first and after the last time [s], (K, N)."""
    knots = np.linspace(start, end, max(round((end - start) / KNOTS), 2) + 1)
    hats = (np.interp(motion.time, knots, one) for one in np.eye(len(knots))[1:-1])
    return np.stack([motion.signals.soften(hat) for hat in hats])


def _joined(terms: Sequence[Term]) -> Term:
    """The first push, from the earliest start to the latest end of all."""
    starts, ends = zip(*map(edges, terms), strict=True)
    return _lasting(terms[0], min(starts), max(ends))


def _longer(term: Term) -> Term:
    """A push extended by the time in which it may swell and fade; other terms unchanged."""
    if not term.effect.timed:
        return term
    start, end = edges(term)
    return _lasting(term, start - AROUND * (end - start), end + AROUND * (end - start))


def _lasting(term: Term, start: float, end: float) -> Term:
    return term.shaped({**dict(term.shape), "start": start, "end": end})
