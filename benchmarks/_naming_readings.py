"""Ways in which recordings of real robots are read badly, and what diagnoses of such recordings add up to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from _naming_records import BRIEF, in_brief, latest, standing
from _naming_tables import Record, Totals, counted
from _naming_text import Rows, markdown
from scipy.signal import butter, lfilter, sosfiltfilt

from bdnn_ros.recording import Recording

RECORDS = Path(__file__).resolve().parent / "results" / "naming_readings.jsonl"
Misread = Callable[[Recording, np.random.Generator], Recording]

LOST = 0.02
"""Share of lost messages."""
JITTER = 0.1
"""Standard deviation of the stamps, in sample periods."""
WRONG_READINGS = 2e-4
"""Share of efforts read wrong by ten standard deviations, and half as many positions by half of one."""
LIMIT = 0.75
"""Share of the largest effort at which a sensor is at its limit."""
DROPOUTS, DROPOUT = 5, 0.06
"""How often all efforts are zero, and for how long [s]."""
SLOW = 50.0
"""Rate of a slow driver [Hz]."""
SENSOR_CUTOFF = 10.0
"""Of a first-order low-pass in the effort sensors [Hz]."""
EXPONENTIAL = 2.0
"""Of exponential smoothing of the efforts by a driver [Hz]."""
SMOOTHED = 3.0
"""Of the low-pass in both directions of a published recording [Hz]."""
LATE = 0.05
"""How late efforts come [s]."""


def as_recorded(recording: Recording, rng: np.random.Generator) -> Recording:
    """As the simulation made it."""
    return recording


def encoder(recording: Recording, rng: np.random.Generator) -> Recording:
    """Positions in steps of 14 bits a turn, velocity as their difference quotient."""
    step = 2.0 * np.pi / 2**14
    position = np.round(recording.position / step) * step
    return replace(recording, position=position, velocity=np.gradient(position, recording.time, axis=0))


def jittered(recording: Recording, rng: np.random.Generator) -> Recording:
    """Stamps that are off by a tenth of a period."""
    period = float(np.median(np.diff(recording.time)))
    off = np.clip(JITTER * rng.standard_normal(len(recording)), -0.4, 0.4)
    return replace(recording, time=recording.time + period * off)


def lossy(recording: Recording, rng: np.random.Generator) -> Recording:
    """One message in fifty lost."""
    return recording.part(rng.random(len(recording)) > LOST)


def slow(recording: Recording, rng: np.random.Generator) -> Recording:
    """50 messages a second."""
    return recording.part(slice(None, None, max(round(recording.rate / SLOW), 1)))


def without_velocity(recording: Recording, rng: np.random.Generator) -> Recording:
    """No velocity."""
    return replace(recording, velocity=None)


def held(recording: Recording, rng: np.random.Generator) -> Recording:
    """Efforts measured at a third of the rate, each published three times."""
    return replace(recording, effort=recording.require_effort()[np.arange(len(recording)) // 3 * 3])


def lagging(recording: Recording, rng: np.random.Generator) -> Recording:
    """Effort sensors behind a low-pass of 10 Hz."""
    return _of_first_order(recording, SENSOR_CUTOFF)


def sluggish(recording: Recording, rng: np.random.Generator) -> Recording:
    """Efforts that their driver smooths exponentially, at 2 Hz."""
    return _of_first_order(recording, EXPONENTIAL)


def _of_first_order(recording: Recording, cutoff: float) -> Recording:
    effort = recording.require_effort()
    share = 1.0 - np.exp(-2.0 * np.pi * cutoff / recording.rate)
    passed = lfilter([share], [1.0, share - 1.0], effort - effort[0], axis=0)
    return replace(recording, effort=passed + effort[0])


def smoothed(recording: Recording, rng: np.random.Generator) -> Recording:
    """All signals low-passed at 3 Hz, in both directions, before they were published."""
    passes = butter(2, SMOOTHED, fs=recording.rate, output="sos")
    position, effort = (
        sosfiltfilt(passes, values, axis=0) for values in (recording.position, recording.require_effort())
    )
    return replace(recording, position=position, velocity=None, effort=effort)


def smoothed_efforts(recording: Recording, rng: np.random.Generator) -> Recording:
    """The efforts alone low-passed at 3 Hz, in both directions."""
    return replace(recording, effort=smoothed(recording, rng).effort)


def wrong_readings(recording: Recording, rng: np.random.Generator) -> Recording:
    """One effort in 5 000 and one position in 10 000 read wrong."""
    position, effort = recording.position.copy(), recording.require_effort().copy()
    for values, often, far in ((effort, WRONG_READINGS, 10.0), (position, 0.5 * WRONG_READINGS, 0.5)):
        wrong = rng.random(values.shape) < often
        values[wrong] += (far * values.std(axis=0) * rng.choice([-1.0, 1.0], values.shape))[wrong]
    return replace(recording, position=position, effort=effort)


def limited(recording: Recording, rng: np.random.Generator) -> Recording:
    """Effort sensors at their limit above three quarters of the largest effort."""
    limit = LIMIT * np.abs(recording.require_effort()).max(axis=0)
    return replace(recording, effort=np.clip(recording.require_effort(), -limit, limit))


def dropping(recording: Recording, rng: np.random.Generator) -> Recording:
    """Efforts zero for 60 ms, five times."""
    effort = recording.require_effort().copy()
    for start in rng.uniform(0.0, recording.duration - DROPOUT, DROPOUTS):
        effort[(recording.time >= start) & (recording.time < start + DROPOUT)] = 0.0
    return replace(recording, effort=effort)


def late(recording: Recording, rng: np.random.Generator) -> Recording:
    """Efforts that come 50 ms after the motion they belong to."""
    samples = round(LATE * recording.rate)
    return replace(recording.part(slice(samples, None)), effort=recording.require_effort()[:-samples])


def within_a_turn(recording: Recording, rng: np.random.Generator) -> Recording:
    """Angles within one turn, which ends where the joints are most of the time."""
    end = np.pi + np.median(recording.position, axis=0)
    turns = np.round((recording.position - end) / (2.0 * np.pi))
    return replace(recording, position=recording.position - 2.0 * np.pi * turns)


WAYS: dict[str, Misread] = {
    "as recorded": as_recorded,
    "encoders of 14 bits": encoder,
    "stamps off by a tenth of a period": jittered,
    "2 % of the messages lost": lossy,
    "50 messages a second": slow,
    "no velocity": without_velocity,
    "each effort published three times": held,
    "effort sensors of 10 Hz": lagging,
    "efforts smoothed exponentially, at 2 Hz": sluggish,
    "all signals low-passed at 3 Hz": smoothed,
    "efforts low-passed at 3 Hz": smoothed_efforts,
    "one reading in 5 000 wrong": wrong_readings,
    "sensors at their limit above 75 %": limited,
    "efforts zero for 60 ms, five times": dropping,
    "efforts 50 ms late": late,
    "angles within one turn": within_a_turn,
}


def table(records: Sequence[Record]) -> Rows:
    """A row for each way."""
    rows = [["recorded", *BRIEF, "CPU s"]]
    for way in WAYS:
        if some := counted([record for record in records if record["way"] == way]):
            seconds = [record["cpu_seconds"] for record in Totals(some).diagnosed]
            rows.append([way, *in_brief(some), f"{np.median(seconds):.1f}" if seconds else "-"])
    return rows


def section(code: str) -> list[str]:
    """Part of a document; nothing without results.

    Args:
        code: tells the sources as they stand from those that made the results.
    """
    if not RECORDS.is_file():
        return []
    records = latest(RECORDS, lambda record: (record["draw"]["seed"], record["way"]))
    return [
        "\n## Recordings that were read badly\n",
        "Made by `python benchmarks/naming_readings.py --budget 0`: one effect of each kind is hidden, links are 5 % off, four\n"
        "of ten robots are worn; the same recording is then diagnosed as it is, and in every way that drivers spoil them.\n",
        f"{len(records)} diagnoses, {standing(records, code)}\n",
        markdown(table(records)),
    ]
