"""Reporting a diagnosis: findings, verdict, gain, and what is unexplained."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.diagnosis.pushes.pushes import pushing
from bdnn_ros.diagnosis.recorded.velocity_filter import reported_velocity
from bdnn_ros.diagnosis.regression.building import least_motion
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.gains import held_out_gain
from bdnn_ros.diagnosis.result import Diagnosis, Finding, Verdict, reference
from bdnn_ros.diagnosis.telling.advice import MORE, MORE_SINCE, advice
from bdnn_ros.diagnosis.telling.alike import ALIKE, FEWEST, SETTLED, Common, common, tied, untold
from bdnn_ros.diagnosis.telling.as_good import at_most
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.endless import endless
from bdnn_ros.diagnosis.telling.left import error_then, mostly_at, unexplained_sentence
from bdnn_ros.diagnosis.telling.naming import Doubts, Named, beyond_links, name_of, named
from bdnn_ros.diagnosis.telling.notes import (
    AT_AN_END,
    AT_REST,
    FAR_OFF,
    MOST,
    SLIGHT,
    THROUGHOUT,
    as_it_was,
    leading,
    loads,
    massless_links,
    mended,
    mostly_links,
    of_recording,
    one_clock,
    uncompared,
    unknown,
    unnamed,
)
from bdnn_ros.diagnosis.telling.with_time import with_time
from bdnn_ros.effects.rigid import LinkInertia
from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording
from bdnn_ros.signals.glitches import jumping, without_glitches

MUCH_LEFT = 0.5
"""Share of a joint's error that, if left, makes its causes doubtful: at a joint that moves now and then they may stand for
changes with time, and a real constant push leaves only noise."""
TOLD = 2.0
"""Ratio to the noise floor above which an error is mentioned, even if a small share of the effort."""
GROWS = 1.02
"""Ratio of errors up to which they count as equal."""


def diagnosis_of(case: Case, cutoff: float | None = None) -> Diagnosis:
    """The diagnosis, with errors and gain on held-out rows.

    Args:
        cutoff: requested low-pass [Hz]; None for the usual one.
    """
    robot, equations, attempt, since = case.robot, case.equations, case.attempt, case.earlier
    near = case.near(case.extended)
    unfit = _unfit(equations, case.simulation, case.extended, near)
    doubts = Doubts(unfit, _poor(case.simulation, case.extended, near), case.predictable)
    names = named(robot, equations, attempt, case.found, doubts, case.at_ends | case.always)
    alike = _alike(case, names.findings)
    before = None if since is None else since.velocity_cutoff
    # a filtered velocity is no cause of an effort's error
    causes, of_velocity = (
        sorted(some, key=lambda finding: -finding.share)
        for some in (tied(names.findings, alike), reported_velocity(case.recordings, cutoff, before))
    )
    findings = [*causes, *of_velocity]
    changing = any(judgement.changing for judgement in attempt.judgements)
    unseen = _unseen(case, names)
    said = names.unsaid <= MOST and not changing and not unseen
    jumps = [note for recording in case.recordings for note in jumping(without_glitches(recording))]
    pushed = pushing(attempt.fitted.terms, equations.rows.time)
    gain, interval = held_out_gain(equations, attempt.extended, case.held, pushed)
    unclear = _unclear(case, names, 1.0 - (1.0 - min(interval[0], 1.0)) ** 2)
    of_effort = _verdict(causes, unclear, bool(near.all()) and not jumps, said)
    above = _above(robot.joints, near, case.left)
    slight = _above(robot.joints, ~near | (case.extended <= TOLD * case.floor), case.left)
    # without a sure gain over an earlier model, what it leaves is no sign of a change
    poor = error_then(case, above) if since and of_effort == "cannot_tell" and interval[0] <= 0.0 else None
    return Diagnosis(
        source=_source(case.recordings, equations),
        verdict="explained" if of_effort == "nothing_wrong" and findings else of_effort,
        findings=tuple(findings),
        effort_rmse={"simulation": case.simulation, "extended": case.extended, "noise_floor": case.floor},
        gain=gain,
        gain_interval=interval,
        unexplained_share=case.share_left,
        unexplained_depends_on=tuple(case.remainder.depends_on(above or slight))[:6],
        unexplained_sentence=unexplained_sentence(
            case.share_left, case.remainder, above, reference(bool(since)), bool(causes), slight, poor
        ),
        advice=(*_advice(case, names, of_effort), *_settling(alike, findings)),
        notes=tuple(
            dict.fromkeys((*jumps, *_notes(case, names, findings, of_effort, interval[0], alike, unseen)))
        ),
        above=above,
        slight=slight,
        endless=bool(unseen),
        also=("links",) * (case.by_links > MOST) + ("stamps",) * bool(_led(case)),
    )


def _alike(case: Case, causes: Sequence[Finding]) -> Common | None:
    """One factor common to all link errors, if these are reported: named, or most of what the extended model improves."""
    named = sum(one.effect == LinkInertia.name for one in causes)
    told = case.by_links > (MOST if causes else SLIGHT)
    if case.earlier is not None or case.equations.alone is not None or not (told or named >= FEWEST):
        return None
    return common(case.equations, case.attempt.fitted)


def _settling(alike: Common | None, findings: Sequence[Finding]) -> list[str]:
    """Advice on whether the links or the efforts' unit is wrong."""
    return [alike.said(SETTLED)] if alike is not None and untold(findings) else []


def _advice(case: Case, names: Named, of_effort: Verdict) -> tuple[str, ...]:
    """Advice on terms that are large enough for a name, or on what to record where nothing can be told."""
    told = advice(
        [case.found[one] for one in names.weighty],
        [case.attempt.judgements[one] for one in names.weighty],
        case.robot,
        lambda term: name_of(case.robot, term),
        [k for k, one in enumerate(names.weighty) if one in (*names.silent, *names.unknown)],
        lambda k, rival: at_most(case.equations, case.attempt.fitted, names.weighty[k], rival),
    )
    if of_effort == "cannot_tell" and not told:
        told = [MORE_SINCE if case.earlier else MORE]
    return tuple(told)


def _notes(
    case: Case,
    names: Named,
    findings: Sequence[Finding],
    of_effort: Verdict,
    least: float,
    alike: Common | None,
    unseen: Sequence[str],
) -> tuple[str, ...]:
    """Notes beside findings and verdict; the gain is surely at least `least`."""
    robot, equations, since = case.robot, case.equations, bool(case.earlier)
    error = case.attempt.fitted.link_error
    # a named dry friction may hold any effort at rest
    at_rest = () if names.findings else case.remainder.resting
    silent, unknowns = (
        [(case.found[one], name_of(robot, case.found[one].term)) for one in some]
        for some in (names.silent, names.unknown)
    )
    return (
        *(note for recording in case.recordings for note in recording.notes),
        *of_recording(robot, equations),
        *uncompared(robot, equations.usable, case.held),
        *one_clock(case.recordings, findings),
        *[AT_AN_END] * bool(case.at_ends),
        *[THROUGHOUT] * bool(case.always),
        *([] if since else massless_links(robot, findings)),
        *loads(robot, findings, equations.rows.time, equations.motion.signals.begun),
        *unseen,
        *unnamed([(one.term, place) for one, place in silent], names.unsaid, since),
        *unknown(
            [(one, place, beyond_links(equations, error, one, but_rotor=True)) for one, place in unknowns]
        ),
        *[FAR_OFF] * (case.far_off and not case.stays),
        *[as_it_was(since)] * case.stays,
        *(mostly_links(case.by_links, case.far_off, since) if names.findings else ()),
        *(mostly_at(case, least) if of_effort == "cannot_tell" else ()),
        *(_mended(case, least) if of_effort == "nothing_wrong" else _led(case)),
        *([] if alike is None else [alike.said(ALIKE)]),
        *[AT_REST.format(joints=listed(at_rest), reference=reference(since))] * bool(at_rest),
    )


def _unseen(case: Case, names: Named) -> list[str]:
    """Notes on findings that another cause which changed meanwhile may imitate."""
    told = (case.found[one] for one in names.weighty if one not in (*names.silent, *names.unknown))
    placed = [(one, name_of(case.robot, one.term), case.equations) for one in told]
    return [note for each in placed for note in (*endless(*each), *with_time(*each))]


def _mended(case: Case, least: float) -> list[str]:
    """Notes on unnamed improvements by the extended model, surely at least `least` of the squared error."""
    return mended(
        least, case.by_links, case.by_lead, case.lead, case.equations.nuisances.hold, bool(case.earlier)
    )


def _led(case: Case) -> list[str]:
    """Note on a lead of the efforts that makes up most of the improvement."""
    if case.by_lead <= max(MOST * case.gained, SLIGHT):
        return []
    return leading(case.by_lead, case.lead, case.equations.nuisances.hold, bool(case.earlier))


def _unfit(
    equations: Equations, simulation: np.ndarray, extended: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Joints at which nothing is named, (n,) bool, since the model of what was found is not valid there.

    All joints if held-out errors grow above the noise, relative to each joint's effort or in total; and a joint that moves now
    and then with much of its error left, whose causes may stand for a push or drift.

    Args:
        simulation, extended: held-out errors of either model, (n,) [N·m].
        near: whether the extended one's is near the noise, (n,) bool.
    """
    scaled = (np.sum((error / equations.rows.effort_scale) ** 2) for error in (simulation, extended))
    plain = (GROWS**2 * np.sum(simulation**2), np.sum(extended**2))
    seldom = equations.rows.moving < least_motion(equations.motion.signals)
    # a cause outside the held-out rows leaves their error at the noise: no reason against it
    worse = any(after > before for before, after in (scaled, plain)) and not near.all()
    return np.asarray((seldom & _poor(simulation, extended, near)) | worse)


def _poor(simulation: np.ndarray, extended: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Joints with much error left above the noise, (n,) bool; see `_unfit`."""
    return np.asarray(~near & (extended > MUCH_LEFT * simulation))


def _unclear(case: Case, names: Named, least: float) -> bool:
    """Whether something may be wrong though nothing is named.

    Args:
        least: share of the squared error that the extended model surely removes.
    """
    of_weight = case.equations.alone is not None and not case.near(case.simulation).all()
    unsure = names.doubtful or bool(names.unknown) or bool(case.always)
    # unnamed link errors are expected; other unnamed terms that remove more than these are not
    unsure |= min(names.beside_links, least) > max(SLIGHT, case.by_links)
    return unsure or case.far_off or of_weight or bool(case.remainder.resting)


def _verdict(causes: Sequence[Finding], doubtful: bool, near: bool, said: bool) -> Verdict:
    """Verdict on the effort; never "nothing wrong" if something large is likely without being sure.

    Args:
        causes: findings of the effort.
        doubtful: whether something may be wrong without a name; see `_unclear`.
        near: whether the extended model's error is near the noise at all joints.
        said: whether the findings tell enough of what the extended model removes, and none may be another cause.
    """
    if causes:
        return "explained" if near and said else "partly_explained"
    return "nothing_wrong" if near and not doubtful else "cannot_tell"


def _above(joints: Sequence[str], near: np.ndarray, left: np.ndarray) -> tuple[str, ...]:
    """Joints whose extended-model error exceeds the noise, in order of the remaining squared error, (n,) [(N·m)²]."""
    return tuple(joints[j] for j in np.argsort(-left, kind="stable") if not near[j])


def _source(recordings: Sequence[Recording], equations: Equations) -> dict[str, object]:
    signals = equations.motion.signals
    return {
        "bags": [recording.name for recording in recordings],
        "duration": round(sum(recording.recorded for recording in recordings), 3),
        "samples": sum(len(recording) for recording in recordings),
        "rate": round(signals.raw_rate, 3),
        "cutoff": round(signals.cutoff, 3),
        "urdf": "",
        "joints": list(signals.joints),
    }
