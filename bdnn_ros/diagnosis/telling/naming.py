"""Which terms of a fit have a name: those that are sure, large enough, and borne out by rows that were not fitted."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.diagnosis.judging.attempt import Attempt
from bdnn_ros.diagnosis.judging.identifiability import Judgement
from bdnn_ros.diagnosis.judging.lookalikes import Placed
from bdnn_ros.diagnosis.judging.posterior import CLEAR, Estimate
from bdnn_ros.diagnosis.pushes.pushes import leftover, together
from bdnn_ros.diagnosis.regression.equations import USUAL_MASS_ERROR, Equations
from bdnn_ros.diagnosis.regression.gains import removed, squares
from bdnn_ros.diagnosis.regression.term import WEAR
from bdnn_ros.diagnosis.result import Finding, Rival
from bdnn_ros.diagnosis.telling.unexplained import LARGE_ERROR
from bdnn_ros.effects.actuation import EffortDelay
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.environment import EDGES
from bdnn_ros.effects.rigid import POINT, OnBody, slots
from bdnn_ros.robot import Robot
from bdnn_ros.robot.axes import rotor_on

SAMPLES_LATE = 0.75
"""What acts later than its stamp by less than so many sample periods acts with its sample."""
DOUBTFUL = 0.1
"""An effect that may as well not be there with this probability stays in the model without a name, as one that is hardly as
likely as this beside what could stand in its place."""
UNLIKELY = 0.5
"""What has no name is told as a doubt only where nothing at all is no likelier than this."""
OF_THIS_FORM = 2.0
"""Any other law removes so many times what is left that inputs predict: else they do something there that has not its form."""
CHANGES = " Its force changes meanwhile, or where it acts: this is the constant push that comes nearest."
"""What is said of a push that no constant one explains."""

ANYTHING = 1e3
"""So many times as large as usual may be anything."""


@dataclass(frozen=True)
class Doubts:
    """What speaks against a name at a joint.

    Attributes:
        unfit: joints of which nothing is named, (n,) bool.
        poor: those where much is left, of which no push is named that is constant, (n,) bool.
        told: what is left there that inputs predict, (n,) [(N·m)²].
    """

    unfit: np.ndarray
    poor: np.ndarray
    told: np.ndarray

    def against(self, effect: Effect, changing: bool, joint: int, less: float) -> bool:
        """Whether an effect that removes most of a joint's error, `less` [(N·m)²], is not to be named there."""
        constant = effect.timed and not changing
        formed = effect.name in WEAR or less >= OF_THIS_FORM * self.told[joint]
        return bool(self.unfit[joint] or (constant and self.poor[joint]) or not formed)


@dataclass(frozen=True)
class Named:
    """What of some terms has a name.

    Attributes:
        findings: what is sure and large enough for one.
        doubtful: whether something large is likely without being sure.
        weighty: what is large enough, and borne out.
        silent: what is large enough and has none.
        unknown: payloads that are sure and large enough, and beyond what links may be off by, though their masses are not known.
        unsaid: share of the simulation's squared error that the model takes away by what has no name.
        beside_links: the same but for links that are off, as all are a little.
    """

    findings: list[Finding]
    doubtful: bool
    weighty: list[int]
    silent: list[int]
    unknown: list[int]
    unsaid: float
    beside_links: float


def named(
    robot: Robot,
    equations: Equations,
    attempt: Attempt,
    found: Sequence[Estimate],
    doubts: Doubts,
    unnamed: Container[int],
) -> Named:
    """Which terms have a name.

    Args:
        doubts: what speaks against names at the joints.
        unnamed: terms that have no name, whatever they explain.
    """
    held = equations.usable & attempt.test[:, None]
    taken = removed(equations, attempt.fitted, attempt.extended, held, equations.usable)
    scale = equations.effort_scale
    before = max(float(np.sum(equations.target[held] ** 2)), 1e-30)
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
        # what is named for a link or the base is told by joints that bear most of it
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
    """Whether a body's change is more than its link may be off by anyway, as well as it is known.

    Args:
        link_error: by which the links seem to be off.
        but_rotor: look at what is no inertia about the joint's axis, as of a rotor.
    """
    term, robot = estimate.term, equations.motion.robot
    assert isinstance(term.effect, OnBody) and term.link is not None
    body, added = term.effect.inertials(robot, dict(term.shape), term.link)
    usual = max(link_error, USUAL_MASS_ERROR) if equations.jointwise is None else link_error
    own = equations.relative[slots(body)] * equations.link_spread(usual)
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
    """Whether a delay is one that tells no more than where in its sample an effort was taken."""
    if estimate.term.effect.name != EffortDelay.name:
        return False
    return abs(estimate.values["delay"]) < SAMPLES_LATE / equations.motion.signals.raw_rate


def _alone(push: Estimate, found: Sequence[Estimate]) -> bool:
    """Whether a push is the only one at its time: then that something pushes is sure, though no part of its wrench is.

    On few joints many a wrench does the same. A second push that is not known may be what is left of the first, and one that
    may as well have begun or ended long before is none.
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
    """Parameters as a sentence tells them: NaN for the part of a whole that the motion does not show."""
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
    """The name of a term's joint or link, in words where it has none."""
    joint, link = _place(robot, term)
    return joint or link or ("the base" if term.effect.on == "base" else "every joint")
