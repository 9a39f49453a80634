"""Several recordings as one: their clock, their noise, and what is said of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.joining import concatenated
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.simulate import simulate

ARM = Robot.bundled("arm2")


def recorded(seed: int, *specs: str, rate: float = 100.0) -> Recording:
    effects = [parse_spec(spec, ARM) for spec in specs]
    made = simulate(ARM, effects, seed=seed, duration=20.0, rate=rate).recording
    return replace(made, name=f"bag{seed}")


def test_the_noise_of_the_efforts_is_the_largest_in_either_order():
    quiet = recorded(1)
    noise = np.random.default_rng(0).standard_normal((len(quiet), 2))
    parts = [prepare(quiet), prepare(replace(quiet, effort=quiet.require_effort() + noise))]
    for order in (parts, parts[::-1]):
        np.testing.assert_array_equal(concatenated(order).effort_noise, parts[1].effort_noise)


def test_a_push_in_one_of_several_is_told_with_when_each_begins():
    """Its time is of no recording's own clock."""
    pushed = recorded(2, "external_wrench@arm2_joint2:torque=3,start=9,end=11")
    for recordings, start in (([pushed], 9.0), ([recorded(1), pushed], 30.0)):
        found = diagnose(recordings, ARM)
        (finding,) = found.findings
        assert finding.parameters["start"].value == pytest.approx(start, abs=0.02)
        told = [note for note in found.notes if "one clock" in note]
        assert told == [
            "Times are told on one clock, on which the recordings follow one another: "
            "bag1 begins at 0.0 s, bag2 begins at 21.0 s."
        ] * (len(recordings) - 1)


def test_recordings_of_two_rates_go_together_by_one_cutoff():
    """They did up to the end, where the reported velocities were prepared as each by itself is."""
    found = diagnose([recorded(1, rate=50.0), recorded(2)], ARM, cutoff=8.0)
    assert found.verdict == "nothing_wrong"


def test_recordings_of_one_rate_go_together_though_their_clocks_differ():
    """Of slow ones the low-pass follows the rate that was measured, which is never twice the same."""
    slow, other = recorded(1, rate=50.0), recorded(2, rate=50.0)
    found = diagnose([slow, replace(other, time=1.0003 * other.time)], ARM)
    assert found.verdict == "nothing_wrong"
