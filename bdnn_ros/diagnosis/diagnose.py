"""Diagnosis of recordings against a simulation: what it gets wrong, the causes, the gain, and what cannot be told apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bdnn_ros.bdnn.rest import RestNetwork
from bdnn_ros.checks.conventions import breaches, unlike
from bdnn_ros.checks.description import require_mass
from bdnn_ros.diagnosis.judging.attempt import EVERY_TEST_BLOCK, Looks, best_attempt, completed
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.judging.simplified import simplified
from bdnn_ros.diagnosis.judging.without_harm import without_harm
from bdnn_ros.diagnosis.recorded.compared import Compared
from bdnn_ros.diagnosis.recorded.creep import creeping, remarked, undisturbed
from bdnn_ros.diagnosis.recorded.excerpts import ENOUGH, excerpts, refuse_short, too_short
from bdnn_ros.diagnosis.recorded.joining import concatenated, prepared_alike
from bdnn_ros.diagnosis.recorded.lateness import Lateness, lateness, without_lateness
from bdnn_ros.diagnosis.recorded.lowpass import CUTOFF_OF_USUAL, quiet_cutoff, slow_cutoff, stepping
from bdnn_ros.diagnosis.recorded.softness import noted, softened, softness
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.result import Diagnosis
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.search import IDENTIFIED_LINK_ERRORS, LINK_ERRORS, Progress
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.rest import with_rest
from bdnn_ros.diagnosis.telling.telling import diagnosis_of
from bdnn_ros.diagnosis.telling.unexplained import Remainder, describe
from bdnn_ros.errors import ConventionError, RecordingError
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import Predictor
from bdnn_ros.signals import Signals, flattened, usual_cutoff, without_copies

FEWEST_VALUES = 12.0
"""Fewest independent low-passed values of the joint that moves longest: any cause would fit fewer."""


@dataclass(frozen=True)
class Examination:
    """A diagnosis with the data and models it was made from, for the extended model and the report.

    Attributes:
        pool, fit: the chosen terms, fitted to all data.
        estimates: the findings' terms with their parameters, in the order of `fit.terms`.
        test: rows held out of the search or (see `completed`) only of the fit that predicts them, (R,) bool.
        extended: held-out prediction error of the extended model, rows (R, n) [N·m].
        by_links: share of the simulation's squared error in the test rows that the link corrections remove, fitted without them.
        recordings: what was examined; efforts at the times and in the units in which they act.
        robot: the robot before the diagnosis, with joint zeros as the sensors report them.
        model: the earlier model that took the simulation's place, if any.
        late: delay or lag of the measured efforts that was undone.
        networks: those that learned the unexplained rest.
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
    by_links: float
    remainder: Remainder
    model: Predictor | None = None
    late: Lateness = field(default_factory=Lateness)
    networks: tuple[RestNetwork, ...] = ()


def diagnose(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    cutoff: float | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnose recordings of a robot against its simulation; see `examine`."""
    return examine(recordings, robot, cutoff=cutoff, progress=progress).diagnosis


def examine(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    cutoff: float | None = None,
    progress: Progress | None = None,
    model: Predictor | None = None,
) -> Examination:
    """Diagnose recordings of a robot against its simulation, or against a model identified earlier.

    Args:
        recordings: with effort; joints in the robot's order.
        robot: as the simulation has it.
        cutoff: low-pass [Hz]; None chooses.
        progress: called with a few words on the current step.
        model: an earlier model in the simulation's place: findings are what changed since it was identified; see `Compared`.

    Raises:
        RecordingError: no effort, too short, or no motion.
        RobotError: the robot weighs nothing.
        ConventionError: units or signs are wrong, or the description is not of this robot.
    """
    say = progress or (lambda text: None)
    for recording in recordings:
        recording.require_effort()
    known = Compared.of(model, robot)
    robot, recordings = known.robot, known.acting([without_copies(recording) for recording in recordings])
    require_mass(robot)
    refuse_short(recordings)
    say("filtering")
    measured = _measured(excerpts(recordings), known, cutoff)
    looks = _settled_looks(measured, known, say, cutoff)
    recordings, equations = measured.recordings, looks.equations
    signals, attempt = equations.motion.signals, best_attempt(looks)
    if not equations.usable[attempt.test].any():
        raise _too_short(recordings, cutoff, signals.cutoff)
    attempt, pool, found = simplified(looks.candidates, equations, attempt)
    attempt, pool, found = without_harm(equations, completed(equations, attempt), pool, found)
    equations.use_rows(pool.sure)
    left = pool.residual_of_all()
    remainder = describe(equations, left, stepping(recordings, robot, signals.cutoff), known.dry)
    recordings = remarked(recordings, signals, robot, [*known.held, *pool.terms])
    case = Case(recordings, robot, equations, attempt, found, remainder, known.earlier)
    diagnosis, networks = with_rest(diagnosis_of(case, cutoff), case, left)
    return Examination(
        diagnosis,
        tuple(recordings),
        robot,
        equations,
        pool,
        pool.whole,
        tuple(found),
        attempt.test,
        attempt.extended,
        case.by_links,
        remainder,
        model,
        measured.late,
        networks,
    )


@dataclass(frozen=True)
class _Measured:
    """Recordings and their motion, with delays and low-passes of the measurement undone.

    Attributes:
        signals: its motion.
        predicted: effort that an earlier model predicts along it, (N, n) [N·m]; None against the simulation.
        late: delay or lag of the efforts that was undone.
    """

    recordings: Sequence[Recording]
    signals: Signals
    predicted: np.ndarray | None
    late: Lateness


def _measured(recordings: Sequence[Recording], known: Compared, cutoff: float | None) -> _Measured:
    """Recordings and their motion, with delays and low-passes of the measurement undone.

    Against an earlier model neither the lateness of efforts nor the onset of friction is estimated again: the model holds
    them.

    Raises:
        ConventionError: units or signs are wrong, or the description is not of this robot.
    """
    robot, model = known.robot, known.model
    signals = _signals(recordings, robot, cutoff)
    predicted = None if model is None else model.predict(signals)
    for breach in breaches(signals, robot) if predicted is None else unlike(signals, predicted, robot):
        raise ConventionError(breach.problem, breach.remedy)
    late = lateness(signals, robot) if model is None else Lateness()
    if late.total:
        recordings, late = without_lateness(recordings, late)
        signals = _signals(recordings, robot, cutoff)
    signals, notes = known.shown(signals)
    if notes:
        recordings = [replace(recordings[0], notes=(*recordings[0].notes, *notes)), *recordings[1:]]
    own = softness(signals, robot)
    if own is not None:  # behind a low-pass of its own, effort no longer shows how friction comes on
        signals = softened(signals, own)
        predicted = None if model is None else model.predict(signals)
        return _Measured(noted(recordings, own), signals, predicted, late)
    creep = creeping(signals, robot) if known.creep is None else known.creep
    signals = signals if creep is None else replace(signals, creep=creep)
    return _Measured(recordings, signals, predicted, late)


def _settled_looks(measured: _Measured, known: Compared, say: Progress, cutoff: float | None) -> Looks:
    """First looks, repeated with the onset of dry friction found beside pushes and with a tilted base, where they show either."""
    signals, robot = measured.signals, known.robot
    looks = _looks(measured, known, say, cutoff)
    creep_is_told = signals.own is not None or known.creep is not None
    calm = signals if creep_is_told else undisturbed(signals, robot, looks.pushed())
    if calm is not signals:
        say("beside what pushes dry friction comes on otherwise")
        measured = replace(measured, signals=calm)
        looks = _looks(measured, known, say, cutoff)
    tilt = looks.tilt()
    if tilt is not None:
        say("as the bodies hang on a base that is tilted")
        looks = _looks(measured, known, say, cutoff, tilt)
    return looks


def _looks(
    measured: _Measured,
    known: Compared,
    say: Progress,
    cutoff: float | None = None,
    tilt: tuple[float, float] | None = None,
) -> Looks:
    """Build the regression of a motion and prepare first looks at it.

    Args:
        cutoff: requested low-pass [Hz]; None for the usual one.
        tilt: roll and pitch of the base beyond the description [rad]; None for none.

    Raises:
        RecordingError: too short.
    """
    signals = measured.signals
    equations = build(signals, known.robot, measured.predicted, known.of_model, tilt)
    values = 2.0 * signals.cutoff * equations.rows.moving.max()
    if equations.rows.blocks < EVERY_TEST_BLOCK or values < FEWEST_VALUES:
        raise _too_short(measured.recordings, cutoff, signals.cutoff)
    errors = LINK_ERRORS if known.left_open is None else IDENTIFIED_LINK_ERRORS
    candidates = Candidates.shown_by(equations, None if known.model is None else known.held)
    return Looks(equations, candidates, errors, say)


def _too_short(
    recordings: Sequence[Recording], asked: float | None, passed: float | None = None
) -> RecordingError:
    """The error to raise where too little motion is left behind a low-pass.

    Args:
        asked: requested cut-off [Hz], if any.
        passed: cut-off actually used [Hz], lower than usual where noise of the position asks for it; None if not known yet.
    """
    name, together = recordings[0].name, sum(recording.recorded for recording in recordings)
    if together < ENOUGH:
        return too_short(name, together)
    usual = min(usual_cutoff(recording.rate) for recording in recordings)
    low = asked is not None and asked < usual
    cutoff = asked or passed or usual
    return RecordingError(
        f"{name}: {together:.1f} s hold too little motion for a diagnosis behind a low-pass of {cutoff:.3g} Hz.",
        f"Give a higher --cutoff ({usual:.3g} Hz is usual), or record longer."
        if low
        else "Record longer motion of the joints without pauses, better 30 s.",
    )


def _signals(recordings: Sequence[Recording], robot: Robot, cutoff: float | None) -> Signals:
    if cutoff is None:
        lower = quiet_cutoff(recordings, robot)
        slow = slow_cutoff(recordings, robot, lower)
        if slow is not None:
            cutoff, lower = slow / CUTOFF_OF_USUAL, slow
    else:
        lower = CUTOFF_OF_USUAL * cutoff
    parts = prepared_alike(recordings, cutoff)
    return flattened(concatenated(parts, [recording.time for recording in recordings]), lower)
