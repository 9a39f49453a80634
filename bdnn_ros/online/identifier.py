"""Incremental identification. Live streams and recordings go through the same code."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from bdnn_ros.diagnosis.recorded.lateness import without_lateness
from bdnn_ros.errors import UpdateRejected, UsageError
from bdnn_ros.online.chunks import Chunks
from bdnn_ros.online.recorded import as_recorded, stretches, usual_lateness
from bdnn_ros.physical.dictionary import Scales
from bdnn_ros.physical.handover import physical_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Prior, Spread, prior
from bdnn_ros.physical.possible import Possible, typical_friction
from bdnn_ros.physical.presliding import Directions
from bdnn_ros.physical.recursive import Posterior
from bdnn_ros.physical.selection import choose, set_up, sure
from bdnn_ros.physical.structure import Layout, Structure, layout, straightened
from bdnn_ros.physical.sums import Motion, Sums
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

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
FIRST_SET_UP = 4
"""Chunks after which it is first asked how the robot is set up, again whenever they have doubled, until terms are chosen."""
ITERATIONS = 10
"""Of noise and parameters, where there is time."""
Progress = Callable[[float, str], None]
"""(share done, what is being done)."""


class Identifier:
    """Identifies a robot from raw samples in order, from a stream or from recordings, with the same result.

    Parameters are solved for whenever a model is asked for. Each time the number of chunks has doubled, all kept motion is
    processed again (`settle`): with the load known by then, and with those terms switched on that lower the error on stretches
    left out.

    Args:
        robot: the simulation's robot, the prior.
        cutoff: of the low-pass [Hz], None for the recording's default.
        spread: how far the real robot may be from the prior.
        belief: what is known already, instead of the robot and the spread.
        settle_at: chunks after which the motion is gone through for the first time.
        beat: called at every step of what takes long.

    Attributes:
        robot: the prior, set up as far as that is known.
        belief: of the base parameters before any motion.
        stream: cuts what comes into chunks, and counts what it leaves out.
        sums: of all motion so far.
        samples: taken in so far.
        chunks: of time completed so far.
        structure: terms that are switched on.
        latest: motion of the last chunk and its rows, until somebody takes them; None before.
        rejected: why the motion could not be gone through again, for the caller to take.
    """

    def __init__(
        self,
        robot: Robot,
        cutoff: float | None = None,
        spread: Spread | None = None,
        belief: Prior | None = None,
        settle_at: int = FIRST_SETTLED,
        beat: Callable[[], None] = lambda: None,
    ) -> None:
        self.robot = self._described = robot
        self.belief = belief or prior(robot, spread)
        self.scales = Scales(self.belief.effort_scale, robot.limits.usual_velocity)
        self.structure = Structure.plain(self.belief)
        self.version = self.samples = self.chunks = 0
        self.latest: tuple[Signals, np.ndarray] | None = None
        self.rejected: list[str] = []
        self._beat = beat
        self.stream = Chunks(robot.joints, cutoff)
        self.sums = Sums(robot, self.belief, self.scales)
        self._straight: tuple[np.ndarray, ...] = ()
        self._kept: list[Motion] = []
        self._used = 0
        self._settle_first, self._settle_at, self._set_up_at = settle_at, settle_at, FIRST_SET_UP
        self._state: tuple[np.ndarray, Directions] | None = None

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
        for chunk in self.stream.add(time, position, effort):
            self._take_in(chunk)
        return self.chunks - before

    def finish(self) -> None:
        """Process the rest: the recording ends here, and later samples may have any stamps."""
        for chunk in self.stream.end():
            self._take_in(chunk)
        self._state = None

    def hurry(self) -> None:
        """Stop selecting terms, which takes seconds: the present ones stay."""
        self._settle_at = NEVER

    def fit(self, recordings: Sequence[Recording], progress: Progress = lambda *_: None) -> PhysicalModel:
        """Identify a model from one or several recordings of the robot.

        Delayed efforts are shifted to when they acted; the model predicts them with their delay again.

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
        late = usual_lateness(recordings, self.robot, self.stream.asked)
        recordings, late = without_lateness(recordings, late)
        total = sum(recording.duration for recording in recordings) or 1.0
        done = 0.0
        self._settle_at = NEVER  # once is enough, at the end
        for recording in recordings:
            effort = recording.require_effort()
            for rows in stretches(recording, LONG_PAUSE):
                if rows.start and recording.time[rows.start] - recording.time[rows.start - 1] > LONG_PAUSE:
                    self.finish()
                self.feed(recording.time[rows], recording.position[rows], effort[rows])
                share = (done + float(recording.time[rows][-1] - recording.time[0])) / total
                progress(0.8 * share, f"reading {recording.name}")
            self.finish()
            done += recording.duration
        progress(0.8, "choosing terms")
        self.settle()
        self._settle_at = 2 * self._used
        model = self.model(ITERATIONS)
        progress(1.0, "done")
        return as_recorded(model, recordings, late, self.stream.asked)

    # -- models out ------------------------------------------------------------------------------

    def model(self, iterations: int = 1) -> PhysicalModel:
        """The model from all samples so far, checked for feasibility.

        Raises:
            RecordingError: no motion came yet.
            UpdateRejected: the result is not finite or not feasible.
        """
        recursion = self.sums.recursion
        posterior = recursion.solve(self.parameter_layout, iterations)
        self.version += 1
        return physical_model(self.robot, posterior, self.structure, self.scales, self.version, recursion)

    def settle(self) -> None:
        """Process all kept motion again with the load known now, and select the terms that it supports."""
        sums, belief = self.sums, self.belief
        evidence = sums.evidence
        if evidence.total is None:
            return
        whole = len(self._kept) == self._used
        # the choice depends on the motion alone, not on when it was made before
        for each in (sums.recursion, evidence):
            each.doubt()
        if whole:
            self._begin_as_described()
        plain, posterior = self._as_set_up(whole)
        usual = typical_friction(posterior.mean, posterior.layout, evidence.total)
        friction = np.clip(usual, LEAST_FRICTION * belief.effort_scale, belief.effort_scale)
        possible = Possible.of(evidence, posterior)
        # a spring, say, may be far more than the joint's friction
        beyond = np.maximum(friction, np.minimum(possible.left, belief.effort_scale))
        plain = replace(plain, friction=tuple(friction), beyond=tuple(beyond))
        bodies = possible.inertials if possible.unexplained.any() else None
        if whole:
            self._take_for(posterior, plain)
        self._choose(plain, posterior.layout, bodies)
        if not whole:
            return
        left = sums.recursion.solve(self.parameter_layout, ITERATIONS).noise
        if (left < LEARNED * sums.usual).any():
            self._sum_again(left)
            self._choose(plain, posterior.layout, bodies)

    def set_up(self) -> None:
        """Identify only base tilt and joint zeros: within seconds the bodies would absorb what comes from a wrong set-up."""
        if self.sums.evidence.total is None:
            return
        self.sums.evidence.doubt()
        self._begin_as_described()
        plain, posterior = self._as_set_up(whole=True)
        if plain.setup or self.structure.setup:
            with suppress(UpdateRejected):  # so little motion may not make a robot yet
                self.structure = plain
                self._take_for(posterior, plain)

    def _begin_as_described(self) -> None:
        """Sum all motion again about the robot as described: an earlier estimate of its set-up must not confirm itself."""
        noise = self.sums.evidence.noise
        if self.robot is not self._described or (self.sums.usual != noise).any():
            self.robot = self._described
            self.sums.take_for(self.robot)
            self._sum_again(noise)

    def _take_for(self, posterior: Posterior, structure: Structure) -> None:
        """Sum all motion again, linearised about the robot as known now."""
        known = physical_model(self.robot, posterior, structure, self.scales)
        self.robot = self.robot.set_up_as(known.robot)
        self.sums.take_for(known.robot, known.std.coulomb)
        self._sum_again(posterior.noise)

    def _sum_again(self, usual: np.ndarray) -> None:
        """Sum all motion again, given the standard deviation of its residual, (n,) [N·m]."""

        def one_by_one() -> Iterator[Motion]:
            for motion in self._kept:
                self._beat()
                yield motion

        self.sums.again(one_by_one(), usual)
        self._beat()

    def _as_set_up(self, whole: bool) -> tuple[Structure, Posterior]:
        """The structure of bodies, rotors, friction and the set-up that the motion shows with certainty, and its posterior.

        Args:
            whole: all motion is still kept; otherwise the set-up found earlier stays.
        """
        evidence, plain = self.sums.evidence, Structure.plain(self.belief)
        posterior = evidence.solve(layout(plain, self.belief), ITERATIONS)
        setup = set_up(evidence, plain).setup if whole else self.structure.setup
        while setup != plain.setup:
            plain = replace(plain, setup=setup)
            posterior = evidence.solve(layout(plain, self.belief), ITERATIONS)
            setup = sure(posterior, setup) if whole else setup
        return plain, posterior

    def _choose(self, plain: Structure, without: Layout, bodies: np.ndarray | None) -> None:
        """Select the terms; the noise of the evidence was estimated with the layout `without` any."""
        self._beat()
        moves = self.sums.fast.any(axis=(1, 2))
        kinds: list[int] = np.where(moves, 1 + self.robot.slides, 0).tolist()
        structure = choose(self.sums.evidence, plain, without, kinds, bodies)
        self._straight = straightened(structure, self.sums.fast)
        self.structure = structure

    @property
    def parameter_layout(self) -> Layout:
        """The parameter layout of the present structure."""
        return layout(self.structure, self.belief, self._straight)

    def restarted(self, belief: Prior) -> Identifier:
        """An identifier that continues with this stream but starts from this belief about the robot."""
        other = Identifier(self.robot, belief=belief, settle_at=self._settle_first, beat=self._beat)
        other.version, other.samples, other.chunks = self.version, self.samples, self.chunks
        other.stream, other._state, other.rejected = self.stream, self._state, self.rejected
        return other

    # -- chunks ----------------------------------------------------------------------------------

    def _take_in(self, chunk: tuple[Signals, np.ndarray] | None) -> None:
        self._beat()
        self.chunks += 1
        if chunk is None:
            self._state = None
            return
        motion = Motion(*chunk, self._state_at(chunk[0].time[0]))
        state = self.sums.add(motion)
        self._state = motion.signals.time, state
        self._used += 1
        if len(self._kept) < MOST_KEPT:
            self._kept.append(motion)
        self.latest = chunk
        try:
            if self._used == MOST_KEPT and self._settle_at == NEVER:
                self.set_up()  # how the robot stands is told by all of its motion, while all of that is kept
            if self._used >= self._settle_at:
                self._settle_at *= 2
                self.settle()
            elif self._used == self._set_up_at < self._settle_at < NEVER:
                self._set_up_at *= 2
                self.set_up()
        except (UpdateRejected, np.linalg.LinAlgError) as error:
            self.rejected.append(str(error))  # what was settled before holds until there is twice the motion

    def _state_at(self, time: float) -> Directions | None:
        """State of dry friction at a time within the last chunk's motion; None if there is none."""
        if self._state is None or not self._state[0][0] <= time <= self._state[0][-1]:
            return None
        return self._state[1].at(int(np.searchsorted(self._state[0], time, side="right")) - 1)
