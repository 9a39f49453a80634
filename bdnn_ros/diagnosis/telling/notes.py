"""Which notes hold beside findings and verdict: what the recording cannot tell, and what is there without a name."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from bdnn_ros.checks.description import weightless
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.pushes.pushes import ENDS
from bdnn_ros.diagnosis.recorded.joining import own_zeros
from bdnn_ros.diagnosis.regression.building import least_motion
from bdnn_ros.diagnosis.regression.equations import HARDLY_USABLE, Equations
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.result import Finding
from bdnn_ros.diagnosis.sentences import Kind, Note
from bdnn_ros.diagnosis.telling.alike import scaled
from bdnn_ros.diagnosis.telling.case import MOST, SLIGHT, Case
from bdnn_ros.diagnosis.telling.endless import loads
from bdnn_ros.diagnosis.telling.left import mostly_at
from bdnn_ros.diagnosis.telling.naming import beyond_links, name_of
from bdnn_ros.diagnosis.telling.outcome import Outcome
from bdnn_ros.effects.environment import EDGES
from bdnn_ros.effects.registry import get
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

USUAL_LEAD = 1.25
"""Largest lead of efforts, relative to a hold's, that is not worth a note."""


def notes(outcome: Outcome) -> Iterator[Note]:
    """All notes, in the order in which they are told."""
    case, names, findings = outcome.case, outcome.names, outcome.findings
    robot, equations = case.robot, case.equations
    yield from of_recording(robot, equations)
    yield from uncompared(robot, equations.usable, case.held)
    yield from one_clock(case.recordings, findings)
    if case.at_ends:
        yield Note(Kind.AT_AN_END, {"ends": ENDS})
    if case.always:
        yield Note(Kind.THROUGHOUT)
    if case.earlier is None:
        yield from massless_links(robot, findings)
    yield from loads(robot, findings, equations.rows.time, equations.motion.signals.begun)
    yield from outcome.doubted
    silent, unknowns = (
        [(case.found[one], name_of(robot, case.found[one].term)) for one in some]
        for some in (names.silent, names.unknown)
    )
    error = case.attempt.fitted.link_error
    yield from unnamed([(one.term, place) for one, place in silent], names.unsaid)
    yield from unknown(
        [(one, place, beyond_links(equations, error, one, but_rotor=True)) for one, place in unknowns]
    )
    if case.stays:
        yield Note(Kind.STAYS)
    elif case.far_off:
        yield Note(Kind.FAR_OFF)
    if names.findings:
        yield from mostly_links(case)
    if outcome.verdict == "cannot_tell":
        yield from mostly_at(case, outcome.surely)
    if outcome.verdict == "nothing_wrong":
        yield from mended(case, outcome.surely)
    else:
        yield from mostly_lead(case)
    if outcome.alike is not None:
        yield outcome.alike.note(Kind.ALIKE)
    elif case.earlier is None and (joints := scaled(findings)):
        yield Note(Kind.SCALED, {"joints": joints})
    # a named dry friction may hold any effort at rest
    if case.remainder.resting and not names.findings:
        yield Note(Kind.AT_REST, {"joints": case.remainder.resting})


def of_recording(robot: Robot, equations: Equations) -> Iterator[Note]:
    """Notes on what a recording cannot tell: of bodies if one joint moves alone, of changes with time if all move briefly."""
    signals, longest = equations.motion.signals, float(equations.rows.moving.max())
    least = least_motion(signals)
    if equations.alone is not None:
        yield _alone(robot, equations, equations.alone)
    if longest < least:
        told = {"seconds": math.floor(longest), "least": math.ceil(least), "cutoff": signals.cutoff}
        yield Note(Kind.BRIEFLY, told)


def _alone(robot: Robot, equations: Equations, joint: int) -> Note:
    """The note on the only joint with usable rows, of a robot with one joint or more."""
    signals, measured = equations.motion.signals, equations.usable.any(axis=0)
    moving = (~signals.at_rest).mean(axis=0) > HARDLY_USABLE
    unmeasured = [robot.joints[k] for k in np.flatnonzero(moving & ~measured) if k != joint]
    does, remedy = Kind.MOVES, Note(Kind.MOVE_SEVERAL) if robot.width > 1 else ""
    if unmeasured:
        does, remedy = Kind.MEASURED, Note(Kind.RECORD_EFFORTS, {"joints": unmeasured})
    if np.count_nonzero(measured) > 1:
        does = Kind.MEASURED_LONGEST
    told = {"joint": robot.joints[joint], "does": Note(does, {"least": HARDLY_USABLE}), "remedy": remedy}
    return Note(Kind.ALONE, told)


def uncompared(robot: Robot, usable: np.ndarray, held: np.ndarray) -> Iterator[Note]:
    """Notes on joints without held-out rows, whose zero errors mean nothing.

    Args:
        usable: usable rows, (R, n) bool.
        held: the held-out ones among them, (R, n) bool.
    """
    none, brief = ~usable.any(axis=0), usable.any(axis=0) & ~held.any(axis=0)
    for kind, joints in ((Kind.UNCOMPARED, none), (Kind.NOT_HELD_OUT, brief)):
        if joints.any():
            yield Note(kind, {"joints": [robot.joints[k] for k in np.flatnonzero(joints)]})


def one_clock(recordings: Sequence[Recording], findings: Sequence[Finding]) -> Iterator[Note]:
    """Note on when each of several recordings begins on the common clock, if a finding tells a time."""
    if len(recordings) > 1 and any(set(EDGES) <= set(finding.parameters) for finding in findings):
        zeros = zip(recordings, own_zeros([recording.time for recording in recordings]), strict=True)
        begin = [Note(Kind.BEGINS, {"name": one.name, "start": start}) for one, start in zeros]
        yield Note(Kind.ONE_CLOCK, {"begin": begin})


def massless_links(robot: Robot, findings: Sequence[Finding]) -> Iterator[Note]:
    """Notes on named links or payloads whose body includes the inertia of massless links."""
    for link in dict.fromkeys(one.link for one in findings if one.link and get(one.effect).on_body):
        if ghosts := weightless(robot, link):
            yield Note(Kind.WEIGHTLESS, {"where": link, "links": ghosts})


def unnamed(terms: Sequence[tuple[Term, str]], share: float) -> Iterator[Note]:
    """Notes on fitted terms that are no findings, each with its place: all but pushes are in the extended model.

    Args:
        share: of the squared error that unnamed terms in the model remove.
    """
    pushes = dict.fromkeys(place for term, place in terms if term.effect.timed)
    others = dict.fromkeys(f"{term.title} at {place}" for term, place in terms if not term.effect.timed)
    if others:
        much = Note(Kind.OF_ERROR, {"share": share}) if share > SLIGHT else ""
        yield Note(Kind.IN_MODEL, {"what": [*others], "much": much})
    if pushes:
        yield Note(Kind.NOT_IN_MODEL, {"where": [*pushes]})


def unknown(found: Sequence[tuple[Estimate, str, bool]]) -> Iterator[Note]:
    """Note on payloads that surely exist though possibly without mass, each with its place and whether it exceeds a rotor."""

    def told(estimate: Estimate, place: str, weighs: bool) -> Note:
        if not weighs:
            return Note(Kind.OF_INERTIA, {"place": place})
        mass, title = estimate.quantities["mass"], estimate.term.title
        return Note(Kind.OFF_CENTRE, {"place": place, "title": title, "mass": mass.value, "std": mass.std})

    if found:
        yield Note(Kind.UNKNOWN, {"what": [told(*one) for one in found]})


def mostly_links(case: Case) -> Iterator[Note]:
    """Note on link corrections that remove most of the squared error, beside named causes."""
    if case.by_links > MOST:
        more = Note(Kind.AMONG_THEM) if case.far_off else ""
        yield Note(Kind.MOSTLY_LINKS, {"share": case.by_links, "more": more})


def mostly_lead(case: Case) -> Iterator[Note]:
    """Note on a lead of the efforts that makes up most of the improvement."""
    if case.by_lead > max(MOST * case.gained, SLIGHT):
        yield from _leading(case)


def mended(case: Case, least: float) -> Iterator[Note]:
    """Note on what the extended model improves where nothing is wrong, surely at least `least` of the squared error."""
    if min(least, max(case.by_links, case.by_lead)) >= SLIGHT:
        by_links = Note(Kind.BY_LINKS, {"share": case.by_links})
        yield from _leading(case) if case.by_links < case.by_lead else [by_links]


def _leading(case: Case) -> Iterator[Note]:
    """Note on a lead of the efforts over the motion, if longer than that of an effort that is held for a sample."""
    if abs(case.lead) > USUAL_LEAD * case.equations.nuisances.hold:
        way, much = "early" if case.lead > 0.0 else "late", 1e3 * abs(case.lead)
        yield Note(Kind.BY_LEAD, {"much": much, "way": way, "share": case.by_lead})
