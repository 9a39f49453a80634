"""What a recording can tell at best: the evidence for a hidden effect, for one who knows what to look for.

Nothing but the effect is in question: what else is true of the robot is given, with its shapes and all but its sizes. What
links' errors explain as well, or a simpler effect that this one contains or settles into, no diagnosis can tell from it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from _naming_judging import WORN

from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.diagnosis.regression.coloring import noise_of
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.odds import link_error_cost
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.search import LINK_ERRORS
from bdnn_ros.diagnosis.search.settling import update_load
from bdnn_ros.effects.registry import Installed, get, variants
from bdnn_ros.robot import Robot

ROUNDS = 2


def evidence(
    truth: Mapping[str, Any], hidden: Sequence[Installed], examination: Examination
) -> dict[tuple[str, int], float]:
    """Log evidence for each hidden effect by name and joint; what shows in the reported velocity alone is left out.

    Args:
        truth: of the draw, for its wear.
        hidden: what was installed.
    """
    robot, equations = examination.robot, examination.equations
    counted = equations.usable
    equations.use_rows(
        equations.rows.usable
    )  # what a search sees, more than what parameters are estimated from
    own = [_term(one) for one in hidden if not one.effect.kinematic]
    terms = [*own, *_wear(truth, robot)]
    pool = Pool(equations, examination.pool.noise, terms, examination.pool.link_error)
    for _ in range(ROUNDS):
        residual = pool.residual(pool.whole)
        noise = noise_of(equations, residual, 1e-4 * equations.rows.effort_scale)
        update_load(Candidates.of(robot), equations, pool)
        pool = Pool(equations, noise, terms, pool.link_error)
    gained = {(term.effect.name, term.target): _gain(pool, k) for k, term in enumerate(own)}
    equations.use_rows(counted)
    return gained


def _gain(pool: Pool, one: int) -> float:
    """Log evidence of all terms less the best of what one of them could be instead: nothing, or a part of it."""
    term, count = pool.terms[one], len(pool.terms)
    parts = [Term(get(name), term.target) for name in term.effect.contains]
    settled = term.settled(pool.equations.motion)
    parts += [] if settled is None else [settled]
    rest = [k for k in range(count) if k != one]
    instead = [rest, *([*rest, count + k] for k in range(len(parts)))]
    with_parts = Pool(pool.equations, pool.noise, [*pool.terms, *parts], pool.link_error)
    beliefs = [with_parts.with_link_error(error) for error in LINK_ERRORS]
    return max(_score(p, range(count)) for p in beliefs) - max(_score(p, s) for p in beliefs for s in instead)


def _score(pool: Pool, chosen: Sequence[int]) -> float:
    return pool.fit(chosen).evidence - link_error_cost(pool)


def _term(one: Installed) -> Term:
    """The effect as a term whose columns have the true shape."""
    _, shape = one.effect.coefficients(one.values)
    return Term(one.effect, one.target, one.link).shaped(dict(shape))


def _wear(truth: Mapping[str, Any], robot: Robot) -> list[Term]:
    if not truth.get("worn"):
        return []
    return [Term(variants(name)[0], j) for name in WORN for j in range(robot.width)]
