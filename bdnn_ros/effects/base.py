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
"""What an earlier model has at a place beside its robot: the values of each effect there, by the effect's name."""
NONE_HELD: Held = MappingProxyType({})
SHOWN = 2.0
"""So many standard deviations from nothing is what a recording shows."""


class Effect(Declaration, ABC):
    """One physical cause a simulation may leave out.

    The measured effort is modelled as `rigid effort of the URDF + sum of columns · coefficients`.
    Coefficients enter linearly; the parameters that do not (a Stribeck velocity, a breakaway distance) are
    the `shape`, tried on a grid and then refined. `target` is the index of the joint (or of the joint that
    moves the link), -1 where the effect acts on the base or on all joints.
    """

    def with_defaults(self, given: Values) -> dict[str, float]:
        """Values with the defaults of those that were left out; what has none may be missing."""
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
        ends = self.shape_bounds
        return all(ends[k][0] <= value <= ends[k][1] for k, value in shape.items() if k in ends)

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        """Shapes to try first; one empty shape where every parameter is linear."""
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
        """Whether fitted coefficients (k,), each inside its bounds, can be such an effect together.

        What is pressed against the end of what is possible is something else; an effect of nothing is at an end, too.

        Args:
            std: of the coefficients, where they need not be taken at their word, (k,).
        """
        pairs = zip(np.asarray(coefficients).tolist(), self.coefficient_bounds, strict=True)
        ends = [(value, end) for value, both in pairs for end in both[self.may_be_gone :]]
        return not [end for value, end in ends if end and math.isclose(value, end, rel_tol=1e-3)]

    def shown(self, values: Values, stds: Values, most: float = math.inf) -> bool:
        """Whether values with these standard deviations may be named, where a joint's effort was never more than `most` [N·m]."""
        return True

    def strength(self, unit: np.ndarray, usual: np.ndarray) -> np.ndarray:
        """What units of the coefficients do (n, k) of the usual efforts (n, k), at the joint where that is most, (k,)."""
        return np.asarray((unit / usual).max(axis=0))

    def spread(self, typical: np.ndarray, motion: Motion, target: int) -> np.ndarray:
        """Prior standard deviations of the coefficients (k,): what the effect's nature tells of them.

        Args:
            typical: such that each makes a typical share of the effort along the motion, (k,).
        """
        return np.where(math.isinf(self.coefficient_spread), typical, self.coefficient_spread)

    @property
    def kinds(self) -> np.ndarray:
        """Kinds of it that are as likely: each has spreads of its coefficients in units of `spread`, (m, k); 0 is nothing."""
        return np.ones((1, len(self.coefficient_bounds)))

    def points(self, robot: Robot, link: str | None) -> list[dict[str, float]]:
        """Parts of the shape that say where on its link it acts, each worth a try."""
        return [{}]

    def resolved(self, motion: Motion, target: int, shape: Values) -> bool:
        """Whether a motion behind its low-pass shows the effect with this shape at all."""
        return True

    def echo(self, motion: Motion, target: int, shape: Values) -> tuple[float, float, float] | None:
        """How much of the effort sensor's noise, differentiated twice, a unit of the coefficient takes from the target's effort
        [s²·...], the coefficient that the column is exact at, 0 where that is not known, and up to where the noise is heard [Hz].

        The same noise is in what the column is to explain. None where the column is free of it.
        """
        return None

    def relinearised(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        """The shape at which the columns are exact for these coefficients; the same where they always are."""
        return dict(shape)

    def inertials(self, robot: Robot, shape: Values, link: str) -> tuple[int, np.ndarray] | None:
        """A body, and what one unit of each coefficient adds to its inertial parameters, (PER_LINK, k).

        None for what does not change one.
        """
        return None

    def general(self, robot: Robot, link: str) -> tuple[int, np.ndarray] | None:
        """As `inertials`, of a body that is more general than this effect; None where its first shape is good enough.

        Its first coefficients are those of the effect: a shape follows from them as from its own.
        """
        return None

    def at(self, robot: Robot, target: int, link: str | None) -> Effect:
        """The effect as it is told of a place: with other units where it acts on a joint that slides."""
        if link is not None or target < 0 or not robot.slides[target]:
            return self
        sliding = copy(self)
        sliding.slides = True
        return sliding

    def had(self, robot: Robot, target: int) -> float:
        """How much of its first coefficient a robot has."""
        return 0.0

    def holds(self, robot: Robot, target: int, held: Held) -> np.ndarray:
        """How much of each coefficient (k,) an earlier model has at a place, in its robot and beside it."""
        beside = [self.coefficients(values)[0] for values in held.get(self.name, ())]
        first = np.arange(len(self.coefficient_bounds)) == 0
        return np.asarray(sum(beside, self.had(robot, target) * first))

    def since(self, robot: Robot, target: int, link: str | None, held: Held = NONE_HELD) -> Effect:
        """The effect as a change from an earlier model, which may have had more of it."""
        changed = self.with_less(*self.holds(robot, target, held).tolist())
        if changed.may_be_gone and self.name in held and type(self).relinearised is Effect.relinearised:
            changed.kept = self.coefficients(held[self.name][0])[1] or None
        return changed

    def against(self, robot: Robot, target: int) -> Effect:
        """The effect beside a robot that is described with some of it: there may be less, or none."""
        return self.with_less(*self.holds(robot, target, NONE_HELD).tolist())

    def with_less(self, *had: float) -> Effect:
        """The effect beside what there was of its first coefficients, of which there may be less, by up to all of it."""
        if not any(had):
            return self
        changed, bounds = copy(self), list(self.coefficient_bounds)
        for k, one in enumerate(had):
            bounds[k] = (-one if one > 0.0 == bounds[k][0] else bounds[k][0], bounds[k][1])
        changed.before, changed.may_be_gone = had, tuple(bounds) != self.coefficient_bounds
        changed.coefficient_bounds = tuple(bounds)  # type: ignore[misc]
        return changed

    def change(self, values: Values) -> Change:
        """Whether there is more of it than a model has, or less: amounts of its first parameter's kind below nothing."""
        amounts = [p for p in self.parameters if p.name not in self.shape_bounds and p.lower >= 0.0]
        alike = [p for p in amounts if p.unit == self.parameters[0].unit]
        beyond = [values.get(p.name, p.lower) - p.lower for p in alike]
        if not any(one < 0.0 for one in beyond):
            return "more"
        return "both" if any(one > 0.0 for one in beyond) else "less"

    def sentence(self, where: str, values: Values) -> str:
        """The finding in words, one sentence with its numbers."""
        known = ((p, shown_as(values[p.name])) for p in self.parameters if p.name in values)
        numbers = ", ".join(f"{p.name} {one} {printed(p.unit_at(self.slides))}".rstrip() for p, one in known)
        than = f"{'of ' * self.title.startswith(('a ', 'an '))}{self.title} than the model"
        # of a payload there is already the body that carries it
        again = self.may_be_gone and not self.on_body
        more = f"has more {than}" if again else f"has {self.title} that the model leaves out"
        told = {"more": more, "less": f"has less {than}", "both": f"differs from the model in {self.title}"}
        return f"{where} {told[self.change(values)]} ({numbers})."
