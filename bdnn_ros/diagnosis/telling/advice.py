"""Advice on how to settle ties: a motion, an inspection of the robot, or a known load."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence

from bdnn_ros.diagnosis.judging.identifiability import TIE, Judgement, same_physics
from bdnn_ros.diagnosis.judging.lookalikes import in_words, looked_for
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.telling.as_good import as_good
from bdnn_ros.effects.rigid import Armature
from bdnn_ros.robot import Robot
from bdnn_ros.robot.axes import spins


def advice(
    found: Sequence[Estimate],
    judgements: Sequence[Judgement],
    robot: Robot,
    places: Callable[[Term], str],
    unnamed: Container[int] = (),
    at_most: Callable[[int, Term], float | None] = lambda one, rival: None,
) -> list[str]:
    """A sentence or two for each tie: what would settle it, or that it need not be settled.

    Args:
        places: the name of a term's joint or link.
        unnamed: indices of the found that are no findings, for which `bdnn excite` plans no motion.
        at_most: upper bound of a rival's excess over one of the found, as a share of the effort; None if not shown.
    """
    sentences, causes = [], [one.term for one in found]
    for k, (one, judgement) in enumerate(zip(found, judgements, strict=True)):
        term = one.term
        close = [rival for rival, p in judgement.rivals if p >= TIE and not same_physics(term, rival)]
        values = one.values if term.effect.name == "payload" else {}
        looks, close = looked_for(term, values, close, causes, robot, places)
        sentences += looks
        no_more = {rival: share for rival in close if (share := at_most(k, rival)) is not None}
        sentences += [
            as_good(term, rival, places(term), share).sentence(False) for rival, share in no_more.items()
        ]
        close = [rival for rival in close if rival not in no_more]
        passed = [rival for rival in close if rival.effect.timed is not term.effect.timed]
        lasting = [rival for rival in close if rival not in passed]
        sentences += [
            _to_tell(term, some, robot, places, k not in unnamed) for some in (passed, lasting) if some
        ]
    return list(dict.fromkeys(sentences))


def _to_tell(
    term: Term, close: Sequence[Term], robot: Robot, places: Callable[[Term], str], named: bool
) -> str:
    """What tells a term from its rivals: usually a motion, which `bdnn excite` makes if the term is named.

    A rival that settles into the term is shown by the motion that the rival needs.
    """
    place = places(term)
    names = in_words(_with_place(r, places) if places(r) != place else r.title for r in close)
    told = f"{_with_place(term, places)} from {names}"
    push = next((one for one in (term, *close) if one.effect.timed), None)
    if push is not None:  # a push is over: other motions only show lasting causes
        return f"To tell {told}, record {push.effect.shown_by}."
    inertias = all(one.effect.on_body or one.effect.name == Armature.name for one in (term, *close))
    if inertias and spins(robot, term.target):
        return f"No motion of this robot tells {told}: {place} only turns about an upright axis, as a rotor does."
    if inertias and term.effect.on_body and robot.slides[robot.carries[:, term.target]].all():
        return f"No motion of this robot tells {told}: {place} never turns. Move it with a known load on it."
    made = "; `bdnn excite --for diagnosis.json` makes such a motion" if named else ""
    beyond = [r.effect for r in close if (r.effect.settles_into, r.target) == (term.effect.name, term.target)]
    return f"To tell {told}, record {(*beyond, term.effect)[0].shown_by}{made}."


def _with_place(term: Term, places: Callable[[Term], str]) -> str:
    """A term's name and place, without a place for the base or all joints."""
    return term.title if term.target < 0 else f"{term.title} at {places(term)}"
