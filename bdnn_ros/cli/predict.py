"""`bdnn predict`: the effort that a model predicts along a recording."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TextIO

import numpy as np
from scipy.interpolate import PchipInterpolator

from bdnn_ros.bags import EveryState, Progress
from bdnn_ros.cli import loading, options, outputs
from bdnn_ros.cli.tables import csv_header
from bdnn_ros.errors import BdnnError
from bdnn_ros.models import Model, load_model
from bdnn_ros.recording import Recording
from bdnn_ros.signals import (
    MINIMUM_SAMPLES,
    SAMPLES_PER_CUTOFF,
    prepare,
    suitable_cutoff,
    without_copies,
)
from bdnn_ros.signals.kernels import KERNEL_WIDTHS, gaussian_std
from bdnn_ros.signals.wraps import without_wraps

ROWS_AT_ONCE = 4096
PARABOLA_WIDTHS = 8.0
"""Length of the parabola at an end, in standard deviations of the low-pass: as long as its kernel."""
LEAST_FOR_PARABOLA = 8


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn predict`."""
    options.add_model_argument(parser)
    options.add_recording_arguments(parser, bags="one")
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        help="CSV file to write, a row for every joint state, cells empty where nothing is known "
        "(default: standard output)",
    )


def run(args: argparse.Namespace) -> int:
    """Write one row per joint state, also where nothing can be predicted."""
    if args.out:
        outputs.require_file(args.out)
    model = load_model(args.model)
    joints = loading.shown(args, model.joints)
    every = loading.load_every(args, model)
    model = loading.along(model, every.motion)
    with options.progress("predicting") as show:
        along = effort_along(model, every.motion, args.cutoff, show)
    effort = np.where((every.row >= 0)[:, None], along[every.row], np.nan)
    effort = effort[:, [model.joints.index(joint) for joint in joints]]
    target: AbstractContextManager[TextIO] = (
        outputs.written_whole(args.out) if args.out else nullcontext(sys.stdout)
    )
    with target as file, options.progress("writing") as show:
        for row, lines in enumerate(_lines(every.select(joints), effort)):
            file.write(lines)
            show(min(row * ROWS_AT_ONCE, len(every)), len(every))
    return 0


def effort_along(
    model: Model, recording: Recording, cutoff: float | None = None, progress: Progress | None = None
) -> np.ndarray:
    """The predicted effort at every joint state, (N, n) [N·m].

    The model sees the low-passed motion at the working rate; its effort is interpolated monotonically (PCHIP). The low-pass
    needs samples on both sides, so every gap-free piece is extended at its ends by point reflection and a parabola, which
    keeps position, velocity and acceleration continuous. In pieces that are too short even so, the effort is that of the
    positions at the reported velocity (or zero), without acceleration.

    Args:
        cutoff: of the low-pass [Hz]; None takes the usual one.

    Raises:
        UsageError: the cut-off does not fit the rate.
    """
    if len(recording) < 2:
        return _unaccelerated(model, recording)
    recording = without_wraps(recording)  # what is continued at its ends must not jump there
    cutoff = suitable_cutoff(without_copies(recording).rate, cutoff)
    result = np.empty_like(recording.position)
    for rows in recording.segments():
        result[rows] = _piece(model, recording.part(rows), cutoff)
        if progress is not None:
            progress(rows.stop, len(recording))
    return result


def _piece(model: Model, piece: Recording, cutoff: float) -> np.ndarray:
    try:
        signals = prepare(_continued(without_copies(piece), cutoff), cutoff)
    except BdnnError:
        return _unaccelerated(model, piece)
    return np.asarray(PchipInterpolator(signals.time, model.predict(signals))(piece.time))


def _unaccelerated(model: Model, piece: Recording) -> np.ndarray:
    rest = np.zeros_like(piece.position)
    velocity = rest if piece.velocity is None else piece.velocity
    return model.inverse_dynamics(piece.position, velocity, rest)


def _continued(piece: Recording, cutoff: float) -> Recording:
    """A piece extended at both ends as far as the low-pass reaches.

    Beyond the end e: q(e + s) = 2 q(e) - q(e - s) + a s², with the acceleration a of a parabola through the
    last samples.
    """
    if len(piece) < 2:
        return piece
    std = gaussian_std(cutoff)
    reach = KERNEL_WIDTHS * std + MINIMUM_SAMPLES / (SAMPLES_PER_CUTOFF * cutoff)
    count = int(np.ceil(reach * piece.rate)) + 2
    ends = ((count, count), (0, 0))

    def even(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else np.pad(values, ends, mode="reflect")

    time = np.pad(piece.time, count, mode="reflect", reflect_type="odd")
    position = np.pad(piece.position, ends, mode="reflect", reflect_type="odd")
    for beyond, end in ((slice(0, count), 0), (slice(-count, None), -1)):
        since = time[beyond] - piece.time[end]
        position[beyond] += since[:, None] ** 2 * _acceleration_at(piece, end, PARABOLA_WIDTHS * std)
    return replace(
        piece, time=time, position=position, velocity=even(piece.velocity), effort=even(piece.effort)
    )


def _acceleration_at(piece: Recording, end: int, window: float) -> np.ndarray:
    """Acceleration of a parabola through the samples within `window` [s] of an end, (n,) [rad/s²]."""
    since = piece.time - piece.time[end]
    near = np.abs(since) <= window
    if np.count_nonzero(near) < LEAST_FOR_PARABOLA:
        return np.zeros(piece.width)
    return np.asarray(2.0 * np.polyfit(since[near], piece.position[near], 2)[0])


def _lines(every: EveryState, effort: np.ndarray) -> Iterator[str]:
    """The CSV in blocks; stamps are the bag's to the nanosecond, and cells without a value are empty."""
    kinds = ("effort", "measured")
    yield csv_header(["time", *(f"{joint}.{kind}" for joint in every.motion.joints for kind in kinds)])
    for start in range(0, len(every), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        cells = [[f"{stamp // 10**9}.{stamp % 10**9:09d}" for stamp in every.stamp[rows].tolist()]]
        for predicted, measured in zip(effort[rows].T, every.effort[rows].T, strict=True):
            cells += [_cells(predicted), _cells(measured)]
        yield "".join(",".join(row) + "\n" for row in zip(*cells, strict=True))


def _cells(values: np.ndarray) -> list[str]:
    return [f"{value:.9g}" if math.isfinite(value) else "" for value in values.tolist()]
