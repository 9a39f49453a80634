"""Iterating a set of effects until noise, load, bodies and shapes are consistent with its own fit.

An effort scale scales the friction found beside it, a tilt turns the payload's gravity: columns are exact only for the robot
that the fit implies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.regression.coloring import noise_of
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.odds import contains
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.leads import undelayed

NOISE_ROUNDS = 3
LAST_ROUNDS = 2


def refined(
    candidates: Candidates,
    equations: Equations,
    pool: Pool,
    chosen: Sequence[int],
    moved: Sequence[int] | None = None,
) -> Pool:
    """The pool with shapes of its chosen terms, or of some, refined one after another.

    A push is refined against the others without it and kept only if the whole set gains.
    """
    for one in chosen if moved is None else moved:
        term = candidates.refined(equations, pool, pool.fit(chosen), one)
        if term == pool.terms[one]:
            continue
        other = pool.replacing({one: term})
        if not term.effect.timed or other.fit(chosen).evidence > pool.fit(chosen).evidence:
            pool = other
    return pool


def anew(candidates: Candidates, equations: Equations, pool: Pool) -> Pool:
    """The pool with each term's shape replaced by a better one from the whole grid, which refinement would not reach.

    Earlier shapes were found beside a load and terms not known well. Pushes have a search of their own. The gain is first
    estimated with others free to leave their bounds, so it must hold within these as well.
    """
    every = range(len(pool.terms))
    for one, term in enumerate(pool.terms):
        if not term.effect.timed:
            rest = pool.without(pool.fit(every), [one])
            other = candidates.anew(equations, pool, rest, one)
            if other is not pool and other.fit(every).evidence > pool.fit(every).evidence:
                pool = other
    return pool


def update_load(candidates: Candidates, equations: Equations, pool: Pool) -> None:
    """Update the load and bodies of the equations from the pool's fit."""
    pool = undelayed(pool)
    found = equations, pool, pool.whole
    equations.update_load(*candidates.load(*found), bodies=candidates.bodies(*found))


def at_own_noise(
    candidates: Candidates, equations: Equations, pool: Pool, floor: np.ndarray, beside: Sequence[Term] = ()
) -> Pool:
    """The pool with noise, load, bodies and shapes from its own fit, iterated.

    Args:
        floor: smallest noise, (n,) [N·m].
        beside: further terms whose effort the noise must not absorb.
    """
    every = range(len(pool.terms))
    for _ in range(NOISE_ROUNDS):
        noise = _noise(equations, pool, floor, beside)
        update_load(candidates, equations, pool)
        pool = refined(candidates, equations, Pool(equations, noise, pool.terms, pool.link_error), every)
    return Pool(equations, _noise(equations, pool, floor, beside), pool.terms, pool.link_error)


def _noise(equations: Equations, pool: Pool, floor: np.ndarray, beside: Sequence[Term]) -> Noise:
    """Noise of the residual of the pool's terms, with further terms fitted beside them."""
    more = [t for t in beside if not any(t.place == one.place or contains(one, t) for one in pool.terms)]
    if more:
        pool = Pool(equations, pool.noise, [*pool.terms, *more], pool.link_error)
    return noise_of(equations, pool.residual(pool.whole), floor)


def settled(candidates: Candidates, equations: Equations, pool: Pool) -> Pool:
    """The pool with load, bodies and linearisation points from its own fit, at the same noise."""
    for _ in range(LAST_ROUNDS):
        fit = pool.whole
        terms = list(pool.terms)
        for chosen in fit.terms:
            term, coefficients = terms[chosen], pool.coefficients(fit, chosen)
            terms[chosen] = term.shaped(term.effect.relinearised(coefficients, dict(term.shape)))
        update_load(candidates, equations, pool)
        pool = Pool(equations, pool.noise, terms, pool.link_error)
    return pool


def windows_anew(candidates: Candidates, equations: Equations, pool: Pool) -> Pool:
    """The pool with the windows of its pushes refined, after rows were added.

    What begins in a stretch that was held out can be timed only with it.
    """
    pushes = [one for one, term in enumerate(pool.terms) if term.effect.timed]
    return refined(candidates, equations, pool, range(len(pool.terms)), pushes)
