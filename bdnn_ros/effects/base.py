"""What every effect says of itself, and how it enters the measured effort."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import along, printed, shown_as

Where = Literal["joint", "link", "base", "all"]
Change = Literal["more", "less", "both"]
Values = Mapping[str, float]
"""Parameter values by name, in the units of the contract."""
Held = Mapping[str, Sequence[Values]]
"""What an earlier model has at a place beside its robot: the values of each effect there, by the effect's name."""
NONE_HELD: Held = MappingProxyType({})
SHOWN = 2.0
"""So many standard deviations from nothing is what a recording shows."""
UNSEEN = 5.0
"""A standard deviation of so many times what is met in practice says nothing."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name, unit: as in the contract; the unit is that of a joint that turns.
        lower, upper: what is physically possible.
        plausible: magnitudes met in practice, (low, high); the simulation draws from it.
        of_effort: the plausible range is a share of the joint's typical effort instead of absolute.
        believed: what is known of it beforehand: a standard deviation as large says nothing, unless of twice as much.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    plausible: tuple[float, float] = (0.0, 1.0)
    of_effort: bool = False
    believed: float = np.inf
    phase: bool = False
    """An angle on any joint."""
    default: float | str | None = None
    """Taken where a specification leaves the parameter out, the name of another takes its value; None where it must be given."""

    def unit_at(self, slides: bool) -> str:
        """Its unit on a joint that turns, or `slides`."""
        return self.unit if self.phase else along(self.unit, slides)

    def seen(self, value: float, std: float) -> bool:
        """Whether a recording says anything of it: that a force is below a hundred kilonewtons is nothing."""
        usual = 0.0 if self.of_effort else max(map(abs, self.plausible))
        limit = max(UNSEEN * usual, abs(value)) if usual else np.inf
        return bool(std < min(max(self.believed, abs(value) / 2.0), limit))


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
    slides: bool = False
    """Whether it acts along a joint's axis, and has units of that; see `at`."""
    equation: ClassVar[str]
    """Contribution to the resisting effort, with the contract's names."""
    confused_with: ClassVar[tuple[str, ...]]
    shown_by: ClassVar[str]
    """The motion that brings it out."""
    source: ClassVar[str]
    coefficient_bounds: ClassVar[tuple[tuple[float, float], ...]]
    """Lower and upper bound of each linear coefficient."""
    coefficient_spread: ClassVar[float] = math.inf
    """Coefficients are rarely larger, whatever the effort; most scale with it."""
    idealised: ClassVar[float] = 0.01
    idealised_shapes: ClassVar[frozenset[str]] = frozenset()
    """No law is exact: so much of each coefficient, and of these shapes, is added to its deviation, whatever the noise."""
    contains: ClassVar[tuple[str, ...]] = ()
    """Effects at the same place whose columns are a special case of this one's: this one replaces them."""
    without: ClassVar[tuple[str, ...]] = ()
    """Effects that are not looked for beside it at the same place: they would mend what its law leaves."""
    settles_into: ClassVar[str | None] = None
    """What becomes of it where the motion lacks the moments that tell it: a gap that is never crossed is an offset."""
    excess: ClassVar[np.ndarray | None] = None
    """What of its coefficients it says beyond what it settles into: weights (k,) whose sum is nothing where it says no more."""
    of_load: ClassVar[bool] = False
    """Its columns are made from the load, so a better estimate of the load changes them."""
    of_bodies: ClassVar[bool] = False
    """Its columns are made from the robot's bodies, so a better estimate of them changes them."""
    on_body: ClassVar[bool] = False
    """It is a body or changes one: all joints before it carry it."""
    at_sensor: ClassVar[bool] = False
    """It changes what is measured of the effort, not the effort that acts: no joint carries it."""
    in_drive: ClassVar[bool] = False
    """It takes its effort before the gear, so that the gear does not carry it."""
    brief: ClassVar[bool] = False
    """It acts for moments: its share of a whole recording says little of it."""
    changing: ClassVar[bool] = False
    """What it does changes with time, not with the motion alone."""
    constant: ClassVar[bool] = False
    """It hardly changes: how far a joint's effort goes up and down says nothing of its size, how large that effort is does."""
    winding: ClassVar[bool] = False
    """What it does goes up and down with the position, as what changes with time may where a joint is seldom at a place."""
    timed: ClassVar[bool] = False
    """It acts between two times that only the data tell: its `start` and `end`."""
    parts: ClassVar[tuple[str, ...]] = ()
    """Parameters of which a motion may show some without the others; a sentence is given NaN for what is not shown."""
    once: ClassVar[bool] = False
    """It says how something is, not what is added: two of it at one place contradict each other."""
    kinematic: ClassVar[bool] = False
    """It shows in the reported velocity, not in the effort."""
    may_be_gone: bool = False
    """Whether there may be nothing at all of what the robot is described with: a tag in a URDF is often a guess."""
    before: tuple[float, ...] = ()
    """How much of each coefficient there is already, in a description or an earlier model; empty for nothing."""
    kept: Values | None = None
    """The only shape there is, where the effect is a change of what an earlier model has in that shape."""
    shape_bounds: ClassVar[Mapping[str, tuple[float, float]]] = MappingProxyType({})
    """Range of each shape parameter that a search may refine; a shape parameter not named here is given."""

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

    @abstractmethod
    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        """Parameters of the contract from linear coefficients (k,) and shape."""

    @abstractmethod
    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        """Linear coefficients (k,) and shape from the contract's parameters: the inverse of `values`."""

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
