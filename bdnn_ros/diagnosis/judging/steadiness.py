"""Whether what pushes at one time is constant wrenches, or one that changes and is taken for them."""

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
from bdnn_ros.diagnosis.search.search import Search, Selection
from bdnn_ros.effects.environment import ExternalWrench, Push, window
from bdnn_ros.effects.motion import Motion

BETTER = 0.003
"""A push that changes explains more than the constant one in its place by this share at least; less of it tells no place."""
AROUND = 0.25
"""A push that swells and fades lasts longer than the constant one in its place by this share, before it and after it."""
KNOTS = 0.4
"""How far the times are apart at which the size of a push is sought, about [s]."""
REVERSED = -0.25
"""What pulls back at any time by more than this per most that it pushes with is no push."""
ROUNDS = 3
"""So often a push's size in time is sought for its wrench, and its wrench for that."""


def steadied(search: Search, selection: Selection) -> tuple[Selection, dict[int, Judgement]]:
    """The selection with one push for those at one time that are one which changes, and how sure each such is.

    It stays as it is where there is none. Else its noise is that of the times when nothing pushes: what constant pushes
    leave of one that changes passes for slow noise.
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
    """The chosen pushes, those together that last over one another or nearly touch."""
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
    """The selection at the noise of the times when nothing pushes; None where these do not tell it of each joint."""
    equations, pool = search.equations, selection.pool
    counted, time = equations.usable, equations.motion.time[equations.rows]
    equations.count(counted & ~pushing([_longer(term) for term in selection.terms], time)[:, None])
    told = bool((~counted.any(axis=0) | (equations.full().sum(axis=0) >= LEAST_ROWS)).all())
    if told:
        others = [term for term in selection.terms if not term.effect.timed]
        calm = Pool(equations, pool.noise, others, pool.link_error)
        noise = noise_of(equations, calm.residual(calm.whole), search.floor)
    equations.count(counted)
    if not told:
        return None
    pool = Pool(equations, noise, pool.terms, pool.link_error)
    return Selection(pool, selection.chosen, pool.fit(selection.chosen))


def _single(search: Search, selection: Selection, crowd: Sequence[int]) -> tuple[int, Term, Judgement] | None:
    """The place, as the constant push that comes nearest, of the one that changes which some at one time are; None of others.

    That it changes costs as much as another push.
    """
    pool, rest = selection.pool, _without(selection, crowd)
    fit, costs = pool.fit(rest), 2.0 * search.costs(pool, rest, range(len(pool.terms)))
    whole = _joined([pool.terms[c] for c in crowd])
    if len(crowd) == 1:
        (one,) = crowd
        gain = (1.0 + BETTER) * pool.gain_of(fit, pool.terms[one])[0]
        if _swelling(pool, fit, pool.terms[one], whole) - costs[one] < gain:
            return None
    constant = search.score(pool, selection.chosen) - search.score(pool, rest)
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
    """Log evidence that a push adds to a fit whose wrench changes its size, and of which the point may move on.

    Of one that would pull back in turn it is that of the constant one.

    Args:
        whole: begins and ends with all that pushes then.
    """
    equations, effect, motion, shape = pool.equations, term.effect, pool.equations.motion, dict(term.shape)
    assert isinstance(effect, Push)
    mixing, acting = effect.mixing(shape), window(motion, shape)
    sizes = np.vstack([acting, _hats(motion, *edges(_longer(_joined([term, whole]))))])
    moving = acting * (motion.time - np.mean(edges(term)))
    constant, wrench = pool.gain_of(fit, term)
    for _ in range(ROUNDS):
        on = (
            [equations.pushed(term, moving, effect.displaced(wrench[:3]))]
            if isinstance(effect, ExternalWrench)
            else []
        )
        swelling = [equations.pushed(term, size, mixing @ wrench[:, None]) for size in sizes]
        gain, found = pool.gain_of(fit, term, np.concatenate([*swelling, *on], axis=2))
        size = found[: len(sizes)] @ sizes
        size /= max(float(size.max()), 1e-12)
        own = equations.pushed(term, size, mixing)
        wrench = pool.gain_of(fit, term, np.concatenate([own, *on], axis=2))[1][: len(wrench)]
    return gain if size.min() > REVERSED else constant


def _hats(motion: Motion, start: float, end: float) -> np.ndarray:
    """What a size that is linear between some times is made of, nothing before the first [s] and after the last, (K, N)."""
    knots = np.linspace(start, end, max(round((end - start) / KNOTS), 2) + 1)
    hats = (np.interp(motion.time, knots, one) for one in np.eye(len(knots))[1:-1])
    return np.stack([motion.signals.soften(hat) for hat in hats])


def _joined(terms: Sequence[Term]) -> Term:
    """A push from the first's begin to the last's end."""
    starts, ends = zip(*map(edges, terms), strict=True)
    return _lasting(terms[0], min(starts), max(ends))


def _longer(term: Term) -> Term:
    """A push with the time before and after it in which it may swell and fade; what is none as it is."""
    if not term.effect.timed:
        return term
    start, end = edges(term)
    return _lasting(term, start - AROUND * (end - start), end + AROUND * (end - start))


def _lasting(term: Term, start: float, end: float) -> Term:
    return term.shaped({**dict(term.shape), "start": start, "end": end})
