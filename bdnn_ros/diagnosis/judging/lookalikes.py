"""Ties that no motion settles, and what to inspect instead; shared by the advice and the planning of the next motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol, TypeVar

import numpy as np

from bdnn_ros.diagnosis.search.candidates import ANGLES, Candidates
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.friction import DryFriction
from bdnn_ros.robot import Robot
from bdnn_ros.robot.axes import distances_from_axes, spins, turns_all

ON_AXIS = 0.01
"""A weight nearer than this to a joint's axis is hardly moved by that joint [m]."""


class Placed(Protocol):
    """An effect at a joint or a link."""

    @property
    def effect(self) -> Effect:
        """What acts."""

    @property
    def target(self) -> int:
        """Index of the joint, or of the one that moves the link; -1 for the base or all joints."""

    @property
    def link(self) -> str | None:
        """The link, where it sits on one."""


One = TypeVar("One", bound=Placed)


def looked_for(
    cause: One,
    values: Mapping[str, float],
    rivals: Sequence[One],
    causes: Sequence[Placed],
    robot: Robot,
    places: Callable[[One], str],
) -> tuple[list[str], list[One]]:
    """What to inspect where no motion tells a cause from some rivals, a sentence each; and the rivals that a motion may tell.

    Args:
        values: parameters of a payload; not used for other causes.
        causes: all that was found.
        places: the name of a joint or link.
    """
    place, sentences = places(cause), []
    touched = [rival for rival in rivals if cause.effect.timed and rival.effect.timed]
    hung = [rival for rival in rivals if _hangs_alike(cause, values, rival, robot)]
    turned = [rival for rival in rivals if _turned_alike(cause, rival, robot)]
    uneven = [rival for rival in rivals if _uneven_alike(cause, rival, causes, robot)]
    if touched:
        others = in_words(map(places, touched))
        sentences.append(
            f"Whether {place} or {others} was pushed, no motion shows: look where it was touched."
        )
    if hung:
        others = in_words(map(places, hung))
        sentences.append(
            f"Whether {place} or {others} carries the payload, no motion shows, for its centre lies on the axes "
            "of the joints between them: look where it hangs."
        )
    if turned:
        joint = next(places(each) for each in (cause, *turned) if each.target >= 0)
        sentences.append(
            f"Whether the base is tilted or the zero of {joint} is off, no motion of this robot shows, for {joint} turns "
            "all of it: look with a level."
        )
    if uneven:
        sentences.append(
            f"Whether dry friction at {place} is uneven or its effort has an offset, no motion shows, for both do the "
            "same: look at the effort that is measured while the drive is off."
        )
    return sentences, [rival for rival in rivals if rival not in (*touched, *hung, *turned, *uneven)]


def in_words(names: Iterable[str]) -> str:
    """Names as alternatives, without repetition."""
    return " or ".join(dict.fromkeys(names))


def _turned_alike(cause: Placed, rival: Placed, robot: Robot) -> bool:
    """Whether one is a tilt of the base and the other the zero of a joint that turns the whole robot."""
    joint = max(cause.target, rival.target)
    return {cause.effect.name, rival.effect.name} == ANGLES and turns_all(robot, joint)


def _uneven_alike(cause: Placed, rival: Placed, causes: Sequence[Placed], robot: Robot) -> bool:
    """Whether one is an offset beside dry friction and the other, at that joint, friction that differs by direction."""
    joint = cause.target
    dry = robot.coulomb[joint] > 0.0 or any(
        isinstance(one.effect, DryFriction) and one.target == joint for one in causes
    )
    same = {cause.effect.name, rival.effect.name} == {"effort_offset", "asymmetric_friction"}
    return same and dry and rival.target == joint


def _hangs_alike(cause: Placed, values: Mapping[str, float], rival: Placed, robot: Robot) -> bool:
    """Whether a payload would do the same on a rival's link: the joints between the two turn about its centre."""
    if not cause.effect.name == rival.effect.name == "payload":
        return False
    assert cause.link is not None
    centre = np.array([values[name] for name in ("com_x", "com_y", "com_z")])
    between = robot.carries[:, cause.target] != robot.carries[:, rival.target]
    return bool((distances_from_axes(robot, cause.link, centre)[between] < ON_AXIS).all())


def hang(term: Placed, rival: Placed) -> bool:
    """Whether both are payloads, on different links."""
    return term.effect.name == rival.effect.name == "payload"


def turn_alike(candidates: Candidates, term: Placed, rival: Placed) -> bool:
    """Whether they are a rotor and the inertia of its link that only spins, which an earlier model had to split blindly."""
    one_inertia = {term.effect.name, rival.effect.name} == {"link_inertia", "armature"}
    turn = one_inertia and term.target == rival.target and candidates.earlier_effects is not None
    return turn and spins(candidates.robot, term.target)
