"""Excerpts of long recordings, and limits on short ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bdnn_ros.errors import RecordingError, UsageError, listed
from bdnn_ros.recording import Recording

ENOUGH = 10.0
"""Duration of motion that is asked for [s]: mostly enough behind a usual low-pass, and mostly refused if shorter."""
SHORTEST = 8.0
"""Shorter recordings are always refused [s]: they make too few blocks to hold out."""
MOST_SECONDS = 180.0
"""Longest motion examined [s]: more takes minutes and gigabytes, and shows hardly more."""
PIECE = 15.0
"""Length of a piece [s], enough to see a push or a gap whole."""
LEAST = 5.0
"""Recordings whose excerpt would be shorter than this are left out [s]."""
EXCERPT = (
    "{name}: of {all:.0f} s of motion {kept:.0f} s are examined, in pieces of {piece:.0f} s all over it; "
    "what acts between them only is not seen. Cut out what matters, to see it all."
)
UNSEEN = (
    "Of {all:.0f} s of motion in all recordings {most:.0f} s are examined at most; not looked at: {names}. "
    "Name fewer, to see them."
)


def refuse_short(recordings: Sequence[Recording]) -> None:
    """Refuse recordings that are too short, whatever their motion.

    Raises:
        RecordingError: they last less than `SHORTEST` together.
    """
    together = sum(recording.recorded for recording in recordings)
    if together < SHORTEST:
        raise too_short(recordings[0].name, together)


def refuse_window(seconds: float) -> None:
    """Refuse a window that is too short for any answer [s]; 0 stands for all there is.

    Raises:
        UsageError: it is shorter than `SHORTEST`.
    """
    if 0.0 < seconds < SHORTEST:
        raise UsageError(
            f"A window of {seconds:.3g} s is too short for a diagnosis.",
            f"Ask for {ENOUGH:g} s at least, better 30 s, or 0 for all that is kept.",
        )


def too_short(name: str, seconds: float) -> RecordingError:
    """The error for a recording of so little motion."""
    return RecordingError(
        f"{name}: {seconds:.1f} s of motion are too short for a diagnosis.",
        f"Record at least {ENOUGH:g} s of motion, better 30 s.",
    )


def excerpts(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings limited to `MOST_SECONDS` together: of longer ones pieces spread over them, with a note."""
    together = sum(recording.recorded for recording in recordings)
    if together <= MOST_SECONDS:
        return list(recordings)
    result, unseen, before = list[Recording](), list[str](), 0.0
    for recording in recordings:
        kept = recording.excerpt(MOST_SECONDS / together, PIECE, before)
        before += recording.recorded
        if kept.recorded < min(LEAST, recording.recorded):
            unseen.append(recording.name)
        else:
            result.append(recording if kept.recorded == recording.recorded else _told(recording, kept))
    if unseen:
        note = UNSEEN.format(names=listed(unseen), all=together, most=MOST_SECONDS)
        result[0] = replace(result[0], notes=(*result[0].notes, note))
    return result


def _told(recording: Recording, kept: Recording) -> Recording:
    note = EXCERPT.format(name=recording.name, all=recording.recorded, kept=kept.recorded, piece=PIECE)
    return replace(kept, notes=(*recording.notes, note))
