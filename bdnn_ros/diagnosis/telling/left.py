"""What is unexplained, and where most of the unnamed improvement lies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bdnn_ros.diagnosis.regression.gains import rms
from bdnn_ros.diagnosis.result import remaining
from bdnn_ros.diagnosis.sentences import Kind, Note
from bdnn_ros.diagnosis.telling.case import MOST, SLIGHT, Case
from bdnn_ros.diagnosis.telling.outcome import Outcome


def unexplained(outcome: Outcome) -> Note:
    """The note on what the extended model leaves above the noise, where, and what that depends on."""
    case, remainder = outcome.case, outcome.case.remainder
    if case.share_left > 1.0:
        return Note(Kind.WORSE)
    there, left = outcome.above or outcome.slight, _left(outcome)
    if inputs := remainder.depends_on(there):
        of_these = [joint for joint in there if joint in remainder.inputs]
        kind = Kind.DEPENDS_AT if len(of_these) < len(there) else Kind.DEPENDS
        return Note(kind, {"left": left, "of_these": of_these, "inputs": [*inputs][:3]})
    if remainder.bursts:
        return Note(Kind.IN_BURSTS, {"left": left, "joints": remainder.bursts})
    return Note(Kind.LIKE_NOTHING, {"left": left}) if there else Note(Kind.LIKE_NOISE)


def _left(outcome: Outcome) -> Note:
    """The clause on how much is left, and where."""
    if not outcome.causes and not outcome.above:  # without a finding, all of a small error may remain
        return Note(Kind.SMALL, {"there": outcome.slight}) if outcome.slight else Note(Kind.HARDLY)
    there = outcome.above or outcome.slight
    much, where = remaining(outcome.case.share_left), Note(Kind.AT, {"there": there}) if there else ""
    unshown = outcome.verdict == "cannot_tell" and outcome.surely <= 0.0
    if outcome.case.earlier and unshown and outcome.above:  # what it leaves is no sign of a change
        return Note(
            Kind.POOR, {"then": error_then(outcome.case, outcome.above), "much": much, "where": where}
        )
    return Note(Kind.LEFT, {"Much": much.capitalize(), "where": where})


def error_then(case: Case, above: Sequence[str]) -> Note | str:
    """Clause on how much more an earlier model errs at some joints than on its own motion; empty if not known."""
    known = None if case.earlier is None else getattr(case.earlier.model, "noise", None)
    if known is None or case.earlier is None:
        return ""
    before, at = known * case.earlier.scale, [case.robot.joints.index(joint) for joint in above]
    times = [float(case.simulation[j] / before[j]) for j in at if before[j] > 0.0]
    ends = dict.fromkeys(f"{end(times):.1f}" for end in (min, max)) if times else ()
    return Note(Kind.ERRED_LESS, {"times": [*ends]}) if ends else ""


def mostly_at(case: Case, least: float) -> Iterator[Note]:
    """The note on the joint, and kind of correction, with most of the improvement on an earlier model; none if there is none.

    Args:
        least: share of the squared error that the extended model surely removes.
    """
    equations, fitted = case.equations, case.attempt.fitted
    joints = equations.errors.joints
    if joints is None or case.found or least < SLIGHT:
        return
    errors = fitted.whole.coefficients[: equations.rigid.shape[2]]
    every = equations.rigid @ errors
    of_joint = joints.columns(equations.columns) @ errors
    left, total = fitted.residual_of_all(), float(np.sum(equations.rows.target[case.held] ** 2))
    counts = case.held.sum(axis=0)

    def removed(part: np.ndarray) -> np.ndarray:
        """Squared error of each joint that a part removes, (n,)."""
        return np.asarray((rms(left + part, case.held) ** 2 - rms(left, case.held) ** 2) * counts)

    mended = removed(every)
    one = int(np.argmax(mended))
    if mended[one] >= MOST * np.sum(np.maximum(mended, 0.0)):
        does = Kind.OF_JOINT if removed(of_joint)[one] > removed(every - of_joint)[one] else Kind.OF_LINKS
        share = mended[one] / max(total, 1e-30)
        yield Note(Kind.MOSTLY_AT, {"joint": case.robot.joints[one], "share": share, "does": Note(does)})
