"""What changed since an earlier model in one with what that has: one effect of a kind at a place, none less than nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.effects.actuation import EffortOffset, EffortScale, JointSpring
from bdnn_ros.effects.friction import SLIDING
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.extension.earlier import Known
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


def merged(robot: Robot, known: Iterable[Known]) -> list[Known]:
    """Effects, each found one within the earlier one that it is a change of.

    Args:
        robot: what the effects come on top of.
        known: in the order in which they were found, with standard deviations as far as these are known.
    """
    kept: list[Known] = []
    for one in known:
        for k, before in enumerate(kept):
            together = _together(before, one)
            if together is not None:
                kept[k : k + 1] = together
                break
        else:
            kept.append(one)
    left = _from_other_laws(robot, [effect for effect, _ in kept])
    return [(one, std) for one, (_, std) in zip(left, kept, strict=True) if one is not None]


def _together(before: Known, after: Known) -> list[Known] | None:
    """Two effects as one, or as none where nothing is left; None where they are not of a kind and shape."""
    (first, _), (second, _) = before, after
    effect = first.effect
    if _place(first) != _place(second):
        return None
    if effect.name == EffortScale.name:
        return [_both_scales(before, after)]
    if effect.kinematic:  # what was found is all that there is by now
        return [after]
    if effect.name not in ADD_UP:
        return None
    (had, shape), (more, other) = (effect.coefficients(one.values) for one in (first, second))
    if any(shape[name] != other[name] for name in effect.shape_bounds):
        return None
    total = np.where(np.abs(had + more) <= GONE * np.abs(had), 0.0, had + more)
    if not total.any():
        return []
    both = replace(first, values=effect.values(total, effect.relinearised(total, shape)))
    if effect.name == JointSpring.name and total[0] <= 0.0:  # what rested elsewhere leaves a constant
        both = replace(first, effect=get(EffortOffset.name), values={"offset": -float(total[1])})
    return [(both, _spread(both, before, after))]


def _place(one: Installed) -> tuple[str, str, int, str | None]:
    return one.effect.name, one.effect.variant, one.target, one.link


def _both_scales(first: Known, second: Known) -> Known:
    """One scale that does what two do."""
    (effect, stds), (other, others) = first, second
    scale, further = effect.values["scale"], other.values["scale"]
    spread = float(np.hypot(stds.get("scale", 0.0) * further, others.get("scale", 0.0) * scale))
    return replace(other, values={"scale": scale * further}), {"scale": spread}


def _spread(whole: Installed, *parts: Known) -> Mapping[str, float]:
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
