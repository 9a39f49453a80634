"""Reporting a diagnosis: what is told of a case, put into words."""

from __future__ import annotations

from collections.abc import Sequence

from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.result import Diagnosis
from bdnn_ros.diagnosis.sentences import Kind, Note
from bdnn_ros.diagnosis.telling.advice import advice
from bdnn_ros.diagnosis.telling.alike import untold
from bdnn_ros.diagnosis.telling.as_good import at_most
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.left import unexplained
from bdnn_ros.diagnosis.telling.naming import name_of
from bdnn_ros.diagnosis.telling.notes import notes
from bdnn_ros.diagnosis.telling.outcome import Outcome
from bdnn_ros.recording import Recording


def diagnosis_of(case: Case, cutoff: float | None = None) -> Diagnosis:
    """The diagnosis, with errors and gain on held-out rows.

    Args:
        cutoff: requested low-pass [Hz]; None for the usual one.
    """
    outcome, since = Outcome(case, cutoff), case.earlier is not None
    (gain, interval), findings, noted = outcome.gain, outcome.findings, tuple(notes(outcome))
    recorded = (note for recording in case.recordings for note in recording.notes)
    explained = outcome.verdict == "nothing_wrong" and findings
    return Diagnosis(
        source=_source(case.recordings, case.equations),
        verdict="explained" if explained else outcome.verdict,
        findings=tuple(findings),
        effort_rmse={"simulation": case.simulation, "extended": case.extended, "noise_floor": case.floor},
        gain=gain,
        gain_interval=interval,
        unexplained_share=case.share_left,
        unexplained_depends_on=tuple(case.remainder.depends_on(outcome.above or outcome.slight))[:6],
        unexplained_sentence=unexplained(outcome).sentence(since),
        advice=tuple(_advice(outcome)),
        notes=tuple(dict.fromkeys((*outcome.jumps, *recorded, *(note.sentence(since) for note in noted)))),
        above=outcome.above,
        slight=outcome.slight,
        noted=noted,
    )


def _advice(outcome: Outcome) -> list[str]:
    """Advice on terms that are large enough for a name, or on what to record where nothing can be told."""
    case, names = outcome.case, outcome.names
    told = advice(
        [case.found[one] for one in names.weighty],
        [case.attempt.judgements[one] for one in names.weighty],
        case.robot,
        lambda term: name_of(case.robot, term),
        [k for k, one in enumerate(names.weighty) if one in (*names.silent, *names.unknown)],
        lambda k, rival: at_most(case.equations, case.attempt.fitted, names.weighty[k], rival),
    )
    since = case.earlier is not None
    if outcome.verdict == "cannot_tell" and not told:
        more = Kind.IDENTIFY_MORE if since else Kind.RECORD_MORE
        told = [Note(more, {"wider": Note(Kind.WIDER)}).sentence(since)]
    if outcome.alike is not None and untold(outcome.causes):
        told.append(outcome.alike.note(Kind.WEIGH).sentence(since))
    return told


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
