"""`bdnn replay`: runs the live learner over a bag and shows its error against time."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bdnn_ros.checks.description import doubts
from bdnn_ros.cli import fitness, loading, options, outputs
from bdnn_ros.cli.options import counted
from bdnn_ros.cli.tables import cell
from bdnn_ros.errors import DataError, UsageError
from bdnn_ros.models import save_model
from bdnn_ros.online.learning import Error, Learning
from bdnn_ros.recording import Recording
from bdnn_ros.scores import numbers

BATCH_SECONDS = 0.1
"""Samples are handed over in pieces of this length, as they would come."""
MOST_ROWS = 40
"""Longest table that is printed."""
HEADER = f"{'time s':>8}  {'version':>7}  {'nMSE %':>9}  {'worst %':>9}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn replay`."""
    options.add_recording_arguments(parser, bags="one")
    parser.add_argument(
        "--rate",
        metavar="X",
        type=float,
        help="speed as a multiple of the bag's own, above 0 (default: as fast as it goes)",
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="directory (or .bdnn file) for the model at the end"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(args: argparse.Namespace) -> int:
    """Replay, print the error of each second under the model of that time, save the last model."""
    if args.rate is not None and not 0.0 < args.rate < float("inf"):
        raise UsageError(
            f"--rate {args.rate:g} is not a speed above 0.",
            "Use for example 1.0, or leave it out for as fast as it goes.",
        )
    if args.out:
        outputs.require_model_place(args.out)
    recordings, robot = loading.load(args)
    if robot is None:
        raise UsageError("There is no URDF to start from.", "Give --urdf FILE or --robot NAME.")
    for remark in doubts(robot):
        options.say(str(remark))
    fitness.require_length(recordings)
    recording = recordings[0]
    loading.require_efforts(args, recordings)
    learning = Learning(robot, args.cutoff)
    began = time.perf_counter()
    errors = []
    at_once = args.rate is not None and not args.json
    if at_once:
        print(HEADER, flush=True)
    for error in replayed(learning, recording, args.rate):
        errors.append(error)
        if at_once:
            print(_row(error), flush=True)
    took = time.perf_counter() - began
    if args.json:
        print(json.dumps(_as_json(recording, learning, errors, took), allow_nan=False))
    else:
        _print(learning, errors, recording, took, table=not at_once)
    if args.out:
        if learning.served is None:
            raise DataError("No model passed its checks; nothing is saved.", "Replay a longer motion.")
        path = save_model(args.out, learning.served.model)
        options.say(f"the model is {path}")
    return 0


def replayed(learning: Learning, recording: Recording, rate: float | None = None) -> Iterator[Error]:
    """Feed a recording to the learner as a stream would; yields each chunk's error before it is learned from.

    Args:
        rate: speed as a multiple of the recording's own, above 0; None for as fast as it goes.
    """
    effort = recording.require_effort()
    batch = np.floor((recording.time - recording.time[0]) / BATCH_SECONDS)
    edges = np.flatnonzero(np.diff(batch)) + 1
    began = time.perf_counter()
    for low, high in zip([0, *edges], [*edges, len(recording)], strict=True):
        if rate is not None:
            due = began + (recording.time[high - 1] - recording.time[0]) / rate
            time.sleep(max(due - time.perf_counter(), 0.0))
        rows = slice(int(low), int(high))
        for _ in learning.take(recording.time[rows], recording.position[rows], effort[rows]):
            pass
        yield from _taken(learning)
    for _ in learning.finish():
        pass
    yield from _taken(learning)


def _taken(learning: Learning) -> list[Error]:
    errors, learning.errors = learning.errors, []
    return errors


def _row(error: Error) -> str:
    mean, worst = (cell(100.0 * value, 9, ".3f") for value in (error.nmse_mean, error.nmse_worst))
    return f"{error.time:8.1f}  {error.number:7d}  {mean}  {worst}"


def _print(learning: Learning, errors: list[Error], recording: Recording, took: float, table: bool) -> None:
    if table:
        print(HEADER)
        step = max(-(-len(errors) // MOST_ROWS), 1)
        for error in errors[::step] if len(errors) > step else errors:
            print(_row(error))
    for change in learning.changes:
        print(change.finding["sentence"])
    speed = recording.recorded / max(took, 1e-9)
    served = learning.served
    print(
        f"{counted(len(recording), 'sample')} in {took:.1f} s ({speed:.0f} times as fast as they came), "
        f"{counted(served.number if served else 0, 'version')}, {counted(len(learning.rejected), 'update')} refused"
    )


def _as_json(recording: Recording, learning: Learning, errors: list[Error], took: float) -> dict[str, object]:
    return {
        "joints": list(recording.joints),
        "time": [round(error.time, 6) for error in errors],
        "version": [error.number for error in errors],
        "nmse": [numbers(error.nmse) for error in errors],
        "nmse_mean": numbers([error.nmse_mean for error in errors]),
        "samples": len(recording),
        "seconds": took,
        "rejected": learning.rejected,
        "changes": [change.finding for change in learning.changes],
    }
