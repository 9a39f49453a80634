"""From a recording to clean signals: even sampling, zero-phase low-pass, derivatives.

Every signal passes the same Gaussian kernel, and derivatives are that kernel's own derivatives, so position, velocity,
acceleration and effort are filtered exactly alike.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import convolve1d

from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.recording import Recording, position_noise, white_noise
from bdnn_ros.signals.copies import without_copies
from bdnn_ros.signals.glitches import without_glitches
from bdnn_ros.signals.jitter import without_jitter
from bdnn_ros.signals.kernels import even_grid, gaussian_kernel, gaussian_std, grid_of
from bdnn_ros.signals.powerless import powerless
from bdnn_ros.signals.rattling import rattling
from bdnn_ros.signals.repeats import without_repeats
from bdnn_ros.signals.signals import Signals
from bdnn_ros.signals.stuck import without_stuck
from bdnn_ros.signals.unmeasured import unmeasured
from bdnn_ros.signals.wraps import without_wraps

DEFAULT_CUTOFF = 10.0
"""-3 dB frequency of the low-pass [Hz], lowered for slow recordings to `rate * CUTOFF_PER_RATE`."""
CUTOFF_PER_RATE = 1.0 / 6.0
LEAST_CUTOFF = 0.01
"""Least cut-off [Hz]: the kernel of a lower one spans minutes and takes too much memory."""
SAMPLES_PER_CUTOFF = 20.0
"""Working rate per cut-off frequency: 200 Hz for 10 Hz."""
MINIMUM_SAMPLES = 20
"""A segment shorter than this many working samples is left out."""


def mended(recording: Recording) -> Recording:
    """The recording as `prepare` takes it: repeats, outliers and late stamps corrected, each with a note."""
    single = without_repeats(without_copies(without_wraps(recording)))
    return without_stuck(without_jitter(without_glitches(single)))


def prepare(recording: Recording, cutoff: float | None = None, working: float | None = None) -> Signals:
    """Clean signals of a recording.

    Args:
        cutoff: -3 dB frequency [Hz]; None takes `DEFAULT_CUTOFF` or less for slow recordings.
        working: rate of the signals [Hz]; None takes what suits the recording, see `working_rate`.

    Raises:
        RecordingError: no segment is long enough.
        UsageError: the cut-off is not within what the rate allows.
    """
    if len(recording) < MINIMUM_SAMPLES:
        raise RecordingError(
            f"{recording.name}: {len(recording)} samples are too few to tell a motion.",
            "Record at least some seconds of motion.",
        )
    recording = mended(recording)
    chosen = suitable_cutoff(recording.rate, cutoff)
    if working is None:
        step, every = even_grid(recording.rate, SAMPLES_PER_CUTOFF * chosen)
    else:
        step, every = grid_of(recording.rate, working)
    pieces = [_segment(recording, rows, chosen, step, every) for rows in recording.segments()]
    pieces = [piece for piece in pieces if len(piece["time"]) >= MINIMUM_SAMPLES]
    if not pieces:
        raise RecordingError(
            f"{recording.name}: {recording.duration:.2f} s in {len(recording.segments())} pieces is too "
            f"short for a low-pass at {chosen:g} Hz.",
            "Record a longer motion without gaps, or raise --cutoff.",
        )
    joined = {key: np.concatenate([piece[key] for piece in pieces]) for key in pieces[0]}
    edges = np.cumsum([0, *(len(piece["time"]) for piece in pieces)])
    return Signals(
        time=joined["time"],
        joints=recording.joints,
        position=joined["position"],
        velocity=joined["velocity"],
        acceleration=joined["acceleration"],
        effort=joined.get("effort"),
        reported_velocity=joined.get("reported"),
        rate=1.0 / (step * every),
        cutoff=chosen,
        segments=tuple(slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)),
        position_noise=position_noise(recording),
        raw_rate=recording.rate,
        effort_noise=None if recording.effort is None else white_noise(recording.effort),
        unmeasured=_unmeasured(recording, joined["time"]),
    )


def _unmeasured(recording: Recording, time: np.ndarray) -> np.ndarray | None:
    """Where the effort at moments (N,) says nothing about what acts, (N, n) bool.

    If one drive rattles or all rest without power, that is so for all joints.
    """
    if recording.effort is None:
        return None
    none = np.asarray(rattling(recording).any(axis=1)) | powerless(recording)
    nothing = unmeasured(recording) | none[:, None]
    return nothing[np.searchsorted(recording.time, time)]


def flattened(signals: Signals, cutoff: float) -> Signals:
    """The same signals with a flattened low-pass, to be compared after a lower one.

    What the kernel attenuates is added back once (twicing: 2 K - K², of fourth order; Stuetzle and Mittal, 1979), for motion
    and effort alike, so that a model that is nonlinear in the motion commutes with the filter.

    Args:
        cutoff: -3 dB frequency of `smooth` [Hz] from now on.
    """

    def flat(values: np.ndarray) -> np.ndarray:
        return 2.0 * values - signals.smooth(values)

    return replace(
        signals,
        position=flat(signals.position),
        velocity=flat(signals.velocity),
        acceleration=flat(signals.acceleration),
        effort=None if signals.effort is None else flat(signals.effort),
        reported_velocity=None if signals.reported_velocity is None else flat(signals.reported_velocity),
        cutoff=cutoff,
        flat=signals.cutoff,
    )


def usual_cutoff(rate: float) -> float:
    """The default cut-off [Hz] for a recording of this rate [Hz]."""
    return min(DEFAULT_CUTOFF, rate * CUTOFF_PER_RATE)


def suitable_cutoff(rate: float, cutoff: float | None = None) -> float:
    """The given cut-off [Hz], or the default one, for a recording of this rate [Hz].

    Raises:
        UsageError: the rate does not allow it, or it is below `LEAST_CUTOFF`.
    """
    usual = usual_cutoff(rate)
    least, chosen = min(LEAST_CUTOFF, usual), usual if cutoff is None else cutoff
    if not 0.0 < least <= chosen <= rate / 2.0:
        raise UsageError(
            f"A cut-off of {chosen:g} Hz does not fit a recording of {rate:g} Hz.",
            f"Choose up to {rate * CUTOFF_PER_RATE:g} Hz, and {least:g} Hz at least.",
        )
    return chosen


def working_rate(rate: float, cutoff: float) -> float:
    """The rate of the signals [Hz] that `prepare` makes of a recording with this rate and cut-off [Hz]."""
    step, every = even_grid(rate, SAMPLES_PER_CUTOFF * cutoff)
    return 1.0 / (step * every)


def _segment(
    recording: Recording, rows: slice, cutoff: float, step: float, every: int
) -> dict[str, np.ndarray]:
    """One gap-free piece on the working grid, shortened by half the kernel's length at each end."""
    stamps = recording.time[rows]
    grid = np.arange(stamps[0], stamps[-1], step)
    std = gaussian_std(cutoff)
    kernel, first, second = gaussian_kernel(std, 1.0 / step)
    half = len(kernel) // 2
    inner = slice(half, max(len(grid) - half, half), every)
    if len(grid) <= 2 * half or len(stamps) < 4:
        return {"time": np.empty(0), "position": np.empty((0, recording.width))}

    # compared with the grid, not step by step, as small differences add up
    uniform = len(grid) <= len(stamps) and np.abs(stamps[: len(grid)] - grid).max() < 1e-3 * step

    given = {"position": recording.position, "effort": recording.effort, "reported": recording.velocity}
    fields = {name: values[rows] for name, values in given.items() if values is not None}
    if uniform:
        even = {name: values[: len(grid)] for name, values in fields.items()}
    else:
        course = CubicSpline(stamps, np.concatenate(list(fields.values()), axis=1))(grid)
        even = dict(zip(fields, np.split(course, len(fields), axis=1), strict=True))

    def filtered(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return convolve1d(values, weights, axis=0, mode="nearest")[inner]

    return {
        "time": grid[inner],
        "velocity": filtered(even["position"], first),
        "acceleration": filtered(even["position"], second),
        **{name: filtered(values, kernel) for name, values in even.items()},
    }
