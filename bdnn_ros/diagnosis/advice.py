"""What would settle the ties: a motion, a look at the robot, or a known load."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from bdnn_ros.diagnosis.candidates import ANGLES
from bdnn_ros.diagnosis.identifiability import TIE, Judgement, same_physics
from bdnn_ros.diagnosis.posterior import Estimate
from bdnn_ros.diagnosis.term import Term
from bdnn_ros.effects.friction import DryFriction
from bdnn_ros.robot import Robot
from bdnn_ros.robot.axes import distances_from_axes, turns_all

ON_AXIS = 0.01
"""A weight nearer than this to a joint's axis is hardly moved by that joint [m]."""


def advice(
    found: Sequence[Estimate], judgements: Sequence[Judgement], robot: Robot, places: Callable[[Term], str]
) -> list[str]:
    """A sentence or two for each tie: what would settle it.

    Args:
        places: the name of a term's joint or link.
    """
    sentences = []
    for one, judgement in zip(found, judgements, strict=True):
        term, place = one.term, places(one.term)
        close = [rival for rival, p in judgement.rivals if p >= TIE and not same_physics(term, rival)]
        touched = [rival for rival in close if term.effect.timed and rival.effect.timed]
        hung = [rival for rival in close if _hangs_alike(one, rival, robot)]
        if touched:
            others = _in_words(places(rival) for rival in touched)
            sentences.append(
                f"Whether {place} or {others} was pushed, no motion shows: look where it was touched."
            )
        if hung:
            others = _in_words(places(rival) for rival in hung)
            sentences.append(
                f"Whether {place} or {others} carries the payload, no motion shows, for its centre lies on the axes "
                "of the joints between them: look where it hangs."
            )
        turned = [rival for rival in close if _turned_alike(term, rival, robot)]
        if turned:
            joint = next(places(each) for each in (term, *turned) if each.target >= 0)
            sentences.append(
                f"Whether the base is tilted or the zero of {joint} is off, no motion of this robot shows, for {joint} turns "
                "all of it: look with a level."
            )
        uneven = [rival for rival in close if _uneven_alike(term, rival, found, robot)]
        if uneven:
            sentences.append(
                f"Whether dry friction at {place} is uneven or its effort has an offset, no motion shows, for both do the "
                "same: look at the effort that is measured while the drive is off."
            )
        close = [rival for rival in close if rival not in (*touched, *hung, *turned, *uneven)]
        if close:
            sentences.append(_to_tell(term, close, robot, places))
    return sentences


def _to_tell(term: Term, close: Sequence[Term], robot: Robot, places: Callable[[Term], str]) -> str:
    """What tells a term from its rivals: as a rule a motion."""
    place = places(term)
    names = _in_words(_with_place(r, places) if places(r) != place else r.title for r in close)
    told = f"{_with_place(term, places)} from {names}"
    if term.effect.on_body and robot.slides[robot.carries[:, term.target]].all():
        return f"No motion of this robot tells {told}: {place} never turns. Move it with a known load on it."
    return (
        f"To tell {told}, record {term.effect.shown_by}; "
        f"`bdnn excite --for diagnosis.json` makes such a motion."
    )


def _with_place(term: Term, places: Callable[[Term], str]) -> str:
    """A term's name and place; what is of the base, or of all joints, needs none."""
    return term.title if term.target < 0 else f"{term.title} at {places(term)}"


def _turned_alike(term: Term, rival: Term, robot: Robot) -> bool:
    """Whether one is a tilt of the base and the other the zero of a joint that turns the whole robot."""
    joint = max(term.target, rival.target)
    return {term.effect.name, rival.effect.name} == ANGLES and turns_all(robot, joint)


def _uneven_alike(term: Term, rival: Term, found: Sequence[Estimate], robot: Robot) -> bool:
    """Whether one is an offset beside dry friction and the other, at that joint, friction of another size either way."""
    joint = term.target
    dry = robot.coulomb[joint] > 0.0 or any(
        isinstance(one.term.effect, DryFriction) and one.term.target == joint for one in found
    )
    same = {term.effect.name, rival.effect.name} == {"effort_offset", "asymmetric_friction"}
    return same and dry and rival.target == joint


def _hangs_alike(found: Estimate, rival: Term, robot: Robot) -> bool:
    """Whether a payload would do the same on a rival's link: the joints between the two turn about its centre."""
    term = found.term
    if not term.effect.name == rival.effect.name == "payload":
        return False
    assert term.link is not None
    centre = np.array([found.values[name] for name in ("com_x", "com_y", "com_z")])
    between = robot.carries[:, term.target] != robot.carries[:, rival.target]
    return bool((distances_from_axes(robot, term.link, centre)[between] < ON_AXIS).all())


def _in_words(names: Iterable[str]) -> str:
    return " or ".join(dict.fromkeys(names))
