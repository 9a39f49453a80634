"""Identification from samples as they come; a recording is only samples that came earlier."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.diagnosis.lateness import Lateness, in_time, lateness
from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.online.chunks import Chunks
from bdnn_ros.physical.columns import low_passed, sharp_columns, smooth_columns
from bdnn_ros.physical.dictionary import Scales
from bdnn_ros.physical.handover import physical_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Prior, Spread, prior
from bdnn_ros.physical.possible import Possible
from bdnn_ros.physical.presliding import Directions, directions
from bdnn_ros.physical.recursive import Recursion
from bdnn_ros.physical.selection import choose
from bdnn_ros.physical.sensing import SensorNoise
from bdnn_ros.physical.structure import Layout, Structure, layout, straightened, typical_friction
from bdnn_ros.physical.weighing import certainty, moving, sliding
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, prepare

FAST = 0.02
"""Speed, in units of the limit, above which friction is sliding friction."""
MOST_KEPT = 300
"""Chunks of motion kept to be gone through again; what later ones say is only summed up."""
LEAST_FRICTION = 0.01
"""Of a joint, in units of its effort scale: what it lacks may still be learned."""
LEARNED = 0.5
"""Share of the residual that is left where what is learned lowers it so far that doubtful rows must be weighed anew."""
LONG_PAUSE = 10.0
"""No chunk is looked for in a pause longer than this [s]."""
NEVER = 1 << 62
FIRST_SETTLED = 4
ITERATIONS = 10
"""Of noise and parameters, where there is time."""
VELOCITY = 2.0
"""Velocity limit of a joint whose URDF has none [rad/s]: only a unit."""
Progress = Callable[[float, str], None]
"""(share done, what is being done)."""


@dataclass(frozen=True)
class _Motion:
    """A chunk of motion: its signals, its rows, and the state of friction at its start."""

    signals: Signals
    rows: np.ndarray
    start: Directions | None


class Identifier:
    """Identifies a robot from raw samples fed in order, live or from recordings, with the same result.

    Parameters are solved for whenever a model is asked for. Whenever the chunks of motion have doubled in
    number, they are gone through again: what is known by then of the load, and which terms lower the error
    on stretches left out, is settled anew.

    Args:
        robot: the simulation's robot, the prior.
        cutoff: of the low-pass [Hz], None for the recording's default.
        spread: how far the real robot may be from the prior.
        belief: what is known already, instead of the robot and the spread.
        settle_at: chunks after which the motion is gone through for the first time.

    Attributes:
        samples: taken in so far.
        chunks: of time completed so far.
        structure: terms that are switched on.
        latest: motion of the last chunk and its rows, until somebody takes them; None before.
    """

    def __init__(
        self,
        robot: Robot,
        cutoff: float | None = None,
        spread: Spread | None = None,
        belief: Prior | None = None,
        settle_at: int = FIRST_SETTLED,
    ) -> None:
        self.robot = robot
        self.recursion = Recursion(belief or prior(robot, spread))
        limit = robot.limits.velocity
        self.scales = Scales(
            self.recursion.belief.effort_scale, np.where(np.isfinite(limit), limit, VELOCITY)
        )
        self.structure = Structure.plain(self.recursion.belief)
        self.version = 0
        self.samples = 0
        self.chunks = 0
        self.latest: tuple[Signals, np.ndarray] | None = None
        self._stream = Chunks(robot.joints, cutoff)
        self._evidence = Recursion(self.recursion.belief)
        self._usual = self._evidence.noise
        self._fast = np.zeros(())
        self._straight: tuple[np.ndarray, ...] = ()
        self._carrier = robot
        self._kept: list[_Motion] = []
        self._used = 0
        self._settle_at = settle_at
        self._state: tuple[np.ndarray, Directions] | None = None

    @property
    def cutoff(self) -> float | None:
        """-3 dB frequency of the low-pass [Hz], None before it is known."""
        return self._stream.cutoff

    @property
    def left_out(self) -> int:
        """Samples in stretches too short for the low-pass."""
        return self._stream.left_out

    # -- samples in ------------------------------------------------------------------------------

    def feed(self, time: np.ndarray, position: np.ndarray, effort: np.ndarray) -> int:
        """Take in samples in order of their stamps.

        Args:
            time: [s], (N,), later than all before.
            position, effort: [rad], [N·m], (N, n) in the order of the robot's joints.

        Returns:
            The number of chunks that were completed: above zero, `model` has news.
        """
        self.samples += len(time)
        before = self.chunks
        for chunk in self._stream.add(time, position, effort):
            self._take_in(chunk)
        return self.chunks - before

    def finish(self) -> None:
        """Take in what is left: the recording ends here, and what comes next may have any stamps."""
        for chunk in self._stream.end():
            self._take_in(chunk)
        self._state = None

    def fit(self, recordings: Sequence[Recording], progress: Progress | None = None) -> PhysicalModel:
        """The model of one or several recordings of the robot.

        Efforts that come late are moved to when they acted; the model then predicts them as late as they came.

        Raises:
            RecordingError: there is no effort, or nothing that could be used.
            UsageError: the joints are not the robot's.
        """
        for recording in recordings:
            if recording.joints != self.robot.joints:
                raise UsageError(
                    f"{recording.name} has other joints than the robot.", "Select the robot's joints."
                )
            recording.require_effort()
        late = self._lateness(recordings)
        recordings = in_time(recordings, late)
        total = sum(recording.duration for recording in recordings) or 1.0
        done = 0.0
        self._settle_at = NEVER  # once is enough, at the end
        for recording in recordings:
            effort = recording.require_effort()
            for rows in _stretches(recording, LONG_PAUSE):
                if rows.start and recording.time[rows.start] - recording.time[rows.start - 1] > LONG_PAUSE:
                    self.finish()
                self.feed(recording.time[rows], recording.position[rows], effort[rows])
                if progress:
                    share = (done + float(recording.time[rows][-1] - recording.time[0])) / total
                    progress(0.8 * share, f"reading {recording.name}")
            self.finish()
            done += recording.duration
        if progress:
            progress(0.8, "choosing terms")
        self.settle()
        self._settle_at = 2 * self._used
        model = self.model(ITERATIONS)
        if progress:
            progress(1.0, "done")
        return replace(model, lead=model.lead - late.delay, lag=late.lag)

    def _lateness(self, recordings: Sequence[Recording]) -> Lateness:
        """How late the efforts of recordings are, the median one; not at all where they are too short to tell."""
        found = []
        for recording in recordings:
            try:
                found.append(lateness(prepare(recording, self._stream.cutoff), self.robot))
            except RecordingError:
                continue
        return sorted(found, key=lambda late: late.total)[len(found) // 2] if found else Lateness()

    # -- models out ------------------------------------------------------------------------------

    def model(self, iterations: int = 1) -> PhysicalModel:
        """The robot as known now, checked.

        Raises:
            RecordingError: no motion came yet.
            UpdateRejected: the result is not finite or not feasible.
        """
        posterior = self.recursion.solve(self.parameter_layout, iterations)
        self.version += 1
        return physical_model(self.robot, posterior, self.structure, self.scales, self.version)

    def settle(self) -> None:
        """Go through the motion again with the load as known now, and choose the terms that it supports."""
        evidence, belief = self._evidence, self.recursion.belief
        if evidence.total is None:
            return
        plain = Structure.plain(belief)
        whole = len(self._kept) == self._used
        # the choice depends on the motion alone, not on when it was made before
        for sums in (self.recursion, evidence):
            sums.doubt()
        if whole and (self._usual != evidence.noise).any():
            self._carrier = self.robot
            self._go_through_again(evidence.noise)
        posterior = evidence.solve(layout(plain, belief), ITERATIONS)
        usual = typical_friction(posterior.mean, posterior.layout, evidence.total)
        friction = np.clip(usual, LEAST_FRICTION * belief.effort_scale, belief.effort_scale)
        possible = Possible.of(evidence, posterior)
        # a spring, say, may be far more than the joint's friction
        beyond = np.maximum(friction, np.minimum(possible.left, belief.effort_scale))
        plain = replace(plain, friction=tuple(friction), beyond=tuple(beyond))
        bodies = possible.inertials if possible.unexplained.any() else None
        if whole:
            self._carrier = physical_model(self.robot, posterior, plain, self.scales).robot
            self._go_through_again(posterior.noise)
        self._choose(plain, posterior.layout, bodies)
        if not whole:
            return
        left = self.recursion.solve(self.parameter_layout, ITERATIONS).noise
        if (left < LEARNED * self._usual).any():
            self._go_through_again(left)
            self._choose(plain, posterior.layout, bodies)

    def _go_through_again(self, usual: np.ndarray) -> None:
        """Sum all motion anew, with what its residual usually is, (n,) [N·m]."""
        self._usual = usual
        self.recursion.clear()
        self._evidence.clear()
        self._fast = np.zeros(())
        for motion in self._kept:
            self._sum(motion)

    def _choose(self, plain: Structure, without: Layout, bodies: np.ndarray | None) -> None:
        """Settle which terms are on; by the layout without any the noise of the evidence was estimated."""
        moves = self._fast.any(axis=(1, 2))
        kinds: list[int] = np.where(moves, 1 + self.robot.slides, 0).tolist()
        self.structure = choose(self._evidence, plain, without, kinds, bodies)
        self._straight = straightened(self.structure, self._fast)

    @property
    def parameter_layout(self) -> Layout:
        """Where the parameters of the structure are."""
        return layout(self.structure, self.recursion.belief, self._straight)

    def restarted(self, belief: Prior) -> Identifier:
        """An identifier that goes on with this stream, but knows only this much of the robot."""
        other = Identifier(self.robot, belief=belief, settle_at=self._settle_at)
        other.version, other.samples, other.chunks = self.version, self.samples, self.chunks
        other._stream, other._state = self._stream, self._state
        return other

    # -- chunks ----------------------------------------------------------------------------------

    def _take_in(self, chunk: tuple[Signals, np.ndarray] | None) -> None:
        self.chunks += 1
        if chunk is None:
            self._state = None
            return
        motion = _Motion(*chunk, self._state_at(chunk[0].time[0]))
        state = self._sum(motion)
        self._state = motion.signals.time, state
        self._used += 1
        if len(self._kept) < MOST_KEPT:
            self._kept.append(motion)
        self.latest = chunk
        if self._used >= self._settle_at:
            self._settle_at *= 2
            self.settle()

    def _sum(self, motion: _Motion) -> Directions:
        """Add a chunk to the statistics; returns the directions of friction along it."""
        signals, rows = motion.signals, motion.rows
        assert signals.effort is not None
        state = directions(signals, motion.start)
        smooth = smooth_columns(self.robot, signals)
        bodies = self._carrier.inertials.size
        load = smooth[:, :, :bodies] @ self._carrier.inertials.ravel()
        sharp = sharp_columns(signals, state, load, self.scales)
        columns = low_passed(signals, smooth, sharp, rows)
        fast = np.abs(signals.velocity[rows]) > FAST * self.scales.velocity
        swift = (columns[:, :, bodies:] * fast[:, :, None]).transpose(1, 2, 0)
        self._fast = self._fast + swift @ swift.transpose(0, 2, 1)
        effort = signals.smooth(signals.effort)[rows]
        noise = SensorNoise.of(self.robot, signals, rows)
        residual = np.maximum(np.sqrt(noise.effort / noise.count), self._usual)
        certain = certainty(signals, rows, state, self._carrier.coulomb, residual)
        self._evidence.update(columns, effort, certain * moving(signals, rows), noise)
        self.recursion.update(columns, effort, certain * sliding(signals, rows, self.scales), noise)
        return state

    def _state_at(self, time: float) -> Directions | None:
        """State of friction at a time within the last chunk's motion, None where there is none."""
        if self._state is None or not self._state[0][0] <= time <= self._state[0][-1]:
            return None
        return self._state[1].at(int(np.searchsorted(self._state[0], time, side="right")) - 1)


def _stretches(recording: Recording, seconds: float) -> list[slice]:
    """Rows of the recording in stretches of time."""
    number = np.floor((recording.time - recording.time[0]) / seconds)
    bounds = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(recording)]
    return [slice(a, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
