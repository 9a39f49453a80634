"""Whether recordings are fit for identification: enough samples, motion, and an effort that responds to it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from bdnn_ros.cli.options import say
from bdnn_ros.errors import RecordingError, UsageError, listed
from bdnn_ros.recording import Recording, moving
from bdnn_ros.scores import STILL, Scores
from bdnn_ros.signals import MINIMUM_SAMPLES, Signals, prepare, suitable_cutoff
from bdnn_ros.signals.unmeasured import absent

LEAST_SECONDS = 1.0
"""Motion that a model is identified from, at least [s]."""
LEAST_RATE = 4.0
"""Samples a second, at least [Hz]: a low-pass that suits a lower rate leaves nothing of the motion of an arm."""

WORSE = 1.2
"""An identified model's error of a joint is worth a word from this many times the description's on,"""
NEGLIGIBLE = 0.02
"""and from this share of the effort's spread on: nobody records more to tell one good model from another."""
LITTLE = 0.2
"""A model that leaves so much of the effort's spread, and no less than the description does by `WORSE`, has not learned."""


def require_motion(recording: Recording) -> None:
    """Refuse a recording in which nothing moves.

    Raises:
        RecordingError: there are too few samples to tell, or too few a second, or no joint moves.
    """
    require_samples(recording)
    moves = moving(recording)
    if not moves.any():
        raise RecordingError(f"{recording.name}: no joint moves.", "Record the robot in motion.")
    still = [joint for joint, moved in zip(recording.joints, moves, strict=True) if not moved]
    if still:
        do, them = ("does", "it") if len(still) == 1 else ("do", "them")
        say(f"{recording.name}: {listed(still)} {do} not move: nothing can be learned about {them}.")


def require_samples(recording: Recording) -> None:
    """Refuse a recording with too few samples to see a motion.

    Raises:
        RecordingError: in all, or in a second.
    """
    if len(recording) < MINIMUM_SAMPLES:
        raise RecordingError(
            f"{recording.name}: {len(recording)} samples are too few to tell a motion.",
            "Record at least some seconds of motion.",
        )
    if recording.rate < LEAST_RATE:
        raise RecordingError(
            f"{recording.name}: joint states at {recording.rate:.3g} Hz are too rare to tell a motion.",
            f"Record at 100 Hz or more; {LEAST_RATE:g} Hz are the least.",
        )


def require_measured(recording: Recording) -> np.ndarray:
    """The effort, (N, n) [N·m]; refuses a recording whose effort says nothing about the motion.

    Raises:
        RecordingError: there is none, or that of no joint that moves ever changes.
    """
    effort, moves = recording.require_effort(), moving(recording)
    if moves.any() and (np.ptp(effort, axis=0) <= STILL)[moves].all():
        raise RecordingError(
            f"{recording.name}: the effort of no joint that moves ever changes.",
            "Check that the driver reports it.",
        )
    return effort


def prepared(part: Recording, whole: Recording, cutoff: float | None, what: str) -> Signals:
    """Prepared signals of a part of a recording, with samples that can be scored.

    Args:
        cutoff: of the low-pass [Hz].
        what: the part, for the message.

    Raises:
        RecordingError: the part is too short for the low-pass.
        BdnnError: as `prepare`.
    """
    cutoff = suitable_cutoff(whole.rate, cutoff)
    try:
        signals = prepare(part, cutoff)
        enough = bool(len(signals.time[signals.interior]))
    except RecordingError:
        enough = False
    if not enough:
        prepare(whole, cutoff)  # says what is wrong with all of it
        raise RecordingError(
            f"{whole.name}: {what} has {len(part)} samples in {part.recorded:.2g} s, too few for a low-pass at "
            f"{cutoff:.3g} Hz.",
            "Record longer or at a higher rate, or hold out another share (--holdout of `bdnn identify` and `bdnn evaluate`).",
        )
    return signals


def require_distinct(recordings: Sequence[Recording]) -> None:
    """Refuse recordings that overlap: the same motion would count twice.

    Raises:
        UsageError: of a motion at stamps that two recordings share, both measured the same.
    """
    for one, other in combinations(recordings, 2):
        first, second = _shared(one, other)
        if len(first) >= MINIMUM_SAMPLES and _alike(first, second) and moving(first).any():
            raise UsageError(
                f"{one.name} and {other.name} hold the same {first.recorded:.3g} s of one recording, which would count twice.",
                "Give each recording once.",
            )


def _shared(one: Recording, other: Recording) -> tuple[Recording, Recording]:
    """The samples of two recordings at their common stamps."""
    first, second = (each.epoch + np.round(each.time * 1e9).astype(np.int64) for each in (one, other))
    _, mine, theirs = np.intersect1d(first, second, return_indices=True)
    return one.part(mine), other.part(theirs)


def _alike(one: Recording, other: Recording) -> bool:
    """Whether positions and efforts are equal."""
    pairs = ((one.position, other.position), (one.effort, other.effort))
    return all(a is b or np.array_equal(a, b, equal_nan=True) for a, b in pairs)  # type: ignore[arg-type]


def require_length(recordings: Sequence[Recording]) -> None:
    """Refuse recordings that are too short to learn from.

    Raises:
        RecordingError: the recordings last less than `LEAST_SECONDS` together.
    """
    together = sum(recording.recorded for recording in recordings)
    if together < LEAST_SECONDS:
        raise RecordingError(
            f"{recordings[0].name}: {together:.2g} s of motion are too short to learn from.",
            "Record at least 10 s, better 30 s.",
        )


def split(recording: Recording, signals: Signals, holdout: float) -> tuple[Recording, Recording]:
    """The first part and the last share of the motion; a standstill at the end of the recording does not count as motion.

    Args:
        signals: of all of the recording.

    Raises:
        UsageError: the held-out share is none.
    """
    told = ~signals.resting & signals.seen.any(axis=1)
    moments = np.searchsorted(signals.time, recording.time).clip(max=len(signals) - 1)
    return recording.split(holdout, told[moments] | ~told.any())


def parted(
    recordings: Sequence[Recording], holdout: float, cutoff: float | None
) -> list[tuple[Recording, Recording]]:
    """The training part and the held-out part of each recording.

    Args:
        cutoff: of the low-pass [Hz]; None takes what suits each.

    Raises:
        BdnnError: as `prepare` and `split`.
        UsageError: the held-out share leaves too little to learn from.
    """
    parts = [split(recording, prepare(recording, cutoff), holdout) for recording in recordings]
    for recording, (first, _) in zip(recordings, parts, strict=True):
        if first.recorded < LEAST_SECONDS <= recording.recorded:
            raise UsageError(
                f"--holdout {holdout:g} leaves {first.recorded:.2g} s of {recording.name} to learn from.",
                f"Give a smaller share: {LEAST_SECONDS:g} s are the least.",
            )
    return parts


def prepared_last(part: Recording, whole: Recording, cutoff: float | None, holdout: float) -> Signals:
    """Prepared signals of the held-out part."""
    return prepared(part, whole, cutoff, f"its last {100 * holdout:.3g} %, which is kept out to be scored,")


def unscored(
    recordings: Sequence[Recording], lasts: Sequence[Recording], tested: Sequence[Signals]
) -> list[str]:
    """A sentence on joints that move in the training part but not in the held-out part; empty list if there is none.

    Args:
        lasts: of each recording what is kept out.
        tested: clean signals of that.
    """
    able = [moving(one) & ~absent(one.require_effort()) for one in recordings]
    shown = [
        moving(last) & signals.seen[signals.interior].any(axis=0)
        for last, signals in zip(lasts, tested, strict=True)
    ]
    lost = np.any(able, axis=0) & ~np.any(shown, axis=0)
    if not lost.any():
        return []
    names = [joint for joint, gone in zip(recordings[0].joints, lost, strict=True) if gone]
    do, their, them = ("does", "its", "it") if len(names) == 1 else ("do", "their", "them")
    return [
        f"{listed(names)} {do} not move with an effort measured in the last part, which is kept out to be scored: {their} "
        f"score says nothing. Let {them} move until the end, or give `bdnn identify` another --holdout."
    ]


def worse(model: Scores, described: Scores | None, from_nothing: bool) -> list[str]:
    """A sentence on joints that the description predicts better than the model; empty list if there is none.

    Args:
        model, described: of the same samples, which the model was not learned from.
        from_nothing: whether it was learned without the description.
    """
    if described is None:
        return []
    behind = model.nrmse > np.maximum(WORSE * described.nrmse, NEGLIGIBLE)
    names = [joint for joint, one in zip(model.joints, behind, strict=True) if one]
    if not names:
        return []
    them = "it" if len(names) == 1 else "them"
    instead = ", or start from the description (--prior urdf)" if from_nothing else ""
    return [
        f"{listed(names, 20)}: of what is kept out to be scored, the description says more than the model. Record more and "
        f"wider motion of {them}{instead}."
    ]


def hardly_better(model: Scores, described: Scores | None, recordings: Sequence[Recording]) -> list[str]:
    """A sentence on moving joints that the model predicts about as badly as the description; empty list if there is none.

    Args:
        model, described: as of `worse`, which tells those that the description predicts better.
        recordings: what it was learned from and is scored on.
    """
    if described is None:
        return []
    level = (model.nrmse <= WORSE * described.nrmse) & (WORSE * model.nrmse >= described.nrmse)
    level &= (model.nrmse > LITTLE) & np.any([moving(one) for one in recordings], axis=0)
    names = [joint for joint, one in zip(model.joints, level, strict=True) if one]
    if not names:
        return []
    them = "it" if len(names) == 1 else "them"
    return [
        f"{listed(names, 20)}: of what is kept out to be scored, the model says hardly more than the description: its bodies "
        f"need not be nearer to the real ones. Record more and wider motion of {them}."
    ]
