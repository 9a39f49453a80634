"""A set of effects made to agree with what it says itself: of noise, load, bodies and shapes.

A scaled effort scales the friction found beside it, a tilt turns the payload's gravity: columns are exact only at what the
fit they are part of makes of the robot.
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
    """The pool with the shapes of its chosen terms, or of some of them, moved to where they fit best, one after another.

    A push is sought where the others without it leave something, and may lose there what it explained with them.
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
    """The pool with each term's shape among all there are where one fits better by now: what moves a shape stays near it.

    A term is found beside a load and others that are not known well yet. Pushes have a search of their own. What seems to
    fit better is a gain for which others may leave their bounds: within these it has to, too.
    """
    every = range(len(pool.terms))
    for one, term in enumerate(pool.terms):
        if not term.effect.timed:
            rest = pool.without(pool.fit(every), [one])
            other = candidates.anew(equations, pool, rest, one)
            if other is not pool and other.fit(every).evidence > pool.fit(every).evidence:
                pool = other
    return pool


def relieve(candidates: Candidates, equations: Equations, pool: Pool) -> None:
    """Give the equations load and bodies as the pool's terms together have them."""
    pool = undelayed(pool)
    found = equations, pool, pool.whole
    equations.relieve(*candidates.load(*found), bodies=candidates.bodies(*found))


def at_own_noise(
    candidates: Candidates, equations: Equations, pool: Pool, floor: np.ndarray, beside: Sequence[Term] = ()
) -> Pool:
    """The pool with noise, load, bodies and shapes as its own fit has them, each found again with the others.

    Args:
        floor: smallest noise, (n,) [N·m].
        beside: terms that the noise must not stand for, though the pool has not got them.
    """
    every = range(len(pool.terms))
    for _ in range(NOISE_ROUNDS):
        noise = _noise(equations, pool, floor, beside)
        relieve(candidates, equations, pool)
        pool = refined(candidates, equations, Pool(equations, noise, pool.terms, pool.link_error), every)
    return Pool(equations, _noise(equations, pool, floor, beside), pool.terms, pool.link_error)


def _noise(equations: Equations, pool: Pool, floor: np.ndarray, beside: Sequence[Term]) -> Noise:
    """Noise of what the pool's terms leave, those beside them fitted as well."""
    more = [t for t in beside if not any(t.place == one.place or contains(one, t) for one in pool.terms)]
    if more:
        pool = Pool(equations, pool.noise, [*pool.terms, *more], pool.link_error)
    return noise_of(equations, pool.residual(pool.whole), floor)


def settled(candidates: Candidates, equations: Equations, pool: Pool) -> Pool:
    """The pool with load, bodies and the points its columns are made at as its own fit has them; its noise is kept."""
    for _ in range(LAST_ROUNDS):
        fit = pool.whole
        terms = list(pool.terms)
        for chosen in fit.terms:
            term, coefficients = terms[chosen], pool.coefficients(fit, chosen)
            terms[chosen] = term.shaped(term.effect.relinearised(coefficients, dict(term.shape)))
        relieve(candidates, equations, pool)
        pool = Pool(equations, pool.noise, terms, pool.link_error)
    return pool


def windows_anew(candidates: Candidates, equations: Equations, pool: Pool) -> Pool:
    """The pool with the windows of its wrenches found anew: in all rows, where those of a search left some out.

    What begins in a stretch that was left out can be timed only there.
    """
    pushes = [one for one, term in enumerate(pool.terms) if term.effect.timed]
    return refined(candidates, equations, pool, range(len(pool.terms)), pushes)
