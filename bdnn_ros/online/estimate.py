"""The model's estimate at one instant: effort, its parts, and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.interpolate import CubicSpline

from bdnn_ros.bdnn import mechanics
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.online.stream.feed import Feed, Samples
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.signals import SAMPLES_PER_CUTOFF, usual_cutoff
from bdnn_ros.signals.jitter import taken_at
from bdnn_ros.signals.kernels import gaussian_kernel, gaussian_std, kernel_half
from bdnn_ros.signals.wraps import wraps

EVEN = 1e-3
"""Steps that differ by less than this share of the period count as even."""
FASTEST = 1e5
"""Joint states come at no higher rate [Hz]; stamps that say so are in another unit."""
BRIDGED, BRIDGED_PERIODS = 2.0, 2.5
"""An effort is bridged over so many standard deviations of the kernel, or periods, if that is longer: one row always."""


@runtime_checkable
class Learned(Dynamics, Protocol):
    """A model that can say which part of its friction its networks learned."""

    def learned_effort(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """The effort that networks learned, (..., n) [N·m], in measured units."""


@dataclass(frozen=True)
class Parts(mechanics.Parts):
    """The parts of the effort at one instant, (n,) each [N·m].

    Attributes:
        learned: what the model's networks add, zero without.
        std: standard deviation of the measured effort around it; empty where the model does not know.
    """

    learned: np.ndarray
    std: np.ndarray

    @property
    def effort(self) -> np.ndarray:
        """Their sum."""
        return super().effort + self.learned

    def arranged(self, order: np.ndarray) -> Parts:
        """The same with the joints in another order: `order` gives for each new place the old one."""
        return Parts(
            inertial=self.inertial[order],
            coriolis=self.coriolis[order],
            gravity=self.gravity[order],
            friction=self.friction[order],
            mass_matrix=self.mass_matrix[np.ix_(order, order)],
            learned=self.learned[order],
            std=self.std[order] if len(self.std) else self.std,
        )


@dataclass(frozen=True)
class Instant:
    """The low-passed motion at one stamp, (n,) each; NaN where not measured."""

    stamp: int
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    effort: np.ndarray


def parts(model: Dynamics, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> Parts:
    """The effort at one instant with its parts, (n,) each."""
    if isinstance(model, PhysicalModel):
        return _physical_parts(model, position, velocity, acceleration)
    told = mechanics.parts(model, position, velocity, acceleration)
    learned = np.zeros_like(told.friction)
    if isinstance(model, Learned):
        learned = model.learned_effort(position, velocity)
        told = replace(told, friction=told.friction - learned)
    return Parts(**vars(told), learned=learned, std=np.empty(0))


def _physical_parts(
    model: PhysicalModel, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> Parts:
    """The same for a physical model, each term computed once, because a client waits."""
    robot, motors, way = model.robot, model.motors, np.sign(velocity)
    matrix, gravity = model.mass_matrix(position), robot.gravity(position)
    load = robot.rigid_effort(position, velocity, acceleration)
    moving = load + robot.armature * acceleration
    friction = robot.viscous * velocity + robot.coulomb * way + model.offset
    if motors.couplings:
        moving = moving + motors.inertial(acceleration)
        friction = friction + motors.friction(velocity, np.sign(motors.speeds(velocity)))
    learned = np.zeros_like(load)
    if model.learned is not None:
        learned = model.learned.effort(position, velocity, way, load)
    inertial = matrix @ acceleration
    coriolis = moving - inertial - gravity
    std = model.effort_std(position[None], velocity[None], acceleration[None])[0]
    return Parts(inertial, coriolis, gravity, friction, matrix, learned, std)


@dataclass(frozen=True)
class _Grid:
    """The points at which a low-pass is evaluated on a stream of one period, and its weights.

    Attributes:
        period: of the stream [s].
        step: from point to point [s].
        std: of the kernel [s].
        half: points before and behind the middle one.
        kernels: weights of the value and its derivatives, (3, points); None of what cannot be.
    """

    period: float
    step: float
    std: float
    half: int
    kernels: np.ndarray | None = None

    @classmethod
    def of(cls, period: float, cutoff: float | None, most: float) -> _Grid:
        """The grid for a stream of this period [s], `most` samples of which are kept; cut-off [Hz], None for the usual one."""
        rate = 1.0 / period
        chosen = usual_cutoff(rate) if cutoff is None else cutoff
        step = period / max(int(np.ceil(SAMPLES_PER_CUTOFF * chosen / rate)), 1)
        std = gaussian_std(chosen)
        grid = cls(period, step, std, kernel_half(std, 1.0 / step))
        if grid.too_fast or grid.count > most:  # the kernel alone could take all memory
            return grid
        return replace(grid, kernels=np.array(gaussian_kernel(std, 1.0 / step)))

    @property
    def too_fast(self) -> bool:
        """Whether the stream is faster than the joint states of any robot."""
        return self.period * FASTEST < 1.0

    @property
    def direct(self) -> bool:
        """Whether the grid points are the samples themselves."""
        return self.step == self.period

    @property
    def count(self) -> int:
        """The number of samples that are needed."""
        return int(np.ceil((2 * self.half + 1) * self.step / self.period)) + 3


class Smoother:
    """Low-pass and differentiate the stream at its newest possible stamp: half a kernel before the last sample.

    One thread smooths while another may read `count`.

    Attributes:
        cutoff: -3 dB frequency [Hz]; None until the rate is known.
    """

    def __init__(self, cutoff: float | None = None) -> None:
        self.cutoff = cutoff
        self._grid: _Grid | None = None

    def settle(self, period: float, most: float = np.inf) -> None:
        """Choose kernel and grid for a stream of this period [s], of which at most `most` samples are kept."""
        if self._grid is None or abs(period - self._grid.period) > 0.02 * self._grid.period:
            self._grid = _Grid.of(period, self.cutoff, most)

    @property
    def count(self) -> int:
        """The number of samples that `at` needs; 0 before `settle`."""
        grid = self._grid
        return grid.count if grid is not None else 0

    def complaint(self, most: int) -> str:
        """Why a buffer of so many samples is too short or the stream too fast, and what to do; empty if all is well."""
        grid = self._grid
        if grid is None:
            return ""
        if grid.too_fast:
            return (
                f"The stamps of joint_states go on by {1e9 * grid.period:.0f} ns, and no driver measures so often: "
                "nothing is estimated. Let the driver fill stamp.sec with seconds and stamp.nanosec with nanoseconds."
            )
        if grid.count <= most:
            return ""
        return (
            f"buffer_size keeps {most} joint states, and the low-pass needs {grid.count}: nothing is estimated. "
            f"Set buffer_size to {2 * grid.count}, or a higher cutoff."
        )

    def newest(self, feed: Feed, period: float) -> Instant | None:
        """As `at`, from the stream itself, whose period is given [s]; None while it is too short."""
        self.settle(period, feed.states.most)
        grid = self._grid
        if grid is None or grid.kernels is None:
            return None
        samples, stamps = feed.latest(grid.count)
        return self.at(samples, stamps) if len(samples) >= grid.count else None

    def at(self, samples: Samples, stamps: np.ndarray) -> Instant | None:
        """The motion at the newest stamp with half a kernel of samples on both sides, or None.

        Args:
            samples: the latest of the stream, `count` or more.
            stamps: of those samples [ns].
        """
        grid = self._grid
        assert grid is not None and grid.kernels is not None, "settle first"
        time, period, step, half = samples.time, grid.period, grid.step, grid.half
        reach = half * step
        turns = np.cumsum(wraps(samples.position), axis=0)
        position = samples.position - 2.0 * np.pi * turns
        if np.abs(np.diff(time) - period).max() > EVEN * period:
            time = taken_at(time, position, 1.0 / period, [slice(0, len(time))])
        centre = int(np.searchsorted(time, time[-1] - reach, side="right")) - 1
        if centre < 0 or time[centre] - time[0] < reach or np.diff(time).max() > 5.0 * period + 0.05:
            return None
        position += 2.0 * np.pi * turns[centre]  # told within the turn that the driver tells
        bridged = _bridged(time, samples.effort, max(BRIDGED * grid.std, BRIDGED_PERIODS * period))
        measured = np.isfinite(bridged).all(axis=0)
        values = np.concatenate([position, bridged[:, measured]], axis=1)
        low, high = centre - half, centre + half + 1
        even = grid.direct and low >= 0 and high <= len(time)
        if even and np.abs(np.diff(time[low:high]) - step).max() < EVEN * step:
            window = values[low:high]
        else:
            window = CubicSpline(time, values)(time[centre] + step * np.arange(-half, half + 1))
        # the kernel is even, its first derivative odd: convolution turns it round
        smooth, first, second = grid.kernels[:, ::-1] @ window
        n = position.shape[1]
        effort = np.full(n, np.nan)
        effort[measured] = smooth[n:]
        return Instant(int(stamps[centre]), smooth[:n], first[:n], second[:n], effort)


def _bridged(time: np.ndarray, effort: np.ndarray, longest: float) -> np.ndarray:
    """Efforts (N, n) at times (N,) [s], gaps of NaN interpolated unless they last longer than `longest` [s]."""
    lacking = np.isnan(effort)
    if not lacking.any():
        return effort
    effort = effort.copy()
    for joint in np.flatnonzero(lacking.any(axis=0) & ~lacking.all(axis=0)):
        known = time[~lacking[:, joint]]
        if len(known) > 1 and np.diff([time[0], *known, time[-1]]).max() <= longest:
            told = CubicSpline(known, effort[~lacking[:, joint], joint])
            effort[:, joint] = told(np.clip(time, known[0], known[-1]))
    return effort
