"""What every effect can do: act in a simulation, and explain a measured effort."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from types import MappingProxyType
from typing import Literal

import numpy as np

from bdnn_ros.effects.declaration import Declaration, Parameter, Values, Where
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import printed, shown_as

__all__ = ["NONE_HELD", "SHOWN", "Change", "Effect", "Held", "Parameter", "Values", "Where"]

Change = Literal["more", "less", "both"]
Held = Mapping[str, Sequence[Values]]
"""Effects of an earlier model at one place, beside its robot: the values of each, by the effect's name."""
NONE_HELD: Held = MappingProxyType({})
SHOWN = 2.0
"""An estimate this many standard deviations from 0 is taken as shown by the recording."""


class Effect(Declaration, ABC):
    """A physical cause that a simulation may leave out.

    The measured effort is modelled as `rigid effort of the URDF + sum of columns · coefficients`. Coefficients enter
    linearly; the parameters that do not (a Stribeck velocity, a breakaway distance) are the `shape`, tried on a grid and then
    refined. `target` is the index of the joint (or of the joint that moves the link), -1 where the effect acts on the base or
    on all joints.
    """

    def with_defaults(self, given: Values) -> dict[str, float]:
        """Values completed with the defaults of parameters that were left out; one without a default may stay missing."""
        values = dict(given)
        for parameter in self.parameters:
            default = parameter.default
            value = values.get(default) if isinstance(default, str) else default
            if value is not None:
                values.setdefault(parameter.name, value)
        return values

    # -- simulation ------------------------------------------------------------------------------------------

    @abstractmethod
    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        """Put the effect into a simulated robot."""

    # -- diagnosis and extension -----------------------------------------------------------------------------

    @abstractmethod
    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        """What one unit of each linear coefficient adds to the measured effort, (N, n, k) [N·m]."""

    def places(self, robot: Robot) -> list[tuple[int, str | None]]:
        """Where on a robot it can act: (target, link) pairs."""
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
        """Whether a shape's parameters are within `shape_bounds`."""
        ends = self.shape_bounds
        return all(ends[k][0] <= value <= ends[k][1] for k, value in shape.items() if k in ends)

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        """Shapes to try first; a single empty shape where every parameter is linear."""
        return [{}]

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        """Parameters of the contract from linear coefficients (k,) and shape; to be written where `linear` is empty."""
        every = {**shape, **dict(zip(self.linear, coefficients, strict=True))}
        return {parameter.name: float(every[parameter.name]) for parameter in self.parameters}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        """Linear coefficients (k,) and shape from the contract's parameters: the inverse of `values`."""
        shape = [parameter.name for parameter in self.parameters if parameter.name not in self.linear]
        return np.array([values[name] for name in self.linear]), {name: values[name] for name in shape}

    def believable(self, coefficients: np.ndarray, std: np.ndarray | None = None) -> bool:
        """Whether fitted coefficients (k,), each inside its bounds, are physically plausible together.

        A coefficient at its bound (other than 0) is a sign of another cause. Where the effect may be gone, a coefficient at
        its lower bound is plausible.

        Args:
            std: of the coefficients, where they need not be taken at their word, (k,).
        """
        pairs = zip(np.asarray(coefficients).tolist(), self.coefficient_bounds, strict=True)
        ends = [(value, end) for value, both in pairs for end in both[self.may_be_gone :]]
        return not [end for value, end in ends if end and math.isclose(value, end, rel_tol=1e-3)]

    def shown(self, values: Values, stds: Values, most: float = math.inf) -> bool:
        """Whether an estimate with these standard deviations may be reported.

        Args:
            most: largest magnitude of the joint's effort in the recording [N·m].
        """
        return True

    def strength(self, unit: np.ndarray, usual: np.ndarray) -> np.ndarray:
        """Effort per unit of each coefficient, relative to the usual effort, at the joint where that ratio is largest, (k,).

        Args:
            unit: effort of one unit of each coefficient, (n, k).
            usual: usual effort of each joint, (n, k).
        """
        return np.asarray((unit / usual).max(axis=0))

    def spread(self, typical: np.ndarray, motion: Motion, target: int) -> np.ndarray:
        """Prior standard deviations of the coefficients, (k,).

        Args:
            typical: the ones with which each coefficient makes a typical share of the effort along the motion, (k,).
        """
        return np.where(math.isinf(self.coefficient_spread), typical, self.coefficient_spread)

    @property
    def kinds(self) -> np.ndarray:
        """Prior standard deviations of equally probable kinds of it, in units of `spread`, (m, k); 0: no such coefficient."""
        return np.ones((1, len(self.coefficient_bounds)))

    def points(self, robot: Robot, link: str | None) -> list[dict[str, float]]:
        """Points of its link at which it may act, as parts of the shape to be tried."""
        return [{}]

    def resolved(self, motion: Motion, target: int, shape: Values) -> bool:
        """Whether the low-passed motion can show the effect with this shape at all."""
        return True

    def echo(self, motion: Motion, target: int, shape: Values) -> tuple[float, float, float] | None:
        """How the effort sensor's noise enters the column, which is made from the measured effort; None where it does not.

        The same noise is in the effort that the column is to explain.

        Returns:
            How much of the noise, differentiated twice, one unit of the coefficient takes from the target's effort [s²·...]; the
            coefficient for which this is evaluated, 0 where unknown; the frequency up to which the noise passes [Hz].
        """
        return None

    def relinearised(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        """The shape at which columns and echo are exact for these coefficients; `shape` itself where they always are."""
        return dict(shape)

    def inertials(self, robot: Robot, shape: Values, link: str) -> tuple[int, np.ndarray] | None:
        """The body it changes, and what a unit of each coefficient adds to its inertial parameters, (PER_LINK, k).

        None where it changes no body.
        """
        return None

    def general(self, robot: Robot, link: str) -> tuple[int, np.ndarray] | None:
        """As `inertials`, of a more general body, to find the first shape with; None where the first of `shapes` is good enough.

        Its leading coefficients are those of the effect, so `relinearised` takes them too.
        """
        return None

    def at(self, robot: Robot, target: int, link: str | None) -> Effect:
        """The effect with the units of its place: those of a prismatic joint where it acts on one."""
        if link is not None or target < 0 or not robot.slides[target]:
            return self
        sliding = copy(self)
        sliding.slides = True
        return sliding

    def had(self, robot: Robot, target: int) -> float:
        """How much of its first coefficient a robot's description has."""
        return 0.0

    def holds(self, robot: Robot, target: int, held: Held) -> np.ndarray:
        """How much of each coefficient (k,) an earlier model has at a place, in its robot and beside it."""
        beside = [self.coefficients(values)[0] for values in held.get(self.name, ())]
        first = np.arange(len(self.coefficient_bounds)) == 0
        return np.asarray(sum(beside, self.had(robot, target) * first))

    def since(self, robot: Robot, target: int, link: str | None, held: Held = NONE_HELD) -> Effect:
        """The effect as a change from an earlier model, which may have too much of it."""
        changed = self.with_less(*self.holds(robot, target, held).tolist())
        if changed.may_be_gone and self.name in held:
            shape = self.coefficients(held[self.name][0])[1]
            changed.kept = {name: shape[name] for name in shape if name not in self.linearised_at} or None
        return changed

    def against(self, robot: Robot, target: int) -> Effect:
        """The effect as a change from what the robot is described with: there may be less, or none."""
        return self.with_less(*self.holds(robot, target, NONE_HELD).tolist())

    def with_less(self, *had: float) -> Effect:
        """The effect as a change from amounts `had` of its first coefficients: it may be negative, down to minus all of it."""
        if not any(had):
            return self
        changed, bounds = copy(self), list(self.coefficient_bounds)
        for k, one in enumerate(had):
            bounds[k] = (-one if one > 0.0 == bounds[k][0] else bounds[k][0], bounds[k][1])
        changed.before, changed.may_be_gone = had, tuple(bounds) != self.coefficient_bounds
        changed.coefficient_bounds = tuple(bounds)  # type: ignore[misc]
        return changed

    def change(self, values: Values) -> Change:
        """Whether there is more of it than in the model, or less.

        Judged by the parameters that cannot be negative on their own and have the first one's unit.
        """
        amounts = [p for p in self.parameters if p.name not in self.shape_bounds and p.lower >= 0.0]
        alike = [p for p in amounts if p.unit == self.parameters[0].unit]
        beyond = [values.get(p.name, p.lower) - p.lower for p in alike]
        if not any(one < 0.0 for one in beyond):
            return "more"
        return "both" if any(one > 0.0 for one in beyond) else "less"

    def sentence(self, where: str, values: Values) -> str:
        """The finding as one sentence with its numbers."""
        known = ((p, shown_as(values[p.name])) for p in self.parameters if p.name in values)
        numbers = ", ".join(f"{p.name} {one} {printed(p.unit_at(self.slides))}".rstrip() for p, one in known)
        than = f"{'of ' * self.title.startswith(('a ', 'an '))}{self.title} than the model"
        # a payload may take mass from the body that carries it: that does not make it "more" of a payload
        again = self.may_be_gone and not self.on_body
        more = f"has more {than}" if again else f"has {self.title} that the model leaves out"
        told = {"more": more, "less": f"has less {than}", "both": f"differs from the model in {self.title}"}
        return f"{where} {told[self.change(values)]} ({numbers})."
