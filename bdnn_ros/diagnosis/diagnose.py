"""From recordings and a simulation to findings: what it gets wrong, the cause, the gain, and what cannot be told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bdnn_ros.diagnosis.building import build
from bdnn_ros.diagnosis.candidates import Candidates
from bdnn_ros.diagnosis.equations import Equations
from bdnn_ros.diagnosis.evidence import Fit, Pool
from bdnn_ros.diagnosis.gains import MINIMUM_SHARE, gain_of, noticeable, removed, rms
from bdnn_ros.diagnosis.identifiability import Judgement, advice, judge, likelier
from bdnn_ros.diagnosis.joining import concatenated
from bdnn_ros.diagnosis.kinematics import reported_velocity
from bdnn_ros.diagnosis.lowpass import CUTOFF_OF_USUAL, quiet_cutoff
from bdnn_ros.diagnosis.posterior import Estimate, estimates
from bdnn_ros.diagnosis.result import Diagnosis, Finding, Rival, Verdict
from bdnn_ros.diagnosis.search import DOUBTS, LINK_ERRORS, Search, Selection
from bdnn_ros.diagnosis.settling import settled, timed
from bdnn_ros.diagnosis.unexplained import Remainder, describe
from bdnn_ros.errors import RecordingError
from bdnn_ros.recording import Recording
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals, flattened, prepare

EVERY_TEST_BLOCK = 5
"""One block in so many is kept out of the search and of the fit that the gain is measured with."""
TEST_PHASES = (2, 4)
"""Which one of them; the second where the first held something out that shows nowhere else."""
SURPRISING = 2.0
"""Held-out error per error of the rest that says so."""
SWAPS = 5
"""So many findings may give way to a rival that proves likelier."""
DOUBTFUL = 0.1
"""An effect that may as well not be there with this probability stays in the model without a name."""
EXPLAINED = 1.3
"""An extended model within this factor of the noise floor explains the recording."""

Progress = Callable[[str], None]


class Predicts(Protocol):
    """A model that predicts the effort along a motion."""

    def predict(self, signals: Signals) -> np.ndarray:
        """(N, n) [N·m], not low-passed."""


@dataclass(frozen=True)
class _Attempt:
    """What a search without the test rows found: its selection, and the fit to the rest with its error on all rows."""

    test: np.ndarray
    selection: Selection
    judgements: list[Judgement]
    fitted: Pool
    extended: np.ndarray


@dataclass(frozen=True)
class Examination:
    """A diagnosis with what it was made from, for the extended model and the report.

    Attributes:
        pool, fit: all data, the chosen terms.
        estimates: the findings' terms with their parameters, in the order of `fit.terms`.
        test: rows kept out of the search, (R,) bool.
        extended: held-out prediction error of the extended model, rows (R, n) [N·m].
        model: what took the simulation's place, if anything did.
    """

    diagnosis: Diagnosis
    recordings: tuple[Recording, ...]
    robot: Robot
    equations: Equations
    pool: Pool
    fit: Fit
    estimates: tuple[Estimate, ...]
    test: np.ndarray
    extended: np.ndarray
    remainder: Remainder
    model: Predicts | None = None


def diagnose(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    cutoff: float | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Findings of `examine`."""
    return examine(recordings, robot, cutoff=cutoff, progress=progress).diagnosis


def examine(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    cutoff: float | None = None,
    progress: Progress | None = None,
    model: Predicts | None = None,
) -> Examination:
    """Diagnose recordings of a robot against its simulation, or against a model identified earlier.

    Args:
        recordings: with effort; joints in the robot's order.
        robot: what the simulation believes.
        cutoff: low-pass [Hz], None chooses.
        progress: called with a few words on what is being done.
        model: what takes the simulation's place: findings are then what changed since it was identified.

    Raises:
        RecordingError: no effort, too short, or no motion.
    """
    say = progress or (lambda text: None)
    for recording in recordings:
        recording.require_effort()
    say("filtering")
    lower = quiet_cutoff(recordings, robot) if cutoff is None else CUTOFF_OF_USUAL * cutoff
    signals = flattened(concatenated([prepare(recording, cutoff) for recording in recordings]), lower)
    known = getattr(model, "covariance", None)
    links = slice(robot.width * PER_LINK)
    equations = build(
        signals,
        robot,
        None if model is None else model.predict(signals),
        None if known is None else known[links, links],
    )
    equations.lead = float(getattr(model, "lead", 0.0))
    if equations.blocks < EVERY_TEST_BLOCK:
        raise RecordingError(
            f"{recordings[0].name}: {signals.time[-1] - signals.time[0]:.1f} s are too short for a diagnosis.",
            "Record at least 10 s of motion, better 30 s.",
        )
    whole, motion = equations.usable, equations.motion
    for phase in TEST_PHASES:
        equations.take(motion)
        search = Search(equations, Candidates.of(robot), say, LINK_ERRORS if known is None else DOUBTS)
        attempt = _attempted(search, whole, equations.block % EVERY_TEST_BLOCK == phase)
        if not _surprised(attempt, equations):
            break
        say("what was held out is not like the rest: again with other blocks")
    fitted = attempt.fitted
    pool = Pool(equations, fitted.noise, fitted.terms, fitted.link_error)
    fit = pool.fit(range(len(pool.terms)))
    found = estimates(pool, fit)
    remainder = describe(equations, pool.residual(fit, blur=False))
    diagnosis = _diagnosis(recordings, robot, equations, attempt, found, remainder)
    return Examination(
        diagnosis,
        tuple(recordings),
        robot,
        equations,
        pool,
        fit,
        tuple(found),
        attempt.test,
        attempt.extended,
        remainder,
        model,
    )


def _attempted(search: Search, whole: np.ndarray, test: np.ndarray) -> _Attempt:
    """What a search finds without the test rows (R,); the windows of wrenches are then found in all `whole` rows (R, n)."""
    equations = search.equations
    equations.count(whole & ~test[:, None])
    search.progress("first look")
    selection = search.run()
    search.progress("weighing rivals")
    judgements = judge(search, selection)
    for _ in range(SWAPS):
        better = likelier(selection, judgements)
        if better is None:
            break
        selection, judgements = better, judge(search, better)
    noise, link_error = selection.pool.noise, selection.pool.link_error
    equations.count(whole)
    terms = timed(search.candidates, equations, Pool(equations, noise, selection.terms, link_error)).terms
    equations.count(whole & ~test[:, None])
    fitted = settled(search.candidates, equations, Pool(equations, noise, terms, link_error))
    extended = fitted.residual(fitted.fit(range(len(terms))), blur=False)
    equations.count(whole)
    return _Attempt(test, selection, judgements, fitted, extended)


def _surprised(attempt: _Attempt, equations: Equations) -> bool:
    """Whether a joint's held-out error is so far above that of the rest that the search cannot have seen its cause."""
    held = rms(attempt.extended, equations.usable & attempt.test[:, None])
    rest = rms(attempt.extended, equations.usable & ~attempt.test[:, None])
    return bool(((held > SURPRISING * rest) & (held > MINIMUM_SHARE * equations.effort_scale)).any())


def _diagnosis(
    recordings: Sequence[Recording],
    robot: Robot,
    equations: Equations,
    attempt: _Attempt,
    found: Sequence[Estimate],
    remainder: Remainder,
) -> Diagnosis:
    extended, judgements = attempt.extended, attempt.judgements
    held = equations.usable & attempt.test[:, None]
    taken, ever = (removed(equations, attempt.fitted, extended, rows) for rows in (held, equations.usable))
    # what lasts a moment may remove nothing in any held-out row
    worth = _noticed(equations, attempt, taken, held) | _noticed(equations, attempt, ever, equations.usable)
    simulation, after = rms(equations.target, held), rms(extended, held)
    before = float(np.sum(simulation**2))
    findings = [
        _finding(robot, estimate, judgement, float(np.sum(less)) / max(before, 1e-30))
        for k, (estimate, judgement, less) in enumerate(zip(found, judgements, taken, strict=True))
        if judgement.nothing <= DOUBTFUL and k in worth
    ]
    findings += reported_velocity(recordings)
    findings.sort(key=lambda finding: -finding.share)
    floor = np.minimum(np.maximum(remainder.floor, 0.0), after)
    gain, interval = gain_of(equations, extended, held)
    share = max(float(np.sum(after**2 - floor**2) / max(np.sum(simulation**2), 1e-30)), 0.0)
    verdict = _verdict(findings, simulation, after, floor, equations.effort_scale)
    where = [_place(robot, e)[0] or _place(robot, e)[1] or "the base" for e in found]
    return Diagnosis(
        source=_source(recordings, equations),
        verdict=verdict,
        findings=tuple(findings),
        effort_rmse={"simulation": simulation, "extended": after, "noise_floor": floor},
        gain=gain,
        gain_interval=interval,
        unexplained_share=share,
        unexplained_depends_on=remainder.depends_on[:6],
        unexplained_sentence=_unexplained_sentence(share, remainder),
        advice=tuple(advice([e.term for e in found], judgements, where)),
        notes=tuple(note for recording in recordings for note in recording.notes),
    )


def _noticed(
    equations: Equations, attempt: _Attempt, taken: Sequence[np.ndarray], rows: np.ndarray
) -> set[int]:
    """Which of the chosen terms take enough at these rows (R, n) to be worth a name."""
    left = rms(attempt.extended, rows)
    return {
        k
        for k, (term, less) in enumerate(zip(attempt.fitted.terms, taken, strict=True))
        if noticeable(term.effect, less, left, equations.effort_scale)
    }


def _finding(robot: Robot, estimate: Estimate, judgement: Judgement, share: float) -> Finding:
    joint, link = _place(robot, estimate)
    rivals = tuple(
        Rival(
            rival.effect.name,
            None if rival.target < 0 or rival.link else robot.joints[rival.target],
            rival.link,
            probability,
        )
        for rival, probability in judgement.rivals
    )
    values = estimate.values
    where = link or joint or ("The base" if estimate.term.effect.on == "base" else "every joint")
    return Finding(
        effect=estimate.term.effect.name,
        joint=joint,
        link=link,
        parameters=estimate.quantities(),
        share=share,
        probability=judgement.probability,
        rivals=rivals,
        sentence=estimate.term.effect.sentence(where, values),
    )


def _place(robot: Robot, estimate: Estimate) -> tuple[str | None, str | None]:
    term = estimate.term
    if term.link:
        return None, term.link
    return (robot.joints[term.target] if term.target >= 0 else None), None


def _verdict(
    findings: Sequence[Finding],
    simulation: np.ndarray,
    after: np.ndarray,
    floor: np.ndarray,
    scale: np.ndarray,
) -> Verdict:
    """Explained means: every joint's error is near its floor, or too small a share of its effort to matter."""
    near = bool(((after <= EXPLAINED * floor) | (after <= 0.02 * scale)).all())
    if findings:
        return "explained" if near else "partly_explained"
    return "nothing_wrong" if near else "cannot_tell"


def _unexplained_sentence(share: float, remainder: Remainder) -> str:
    if not remainder.depends_on:
        return "What is left looks like noise: no position, velocity, load or time predicts it."
    return (
        f"{100.0 * share:.1f} % of the simulation's squared error is left above the noise; it depends on "
        + ", ".join(remainder.depends_on[:3])
        + "."
    )


def _source(recordings: Sequence[Recording], equations: Equations) -> dict[str, object]:
    signals = equations.motion.signals
    return {
        "bags": [recording.name for recording in recordings],
        "duration": round(sum(recording.duration for recording in recordings), 3),
        "samples": sum(len(recording) for recording in recordings),
        "rate": round(signals.raw_rate, 3),
        "cutoff": round(signals.cutoff, 3),
        "urdf": "",
        "joints": list(signals.joints),
    }
