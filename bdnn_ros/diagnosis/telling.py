"""What is said of a diagnosis: which terms are findings, the verdict, the gain, and what is left."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.advice import advice
from bdnn_ros.diagnosis.attempt import Attempt
from bdnn_ros.diagnosis.building import least_motion
from bdnn_ros.diagnosis.compared import Compared
from bdnn_ros.diagnosis.equations import Equations
from bdnn_ros.diagnosis.evidence import Pool
from bdnn_ros.diagnosis.gains import by_links, gain_of, rms, share_of, squares
from bdnn_ros.diagnosis.leads import parted
from bdnn_ros.diagnosis.naming import name_of, named
from bdnn_ros.diagnosis.notes import (
    AT_AN_END,
    AT_REST,
    FAR_OFF,
    MOST,
    THROUGHOUT,
    loads,
    mended,
    mostly_links,
    of_recording,
    one_clock,
    uncompared,
    unknown,
    unnamed,
)
from bdnn_ros.diagnosis.posterior import Estimate
from bdnn_ros.diagnosis.pushes import at_an_end, throughout
from bdnn_ros.diagnosis.result import Diagnosis, Finding, Verdict, reference, remaining
from bdnn_ros.diagnosis.unexplained import Remainder
from bdnn_ros.diagnosis.velocity_filter import reported_velocity
from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

USUAL_LINK_ERROR = 0.1
"""Spread of the links' relative errors that any description may have."""
MUCH_LEFT = 0.5
"""Of joints that move now and then, what leaves this share of a joint's error may stand for what changes with time there."""
GROWS = 1.02
"""What is larger by no more than this factor may as well be the same."""
EXPLAINED = 1.3
"""An extended model within this factor of the noise floor explains the recording."""


def told(
    recordings: Sequence[Recording],
    robot: Robot,
    equations: Equations,
    attempt: Attempt,
    found: Sequence[Estimate],
    remainder: Remainder,
    since: Compared | None = None,
    cutoff: float | None = None,
) -> Diagnosis:
    """The diagnosis, its errors and its gain on rows that the search has not seen.

    Args:
        found: the chosen terms' estimates from all rows, in the order of the attempt's.
        remainder: what all of them leave.
        since: the earlier model that takes the simulation's place, if one does.
        cutoff: low-pass that was asked for [Hz].
    """
    extended, held = attempt.extended, equations.usable & attempt.test[:, None]
    simulation, after = rms(equations.target, held), rms(extended, held)
    floor = np.minimum(np.maximum(remainder.floor, 0.0), after)
    near_floor = _near(after, floor, equations.effort_scale)
    unfit = _unfit(equations, simulation, after, near_floor)
    every = range(len(found))
    at_ends = {one for one in every if at_an_end(attempt.fitted, every, one)}
    always = {one for one in every if throughout(attempt.fitted, every, one)}
    names = named(robot, equations, attempt, found, unfit, at_ends | always)
    before = None if since is None else since.velocity_cutoff
    # a filtered velocity is no cause of an effort's error, and says nothing of what else is one
    causes, of_velocity = (
        sorted(some, key=lambda finding: -finding.share)
        for some in (names.findings, reported_velocity(recordings, cutoff, before))
    )
    findings = [*causes, *of_velocity]
    far_off = attempt.fitted.link_error > USUAL_LINK_ERROR
    gain, interval = gain_of(equations, extended, held)
    share = max(squares(after**2 - floor**2, held) / max(squares(simulation**2, held), 1e-30), 0.0)
    near = bool(near_floor.all())
    above = _above(robot.joints, near_floor, after**2 - floor**2)
    of_weight = equations.alone is not None and not _near(simulation, floor, equations.effort_scale).all()
    # what dry friction is named for may hold any effort at rest
    at_rest = () if causes else remainder.resting
    unclear = names.doubtful or bool(names.unknown) or far_off or of_weight or bool(at_rest) or bool(always)
    of_effort = _verdict(causes, unclear, near, names.unsaid <= MOST)
    return Diagnosis(
        source=_source(recordings, equations),
        verdict="explained" if of_effort == "nothing_wrong" and findings else of_effort,
        findings=tuple(findings),
        effort_rmse={"simulation": simulation, "extended": after, "noise_floor": floor},
        gain=gain,
        gain_interval=interval,
        unexplained_share=share,
        unexplained_depends_on=tuple(remainder.depends_on(above))[:6],
        unexplained_sentence=_unexplained_sentence(
            share, remainder, above, reference(bool(since)), bool(causes)
        ),
        advice=tuple(
            advice(
                [found[one] for one in names.weighty],
                [attempt.judgements[one] for one in names.weighty],
                robot,
                lambda term: name_of(robot, term),
                [k for k, one in enumerate(names.weighty) if one in (*names.silent, *names.unknown)],
            )
        ),
        notes=(
            *(note for recording in recordings for note in recording.notes),
            *of_recording(robot, equations),
            *uncompared(robot, equations.usable, held),
            *one_clock(recordings, findings),
            *[AT_AN_END] * bool(at_ends),
            *[THROUGHOUT] * bool(always),
            *loads(robot, findings, equations.motion.time[equations.rows], equations.motion.signals.begun),
            *unnamed(
                [(found[one].term, name_of(robot, found[one].term)) for one in names.silent],
                names.unsaid,
                bool(since),
            ),
            *unknown([(found[one], name_of(robot, found[one].term)) for one in names.unknown]),
            *[FAR_OFF] * far_off,
            *(mostly_links(by_links(equations, attempt.fitted, held), bool(since)) if causes else ()),
            *(
                _mended(equations, attempt.fitted, held, interval[0], since)
                if of_effort == "nothing_wrong"
                else ()
            ),
            *[AT_REST.format(joints=listed(at_rest), reference=reference(bool(since)))] * bool(at_rest),
        ),
        above=above,
    )


def _mended(
    equations: Equations, fitted: Pool, rows: np.ndarray, least: float, since: Compared | None
) -> list[str]:
    """What the extended model mends in some rows that has no name, `least` of the squared error for sure."""
    lead = parted(fitted, fitted.whole)[0]
    by_lead = share_of(equations.nuisances[:, :, 0] * lead, fitted.left(), equations.target, rows)
    of_links = by_links(equations, fitted, rows)
    return mended(least, of_links, by_lead, lead, equations.hold, bool(since))


def _near(error: np.ndarray, floor: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Whether each joint's error is near its floor, or too small a share of its effort to matter, (n,) each [N·m]."""
    return np.asarray((error <= EXPLAINED * floor) | (error <= 0.02 * scale))


def _unfit(
    equations: Equations, simulation: np.ndarray, extended: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Joints of which nothing is named, (n,) bool: what was found does not say what happens there.

    That is all of them where held-out errors grow above the noise, by share of each joint's effort or in all, and a
    joint that moves now and then where much of its error is left: its causes may stand for a push or a drift.

    Args:
        simulation, extended: held-out errors of either model, (n,) [N·m].
        near: whether the extended one's is near the noise, (n,) bool.
    """
    scaled = (np.sum((error / equations.effort_scale) ** 2) for error in (simulation, extended))
    plain = (GROWS**2 * np.sum(simulation**2), np.sum(extended**2))
    seldom = equations.moving < least_motion(equations.motion.signals)
    # what acted outside the held-out rows alone leaves them as they were, at the noise
    worse = any(after > before for before, after in (scaled, plain)) and not near.all()
    return np.asarray((seldom & ~near & (extended > MUCH_LEFT * simulation)) | worse)


def _verdict(causes: Sequence[Finding], doubtful: bool, near: bool, said: bool) -> Verdict:
    """That on the effort. Where something large is likely without being sure, nobody can say that nothing is wrong.

    Args:
        causes: findings that are of the effort.
        near: whether the extended model's error is no more than the noise.
        said: whether most of what the extended model mends is not without a name.
    """
    if causes:
        return "explained" if near and said else "partly_explained"
    return "nothing_wrong" if near and not doubtful else "cannot_tell"


def _above(joints: Sequence[str], near: np.ndarray, left: np.ndarray) -> tuple[str, ...]:
    """Where the extended model errs by more than the noise, most first, by what is left, (n,) [(N·m)²]."""
    return tuple(joints[j] for j in np.argsort(-left, kind="stable") if not near[j])


def _unexplained_sentence(
    share: float, remainder: Remainder, above: Sequence[str], reference: str, named: bool = True
) -> str:
    if share > 1.0:
        return f"What was found predicts the motion that was held out worse than the {reference} does."
    much = remaining(share).capitalize()
    where = f", at {listed(above)}" if above else ""
    left = f"{much} of the {reference}'s squared error is left above the noise{where}"
    if not named and not above:  # all of a small error may well be left
        left = "What is left is hardly more than noise"
    inputs = remainder.depends_on(above)
    if inputs:
        of_these = [joint for joint in above if joint in remainder.inputs]
        there = f"at {listed(of_these)} it" if len(of_these) < len(above) else "it"
        return f"{left}; {there} depends on {', '.join([*inputs][:3])}."
    if remainder.bursts:
        return f"{left}, in bursts at {listed(remainder.bursts)}; no position, velocity, acceleration, load or time predicts it."
    if above:
        return f"{left}; no position, velocity, acceleration, load or time predicts it."
    return "What is left looks like noise: no position, velocity, acceleration, load or time predicts it."


def _source(recordings: Sequence[Recording], equations: Equations) -> dict[str, object]:
    signals = equations.motion.signals
    return {
        "bags": [recording.name for recording in recordings],
        "duration": round(sum(recording.recorded for recording in recordings), 3),
        "samples": sum(len(recording) for recording in recordings),
        "rate": round(signals.raw_rate, 3),
        "cutoff": round(signals.cutoff, 3),
        "urdf": "",
        "joints": list(signals.joints),
    }
