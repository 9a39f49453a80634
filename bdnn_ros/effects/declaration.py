"""What every effect declares of itself: the one table to read before writing a new effect."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from bdnn_ros.robot.units import along

Where = Literal["joint", "link", "base", "all"]
Values = Mapping[str, float]
"""Parameter values by name, in the units of the contract."""
UNSEEN = 5.0
"""An estimate whose standard deviation is this many times the largest plausible value says nothing."""


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes:
        name, unit: as in the contract; the unit is that of a revolute joint.
        lower, upper: what is physically possible.
        plausible: magnitudes met in practice, (low, high); the simulation draws from it.
        of_effort: `plausible` is a share of the joint's typical effort, not an absolute value.
        believed: prior standard deviation; an estimate that is no more certain than this says nothing,
            unless its value is more than twice its standard deviation.
        phase: an angle on any joint, prismatic ones included.
        default: taken where a specification leaves the parameter out: a number, or the name of the parameter
            whose value it takes; None where it must be given.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    plausible: tuple[float, float] = (0.0, 1.0)
    of_effort: bool = False
    believed: float = np.inf
    phase: bool = False
    default: float | str | None = None

    def unit_at(self, slides: bool) -> str:
        """Its unit on a revolute joint, or on a prismatic one (`slides`)."""
        return self.unit if self.phase else along(self.unit, slides)

    def seen(self, value: float, std: float) -> bool:
        """Whether an estimate says anything: to know only that a force is below 100 kN is to know nothing."""
        usual = 0.0 if self.of_effort else max(map(abs, self.plausible))
        limit = max(UNSEEN * usual, abs(value)) if usual else np.inf
        return bool(std < min(max(self.believed, abs(value) / 2.0), limit))


class Declaration:
    """Attributes of an effect; what has no default must be given, flags are False unless they apply.

    The last section is not declared: it is set on a copy of the effect, for one place on one robot.
    """

    # -- what it is ------------------------------------------------------------------------------------------
    name: ClassVar[str]
    variant: ClassVar[str] = ""
    """Distinguishes classes of the same name: which parameter drifts, whether a wrench acts on a joint or a link."""
    title: ClassVar[str]
    """Its name in a sentence: "Coulomb friction"."""
    on: ClassVar[Where]
    also_on: ClassVar[tuple[Where, ...]] = ()
    """Where else it may act: a delay usually affects all joints alike, but may affect one only."""
    equation: ClassVar[str]
    """What it adds to the measured effort, with the names of the contract."""
    confused_with: ClassVar[tuple[str, ...]]
    """Names of effects that a recording hardly distinguishes from it."""
    shown_by: ClassVar[str]
    """The motion that reveals it."""
    source: ClassVar[str]

    # -- its numbers -----------------------------------------------------------------------------------------
    parameters: ClassVar[tuple[Parameter, ...]]
    linear: ClassVar[tuple[str, ...]] = ()
    """Parameters that are themselves the linear coefficients, in order, all others being the shape. Where coefficients are
    something else (an inverse, a sine and a cosine), leave it empty and write `values` and `coefficients`."""
    coefficient_bounds: ClassVar[tuple[tuple[float, float], ...]]
    """Lower and upper bound of each linear coefficient."""
    coefficient_spread: ClassVar[float] = math.inf
    """Prior standard deviation of a coefficient whose size does not scale with the effort (a ratio, a delay); infinite where
    it does."""
    shape_bounds: ClassVar[Mapping[str, tuple[float, float]]] = MappingProxyType({})
    """Range within which a search may refine each shape parameter; one that is not named here is not refined."""
    linearised_at: ClassVar[tuple[str, ...]] = ()
    """Shape parameters that are no property of the robot but where the columns are linearised; see `Effect.relinearised`."""
    idealised: ClassVar[float] = 0.01
    idealised_shapes: ClassVar[frozenset[str]] = frozenset()
    """No law is exact: this share of each coefficient, and of these shape parameters, is added (in squares) to its standard
    deviation, however small the noise."""
    parts: ClassVar[tuple[str, ...]] = ()
    """Parameters that a motion may determine one by one (roll without pitch); a sentence gets NaN for the others."""

    # -- beside which other effects --------------------------------------------------------------------------
    contains: ClassVar[tuple[str, ...]] = ()
    """Effects that are a special case of it: at the same place it replaces them (Stribeck friction replaces Coulomb friction)."""
    without: ClassVar[tuple[str, ...]] = ()
    """Effects that are not added beside it at the same place: they would fit what its law leaves (backlash, joint elasticity)."""
    settles_into: ClassVar[str | None] = None
    """The effect it cannot be distinguished from where the motion never excites the difference: backlash that is never crossed
    is a position offset."""
    excess: ClassVar[np.ndarray | None] = None
    """Weights (k,) of the coefficients whose sum measures how far it differs from what it settles into; 0 if it does not."""

    # -- flags: where its effort acts; none is set for the others, which act on the link behind the gear --
    in_drive: ClassVar[bool] = False
    """Before the gear, which does not carry its effort: friction, rotor inertia, cogging."""
    at_sensor: ClassVar[bool] = False
    """In the effort's measurement, not in the effort that acts, so no joint carries it: effort offset, scale and delay."""
    on_body: ClassVar[bool] = False
    """It is a body or changes one, which all joints before it carry: payload, link inertia."""
    kinematic: ClassVar[bool] = False
    """In the reported velocity only, not in the effort: velocity filter."""

    # -- flags: what its columns are computed from, to know when they are out of date --
    of_load: ClassVar[bool] = False
    """From the load: load-dependent friction, effort scale and delay, joint elasticity."""
    of_bodies: ClassVar[bool] = False
    """From the robot's inertial parameters: backlash, joint elasticity, position offset, base tilt."""

    # -- flags: how its effort varies --
    brief: ClassVar[bool] = False
    """For moments only, so its share of the whole recording says little about it: backlash, contacts."""
    changing: ClassVar[bool] = False
    """With time, not with the motion alone: drifts, contacts."""
    timed: ClassVar[bool] = False
    """Between two moments, `start` and `end`, that are estimated from the data: contacts."""
    constant: ClassVar[bool] = False
    """Hardly at all, so its size is judged by the effort's magnitude, not by its variation: effort offset, drifting or not."""
    winding: ClassVar[bool] = False
    """Periodically with position. A few single moves cannot distinguish that from a change with time: cogging."""

    # -- flags: how often it may be given --
    once: ClassVar[bool] = False
    """Once a place: it states a property, and two statements contradict each other (link inertia, base tilt, velocity filter);
    other effects add up."""

    # -- not declared: set on a copy for one place on one robot ----------------------------------------------
    slides: bool = False
    """Whether it acts along a prismatic joint's axis, and has the units of that; see `Effect.at`."""
    may_be_gone: bool = False
    """Whether the robot may really have less than it is described with, down to nothing: a tag in a URDF is often a guess."""
    before: tuple[float, ...] = ()
    """How much of each coefficient the description or an earlier model has already; empty for none."""
    kept: Values | None = None
    """The only shape to try, where the effect is a change of what an earlier model has with that shape."""
