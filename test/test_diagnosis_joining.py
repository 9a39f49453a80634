"""Several recordings as one: their clock, their noise, and what is said of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.recorded.joining import (
    concatenated,
    own_zeros,
    owners,
    prepared_alike,
    starts,
    stretches,
)
from bdnn_ros.diagnosis.result import Finding, Quantity
from bdnn_ros.diagnosis.sentences import Kind
from bdnn_ros.diagnosis.telling.notes import one_clock
from bdnn_ros.effects.environment import EDGES
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.scenario import Scenario
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


@pytest.mark.parametrize("rates", [(100.0, 1000.0), (1000.0, 100.0), (500.0, 1000.0), (125.0, 100.0)])
@pytest.mark.parametrize("cutoff", [None, 7.0])
def test_recordings_of_any_two_rates_go_together(rates, cutoff):
    """Each joint as it moved, at one rate, whatever suits the recordings by themselves."""
    time = [np.arange(round(6.0 * rate)) / rate for rate in rates]
    made = [Recording(t, ("a",), np.sin(2.0 * t)[:, None], effort=np.cos(2.0 * t)[:, None]) for t in time]
    parts = prepared_alike(made, cutoff)
    joined = concatenated(parts)
    for part, piece in zip(parts, joined.segments, strict=True):
        np.testing.assert_allclose(np.diff(part.time), 1.0 / joined.rate, rtol=1e-9)
        np.testing.assert_array_equal(joined.velocity[piece], part.velocity)
        np.testing.assert_allclose(part.velocity[:, 0], 2.0 * np.cos(2.0 * part.time), atol=2e-3)
    assert joined.raw_rate == pytest.approx(min(rates))


@pytest.mark.parametrize("rates", [(100.0, 1000.0), (1000.0, 100.0)])
def test_a_velocity_that_one_driver_differentiates_is_no_low_pass_of_anothers(rates):
    """It is half a sample late, which is much for the other."""
    made = [
        Scenario(ARM, seed=k, duration=10.0, rate=rate, velocity="differentiated").run()[0].recording
        for k, rate in enumerate(rates, start=1)
    ]
    assert diagnose(made, ARM).findings == ()


@pytest.mark.slow
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


@pytest.mark.parametrize("first", [0.0, 7.0, -3.0])
def test_what_is_cut_away_moves_no_time_of_what_is_left(first):
    """The note told when the first sample that was left came, and times were off by all that was cut away before it."""
    one, other = (replace(recorded(seed), time=recorded(seed).time + first) for seed in (1, 2))
    push = Finding(
        "external_wrench", None, "arm2_link2", {e: Quantity(30.0, 0.1, "s") for e in EDGES}, 0.5, 0.99, (), ""
    )
    for before, after in ((one, other), (one.between(first + 4.0, 99.0), other.between(first + 9.0, 99.0))):
        recordings = [before, after]
        joined = concatenated(prepared_alike(recordings), [recording.time for recording in recordings])
        (note,) = one_clock(recordings, [push])
        told = [one.values["start"] for one in note.values["begin"]]
        assert told == pytest.approx([0.0, before.time[-1] + 1.0 - min(after.time[0], 0.0)], abs=0.051)
        for recording, begin in zip(recordings, own_zeros([before.time, after.time]), strict=True):
            at = begin + first + 15.0
            own, theirs = (np.interp(first + 15.0, recording.time, q) for q in recording.position.T)
            assert np.interp(at, joined.time, joined.position[:, 0]) == pytest.approx(own, abs=1e-3)
            assert np.interp(at, joined.time, joined.position[:, 1]) == pytest.approx(theirs, abs=1e-3)
        assert (np.diff(joined.time) > 0.0).all()
        assert starts([before.time, after.time])[0] == before.time[0]


@pytest.mark.slow
def test_a_push_that_lasts_until_a_recording_ends_is_over_then():
    """Not when the next one begins: nobody knows what was in between."""
    pushed = recorded(2, "external_wrench@arm2_joint2:torque=3,start=17,end=99")
    (finding,) = diagnose([pushed, recorded(1)], ARM).findings
    assert 19.8 < finding.parameters["end"].value < 20.1


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False])
def test_what_pushes_at_an_inner_end_only_is_at_an_end(first):
    """A filter makes the same of every recording's ends, wherever it comes in a row."""
    pushed = recorded(2, "external_wrench@arm2_joint2:torque=3,start=19.45,end=99")
    found = diagnose([pushed, recorded(1)] if first else [recorded(1), pushed], ARM)
    assert found.findings == () and Kind.AT_AN_END in found.kinds


def test_every_row_is_of_the_recording_that_began_last():
    parts = [prepare(recorded(seed)) for seed in (1, 2)]
    assert parts[0].begun == ()
    joined = concatenated(parts)
    np.testing.assert_array_equal(owners(joined.time, joined.begun), np.repeat([1, 2], [*map(len, parts)]))
    ends = np.array(stretches(joined.time, joined.begun))
    np.testing.assert_allclose(ends - ends[:, :1], [[0.0, np.ptp(part.time)] for part in parts])
    assert stretches(parts[0].time, ()) == [(parts[0].time[0], parts[0].time[-1])]


def test_the_clock_of_all_is_that_of_the_first():
    """Which may begin later than its recording: what it shows is told at its time there."""
    first, second = recorded(1), recorded(2)
    parts = [prepare(replace(one, time=one.time + late)) for one, late in ((first, 3.0), (second, 8.0))]
    joined = concatenated(parts, [first.time + 3.0, second.time + 8.0])
    np.testing.assert_allclose(joined.time[: len(parts[0])], parts[0].time)
    np.testing.assert_allclose(joined.time[len(parts[0]) :], parts[1].time + 24.0, atol=0.02)


def test_recordings_of_two_rates_go_together_by_one_cutoff():
    """They did up to the end, where the reported velocities were prepared as each by itself is."""
    found = diagnose([recorded(1, rate=50.0), recorded(2)], ARM, cutoff=8.0)
    assert found.verdict == "nothing_wrong"


@pytest.mark.slow
def test_recordings_of_one_rate_go_together_though_their_clocks_differ():
    """Of slow ones the low-pass follows the rate that was measured, which is never twice the same."""
    slow, other = recorded(1, rate=50.0), recorded(2, rate=50.0)
    found = diagnose([slow, replace(other, time=1.0003 * other.time)], ARM)
    assert found.verdict == "nothing_wrong"
