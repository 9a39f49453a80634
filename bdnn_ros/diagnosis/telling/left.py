"""Sentences on what is unexplained, and on where most of the unnamed improvement lies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.regression.gains import rms
from bdnn_ros.diagnosis.result import remaining
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.notes import MOST, SLIGHT
from bdnn_ros.diagnosis.telling.unexplained import Remainder
from bdnn_ros.errors import listed

MOSTLY_AT = (
    "Most of what the extended model mends without a name is at {joint}, {share:.0f} % of the earlier model's squared error, "
    "by what {kind}: that is where to look, though other parameters that were not known better may do the same."
)
OF_JOINT, OF_LINKS = (
    "acts at the joint itself (friction, rotor, offset)",
    "links weigh and how they turn",
)
POOR = (
    "The earlier model does not describe this motion down to its noise, whether anything changed or not{then}: {much} of its "
    "squared error is left above that{where}"
)
"""Sentence on what an earlier model leaves unexplained where no change can be shown."""


def unexplained_sentence(
    share: float,
    remainder: Remainder,
    above: Sequence[str],
    reference: str,
    named: bool = True,
    slight: Sequence[str] = (),
    poor: str | None = None,
) -> str:
    """Sentence on what is unexplained: `share` of the reference's squared error.

    Args:
        above, slight: joints where that exceeds the noise, and where it does though by little.
        named: whether there are findings.
        poor: clause on an earlier model of which no change can be shown (see `error_then`); else None.
    """
    if share > 1.0:
        return f"What was found predicts the motion that was held out worse than the {reference} does."
    much = remaining(share)
    there = above or slight
    where = f", at {listed(there)}" if there else ""
    left = f"{much.capitalize()} of the {reference}'s squared error is left above the noise{where}"
    if poor is not None and above:
        left = POOR.format(then=poor, much=much, where=where)
    if not named and not above:  # without a finding, all of a small error may remain
        left = "What is left is hardly more than noise"
        if slight:
            left = f"What is left is small, but more than twice the noise at {listed(slight)}"
    inputs = remainder.depends_on(there)
    if inputs:
        of_these = [joint for joint in there if joint in remainder.inputs]
        it = f"at {listed(of_these)} it" if len(of_these) < len(there) else "it"
        return f"{left}; {it} depends on {', '.join([*inputs][:3])}."
    if remainder.bursts:
        return f"{left}, in bursts at {listed(remainder.bursts)}; no position, velocity, acceleration, load or time predicts it."
    if there:
        return f"{left}; no position, velocity, acceleration, load or time predicts it."
    return "What is left looks like noise: no position, velocity, acceleration, load or time predicts it."


def error_then(case: Case, above: Sequence[str]) -> str:
    """Clause on how much more an earlier model errs at some joints than on its own motion; empty if not known."""
    known = None if case.earlier is None else getattr(case.earlier.model, "noise", None)
    if known is None or case.earlier is None:
        return ""
    before, at = known * case.earlier.scale, [case.robot.joints.index(joint) for joint in above]
    times = [float(case.simulation[j] / before[j]) for j in at if before[j] > 0.0]
    if not times:
        return ""
    low, high = (f"{end(times):.1f}" for end in (min, max))
    return f" (it errs {low if low == high else f'{low} to {high}'} times as much there as on the motion that it was made from)"


def mostly_at(case: Case, least: float) -> list[str]:
    """The note on the joint, and kind of correction, with most of the improvement on an earlier model; none if there is none.

    Args:
        least: share of the squared error that the extended model surely removes.
    """
    equations, fitted = case.equations, case.attempt.fitted
    joints = equations.errors.joints
    if joints is None or case.found or least < SLIGHT:
        return []
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
    if mended[one] < MOST * np.sum(np.maximum(mended, 0.0)):
        return []
    kind = OF_JOINT if removed(of_joint)[one] > removed(every - of_joint)[one] else OF_LINKS
    share = 100.0 * min(mended[one] / max(total, 1e-30), 1.0)
    return [MOSTLY_AT.format(joint=case.robot.joints[one], share=share, kind=kind)]
