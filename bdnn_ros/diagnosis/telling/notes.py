"""Notes beside a diagnosis: what the recording cannot tell, and what its causes may be mistaken for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bdnn_ros.checks.description import weightless
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.pushes.pushes import ENDS
from bdnn_ros.diagnosis.recorded.joining import own_zeros, stretches
from bdnn_ros.diagnosis.regression.building import least_motion
from bdnn_ros.diagnosis.regression.equations import HARDLY_USABLE, Equations
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.result import Finding, reference
from bdnn_ros.effects.environment import EDGES, FORCE, ExternalWrench
from bdnn_ros.effects.registry import get
from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

FAR_OFF = "The links' masses and inertias are further off than usual: more is wrong with them than is named."
MOSTLY_LINKS = (
    "Beside the named causes, errors of all links' masses and inertias make up {share:.0f} % of the {reference}'s squared "
    "error: none of them is sure by itself{more}."
)
AMONG_THEM = ", and wrong units or what has no name may be among them"
"""Added for links that are further off than usual."""
BY_LINKS = (
    "Errors of {whose}, none of which stands out, make up {share:.0f} % of the {reference}'s squared error; the extended model "
    "mends them."
)
STAYS = (
    "What would be corrected without a name, by errors of {whose}, surely predicts the motion that was held out worse: the "
    "extended model is the {reference} as it is."
)
BY_LEAD = (
    "Efforts are stamped {much:.1f} ms too {way} for the motion, as where one is held for longer or both are not read at once. "
    "That makes up {share:.0f} % of the {reference}'s squared error; the extended model mends it."
)
USUAL_LEAD = 1.25
"""Largest lead of efforts, relative to a hold's, that is not worth a note."""
SLIGHT = 0.1
"""Share of the squared error that unnamed corrections must surely remove to be worth a note."""
MOST = 0.5
"""Share of the squared error above which link corrections get a note, and unnamed terms leave a verdict open."""
ALONE = (
    "Only {joint} {does}: what it carries, wrong links, wrong angles and a wrong torque constant do the same to it, so none "
    "of them is named.{remedy}"
)
BRIEFLY = (
    "There are {seconds} s of motion at the joint that moves longest, and {least} s are needed behind a low-pass of {cutoff:.1f} "
    "Hz to tell what changes with time, a push or a drift, from what differs from place to place, as cogging: none of them is "
    "named. Record more motion."
)
UNCOMPARED = (
    "No effort of {joints} is compared: it does not move, or none was measured where it does. Zeros of `effort_rmse` are no "
    "errors there."
)
NOT_HELD_OUT = (
    "No effort of {joints} is compared: it was measured in motion too briefly for any of that to be held out, so that its gain "
    "is not known. Zeros of `effort_rmse` are no errors there."
)
ONE_CLOCK = "Times are told on one clock, on which the recordings follow one another: {begin}."
IN_MODEL = "Not sure enough for a name, but in the extended model, which it helps: {what}{share}."
OF_ERROR = " ({share:.0f} % of the {reference}'s squared error)"
UNKNOWN = (
    "Surely something is there, and the extended model has it, but this motion shows its parameters too badly for a name: "
    "{what}. Record more motion; `bdnn excite` makes one that shows them."
)
OFF_CENTRE = (
    "a centre of mass of {place} that is elsewhere than in the model, or {title} at {place}, mass {mass:.2g} ± {std:.1g} kg, "
    "which may be nothing, or a rotor's inertia at the joint that moves it"
)
NOT_IN_MODEL = (
    "Not sure enough for a name, and not in the extended model, though the gain counts it: something that pushes at "
    "{where}."
)
OF_INERTIA = "inertia of {place} beyond the model's, as a rotor that moves it has"
"""Clause on an apparent payload that only its inertia about the joint tells from usual link errors."""
AT_AN_END = (
    f"Something pushes in the first or last {ENDS:g} s only, or a filter that was run both ways made it of the recording's ends, "
    "or pre-sliding friction was bent before the recording began: it is not named. Record from rest until the robot rests."
)
THROUGHOUT = (
    "Something like a push is there nearly always when the joint moves that shows it, so that a cause that changes between its "
    "moves does the same: it is not named. Move that joint again and again from start to end."
)
AT_REST = (
    "Where it rests, the effort at {joints} is far from the {reference}'s for a while: something pushes then, or dry friction "
    "holds what it likes, and no motion shows which. Keep the robot moving."
)
LIKE_A_LOAD = (
    "Something pulls {where} straight down {when}, as a load of {mass:.2g} kg would that was {done} then: a payload is told of "
    "a recording that has it from start to end."
)
CARRIED = (
    "Something pulls {where} straight down {when}, all through some of the recordings, as a load of {mass:.2g} kg would: a "
    "payload is told of recordings that all have it. Diagnose those apart from the others."
)
WEIGHTLESS = (
    "What is named at {where} may be no more than the described inertia of {links}, fixed to it without a mass, which the "
    "simulation counts as its own."
)
DOWN = math.cos(math.radians(30.0))
"""Cosine of the largest angle to gravity of a force that may be a weight: a swung load pulls sideways, too."""


def of_recording(robot: Robot, equations: Equations) -> list[str]:
    """Notes on what a recording cannot tell: of bodies if one joint moves alone, of changes with time if all move briefly."""
    signals, longest = equations.motion.signals, float(equations.rows.moving.max())
    least, notes = least_motion(signals), []
    if equations.alone is not None:
        notes.append(_alone(robot, equations, equations.alone))
    if longest < least:
        told = {"seconds": math.floor(longest), "least": math.ceil(least)}
        notes.append(BRIEFLY.format(cutoff=signals.cutoff, **told))
    return notes


def _alone(robot: Robot, equations: Equations, joint: int) -> str:
    """The note on the only joint with usable rows, of a robot with one joint or more."""
    signals = equations.motion.signals
    moving = (~signals.at_rest).mean(axis=0) > HARDLY_USABLE
    unmeasured = [
        robot.joints[k] for k in np.flatnonzero(moving & ~equations.usable.any(axis=0)) if k != joint
    ]
    does, remedy = "moves", " Move several joints at once." if robot.width > 1 else ""
    if unmeasured:
        does = "has a measured effort while it moves"
        remedy = f" Record the efforts of {listed(unmeasured, 20)}, too."
    if np.count_nonzero(equations.usable.any(axis=0)) > 1:
        does = f"has an effort that was measured in motion for more than {100.0 * HARDLY_USABLE:.0f} % of the time"
    return ALONE.format(joint=robot.joints[joint], does=does, remedy=remedy)


def uncompared(robot: Robot, usable: np.ndarray, held: np.ndarray) -> list[str]:
    """Notes on joints without held-out rows, whose zero errors mean nothing.

    Args:
        usable: usable rows, (R, n) bool.
        held: the held-out ones among them, (R, n) bool.
    """
    none, brief = ~usable.any(axis=0), usable.any(axis=0) & ~held.any(axis=0)
    told = ((UNCOMPARED, none), (NOT_HELD_OUT, brief))
    return [
        note.format(joints=listed([robot.joints[k] for k in np.flatnonzero(joints)], 20))
        for note, joints in told
        if joints.any()
    ]


def one_clock(recordings: Sequence[Recording], findings: Sequence[Finding]) -> list[str]:
    """Note on when each of several recordings begins on the common clock, if a finding tells a time."""
    if len(recordings) < 2 or not any(set(EDGES) <= set(finding.parameters) for finding in findings):
        return []
    begin = own_zeros([recording.time for recording in recordings])
    told = [f"{one.name} begins at {start:.1f} s" for one, start in zip(recordings, begin, strict=True)]
    return [ONE_CLOCK.format(begin=listed(told, 20))]


def unnamed(terms: Sequence[tuple[Term, str]], share: float, since: bool) -> list[str]:
    """Notes on fitted terms that are no findings, each with its place: all but pushes are in the extended model.

    Args:
        share: of the squared error that unnamed terms in the model remove.
    """
    pushes = [place for term, place in terms if term.effect.timed]
    others = list(dict.fromkeys(f"{term.title} at {place}" for term, place in terms if not term.effect.timed))
    much = (
        OF_ERROR.format(share=100.0 * min(share, 1.0), reference=reference(since)) if share > SLIGHT else ""
    )
    told = [IN_MODEL.format(what=listed(others, 20), share=much)] if others else []
    return told + ([NOT_IN_MODEL.format(where=listed(dict.fromkeys(pushes), 20))] if pushes else [])


def unknown(found: Sequence[tuple[Estimate, str, bool]]) -> list[str]:
    """Note on payloads that surely exist though possibly without mass, each with its place and whether it exceeds a rotor."""

    def told(estimate: Estimate, place: str, weighs: bool) -> str:
        if not weighs:
            return OF_INERTIA.format(place=place)
        mass = estimate.quantities["mass"]
        return OFF_CENTRE.format(place=place, title=estimate.term.title, mass=mass.value, std=mass.std)

    return [UNKNOWN.format(what="; ".join(told(*one) for one in found))] if found else []


def mostly_links(share: float, far_off: bool, since: bool) -> list[str]:
    """Note on link corrections that remove most of the squared error, this share of it.

    Args:
        far_off: whether the links are further off than usual.
    """
    told = {"share": 100.0 * min(share, 1.0), "reference": reference(since), "more": AMONG_THEM * far_off}
    return [MOSTLY_LINKS.format(**told)] * (share > MOST)


def mended(least: float, by_links: float, by_lead: float, lead: float, hold: float, since: bool) -> list[str]:
    """Note on what the extended model improves where nothing is named.

    Args:
        least: share of the squared error that it surely removes.
        by_links, by_lead: shares that link corrections and a lead of the effort remove.
        lead: lead of the efforts over the motion [s].
        hold: lead of an effort that is held for a sample [s].
    """
    if least < SLIGHT or max(by_links, by_lead) < SLIGHT:
        return []
    if by_links < by_lead:
        return leading(by_lead, lead, hold, since)
    whose = "the earlier model" if since else "the links' masses and inertias"
    return [BY_LINKS.format(whose=whose, share=100.0 * min(by_links, 1.0), reference=reference(since))]


def as_it_was(since: bool) -> str:
    """The note on corrections that were dropped, so that the reference stays unchanged."""
    whose = "its links and joints" if since else "the links' masses and inertias"
    return STAYS.format(whose=whose, reference=reference(since))


def leading(share: float, lead: float, hold: float, since: bool) -> list[str]:
    """Note on a lead of the efforts [s] that makes up this share of the squared error, if longer than a usual hold [s]."""
    way, much = "early" if lead > 0.0 else "late", 1e3 * abs(lead)
    told = BY_LEAD.format(much=much, way=way, share=100.0 * min(share, 1.0), reference=reference(since))
    return [told] * (abs(lead) > USUAL_LEAD * hold)


def loads(
    robot: Robot, findings: Sequence[Finding], time: np.ndarray, begun: Sequence[float] = ()
) -> list[str]:
    """Notes on pushes that may be loads: present from a recording's start, kept to its end, or both.

    Args:
        time: of the rows, (R,) [s].
        begun: when each of several recordings begins, see `Signals`.
    """
    notes, gravity = [], float(np.linalg.norm(robot.gravity_vector))
    pieces = stretches(time, begun)
    for finding in findings:
        if finding.effect != ExternalWrench.name or finding.link is None:
            continue
        force = np.array([finding.parameters[axis].value for axis in FORCE])
        start, end = (finding.parameters[edge].value for edge in EDGES)
        weight = float(force @ robot.gravity_vector) / max(gravity, 1e-9)
        if weight > DOWN * float(np.linalg.norm(force)):
            notes += _held(finding.link, weight / gravity, start, end, pieces)
    return notes


def massless_links(robot: Robot, findings: Sequence[Finding]) -> list[str]:
    """Notes on named links or payloads whose body includes the inertia of massless links."""
    links = (one.link for one in findings if one.link and get(one.effect).on_body)
    found = ((link, weightless(robot, link)) for link in dict.fromkeys(links))
    return [WEIGHTLESS.format(where=link, links=listed(ghosts)) for link, ghosts in found if ghosts]


def _held(
    where: str, mass: float, start: float, end: float, pieces: Sequence[tuple[float, float]]
) -> list[str]:
    """The note on what pulls as a mass [kg] would between two times [s], given each recording's first and last time."""
    first = next((begin for begin, last in pieces if last >= start), pieces[-1][0])
    last = next((last for begin, last in reversed(pieces) if begin <= end), pieces[0][1])
    from_start, to_end = start < first + ENDS, end > last - ENDS
    at_first, at_last = first == pieces[0][0], last == pieces[-1][1]
    meanwhile = f"from {start:.1f} s to {end:.1f} s"
    if from_start and to_end:
        return [] if at_first and at_last else [CARRIED.format(where=where, when=meanwhile, mass=mass)]
    if not (from_start or to_end):
        return []
    if to_end:
        when, done = f"from {start:.1f} s on" if at_last else meanwhile, "taken up"
    else:
        when, done = f"until {end:.1f} s" if at_first else meanwhile, "put down"
    return [LIKE_A_LOAD.format(where=where, when=when, mass=mass, done=done)]
