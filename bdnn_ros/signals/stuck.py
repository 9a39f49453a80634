"""A drive that repeats its last reading while others go on, with stamps that go on as well: a bus node that drops out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.errors import RecordingError, listed
from bdnn_ros.recording import Recording, white_noise
from bdnn_ros.signals.unmeasured import PLATEAU, runs

LONGER = 3.0
"""A position may be stuck if it is constant for this many times as long as nine of ten of the joint's runs."""
JUMP = 3.0
"""It then jumps by this many times a fast step of the joint (per sample period), ..."""
AWAY = 5
"""... and stays away for so many samples, unlike an outlier."""
SELDOM = 10
"""Least number of other steps per constant run: a joint that steps less often is moved in jumps."""
ABRUPT = 3.0
"""Motion stops or starts abruptly if a step is this many times the usual change between steps, ..."""
MOVES = 0.1
"""... and at least this share of a fast step; a constant velocity counts from this share of its root mean square."""
CLEARLY = 0.2
"""A joint moves by its velocity if its median speed exceeds this share of the root mean square, ..."""
SECONDS = 1.0
"""... for longer than a low-pass takes to decay [s], ..."""
NOISE_WIDTHS = 5.0
"""... with a variation of this many standard deviations of its noise, ..."""
FAR = 0.02
"""... and over more than this distance [rad or m]."""


def without_stuck(recording: Recording) -> Recording:
    """The recording without the moments at which a drive repeats its last reading although its joint moves.

    The motion of one joint affects the efforts of all, so these moments become a gap for all joints.

    Raises:
        RecordingError: nothing is left.
    """
    samples = stuck(recording)
    if not samples.any():
        return recording
    lost = np.asarray(samples.any(axis=1))
    joints = [
        joint for joint, some in zip(recording.joints, np.asarray(samples.any(axis=0)), strict=True) if some
    ]
    who, their = listed(joints), "its driver" if len(joints) == 1 else "their drivers"
    if lost[1:].all():
        raise RecordingError(
            f"{recording.name}: the position of {who} never changes, though the velocity says that it moves.",
            f"Check {their} and the bus, or leave out {who} with --joints.",
        )
    seconds = np.count_nonzero(lost) / recording.rate
    note = (
        f"{recording.name}: {who} repeated the last reading in motion for {seconds:.2g} s in all, first at "
        f"{recording.time[np.argmax(lost)]:.2f} s; these moments are left out of all joints. Check {their} and the bus."
    )
    return replace(recording.part(~lost), notes=(*recording.notes, note))


def stuck(recording: Recording) -> np.ndarray:
    """Samples that repeat the position of a joint that moves meanwhile, (N, n) bool.

    A position that stays constant for long is normal for a joint at rest or with a coarse encoder. It is stuck if it then
    jumps, if the velocity contradicts it, or if all readings of the joint stop or start within a sample period while other
    joints go on.
    """
    result = np.zeros(recording.position.shape, bool)
    if len(recording) <= PLATEAU:
        return result
    period = np.median(np.diff(recording.time))
    inside = np.ones(len(recording) - 1, bool)
    inside[[rows.start - 1 for rows in recording.segments()[1:]]] = False
    stretch = np.maximum(np.diff(recording.time) / period, 1.0)
    steps = np.diff(recording.position, axis=0) / stretch[:, None]
    for joint in range(recording.width):
        pauses = _pauses(recording.position[:, joint], inside)
        if not pauses:
            continue
        step = np.where(inside, np.abs(steps[:, joint]), 0.0)
        ends = [edge for start, stop in pauses for edge in (start - 1, stop - 1) if 0 <= edge < len(step)]
        usual = step.copy()
        usual[ends] = 0.0
        usual = usual[usual > 0.0]
        fast = float(np.percentile(usual, 99.0)) if len(usual) >= SELDOM * len(pauses) else np.inf
        for start, stop in pauses:
            if (
                _jumps(recording.position[:, joint], inside, stop, JUMP * fast)
                or _goes_on(recording, joint, slice(start, stop), JUMP * fast)
                or _halts(recording, joint, slice(start, stop), steps, inside, MOVES * fast)
            ):
                result[start + 1 : stop, joint] = True
    return result


def _pauses(position: np.ndarray, inside: np.ndarray) -> list[tuple[int, int]]:
    """Rows [start, stop) of one segment with a constant position (N,) for much longer than usual."""
    same = np.append(False, (np.diff(position) == 0.0) & inside)
    first = np.flatnonzero(~same)
    lasts = np.diff(np.append(first, len(same)))
    if lasts.max() <= PLATEAU:
        return []
    usual = np.percentile(lasts, 90.0) if len(lasts) > 1 else 0.0
    long = lasts > max(PLATEAU, LONGER * usual)
    return [(int(a), int(a + n)) for a, n in zip(first[long], lasts[long], strict=True)]


def _jumps(position: np.ndarray, inside: np.ndarray, stop: int, least: float) -> bool:
    """Whether the position (N,) steps away after row `stop` - 1 and stays away."""
    after = position[stop : stop + AWAY]
    if len(after) < AWAY or not inside[stop - 1 : stop + AWAY - 1].all():
        return False
    return bool((np.abs(after - position[stop - 1]) > least).all())


def _goes_on(recording: Recording, joint: int, rows: slice, least: float) -> bool:
    """Whether the reported velocity integrates to more than `least` [rad] and `FAR` where the position is constant."""
    if recording.velocity is None:
        return False
    whole = rows.stop - rows.start == len(recording)
    velocity, time = recording.velocity[rows, joint], recording.time[rows]
    usual = float(np.sqrt(np.mean(recording.velocity[:, joint] ** 2)))
    least = FAR if whole else max(least, FAR)
    way = np.cumsum(velocity[1:] * np.diff(time))
    if np.ptp(way) <= least:
        return False
    if np.ptp(velocity) == 0.0:  # a joint that never moves may well report any velocity throughout
        return not whole and abs(float(velocity[0])) > MOVES * usual
    noise = NOISE_WIDTHS * float(white_noise(velocity[:, None])[0])
    clear = float(np.median(np.abs(velocity))) > CLEARLY * usual and float(np.std(velocity)) > noise
    return clear and float(time[-1] - time[0]) > SECONDS


def _halts(
    recording: Recording, joint: int, rows: slice, steps: np.ndarray, inside: np.ndarray, least: float
) -> bool:
    """Whether all readings of a joint stop or start abruptly and stay constant for unusually long while another joint moves.

    Args:
        steps: of the positions per sample period, (N - 1, n) [rad].
        inside: which of them are within a segment, (N - 1,) bool.
        least: least step of a moving joint [rad].
    """
    if recording.effort is None:
        return False
    effort = recording.effort[:, joint]
    lasts = runs(effort[:, None])[1]
    longest = max(PLATEAU, LONGER * float(np.percentile(lasts, 90.0)))
    if np.ptp(effort[rows]) > 0.0 or rows.stop - rows.start <= longest:
        return False
    if recording.velocity is not None and np.ptp(recording.velocity[rows, joint]) > 0.0:
        return False
    others = np.delete(steps[rows.start : rows.stop - 1], joint, axis=1)
    if not (np.count_nonzero(others, axis=0) > 0.5 * len(others)).any():
        return False
    own = steps[:, joint]
    changes = np.abs(np.diff(own))
    changes = changes[changes > 0.0]
    least = max(least, ABRUPT * float(np.percentile(changes, 99.0)) if len(changes) else np.inf)
    ends = [edge for edge in (rows.start - 1, rows.stop - 1) if 0 <= edge < len(own) and inside[edge]]
    return bool((np.abs(own[ends]) > least).any())
