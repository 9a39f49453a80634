"""What a diagnosis looks at of long recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from bdnn_ros.recording import Recording

MOST_SECONDS = 180.0
"""A search through more motion than this [s] takes minutes and gigabytes, and shows hardly more."""
PIECE = 15.0
"""Pieces last so long [s]: a push or a gap is seen whole."""


def excerpts(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings of no more than `MOST_SECONDS` together: of longer ones pieces all over them, with a note."""
    together = sum(recording.recorded for recording in recordings)
    if together <= MOST_SECONDS:
        return list(recordings)
    return [_excerpt(recording, MOST_SECONDS / together) for recording in recordings]


def _excerpt(recording: Recording, share: float) -> Recording:
    kept = recording.excerpt(share, PIECE)
    note = (
        f"{recording.name}: of {recording.recorded:.0f} s of motion {kept.recorded:.0f} s are examined, in pieces of "
        f"{PIECE:.0f} s all over it; what acts between them only is not seen. Cut out what matters, to see it all."
    )
    return replace(kept, notes=(*recording.notes, note))
