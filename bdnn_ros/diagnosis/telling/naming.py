"""Which terms of a fit become findings: those that are sure, large enough, and confirmed by held-out rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.diagnosis.judging.identifiability import Judgement
from bdnn_ros.diagnosis.judging.lookalikes import Placed
from bdnn_ros.diagnosis.judging.posterior import CLEAR, Estimate
from bdnn_ros.diagnosis.pushes.pushes import leftover, together
from bdnn_ros.diagnosis.regression.building import least_motion
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.errors import USUAL_MASS_ERROR
from bdnn_ros.diagnosis.regression.gains import removed, squares
from bdnn_ros.diagnosis.regression.term import WEAR
from bdnn_ros.diagnosis.result import Finding, Rival
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.unexplained import LARGE_ERROR
from bdnn_ros.effects.actuation import EffortDelay
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.environment import EDGES
from bdnn_ros.effects.rigid import POINT, OnBody, slots
from bdnn_ros.robot import Robot
from bdnn_ros.robot.axes import rotor_on

SAMPLES_LATE = 0.75
"""Delays below this many sample periods say no more than when in its sample an effort was taken."""
DOUBTFUL = 0.1
"""Probability of no cause above which, or of the cause itself below which, an effect stays in the model without a name."""
UNLIKELY = 0.5
"""An unnamed effect counts as a doubt only if no cause at all is at most this probable."""
OF_THIS_FORM = 2.0
"""An effect other than wear must remove this many times the predictable rest; else the law has not its form."""
CHANGES = " Its force changes meanwhile, or where it acts: this is the constant push that comes nearest."
"""Added to the sentence of a push that changes."""
MUCH_LEFT = 0.5
"""Share of a joint's error that, if left, makes its causes doubtful: at a joint that moves now and then they may stand for
changes with time, and a real constant push leaves only noise."""
GROWS = 1.02
"""Ratio of errors up to which they count as equal."""
ANYTHING = 1e3
"""Factor that makes a prior standard deviation practically unbounded."""


@dataclass(frozen=True)
class Doubts:
    """Reasons against a name at a joint.

    Attributes:
        unfit: joints at which nothing is named, (n,) bool.
        poor: joints with much error left, at which no constant push is named, (n,) bool.
        told: squared error left above the noise where inputs predict it, see `Case.predictable`, (n,) [(N·m)²].
    """

    unfit: np.ndarray
    poor: np.ndarray
    told: np.ndarray

    @classmethod
    def of(cls, case: Case) -> Doubts:
        """Those of a case.

        The model of what was found is valid nowhere if held-out errors grow above the noise, relative to each joint's effort or
        in total; nor at a joint that moves now and then with much of its error left, whose causes may stand for a push or drift.
        """
        equations, before, after = case.equations, case.simulation, case.extended
        near = case.near(after)
        poor = np.asarray(~near & (after > MUCH_LEFT * before))
        scaled = (np.sum((error / equations.rows.effort_scale) ** 2) for error in (before, after))
        plain = (GROWS**2 * np.sum(before**2), np.sum(after**2))
        seldom = equations.rows.moving < least_motion(equations.motion.signals)
        # a cause outside the held-out rows leaves their error at the noise: no reason against it
        worse = any(now > then for then, now in (scaled, plain)) and not near.all()
        return cls(np.asarray((seldom & poor) | worse), poor, case.predictable)

    def against(self, effect: Effect, changing: bool, joint: int, less: float) -> bool:
        """Whether an effect that removes `less` [(N·m)²] of error, mostly at a joint, must not be named there."""
        constant = effect.timed and not changing
        formed = effect.name in WEAR or less >= OF_THIS_FORM * self.told[joint]
        return bool(self.unfit[joint] or (constant and self.poor[joint]) or not formed)


@dataclass(frozen=True)
class Named:
    """Findings, and terms without a name.

    Attributes:
        findings: terms that are sure and large enough.
        doubtful: whether something large is likely without being sure.
        weighty: terms that are large enough and confirmed by held-out rows.
        silent: terms that are large enough but have no name.
        unknown: bodies that are sure, large enough and beyond usual link errors, though their masses are not known.
        unsaid: share of the simulation's squared error that lasting terms without a name remove.
        beside_links: the same without wrong links, since all are a little wrong.
    """

    findings: list[Finding]
    doubtful: bool
    weighty: list[int]
    silent: list[int]
    unknown: list[int]
    unsaid: float
    beside_links: float


def named(case: Case, doubts: Doubts) -> Named:
    """Decide which terms become findings, with reasons against names at the joints."""
    robot, equations, attempt, found = case.robot, case.equations, case.attempt, case.found
    held, unnamed = case.held, case.at_ends | case.always
    taken = removed(equations, attempt.fitted, attempt.extended, held, equations.usable)
    scale = equations.rows.effort_scale
    before = max(float(np.sum(equations.rows.target[held] ** 2)), 1e-30)
    findings, weighty, doubtful, large = [], list[int](), False, LARGE_ERROR * scale
    silent, unknown = list[int](), list[int]()
    every, error = range(len(found)), attempt.fitted.link_error
    for one, estimate, judgement, (held_out, ever) in zip(
        every, found, attempt.judgements, taken, strict=True
    ):
        less, large_enough = held_out.less, held_out.noticeable or ever.noticeable
        silent += [one] * large_enough
        borne_out = (held_out.brief or judgement.steady) and float(np.sum(less / scale**2)) > 0.0
        borne_out &= float(np.sum(ever.less / scale**2)) > 0.0
        if not (large_enough and borne_out) or one in unnamed or leftover(attempt.fitted, every, one):
            continue
        if _with_its_sample(estimate, equations):
            continue
        weighty.append(one)
        sure = judgement.nothing <= DOUBTFUL <= judgement.at_least(estimate.term)
        # doubts about an effect on a link or the base are those of the joint at which it removes most
        most = int(np.argmax(ever.less / scale**2))
        removes = float(max(held_out.less[most], ever.less[most]))
        sure &= not doubts.against(estimate.term.effect, judgement.changing, most, removes)
        if sure and (estimate.shown or _alone(estimate, found)):
            # causes that work against each other may each remove more than there is
            share = min(max(squares(less, held) / before, 0.0), 1.0)
            findings.append(_finding(robot, estimate, judgement, share))
            silent.remove(one)
        elif (
            sure
            and estimate.term.effect.on_body
            and estimate.there
            and beyond_links(equations, error, estimate)
        ):
            unknown.append(one)
            silent.remove(one)
        elif judgement.nothing <= UNLIKELY:
            doubtful |= bool((less > large**2).any())
    lasting = [one for one in (*silent, *unknown) if not found[one].term.effect.timed]
    each = {one: max(squares(taken[one][0].less, held), 0.0) / before for one in lasting}
    of_links = sum(share for one, share in each.items() if found[one].term.effect.name == "link_inertia")
    unsaid = sum(each.values())
    return Named(findings, doubtful, weighty, silent, unknown, unsaid, unsaid - of_links)


def beyond_links(
    equations: Equations, link_error: float, estimate: Estimate, but_rotor: bool = False
) -> bool:
    """Whether a change of a body is significantly more than its link may be off by anyway.

    Args:
        link_error: prior standard deviation of the links' relative errors.
        but_rotor: disregard inertia about the joint's axis, which may be a rotor's.
    """
    term, robot = estimate.term, equations.motion.robot
    assert isinstance(term.effect, OnBody) and term.link is not None
    body, added = term.effect.inertials(robot, dict(term.shape), term.link)
    usual = max(link_error, USUAL_MASS_ERROR) if equations.errors.joints is None else link_error
    own = equations.errors.relative[slots(body)] * equations.errors.spread(usual)
    count = added.shape[1]
    covariance = own @ own.T + added @ estimate.doubting[:count, :count] @ added.T
    if but_rotor:
        rotor = ANYTHING * math.sqrt(covariance.diagonal()[POINT:].max()) * rotor_on(robot, body)
        covariance += np.outer(rotor, rotor)
    size = np.sqrt(np.diag(covariance))
    change = added @ estimate.coefficients / size
    squared = change @ np.linalg.pinv(covariance / np.outer(size, size), hermitian=True) @ change
    return math.sqrt(max(float(squared), 0.0)) > CLEAR


def _with_its_sample(estimate: Estimate, equations: Equations) -> bool:
    """Whether a delay is too short to differ from when in its sample the effort was taken."""
    if estimate.term.effect.name != EffortDelay.name:
        return False
    return abs(estimate.values["delay"]) < SAMPLES_LATE / equations.motion.signals.raw_rate


def _alone(push: Estimate, found: Sequence[Estimate]) -> bool:
    """Whether a push is the only one at its time, so that a push is sure even if no part of its wrench is.

    On few joints many wrenches do the same. A second, unsure push may be left over from the first, and a push whose times are
    unknown by more than its length is none.
    """
    if not (push.term.effect.timed and push.possible):
        return False
    start, end = (push.quantities[edge] for edge in EDGES)
    if max(start.std, end.std) > end.value - start.value:
        return False
    return not any(together(push.term, other.term) for other in found if other is not push)


def _finding(robot: Robot, estimate: Estimate, judgement: Judgement, share: float) -> Finding:
    joint, link = _place(robot, estimate.term)
    rivals = tuple(
        Rival(rival.effect.name, *_place(robot, rival), probability, rival.effect.variant)
        for rival, probability in judgement.rivals
    )
    where = link or joint or name_of(robot, estimate.term).replace("the base", "The base")
    effect = estimate.term.effect.at(robot, estimate.term.target, link)
    quantities = ((p, estimate.quantities[p.name]) for p in effect.parameters)
    parameters = {p.name: replace(q, unit=p.unit_at(effect.slides)) for p, q in quantities}
    return Finding(
        effect=effect.name,
        joint=joint,
        link=link,
        parameters=parameters,
        share=share,
        probability=judgement.probability,
        rivals=rivals,
        sentence=effect.sentence(where, _told(estimate)) + CHANGES * judgement.changing,
        variant=effect.variant,
    )


def _told(estimate: Estimate) -> dict[str, float]:
    """Parameters for a sentence: NaN for a part of a whole that the motion does not show."""
    effect = estimate.term.effect
    return {
        p.name: q.value if p.name not in effect.parts or p.seen(q.value, q.std) else math.nan
        for p, q in ((p, estimate.quantities[p.name]) for p in effect.parameters)
    }


def _place(robot: Robot, term: Placed) -> tuple[str | None, str | None]:
    if term.link:
        return None, term.link
    return (robot.joints[term.target] if term.target >= 0 else None), None


def name_of(robot: Robot, term: Placed) -> str:
    """Name of a term's joint or link, or words if it has none."""
    joint, link = _place(robot, term)
    return joint or link or ("the base" if term.effect.on == "base" else "every joint")
