"""Simulated recordings: a robot that moves under its controller, with effects its description leaves out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed
from bdnn_ros.errors import DataError, UsageError, listed
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation import sensors
from bdnn_ros.simulation.control import Controller
from bdnn_ros.simulation.excitation import Trajectory, fourier
from bdnn_ros.simulation.integrator import Integrator
from bdnn_ros.simulation.possible import refuse_without_inertia
from bdnn_ros.simulation.sensors import Noise

SLOWEST, FASTEST = 50.0, 2000.0
"""Rates that can be simulated [Hz]."""
EPOCH = 1_600_000_000 * 10**9
"""Clock time at the start of every simulated recording [ns]: the same seed gives the same bytes."""
SPARSE = 50
"""The joints' inertia is checked at every so many-th sample."""
LOST = 1.5
"""A joint this far off its plan is out of control [rad]."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Simulated:
    """A simulated recording and what it hides.

    Attributes:
        recording: what the sensors reported; effort is the command, held for one sample from its stamp.
        plan: the motion that the controller followed.
        position, velocity: true motion of the links, (N, n) [rad], [rad/s].
        motor_position: true positions of the motors, which the encoders see, (N, n) [rad].
        effort: commanded effort without noise, (N, n) [N·m].
        effects: the installed ones.
        real: the robot's bodies, rotors and friction with all effects.
    """

    recording: Recording
    plan: Trajectory
    position: np.ndarray
    velocity: np.ndarray
    motor_position: np.ndarray
    effort: np.ndarray
    effects: tuple[Installed, ...]
    real: Robot


def simulate(
    robot: Robot,
    effects: Sequence[Installed] = (),
    *,
    seed: int = 0,
    duration: float = 30.0,
    rate: float = 500.0,
    noise: Noise | None = None,
    reality: Robot | None = None,
    plan: Trajectory | None = None,
    known: Sequence[Installed] = (),
    progress: Progress | None = None,
) -> Simulated:
    """A recording of a robot in motion.

    Args:
        robot: the description: the controller computes from it, and its URDF comes with the recording.
        effects: what the description leaves out.
        seed: of the motion and the noise; each has its own stream, so the motion does not depend on the
            noise.
        duration, rate: of the recording [s], [Hz], unless a plan is given.
        noise: of the sensors; None takes the default.
        reality: the real bodies, rotors and friction, if they differ from the description's.
        plan: the motion, evenly sampled; None draws a Fourier series.
        known: those of the effects that the controller compensates, except pushes, which it never knows.
        progress: told (samples done, samples in all).

    Raises:
        UsageError: duration or rate make no sense, no motion keeps the limits, or a joint moves nothing.
        DataError: the controller lost the robot.
    """
    if plan is None:
        check(duration, rate)
        time = np.arange(round(duration * rate)) / rate
        plan = fourier(robot, time, np.random.default_rng([seed, 0]))
    plant = Plant(robot if reality is None else reality, duration=float(plan.time[-1]))
    placed = tuple(effect.within(plant.duration) for effect in effects)
    for effect in placed:
        effect.install(plant)
    refuse_without_inertia(plant, plan.position[::SPARSE])
    told = Plant(robot, duration=plant.duration)
    for effect in known:
        if not effect.effect.timed:
            effect.within(plant.duration).install(told)
    track = _moved(told, plant, plan, progress)
    recording = _reported(
        robot, plant, plan, track, Noise() if noise is None else noise, np.random.default_rng([seed, 1])
    )
    position, velocity, motor_position, _, effort = track
    return Simulated(recording, plan, position, velocity, motor_position, effort, placed, plant.robot)


def check(duration: float, rate: float) -> None:
    """Refuses what cannot be simulated.

    Raises:
        UsageError: the duration [s] or the rate [Hz] makes no sense.
    """
    if not SLOWEST <= rate <= FASTEST:
        raise UsageError(f"A rate of {rate:g} Hz cannot be simulated.", f"Use {SLOWEST:g} to {FASTEST:g} Hz.")
    if not 1.0 <= duration <= 3600.0:
        raise UsageError(f"A duration of {duration:g} s cannot be simulated.", "Use 1 to 3600 s.")


def _moved(
    known: Plant, plant: Plant, plan: Trajectory, progress: Progress | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Link position and velocity, motor position and velocity, and command at each sample.

    Raises:
        DataError: the controller lost the robot.
    """
    controller = Controller(known, plant, plan)
    period = float(plan.time[1] - plan.time[0])
    first = controller.effort(0, plan.position[0], plan.velocity[0])
    start = plan.position[0] - plant.position_offset
    integrator = Integrator(plant, start, first * plant.scale + plant.offset, period)
    acting = _Drives(plant, first, period, integrator.steps)
    state, motors = integrator.state, integrator.motors
    tracks = [np.empty(plan.position.shape) for _ in range(5)]
    for sample, time in enumerate(plan.time.tolist()):
        seen, speed = state.position.copy(), state.velocity.copy()
        tracks[0][sample], tracks[1][sample] = seen, speed
        command = controller.effort(sample, seen + plant.position_offset, speed)
        motors.seen(seen, speed)
        tracks[2][sample], tracks[3][sample], tracks[4][sample] = seen, speed, command
        off = np.abs(seen + plant.position_offset - plan.position[sample])
        if not off.max() < LOST:
            raise _lost(known.robot, time, off, tracks[4][: sample + 1])
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # what runs away is lost by the next sample
                integrator.advance(time, acting.after(command))
        except OverflowError:
            raise _lost(known.robot, time, np.abs(state.velocity), tracks[4][: sample + 1]) from None
        if progress is not None and sample % 500 == 0:
            progress(sample, len(plan.time))
    return tracks[0], tracks[1], tracks[2], tracks[3], tracks[4]


def _lost(robot: Robot, time: float, off: np.ndarray, commands: np.ndarray) -> DataError:
    """Which joint was lost, the one that is furthest off (n,), and whether drives could not do what was commanded (N, n)."""
    clipped = [
        joint
        for joint, short in zip(
            robot.joints, (np.abs(commands) >= robot.limits.effort).any(axis=0), strict=True
        )
        if short
    ]
    its = f"the drive{'s' * (len(clipped) > 1)} of {listed(clipped)}" if clipped else "its position loop"
    return DataError(
        f"The simulated robot lost its trajectory: {robot.joints[int(np.argmax(off))]} went astray at {time:.3g} s, "
        f"the effects are too strong for {its}.",
        "Use smaller effects, or a robot with higher effort limits." if clipped else "Use smaller effects.",
    )


class _Drives:
    """From commands to the effort that acts: delay, scale, offset."""

    def __init__(self, plant: Plant, first: np.ndarray, period: float, steps: int) -> None:
        self.scale, self.offset, self.steps = plant.scale, plant.offset, steps
        self.lags = np.round(plant.delay / period * steps).astype(int)
        self.history = np.tile(first, (int(np.ceil(self.lags.max() / steps)) + 1, 1))

    def after(self, command: np.ndarray) -> list[np.ndarray]:
        """Effort that acts in each step of the period after a command, (n,) [N·m] each."""
        if not self.lags.any():
            return [self.scale * command + self.offset] * self.steps
        self.history = np.vstack([self.history[1:], command])
        last, columns = len(self.history) - 1, np.arange(len(command))
        rows = [last - np.ceil((self.lags - k) / self.steps).astype(int).clip(0) for k in range(self.steps)]
        return [self.scale * self.history[row, columns] + self.offset for row in rows]


def _reported(
    nominal: Robot,
    plant: Plant,
    plan: Trajectory,
    track: tuple[np.ndarray, ...],
    noise: Noise,
    rng: np.random.Generator,
) -> Recording:
    """What the sensors make of a motion."""
    period = float(plan.time[1] - plan.time[0])
    position = sensors.measured_position(track[2] + plant.position_offset, noise, rng)
    velocity = sensors.measured_velocity(track[3], position, plant.velocity_cutoff, period, noise, rng)
    effort = sensors.measured_effort(track[4], period, noise, rng)
    return Recording(
        plan.time,
        nominal.joints,
        position,
        velocity,
        effort,
        name="simulation",
        urdf=nominal.urdf,
        epoch=EPOCH,
    )
