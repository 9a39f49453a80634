"""What every effect says of itself, and how it enters the measured effort."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

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
        plausible: magnitudes met in practice, (low, high); the simulation draws from it, the diagnosis starts in it.
        of_effort: the plausible range is a share of the joint's typical effort instead of absolute.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    plausible: tuple[float, float] = (0.0, 1.0)
    of_effort: bool = False


@dataclass(frozen=True)
class Motion:
    """A motion as effects see it: signals, the robot they belong to, and the load its joints carry.

    Attributes:
        signals: low-passed motion, N working samples.
        robot: the simulation's robot (or the current estimate of it).
        load: effort that really acts at each joint, noise-free estimate (from a model), (N, n) [N·m].
    """

    signals: Signals
    robot: Robot
    load: np.ndarray

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
    def sign(self) -> np.ndarray:
        """Direction of each joint, averaged over the sample period, (N, n)."""
        return self.signals.sign

    @cached_property
    def load_rate(self) -> np.ndarray:
        """Time derivative of the load, (N, n) [N·m/s]."""
        return self.derivative(self.load)

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
        rate = self.derivative(position_change)
        curvature = self.derivative(rate)

        def effort(side: float) -> np.ndarray:
            return self.robot.rigid_effort(
                self.position + side * position_change,
                self.velocity + side * rate,
                self.acceleration + side * curvature,
            )

        return (effort(step) - effort(-step)) / (2.0 * step)

    def with_load(self, load: np.ndarray) -> Motion:
        """The same motion with another estimate of the load."""
        return replace(self, load=load)


class Effect(ABC):
    """One physical cause a simulation may leave out.

    The measured effort is modelled as `rigid effort of the URDF + sum of columns · coefficients`. Coefficients enter
    linearly; the parameters that do not (a Stribeck velocity, a breakaway distance) are the `shape`, tried on a grid
    and then refined. `target` is the index of the joint (or of the joint that moves the link), -1 where the effect
    acts on the base or on all joints.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    """What a sentence calls it: "Coulomb friction"."""
    on: ClassVar[Where]
    parameters: ClassVar[tuple[Parameter, ...]]
    equation: ClassVar[str]
    """Contribution to the resisting effort, plain text with the contract's names."""
    confused_with: ClassVar[tuple[str, ...]]
    shown_by: ClassVar[str]
    """The motion that brings it out."""
    source: ClassVar[str]
    coefficient_bounds: ClassVar[tuple[tuple[float, float], ...]]
    """Lower and upper bound of each linear coefficient."""
    contains: ClassVar[tuple[str, ...]] = ()
    """Effects at the same place whose columns are a special case of this one's: naming this one replaces them."""

    # -- simulation -------------------------------------------------------------------------------------------

    @abstractmethod
    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        """Put the effect into a simulated robot."""

    # -- diagnosis and extension ------------------------------------------------------------------------------

    @abstractmethod
    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        """What one unit of each linear coefficient adds to the measured effort, (N, n, k) [N·m]."""

    def shapes(self, motion: Motion, target: int) -> list[dict[str, float]]:
        """Shapes to try first; one empty shape where every parameter is linear."""
        return [{}]

    @abstractmethod
    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        """Parameters of the contract from linear coefficients (k,) and shape."""

    @abstractmethod
    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        """Linear coefficients (k,) and shape from the contract's parameters: the inverse of `values`."""

    def sentence(self, where: str, values: Values) -> str:
        """The finding in words, one sentence with its numbers."""
        numbers = ", ".join(f"{p.name} {values[p.name]:.3g} {p.unit}".rstrip(" -") for p in self.parameters)
        return f"{where} has {self.title} that the model leaves out ({numbers})."
