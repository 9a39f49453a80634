"""What changed since an earlier model in one with what that has: one effect of a kind at a place, none less than nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.effects.actuation import EffortOffset, JointSpring
from bdnn_ros.effects.friction import SLIDING
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.robot import Robot

ADD_UP = frozenset(
    {
        *SLIDING,
        "load_dependent_friction",
        "quadratic_drag",
        "joint_spring",
        "joint_elasticity",
        "backlash",
        "effort_delay",
        "effort_offset",
    }
)
"""Effects of which two at one place are one, whose coefficients are the sums of theirs."""
UNIFORM = {"stribeck_friction": (1.0, 0.0), "asymmetric_friction": (1.0, 1.0), "hysteresis": (1.0,)}
"""What of the coefficients of a joint's other dry friction is the same at any speed, ahead and back."""
GONE = 1e-6
"""What is left of an effect is nothing where it is less than this share of what there was."""

Stds = Mapping[str, float]


def merged(
    robot: Robot, effects: Sequence[Installed], stds: Sequence[Stds]
) -> tuple[list[Installed], list[Stds]]:
    """Effects with their standard deviations, each found one within the earlier one that it is a change of.

    Args:
        robot: what the effects come on top of.
        effects: in the order in which they were found.
        stds: of their values, in the same order; empty where they are unknown.
    """
    kept: list[tuple[Installed, Stds]] = []
    for effect, std in zip(effects, stds, strict=True):
        for k, (before, known) in enumerate(kept):
            together = _together(before, effect)
            if together is not None:
                kept[k : k + 1] = [(one, _spread(one, (before, known), (effect, std))) for one in together]
                break
        else:
            kept.append((effect, std))
    left = _from_other_laws(robot, [effect for effect, _ in kept])
    pairs = [(one, std) for one, (_, std) in zip(left, kept, strict=True) if one is not None]
    return [effect for effect, _ in pairs], [std for _, std in pairs]


def _together(before: Installed, after: Installed) -> list[Installed] | None:
    """Two effects as one, or as none where nothing is left; None where they are not of a kind and shape."""
    effect = before.effect
    places = [(one.effect.name, one.effect.variant, one.target, one.link) for one in (before, after)]
    if effect.name not in ADD_UP or places[0] != places[1]:
        return None
    (had, shape), (more, other) = (effect.coefficients(one.values) for one in (before, after))
    if any(shape[name] != other[name] for name in effect.shape_bounds):
        return None
    total = np.where(np.abs(had + more) <= GONE * np.abs(had), 0.0, had + more)
    if not total.any():
        return []
    if effect.name == JointSpring.name and total[0] == 0.0:  # what rested elsewhere leaves a constant
        return [replace(before, effect=get(EffortOffset.name), values={"offset": -float(total[1])})]
    return [replace(before, values=effect.values(total, effect.relinearised(total, shape)))]


def _spread(whole: Installed, *parts: tuple[Installed, Stds]) -> Stds:
    """Standard deviations of the values that are the sums of those of the parts, as far as these are known."""
    return {
        name: math.hypot(*(std.get(name, 0.0) for _, std in parts))
        for name, value in whole.values.items()
        if any(name in std for _, std in parts)
        and math.isclose(value, sum(one.values[name] for one, _ in parts), rel_tol=1e-6, abs_tol=1e-9)
    }


def _from_other_laws(robot: Robot, effects: Sequence[Installed]) -> list[Installed | None]:
    """Effects where Coulomb friction of less than nothing takes the rest from its joint's other laws; None for what is gone."""
    result: list[Installed | None] = list(effects)
    for k, coulomb in enumerate(effects):
        if coulomb.effect.name != "coulomb_friction":
            continue
        value = coulomb.values["coulomb"]
        for other, law in enumerate(effects):
            lacking = -float(robot.coulomb[coulomb.target]) - value
            if law.effect.name in UNIFORM and law.target == coulomb.target and lacking > 0.0:
                taken = min(lacking, *(law.values[way] for way in SLIDING[law.effect.name]))
                had, shape = law.effect.coefficients(law.values)
                less = law.effect.values(had - taken * np.array(UNIFORM[law.effect.name]), shape)
                result[other], value = replace(law, values=less), value + taken
        if value != coulomb.values["coulomb"]:
            result[k] = replace(coulomb, values={"coulomb": value}) if value else None
    return result
