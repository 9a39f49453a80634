"""What every effect says of itself, and how it enters the measured effort."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

Where = Literal["joint", "link", "base", "all"]
Values = Mapping[str, float]
"""Parameter values by name, in the units of the contract."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name, unit: as in the contract.
        lower, upper: what is physically possible.
        plausible: magnitudes met in practice, (low, high); the simulation draws from it.
        of_effort: the plausible range is a share of the joint's typical effort instead of absolute.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    plausible: tuple[float, float] = (0.0, 1.0)
    of_effort: bool = False
    default: float | None = None
    """Taken where a specification leaves the parameter out; None where it must be given."""


@dataclass(frozen=True)
class Motion:
    """A motion as effects see it: signals, the robot they belong to, and the load its joints carry.

    Attributes:
        signals: low-passed motion, N working samples.
        robot: the simulation's robot (or the current estimate of it).
        load: effort that really acts at each joint, noise-free estimate (from a model), (N, n) [N·m].
        drive: the part of it that drives take before the gear (effects with `in_drive`), (N, n), if known.
    """

    signals: Signals
    robot: Robot
    load: np.ndarray
    drive: np.ndarray | None = None

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

    @cached_property
    def load_rate(self) -> np.ndarray:
        """Time derivative of the load, (N, n) [N·m/s]."""
        return self.derivative(self.load)

    @cached_property
    def link_load(self) -> np.ndarray:
        """Effort of the bodies alone, drive friction and rotor left out, (N, n) [N·m]."""
        return self.robot.rigid_effort(self.position, self.velocity, self.acceleration)

    @cached_property
    def gear_load(self) -> np.ndarray:
        """As `link_load`, from the measured effort less what the drives take, (N, n) [N·m].

        The jumps of a loose motor are in the measured position, and so in `link_load`, but not in the effort.
        """
        effort = self.signals.effort
        if effort is None:
            return self.link_load
        return effort if self.drive is None else effort - self.drive

    @cached_property
    def own_inertia(self) -> np.ndarray:
        """Diagonal of the mass matrix, (N, n) [kg·m²]."""
        return np.diagonal(self.robot.mass_matrix(self.position), axis1=1, axis2=2)

    def joint_column(self, target: int, *columns: np.ndarray) -> np.ndarray:
        """Columns (N,) that act on one joint only, as (N, n, k)."""
        result = np.zeros((*self.position.shape, len(columns)))
        for k, column in enumerate(columns):
            result[:, target, k] = column
        return result

    def sharp_column(self, target: int, *columns: np.ndarray) -> np.ndarray:
        """As `joint_column` for columns with steps or ripples: low-passed as the effort was."""
        return self.joint_column(target, *(self.signals.soften(column) for column in columns))

    @cached_property
    def regressor(self) -> np.ndarray:
        """Regressor of all inertial parameters, (N, n, n * PER_LINK)."""
        return self.robot.regressor(self.position, self.velocity, self.acceleration)

    def jacobian(self, link: str) -> np.ndarray:
        """Jacobian of a link along the motion, as `Robot.link_jacobian`, (N, 6, n)."""
        if link not in self._jacobians:
            self._jacobians[link] = self.robot.link_jacobian(self.position, link)
        return self._jacobians[link]

    @cached_property
    def _jacobians(self) -> dict[str, np.ndarray]:
        return {}

    def advanced(self, values: np.ndarray, lead: float) -> np.ndarray:
        """Values (N, n) as they will be `lead` seconds later, along each segment; held at its end."""
        result = np.empty_like(values)
        for rows in self.signals.segments:
            time = self.time[rows]
            later = np.minimum(time + lead, time[-1])
            result[rows] = CubicSpline(time, values[rows])(later) if len(time) > 3 else values[rows]
        return result

    def late_mean(self, values: np.ndarray, span: float) -> np.ndarray:
        """Mean of values (N,) over the `span` seconds before each sample, along each gap-free segment."""
        result = np.empty(len(values))
        for rows in self.signals.segments:
            time = self.time[rows]
            total = cumulative_trapezoid(values[rows], time, initial=0.0)
            before = np.interp(time - span, time, total, left=np.nan)
            mean = (total - before) / span
            result[rows] = np.where(np.isnan(mean), values[rows], mean)
        return result

    def derivative(self, values: np.ndarray) -> np.ndarray:
        """Time derivative along each gap-free segment, same shape."""
        result = np.empty_like(values)
        for rows in self.signals.segments:
            result[rows] = np.gradient(values[rows], 1.0 / self.signals.rate, axis=0)
        return result

    def shifted(self, position_change: np.ndarray, step: float = 1e-4) -> np.ndarray:
        """Change of the rigid effort per unit of a change of the motion, (N, n) [N·m].

        Args:
            position_change: direction of the change of position, (N, n); velocity and acceleration follow as
                its time derivatives.
        """
        ahead, back = self.moved(step * position_change), self.moved(-step * position_change)
        return (ahead - back) / (2.0 * step)

    def moved(self, position_change: np.ndarray) -> np.ndarray:
        """Rigid effort of the motion with another position (N, n), rates and all, (N, n) [N·m]."""
        rate = self.derivative(position_change)
        return self.robot.rigid_effort(
            self.position + position_change, self.velocity + rate, self.acceleration + self.derivative(rate)
        )

    def changed(self, position_change: np.ndarray) -> np.ndarray:
        """Change of the rigid effort when every position is changed by constants (n,) [rad], (N, n) [N·m]."""
        changed = self.robot.rigid_effort(self.position + position_change, self.velocity, self.acceleration)
        return changed - self.link_load

    def with_robot(self, robot: Robot) -> Motion:
        """The same motion with another estimate of the robot's bodies."""
        other = replace(self, robot=robot)
        for kept in ("regressor", "_jacobians"):  # they do not depend on the bodies
            if kept in self.__dict__:
                other.__dict__[kept] = self.__dict__[kept]
        return other

    def with_load(self, load: np.ndarray, drive: np.ndarray | None = None) -> Motion:
        """The same motion with another estimate of the load, and of the drives' share of it (None keeps)."""
        other = replace(self, load=load, drive=self.drive if drive is None else drive)
        for kept in ("link_load", "regressor", "_jacobians"):  # they do not depend on the load
            if kept in self.__dict__:
                other.__dict__[kept] = self.__dict__[kept]
        return other


class Effect(ABC):
    """One physical cause a simulation may leave out.

    The measured effort is modelled as `rigid effort of the URDF + sum of columns · coefficients`.
    Coefficients enter linearly; the parameters that do not (a Stribeck velocity, a breakaway distance) are
    the `shape`, tried on a grid and then refined. `target` is the index of the joint (or of the joint that
    moves the link), -1 where the effect acts on the base or on all joints.
    """

    name: ClassVar[str]
    variant: ClassVar[str] = ""
    """Tells classes of one name apart: what drifts, or whether a wrench acts on a joint or a link."""
    title: ClassVar[str]
    """What a sentence calls it: "Coulomb friction"."""
    on: ClassVar[Where]
    also_on: ClassVar[tuple[Where, ...]] = ()
    """Where else it may act: a delay on one joint, though it is usually one for all."""
    parameters: ClassVar[tuple[Parameter, ...]]
    equation: ClassVar[str]
    """Contribution to the resisting effort, plain text with the contract's names."""
    confused_with: ClassVar[tuple[str, ...]]
    shown_by: ClassVar[str]
    """The motion that brings it out."""
    source: ClassVar[str]
    coefficient_bounds: ClassVar[tuple[tuple[float, float], ...]]
    coefficient_spread: ClassVar[float] = math.inf
    """Coefficients are rarely larger, whatever the effort; most scale with it."""
    """Lower and upper bound of each linear coefficient."""
    contains: ClassVar[tuple[str, ...]] = ()
    """Effects at the same place whose columns are a special case of this one's: this one replaces them."""
    of_load: ClassVar[bool] = False
    """Its columns are made from the load, so a better estimate of the load changes them."""
    of_bodies: ClassVar[bool] = False
    """Its columns are made from the robot's bodies, so a better estimate of them changes them."""
    at_sensor: ClassVar[bool] = False
    """It changes what is measured of the effort, not the effort that acts: no joint carries it."""
    in_drive: ClassVar[bool] = False
    """It takes its effort before the gear, so that the gear does not carry it."""
    kinematic: ClassVar[bool] = False
    """It shows in the reported velocity, not in the effort."""

    shape_bounds: ClassVar[Mapping[str, tuple[float, float]]] = MappingProxyType({})
    """Range of each shape parameter that a search may refine; a shape parameter not named here is given."""

    # -- simulation ------------------------------------------------------------------------------------------

    @abstractmethod
    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        """Put the effect into a simulated robot."""

    # -- diagnosis and extension -----------------------------------------------------------------------------

    @abstractmethod
    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        """What one unit of each linear coefficient adds to the measured effort, (N, n, k) [N·m]."""

    def velocity_columns(
        self, motion: Motion, target: int, shape: Values, link: str | None = None
    ) -> np.ndarray:
        """What one unit of each linear coefficient adds to the reported velocity, (N, n, k) [rad/s]."""
        return np.zeros((*motion.position.shape, len(self.coefficient_bounds)))

    def places(self, robot: Robot) -> list[tuple[int, str | None]]:
        """Where it can sit on a robot: (target, link) pairs."""
        found: list[tuple[int, str | None]] = []
        for where in (self.on, *self.also_on):
            if where == "joint":
                found += [(i, None) for i in range(robot.width)]
            elif where == "link":
                found += [(i, robot.moving_link(joint)) for i, joint in enumerate(robot.joints)]
            else:
                found.append((-1, None))
        return found

    def shape_allowed(self, shape: Values) -> bool:
        """Whether a shape's parameters are inside their bounds."""
        return all(
            self.shape_bounds[name][0] <= value <= self.shape_bounds[name][1]
            for name, value in shape.items()
            if name in self.shape_bounds
        )

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        """Shapes to try first; one empty shape where every parameter is linear."""
        return [{}]

    @abstractmethod
    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        """Parameters of the contract from linear coefficients (k,) and shape."""

    @abstractmethod
    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        """Linear coefficients (k,) and shape from the contract's parameters: the inverse of `values`."""

    def believable(self, coefficients: np.ndarray) -> bool:
        """Whether fitted coefficients, each inside its bounds, can be such an effect together."""
        return True

    def resolved(self, motion: Motion, target: int, shape: Values) -> bool:
        """Whether a motion behind its low-pass shows the effect with this shape at all."""
        return True

    def echo(self, motion: Motion, target: int) -> np.ndarray | None:
        """Share of the effort sensor's noise, differentiated twice, that is in the target's column, (N,) [s²·...].

        The same noise is in what the column is to explain. None where the column is free of it.
        """
        return None

    def relinearised(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        """The shape at which the columns are exact for these coefficients; the same where they always are."""
        return dict(shape)

    def sentence(self, where: str, values: Values) -> str:
        """The finding in words, one sentence with its numbers."""
        numbers = ", ".join(
            f"{p.name} {values[p.name]:.3g} {p.unit.replace('*', '·').replace('^2', '²')}".rstrip(" -")
            for p in self.parameters
            if p.name in values
        )
        return f"{where} has {self.title} that the model leaves out ({numbers})."
