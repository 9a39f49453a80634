"""The time window of a push: found where it was, the best of all, neither tiny nor everything."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from diagnosis_cases import equations_of, term, white

from bdnn_ros.diagnosis.pushes.windows import COARSE, LONGEST_SHARE, best_window
from bdnn_ros.diagnosis.regression.columns import Columns
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.environment import SHORTEST
from bdnn_ros.robot import Robot

J1, J2 = "arm2_joint1", "arm2_joint2"
TRUSTING = 1e-3
"""Belief in the links that leaves a push to nothing else."""


def pool_of(spec: str, std: float = 0.05, seed: int = 0) -> tuple[Pool, Term]:
    """A pool without candidates on a recording with a push, and the push."""
    equations = equations_of([spec])
    noise, model = white(equations, std, seed)
    equations = equations.with_target(equations.rows.target + noise)
    return Pool(equations, model, [], TRUSTING), term(spec, Robot.bundled("arm2"))[0]


def times(pool: Pool) -> np.ndarray:
    """Stamps of the rows [s]."""
    return pool.equations.rows.time


@pytest.mark.parametrize(
    "spec",
    [
        f"external_wrench@{J1}:start=3.3,end=5.1,torque=1",
        f"external_wrench@{J2}:start=6,end=6.8,torque=-0.5",
        "external_wrench@arm2_link2:start=2.2,end=7.9,force_x=3,force_y=-2",
    ],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_a_push_is_found_when_it_was(spec, seed):
    pool, true = pool_of(spec, seed=seed)
    shape, found = dict(true.shape), dict(best_window(pool, pool.fit(()), true).shape)
    step = 2.0 * float(np.median(np.diff(times(pool))))
    assert found["start"] == pytest.approx(shape["start"], abs=step)
    assert found["end"] == pytest.approx(shape["end"], abs=step)


def test_no_window_of_whole_rows_explains_more():
    """Against every window, with the rows' columns cut where the search's running sums are."""
    pool, true = pool_of(f"external_wrench@{J1}:start=3.3,end=5.1,torque=1", std=0.2, seed=2)
    fit, equations, time = pool.fit(()), pool.equations, times(pool)
    always = equations.columns.of(true.shaped({"start": -1.0, "end": 99.0}))
    precision = 1.0 / equations.spread(true, always)[0] ** 2
    column = equations.whitening.of(always, pool.noise)[:, :, 0]
    left = equations.whitening.of(pool.residual(fit), pool.noise)
    power = np.concatenate([[0.0], np.cumsum(np.sum(column**2, axis=1))])
    moment = np.concatenate([[0.0], np.cumsum(np.sum(column * left, axis=1))])

    def evidence(a: int, b: int) -> float:
        inner = power[b] - power[a] + precision
        return float(0.5 * (moment[b] - moment[a]) ** 2 / inner - 0.5 * np.log(inner))

    found = dict(best_window(pool, fit, true).shape)
    a, b = np.searchsorted(time, [found["start"] - 1e-9, found["end"] - 1e-9])
    step = max(round(COARSE / float(np.median(np.diff(time)))), 1)
    every = [(i, j) for i, j in combinations(range(0, len(time), 2), 2) if time[j] - time[i] >= SHORTEST]
    best = max(evidence(i, j) for i, j in every if time[j] - time[i] <= LONGEST_SHARE * np.ptp(time))
    assert evidence(a, b) >= best - 1.0
    coarse = [(i, j) for i, j in every if i % step == 0 and j % step == 0]
    assert evidence(a, b) >= max(evidence(i, j) for i, j in coarse) - 1e-9


def test_windows_are_neither_tiny_nor_everything():
    pool, true = pool_of(f"external_wrench@{J1}:start=-5,end=99,torque=1")  # always there
    found = dict(best_window(pool, pool.fit(()), true).shape)
    length = found["end"] - found["start"]
    step = float(np.median(np.diff(times(pool))))
    assert length + step >= SHORTEST and length <= LONGEST_SHARE * np.ptp(times(pool)) + step
    assert length > 0.7 * np.ptp(times(pool))


@pytest.mark.parametrize(
    ("start", "end", "found_end"), [(4.0, 6.0, (5.9, 6.1)), (5.95, 7.1, (7.1, 7.5)), (4.0, 9.0, (8.9, 9.1))]
)
def test_the_pause_between_recordings_is_no_time_that_a_window_lasts(start, end, found_end):
    """It may go on in the next one, but neither ends in between nor passes for long by what nobody recorded."""
    pool, true = pool_of(f"external_wrench@{J1}:start={start},end={end - 1.0 if end > 6.5 else end},torque=1")
    equations = pool.equations
    signals = equations.motion.signals
    stamps = np.where(signals.time < 6.0, signals.time, signals.time + 1.0)  # from 7 s on the second one
    equations.use_motion(replace(equations.motion, signals=replace(signals, time=stamps, begun=(0.0, 7.0))))
    equations.columns = Columns(equations.motion, equations.decimation)
    equations.rows = replace(equations.rows, time=stamps[equations.rows.samples])
    found = dict(best_window(pool, pool.fit(()), true).shape)
    inside = (times(pool) >= found["start"]) & (times(pool) <= found["end"])
    assert inside.sum() * float(np.median(np.diff(times(pool)))) >= SHORTEST
    assert found_end[0] <= found["end"] <= found_end[1]


def test_coloured_noise_alone_gives_a_window_all_the_same():
    pool, true = pool_of(f"external_wrench@{J1}:start=3,end=5,torque=1")
    equations = pool.equations
    equations = equations.with_target(np.cumsum(white(equations, 0.05)[0], axis=0))
    slow = Pool(equations, Noise(np.full((2, 1), 0.95), np.full(2, 0.05)), [], TRUSTING)
    found = dict(best_window(slow, slow.fit(()), true).shape)
    assert times(pool)[0] <= found["start"] < found["end"] <= times(pool)[-1]
