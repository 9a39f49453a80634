"""How well a model predicts: errors of the effort, and of the motion integrated from the effort."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.robot import Robot
from bdnn_ros.rollout import integrated
from bdnn_ros.signals import Signals
from bdnn_ros.signals.signals import STANDING_SECONDS

STILL = 1e-9
"""A measured effort that varies less [N·m] has no scale to compare an error with."""
RESTS = 0.1
"""Joints that rest for this share of the samples do so for long."""
STILL_SHARE = 0.02
"""A joint moves where so little of what the low-pass saw is rest."""


class Predictor(Protocol):
    """Anything that predicts the effort along a motion."""

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is."""


@runtime_checkable
class Ahead(Protocol):
    """A model whose effort leads or lags the motion; beyond the ends of the motion its effort is unknown."""

    @property
    def leads(self) -> np.ndarray:
        """How far each joint's effort is ahead, (n,) [s]."""

    @property
    def lag(self) -> float:
        """Time constant of a low-pass of first order that the measured effort has passed [s]."""


@dataclass(frozen=True)
class Scores:
    """Errors of the predicted effort by joint.

    Attributes:
        joints: n joint names.
        rmse: root mean square error, (n,) [N·m]; NaN where no effort was measured.
        nrmse: the same over the standard deviation of the measured effort, (n,); NaN where that is constant.
        nmse: the square of that, (n,).
        nrmse_mean: mean over the joints where it is known.
        in_motion: the same of the samples at which each joint moves, or None where nothing is known of that.
        at_rest: share of each joint's samples that are not among these, (n,), or None as well.
    """

    joints: tuple[str, ...]
    rmse: np.ndarray
    nrmse: np.ndarray
    nmse: np.ndarray
    nrmse_mean: float
    in_motion: Scores | None = None
    at_rest: np.ndarray | None = None

    def of(self, joints: Sequence[str]) -> Scores:
        """The scores of some of the joints, in this order."""
        rows = [self.joints.index(joint) for joint in joints]
        nrmse = self.nrmse[rows]
        moved = None if self.in_motion is None else self.in_motion.of(joints)
        rests = None if self.at_rest is None else self.at_rest[rows]
        return Scores(tuple(joints), self.rmse[rows], nrmse, self.nmse[rows], _mean(nrmse), moved, rests)

    @property
    def resting(self) -> float:
        """Share of the samples at rest, mean of the joints that move as well; 0 where nothing is known of that."""
        if self.in_motion is None or self.at_rest is None:
            return 0.0
        moves = np.isfinite(self.in_motion.nrmse)
        return float(np.mean(self.at_rest[moves])) if moves.any() else 0.0

    @property
    def in_mean(self) -> int:
        """Number of joints in the means."""
        return int(np.count_nonzero(np.isfinite(self.nrmse)))

    @property
    def nmse_mean(self) -> float:
        """Mean of the nMSE over the joints whose effort is not constant; NaN without any."""
        return _mean(self.nmse)

    def as_json(self) -> dict[str, Any]:
        """For `metrics.json` and `evaluate --json`; NaN becomes null. `in_motion` is there where joints rest for long."""
        content: dict[str, Any] = {
            "joints": list(self.joints),
            "rmse": numbers(self.rmse),
            "nrmse": numbers(self.nrmse),
            "nmse": numbers(self.nmse),
            "nrmse_mean": numbers([self.nrmse_mean])[0],
        }
        if self.in_motion is not None and self.at_rest is not None and self.resting > RESTS:
            content["in_motion"] = {"share": numbers(1.0 - self.at_rest), **self.in_motion.as_json()}
        return content


@dataclass(frozen=True)
class RolloutError:
    """Error of the motion that a model integrates from the measured effort.

    Attributes:
        horizon: length of each rollout [s].
        windows: number of rollouts; none where at no time every joint's effort is measured.
        position: root mean square error of the position at the end of the horizon, of the rollouts that did not run away,
            (n,) [rad]; infinite where all did, NaN without any.
        lost: number of rollouts that ran away.
    """

    horizon: float
    windows: int
    position: np.ndarray
    lost: int = 0

    def as_json(self) -> dict[str, Any]:
        """For `evaluate --json`; what is not finite becomes null."""
        return {
            "horizon": self.horizon,
            "windows": self.windows,
            "lost": self.lost,
            "position": numbers(self.position),
        }


def score(
    measured: np.ndarray, predicted: np.ndarray, joints: Sequence[str], seen: np.ndarray | None = None
) -> Scores:
    """Errors of a predicted effort.

    Args:
        measured, predicted: effort, (N, n) each [N·m], low-passed alike.
        seen: samples that count, (N, n) bool; by default all do. A joint without any has no score.

    Raises:
        RecordingError: there is no sample to score.
    """
    if not len(measured):
        raise RecordingError("No sample is left to score.", "Use a longer recording, or a smaller hold-out.")
    seen = np.ones(measured.shape, bool) if seen is None else seen
    known = seen.any(axis=0)
    count = seen | ~known
    rmse = np.where(known, np.sqrt(np.mean((predicted - measured) ** 2, axis=0, where=count)), np.nan)
    spread = np.std(measured, axis=0, where=count)
    nrmse = np.where(spread > STILL, rmse / np.maximum(spread, STILL), np.nan)
    return Scores(tuple(joints), rmse, nrmse, nrmse**2, _mean(nrmse))


def _mean(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.mean(finite)) if len(finite) else float("nan")


def score_model(model: Predictor, parts: Sequence[Signals]) -> Scores:
    """Errors of a model's effort, both sides low-passed alike, over measured samples away from the ends of the motion.

    Raises:
        RecordingError: a part has no effort, or no sample is left.
    """
    measured, predicted, seen, moves = [], [], [], []
    for signals in parts:
        if signals.effort is None:
            raise RecordingError(
                "There is no effort to compare with.", "Use --effort command, or another bag."
            )
        measured.append(signals.smooth(signals.effort)[signals.interior])
        predicted.append(signals.smooth(model.predict(signals))[signals.interior])
        known = signals.seen
        if isinstance(model, Ahead):
            known = known & signals.interior_after(model.leads)
        seen.append(known[signals.interior])
        moves.append(in_motion(signals)[signals.interior])
    compared = np.concatenate(measured), np.concatenate(predicted), parts[0].joints
    known, moved = np.concatenate(seen), np.concatenate(seen) & np.concatenate(moves)
    rests = 1.0 - moved.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return replace(score(*compared, known), in_motion=score(*compared, moved), at_rest=rests)


def in_motion(signals: Signals) -> np.ndarray:
    """Where a joint moves, and moved while the low-pass saw it, (N, n) bool; one that turns round does.

    Elsewhere dry friction has any value up to its full one, which no motion tells.
    """
    still = signals.lasting(signals.at_rest | signals.hardly_moves, STANDING_SECONDS)
    if not still.any():
        return ~still
    return np.asarray(signals.smooth(signals.soften(still.astype(float))) < STILL_SHARE)


class _Described:
    """What a robot's description alone predicts."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is."""
        return described_effort(self._robot, signals)


def described_effort(robot: Robot, signals: Signals) -> np.ndarray:
    """Effort of the description's bodies, armature and friction along a motion, as of `Predictor`, (N, n) [N·m]."""
    drive = robot.drive_effort(signals.velocity, signals.acceleration, signals.sign)
    return robot.rigid_effort(signals.position, signals.velocity, signals.acceleration) + drive


def score_description(robot: Robot, parts: Sequence[Signals]) -> Scores:
    """Errors of the robot description alone, on the same samples as those of a model.

    Raises:
        RecordingError: as `score_model`.
    """
    return score_model(_Described(robot), parts)


def without_effort(signals: Signals) -> list[str]:
    """Joints whose effort was never measured."""
    seen = np.any(signals.seen, axis=0)
    return [joint for joint, some in zip(signals.joints, seen.tolist(), strict=True) if not some]


def rollout_error(model: Dynamics, signals: Signals, horizon: float) -> RolloutError:
    """Error of the motion that a model integrates from the measured effort, restarted every `horizon`.

    Only stretches in which every joint's effort is measured count, since each effort moves all joints. For a model that knows the
    lead and the low-pass of the measured effort, the effort is corrected for them first.

    Args:
        horizon: [s]; cut to the longest such piece without a gap.

    Raises:
        RecordingError: there is no effort.
        UsageError: the horizon is not above zero.
    """
    if signals.effort is None:
        raise RecordingError("There is no effort to integrate.", "Use --effort command, or another bag.")
    if not horizon > 0.0:
        raise UsageError(f"A horizon of {horizon:g} s is no time.", "Give seconds above zero.")
    effort, each = _acted(model, signals) if isinstance(model, Ahead) else (signals.effort, signals.seen)
    seen = np.all(each, axis=1)
    known = signals.rows(seen)
    longest = max(rows.stop - rows.start for rows in known.segments or signals.segments) - 1
    steps = max(round(min(horizon * signals.rate, longest)), 1)
    starts = np.array([k for s in known.segments for k in range(s.start, s.stop - steps, steps)], dtype=int)
    if not len(starts):
        return RolloutError(steps / signals.rate, 0, np.full(signals.width, np.nan))
    missed = integrated(model, known, effort[seen], starts, steps) - known.position[starts + steps]
    kept = np.isfinite(missed).all(axis=1)
    counted = missed[kept] if kept.any() else missed
    error = np.sqrt(np.mean(counted**2, axis=0))
    return RolloutError(steps / signals.rate, len(starts), error, int(np.count_nonzero(~kept)))


def _acted(model: Ahead, signals: Signals) -> tuple[np.ndarray, np.ndarray]:
    """The measured effort corrected for a model's lead and low-pass, (N, n) [N·m], and where it is known, (N, n) bool."""
    assert signals.effort is not None
    seen, known = signals.seen, signals.seen.copy()
    effort = signals.effort + (model.lag * signals.derivative(signals.effort) if model.lag else 0.0)
    for joint in np.flatnonzero(model.leads):
        for rows in signals.segments:
            time = signals.time[rows]
            then = time - model.leads[joint]
            effort[rows, joint] = np.interp(then, time, effort[rows, joint])
            # between two samples both have to be seen, and beyond the ends nothing is
            known[rows, joint] = np.interp(then, time, seen[rows, joint], left=0.0, right=0.0) == 1.0
    return effort, known


def numbers(values: Sequence[float] | np.ndarray) -> list[float | None]:
    """Values for JSON, which has no NaN or infinity: null instead."""
    return [float(value) if np.isfinite(value) else None for value in values]
