"""A motion as effects see it: signals, the robot, and the load on its joints."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from bdnn_ros.robot import Robot
from bdnn_ros.robot.axes import turns_all
from bdnn_ros.signals import LEAST_CUTOFF, Signals

CALM = 3.0
"""A motion has no content beyond this many times its root mean square frequency."""
LIGHTEST = 1e-9
"""Least inertia of a joint: some descriptions give their last links none at all [kg·m²]."""
SPARSE = 50
"""A mean takes every so many-th sample."""
OF_MOTION = ("regressor", "_pulls", "calm")
"""Cached results that depend neither on the bodies nor on the load."""
OF_BODIES = ("link_load", "_slopes", "inertia", "gravity_pulls", "usual_inertia")
"""Cached results that do not depend on the load."""


@dataclass(frozen=True)
class Motion:
    """A motion as effects see it: signals, the robot they belong to, and the load on its joints.

    Attributes:
        signals: low-passed motion, N working samples.
        robot: the simulation's robot (or the current estimate of it).
        load: effort that really acts at each joint, noise-free estimate (from a model), (N, n) [N·m].
        drive: the part of it that is spent before the gear (effects with `in_drive`), (N, n), if known.
        level: the robot that a base tilt is applied to, where the errors of `robot`'s bodies were estimated with the tilt
            it already has; None: `robot` itself.
        springs: stiffness of springs across the joints, behind their gears, (n,) [N·m/rad], if known.
        scale: effort that really acts per measured effort, (n,), if known.
        zeros: offsets of the measured positions, (n,) [rad], as far as they are known.
    """

    signals: Signals
    robot: Robot
    load: np.ndarray
    drive: np.ndarray | None = None
    level: Robot | None = None
    springs: np.ndarray | None = None
    scale: np.ndarray | None = None
    zeros: np.ndarray | None = None

    @property
    def time(self) -> np.ndarray:
        """Stamps [s], (N,)."""
        return self.signals.time

    @property
    def position(self) -> np.ndarray:
        """[rad], (N, n)."""
        return self.signals.position

    @property
    def velocity(self) -> np.ndarray:
        """[rad/s], (N, n)."""
        return self.signals.velocity

    @property
    def acceleration(self) -> np.ndarray:
        """[rad/s²], (N, n)."""
        return self.signals.acceleration

    @property
    def direction(self) -> np.ndarray:
        """Direction of each joint, averaged over the sample period, (N, n)."""
        return self.signals.direction

    def ways(self, target: int) -> tuple[np.ndarray, np.ndarray]:
        """Dry friction of a joint relative to its full size, forwards (0 to 1) and backwards (-1 to 0), (N,) each.

        If it builds up with velocity alike both ways, that is a joint reversing within the sample period: each way has its
        share of time.
        """
        way, creep = self.direction[:, target], self.signals.creep
        if creep is None or creep[target, 0] == creep[target, 1]:
            return 0.5 * (way + 1.0), 0.5 * (way - 1.0)
        return np.maximum(way, 0.0), np.minimum(way, 0.0)

    @cached_property
    def measured_load(self) -> np.ndarray:
        """The load in the effort sensors' (possibly wrong) units, (N, n) [N·m]."""
        return self.load if self.scale is None else self.load / self.scale

    @cached_property
    def load_rate(self) -> np.ndarray:
        """Time derivative of the load in the effort sensors' units, (N, n) [N·m/s]."""
        return self.derivative(self.measured_load)

    @cached_property
    def link_load(self) -> np.ndarray:
        """Rigid-body effort alone, without friction and rotor inertia, (N, n) [N·m]."""
        return self.robot.rigid_effort(self.position, self.velocity, self.acceleration)

    @cached_property
    def gear_load(self) -> np.ndarray:
        """As `link_load`, but from the measured effort less what the drives take, (N, n) [N·m].

        When a motor jumps in its backlash, that is in the measured position and so in `link_load`, but not in the effort.
        """
        effort = self.signals.effort
        if effort is None:
            return self.link_load
        acting = effort if self.scale is None else self.scale * effort
        return acting if self.drive is None else acting - self.drive

    def carried(self, target: int) -> np.ndarray:
        """Load on a joint's gear, (N,) [N·m]: as `gear_load`, with the drive's effort interpolated where the joint may stick.

        While it sticks, dry friction passes from one sign to the other at an unknown moment, but the load on the link does
        not jump.
        """
        load = self.gear_load[:, target].copy()
        if self.signals.effort is None or self.drive is None:
            return load
        drive, sticks = self.drive[:, target], self.signals.hardly_moves[:, target]
        for rows in self.signals.segments:
            held, free = (np.flatnonzero(at) for at in (sticks[rows], ~sticks[rows]))
            if len(held) and len(free):
                load[rows][held] += drive[rows][held] - np.interp(held, free, drive[rows][free])
        return load

    def calmed(self, values: np.ndarray) -> np.ndarray:
        """Values (N, ...) limited to frequencies of the motion: the noise beyond would be amplified by differentiation."""
        return self.signals.passed(values, self.calm)

    @cached_property
    def calm(self) -> float:
        """Highest frequency of the motion [Hz], at least the lowest that so short a recording resolves."""
        rates = np.sum(self.acceleration**2) / max(float(np.sum(self.velocity**2)), 1e-12)
        slowest = self.signals.rate / max(len(self.time), 1)
        return max(CALM * max(float(np.sqrt(rates)) / (2.0 * np.pi), slowest), LEAST_CUTOFF)

    @cached_property
    def usual_velocity(self) -> np.ndarray:
        """Root mean square velocity of each joint, (n,) [rad/s]."""
        return np.asarray(np.sqrt(np.mean(self.velocity**2, axis=0)))

    @cached_property
    def usual_acceleration(self) -> np.ndarray:
        """Root mean square acceleration of each joint, (n,) [rad/s²]."""
        return np.asarray(np.sqrt(np.mean(self.acceleration**2, axis=0)))

    @cached_property
    def known_load(self) -> np.ndarray:
        """The load without the drive effort that was found beyond the robot's own friction and rotor inertia, (N, n) [N·m]."""
        if self.drive is None:
            return self.load
        own = self.robot.drive_effort(self.velocity, self.acceleration, self.signals.sign)
        return np.asarray(self.load - (self.drive - own))

    @cached_property
    def usual_inertia(self) -> np.ndarray:
        """Mean of the mass matrix's diagonal along the motion, (n,) [kg·m²]."""
        matrices = self.robot.mass_matrix(self.position[::SPARSE])
        return np.maximum(np.diagonal(matrices, axis1=1, axis2=2).mean(axis=0), LIGHTEST)

    @cached_property
    def inertia(self) -> np.ndarray:
        """The mass matrix's diagonal along the motion, (N, n) [kg·m²]."""
        return np.maximum(np.diagonal(self._slopes[2], axis1=0, axis2=2), LIGHTEST)

    def joint_column(self, target: int, *columns: np.ndarray) -> np.ndarray:
        """Columns (N,) that act on one joint only, as (N, n, k)."""
        result = np.zeros((*self.position.shape, len(columns)))
        for k, column in enumerate(columns):
            result[:, target, k] = column
        return result

    def sharp_column(self, target: int, *columns: np.ndarray) -> np.ndarray:
        """As `joint_column`, for columns with steps or ripples: low-passed as the effort was."""
        return self.joint_column(target, *(self.signals.soften(column) for column in columns))

    @cached_property
    def regressor(self) -> np.ndarray:
        """Regressor of all inertial parameters, (N, n, n * PER_LINK)."""
        return self.robot.regressor(self.position, self.velocity, self.acceleration)

    def regressed(self, parameters: np.ndarray) -> np.ndarray:
        """Effort of inertial parameters (P,) along the motion, (N, n) [N·m]."""
        tall = self.regressor.reshape(-1, self.regressor.shape[2])  # of many small products one large one
        return np.asarray((tall @ parameters).reshape(self.position.shape))

    def soft_pulls(self, link: str) -> np.ndarray:
        """Effort per unit wrench at a link's origin, and its change per metre of the point, softened as the effort, (N, n, 15).

        First the transposed Jacobian, (N, n, 6); then, for each force component, the change per metre along each of the
        link's axes.
        """
        if link not in self._pulls:
            jacobian, axes = self.robot.link_motion(self.position, link)
            pulls, moved = np.zeros((*self.position.shape, 15)), jacobian.any(axis=(0, 1))
            pull = np.swapaxes(jacobian[..., moved], 1, 2)
            arms = np.cross(pull[..., 3:, None], axes[:, None], axis=2)
            both = np.concatenate([pull, arms.reshape(*pull.shape[:2], 9)], axis=2)
            pulls[:, moved] = self.signals.soften(both)
            self._pulls[link] = pulls
        return self._pulls[link]

    @cached_property
    def _pulls(self) -> dict[str, np.ndarray]:
        return {}

    def advanced(self, values: np.ndarray, lead: float) -> np.ndarray:
        """Values (N, k) shifted `lead` seconds ahead within each segment; held at the segment's ends."""
        result = np.empty_like(values)
        for rows in self.signals.segments:
            time = self.time[rows]
            later = np.clip(time + lead, time[0], time[-1])
            result[rows] = CubicSpline(time, values[rows])(later) if len(time) > 3 else values[rows]
        return result

    def derivative(self, values: np.ndarray) -> np.ndarray:
        """Time derivative along each gap-free segment, same shape."""
        return self.signals.derivative(values)

    def shifted(self, target: int, change: np.ndarray) -> np.ndarray:
        """Change of the rigid effort per unit of a small change of one joint's motion, (N, n) [N·m].

        Args:
            change: direction of the change of its position, (N,); velocity and acceleration follow as its time derivatives.
        """
        rate = self.derivative(change)
        changes = (change, rate, self.derivative(rate))
        return np.asarray(sum(by[target] * c[:, None] for by, c in zip(self._slopes, changes, strict=True)))

    def bent(self, target: int, change: np.ndarray) -> np.ndarray:
        """As `shifted`, for a change of the link's position behind the gear, which joint springs feel too, (N, n) [N·m]."""
        bodies = self.shifted(target, change)
        return (
            bodies
            if self.springs is None
            else bodies + self.joint_column(target, self.springs[target] * change)[..., 0]
        )

    @cached_property
    def _slopes(self) -> list[np.ndarray]:
        """Derivatives of the rigid effort by position, velocity and acceleration of each joint (first index), (n, N, n) each."""
        found = self.robot.effort_derivatives(self.position, self.velocity, self.acceleration)
        return [np.ascontiguousarray(np.moveaxis(by, 2, 0)) for by in found]

    @cached_property
    def gravity_pulls(self) -> np.ndarray:
        """Effort per unit of gravity along x, y and z of the base, (N, n, 3) [N·s²]."""
        turned = self.level or self.robot
        axes = (replace(turned, gravity_vector=axis) for axis in np.eye(3))
        return np.stack([robot.gravity(self.position) for robot in axes], axis=-1)

    def turned(self, target: int, angle: float) -> np.ndarray:
        """Change of the rigid effort when a constant is added to one joint's positions [rad], (N, n) [N·m].

        Half of the other joints' known offsets is subtracted first, so each of two offsets gets half of their joint effect.
        The zero of a first joint may be equivalent to a tilt of the base; such a joint is evaluated on the robot without the
        tilt.
        """
        others = np.zeros(self.robot.width) if self.zeros is None else np.array(self.zeros)
        others[target] = 0.0
        robot = self.level if self.level is not None and turns_all(self.robot, target) else self.robot
        start, change = self.position - 0.5 * others, angle * np.eye(len(others))[target]
        as_it_is = robot is self.robot and not others.any()
        here = self.link_load if as_it_is else robot.rigid_effort(start, self.velocity, self.acceleration)
        return robot.rigid_effort(start + change, self.velocity, self.acceleration) - here

    def with_robot(self, robot: Robot, zeros: np.ndarray | None = None) -> Motion:
        """The same motion with another estimate of the robot's bodies and of the positions' offsets (None keeps)."""
        zeros = self.zeros if zeros is None else zeros
        return self._handing_on(replace(self, robot=robot, zeros=zeros), OF_MOTION)

    def with_load(
        self, load: np.ndarray, drive: np.ndarray | None = None, scale: np.ndarray | None = None
    ) -> Motion:
        """The same motion with another estimate of the load, the drives' share of it and the sensors' scales (None keeps)."""
        drive, scale = self.drive if drive is None else drive, self.scale if scale is None else scale
        other = replace(self, load=load, drive=drive, scale=scale)
        return self._handing_on(other, OF_MOTION + OF_BODIES)

    def _handing_on(self, other: Motion, names: tuple[str, ...]) -> Motion:
        """`other`, with those cached results of this motion that hold for it too."""
        other.__dict__.update({name: self.__dict__[name] for name in names if name in self.__dict__})
        return other
