"""Uncertainty that a diagnosis leaves in the joint effects of the extended model, and corrections to these by a later one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import COMMON, Term
from bdnn_ros.diagnosis.regression.unsure import ERROR_FACTOR, Unsure, slots_of
from bdnn_ros.diagnosis.search.candidates import acting_per_measured
from bdnn_ros.effects.friction import SLIDING
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.extension.earlier import Known
from bdnn_ros.robot import Robot

AT_JOINTS = frozenset({*COMMON, *SLIDING, "quadratic_drag", "joint_spring", "cogging"})
"""Effects of which it is counted how well they are known: they last, add up and depend on the motion alone."""
IN_ROBOT = ("armature", "viscous_friction")
"""Those of them that a robot holds."""
SURE = 2.0
"""What was left out is taken in where it is so many standard deviations from nothing."""


def unsure_of(examination: Examination) -> Unsure:
    """The uncertainty of the joint effects after a diagnosis.

    Common effects that were too small to be named still exist: their uncertainty is as large as their estimate, together with
    the changes of the other terms that go with them. If an earlier model was compared, its uncertainty takes their place.
    """
    pool, fit, equations = examination.pool, examination.fit, examination.equations
    told = [pool.terms[chosen] for chosen in fit.terms]
    if equations.errors.joints is None and equations.errors.unsure is None:
        missing = [*_missing(told, equations.rows.width)]
        every = Pool(equations, pool.noise, [*told, *missing], pool.link_error)
    else:
        missing, every = [], Pool(equations, pool.noise, told, pool.link_error)
    if equations.errors.unsure is not None:  # what the motion says nothing of is as well known as it was
        last = np.arange(equations.rigid.shape[2])[equations.errors.unsure.last]
        precision = every.precision.copy()
        precision[last] *= ERROR_FACTOR**2
        every = every.changed(precision=precision)
    whole = every.whole
    terms = _known(examination, [*told, *missing])
    by_all, by_told = _by(every, whole, terms), _by(pool, fit, terms)
    # where nothing was taken over of what the data say, what was known before is all that is known
    known = whole.covariance if fit.coefficients.any() else np.diag(1.0 / whole.precision)
    covariance = by_all @ known @ by_all.T
    if missing:
        other = by_all @ whole.coefficients - by_told @ fit.coefficients
        joints = np.concatenate(
            [[one.target] * (s.stop - s.start) for one, s in zip(terms, slots_of(terms), strict=True)]
        )
        # that it is off by as much as it is large is no underestimate
        covariance += np.where(joints[:, None] == joints, np.outer(other, other), 0.0) / ERROR_FACTOR**2
    return Unsure(tuple(terms), covariance)


def _plain(term: Term) -> Term:
    """The term as an effect of its own, not as a change."""
    return Term(get(term.effect.name, term.effect.variant), term.target, shape=term.shape)


def _missing(told: Sequence[Term], width: int) -> Iterator[Term]:
    """The common effects at n = `width` joints that were not found; dry friction counts in any variant."""
    for name in COMMON:
        same = SLIDING if name in SLIDING else (name,)
        there = {term.target for term in told if term.effect.name in same}
        yield from (Term(get(name), joint) for joint in range(width) if joint not in there)


def _known(examination: Examination, told: Sequence[Term]) -> list[Term]:
    """Joint effects that were found, left out, or known before, each once."""
    equations = examination.equations
    before = [] if equations.errors.unsure is None else [*equations.errors.unsure.terms]
    if equations.errors.joints is not None:
        before += [Term(get(name), joint) for name in COMMON for joint in range(equations.rows.width)]
    now = [_plain(one) for one in told if one.effect.name in AT_JOINTS]
    return [*dict.fromkeys([*before, *now])]


def _by(pool: Pool, fit: Fit, terms: Sequence[Term]) -> np.ndarray:
    """Map from a fit's coefficients (P,) to those of the joint effects, (K, P)."""
    equations, where = pool.equations, dict(zip(terms, slots_of(terms), strict=True))
    size = max((slot.stop for slot in where.values()), default=0)
    result, links = np.zeros((size, len(fit.coefficients))), equations.rigid.shape[2]
    if equations.errors.joints is not None:
        own = (Term(get(name), joint) for name in COMMON for joint in range(equations.rows.width))
        for one, row in zip(own, equations.errors.joints.parameters, strict=True):
            result[where[one], : len(row)] += row
    if equations.errors.unsure is not None:
        last = np.arange(links)[equations.errors.unsure.last]
        for one, slot in zip(equations.errors.unsure.terms, equations.errors.unsure.slots, strict=True):
            result[where[one], last] += equations.errors.unsure.errors[slot]
    for chosen in fit.terms:
        told = pool.terms[chosen]
        if told.effect.name in AT_JOINTS and (one := _plain(told)) in where:
            slot, acting = where[one], acting_per_measured(pool, fit, chosen)
            result[slot, pool.rows(fit, chosen)] += acting * np.eye(slot.stop - slot.start)
    return result


def joints_moved(
    robot: Robot, before: Sequence[Known], unsure: Unsure, errors: np.ndarray, covariance: np.ndarray
) -> tuple[Robot, list[Known]]:
    """A robot and effects corrected by the errors of the uncertain quantities; none becomes impossible.

    Args:
        before: the effects of the earlier model.
        errors, covariance: of all that was not known, (U,) and (U, U).
    """
    joints = {kind: getattr(robot, kind).copy() for kind in ("armature", "viscous")}
    own = unsure.errors @ covariance[unsure.last, unsure.last] @ unsure.errors.T
    stds = np.sqrt(np.diag(own))
    effects: list[Known] = []
    had = [(_of(effect), effect) for effect, _ in before if effect.effect.name in AT_JOINTS]
    for term, slot, more in zip(unsure.terms, unsure.slots, unsure.moved(errors), strict=True):
        if term.effect.name in IN_ROBOT:
            kind = term.effect.name.removesuffix("_friction")
            joints[kind][term.target] = max(joints[kind][term.target] + more[0], 0.0)
            continue
        there = [term.effect.coefficients(effect.values)[0] for one, effect in had if one == term]
        if not there and (np.abs(more) <= SURE * stds[slot]).all():
            continue
        lowest = np.array(term.effect.coefficient_bounds)[:, 0] - sum(there, np.zeros(len(more)))
        values = term.effect.values(np.maximum(more, lowest), dict(term.shape))
        effects.append((Installed(term.effect, term.target, None, values), {}))
    return robot.with_joint_parameters(**joints), effects


def _of(effect: Installed) -> Term:
    """The term of an effect."""
    return Term(effect.effect, effect.target, effect.link).shaped(
        effect.effect.coefficients(effect.values)[1]
    )
