"""Processor time of an update and of a solution of the identification."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from _physical_data import motions, real

from bdnn_ros.online.identifier import Identifier
from bdnn_ros.recording import Recording

SECONDS, MORE = 40.0, 10.0
PACKET = 10
"""Samples fed at once."""
REPEATS = 50


def speed(args: argparse.Namespace) -> dict[str, Any]:
    """Processor time of an update a sample and of a solution, seven joints at 500 Hz."""
    result = {}
    print(f"{'terms':24} {'update a sample':>16} {'solution':>12} {'with noise and check':>21}")
    for name, effects in (("parameters", "matched"), ("parameters and networks", "unmodelled")):
        one = real(0, effects)
        identifier = Identifier(one.nominal)
        identifier.fit(motions(one, SECONDS, 0))
        row = times(identifier, *motions(one, MORE, 1))
        print(
            f"{name:24} {1e6 * row['update_s']:13.0f} µs {1e3 * row['solution_s']:9.2f} ms {1e3 * row['model_s']:18.2f} ms"
        )
        result[name] = row
    print("aims: 50 µs an update, 0.5 ms a solution")
    return result


def times(identifier: Identifier, recording: Recording) -> dict[str, float]:
    """Of an identifier that goes on with a recording: update a sample, solution, model handed over [s]."""
    effort, count = recording.require_effort(), len(recording)
    start = time.process_time()
    for k in range(0, count, PACKET):
        rows = slice(k, k + PACKET)
        identifier.feed(recording.time[rows], recording.position[rows], effort[rows])
    update = (time.process_time() - start) / count
    layout = identifier.parameter_layout
    return {
        "update_s": update,
        "solution_s": median_time(lambda: identifier.sums.recursion.solve(layout, 0)),
        "model_s": median_time(lambda: identifier.model()),
    }


def median_time(action: Callable[[], object], repeats: int = REPEATS) -> float:
    """Processor time of an action, the median of so many [s]."""
    seconds = []
    for _ in range(repeats):
        start = time.process_time()
        action()
        seconds.append(time.process_time() - start)
    return float(np.median(seconds))
