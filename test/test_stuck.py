"""One drive that repeats its last reading while the others go on: a gap, told; a joint that stands is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from reading_cases import held_effort, repeating

from bdnn_ros import bags
from bdnn_ros.checks import efforts
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.recorded.velocity_filter import reported_velocity
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import RecordingError
from bdnn_ros.online.chunks import Chunks
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import mended, prepare
from bdnn_ros.signals.stuck import stuck, without_stuck
from bdnn_ros.signals.unmeasured import held_alone
from bdnn_ros.simulation.simulate import simulate

RATE = 200.0
FRICTION = "coulomb_friction@arm2_joint2:coulomb=0.5"


def swing(seconds: float = 20.0, noise: float = 1e-5) -> Recording:
    """Two joints that swing, measured with noise."""
    time = np.arange(int(seconds * RATE)) / RATE
    position = np.stack([np.sin(2.0 * time), 0.5 * np.cos(3.0 * time)], axis=1)
    velocity = np.stack([2.0 * np.cos(2.0 * time), -1.5 * np.sin(3.0 * time)], axis=1)
    rng = np.random.default_rng(0)
    return Recording(
        time,
        ("a", "b"),
        position + noise * rng.standard_normal(position.shape),
        velocity + 100.0 * noise * rng.standard_normal(position.shape),
        np.sign(velocity) + position + 1e3 * noise * rng.standard_normal(position.shape),
    )


@pytest.mark.parametrize("reported", [True, False], ids=["velocity", "no velocity"])
@pytest.mark.parametrize(
    "spans", [[(1400, 1500)], [(1400, 2200)], [(k, k + 20) for k in range(200, 3800, 400)]]
)
def test_a_drive_that_repeats_its_last_reading_is_found_to_the_sample(spans, reported):
    recording = repeating(swing(), 0, spans)
    recording = recording if reported else replace(recording, velocity=None)
    found = stuck(recording)
    assert not found[:, 1].any()
    assert np.flatnonzero(found[:, 0]).tolist() == [row for a, b in spans for row in range(a + 1, b)]


@pytest.mark.parametrize("since", [3000, 3900])
def test_a_drive_that_never_comes_back_stopped_at_once(since):
    recording = repeating(swing(), 1, [(since, 4000)])
    for one in (recording, replace(recording, velocity=None)):
        assert np.flatnonzero(stuck(one)[:, 1]).tolist() == list(range(since + 1, 4000))


def test_all_joints_rows_are_left_out_and_told():
    kept = without_stuck(repeating(swing(), 0, [(1400, 1500)]))
    assert len(kept) == 3901 and len(kept.segments()) == 2
    (note,) = kept.notes
    assert "a repeated the last reading in motion for 0.49 s in all, first at 7.0" in note
    assert without_stuck(kept) is kept


def test_a_position_that_never_changes_in_motion_is_refused(tmp_path, capsys):
    recording = swing()
    position = recording.position.copy()
    position[:, 0] = position[0, 0]
    frozen = replace(recording, position=position)
    with pytest.raises(RecordingError, match="position of a never changes, though the velocity"):
        prepare(frozen)
    assert main(["info", str(bags.write(frozen, tmp_path / "bag"))]) == 1
    assert "position of a never changes" in capsys.readouterr().err


def _standing(recording: Recording, rows: slice, ramp: int = 100) -> Recording:
    """Joint a slows down, stands for these rows to the last bit, and starts again."""
    rest = np.ones(len(recording))
    rest[rows] = 0.0
    pace = np.convolve(np.pad(rest, ramp // 2, mode="edge"), np.ones(ramp) / ramp, mode="same")[
        ramp // 2 : -(ramp // 2)
    ]
    pace[np.abs(pace) < 1e-9] = 0.0
    phase = np.cumsum(pace) / RATE
    position, velocity = recording.position.copy(), recording.velocity.copy()
    position[:, 0], velocity[:, 0] = np.sin(2.0 * phase), 2.0 * pace * np.cos(2.0 * phase)
    return replace(recording, position=position, velocity=velocity)


@pytest.mark.parametrize("power", ["measured", "braked", "exact"])
def test_a_joint_that_stands_is_not_taken_for_it(power):
    recording = _standing(swing(), slice(1400, 2200))
    effort = recording.require_effort().copy()
    if power != "measured":
        effort[1460:2140, 0] = 0.0 if power == "braked" else 1.234
    for velocity in (recording.velocity, None):
        assert not stuck(replace(recording, velocity=velocity, effort=effort)).any()


def test_a_standing_joint_that_is_read_wrong_for_a_sample_is_not_taken_for_it():
    recording = _standing(swing(), slice(1400, 2200))
    recording.position[1800:1803, 0] += 1.0
    assert not stuck(recording).any()


@pytest.mark.parametrize("step", [1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("slower", [1.0, 50.0])
def test_coarse_encoders_are_not_taken_for_it(step, slower):
    recording = swing()
    turned = slice(1400, 2800)  # joint a creeps there
    position = recording.position.copy()
    pace = np.ones(len(recording))
    pace[turned] = 1.0 / slower
    position[:, 0] = np.sin(2.0 * np.cumsum(pace) / RATE)
    coarse = replace(
        recording,
        position=step * np.round(position / step),
        velocity=None,
        effort=0.1 * np.round(recording.require_effort() / 0.1),
    )
    assert not stuck(coarse).any()


def test_a_stiff_gripper_that_is_told_where_to_be_jumps_without_being_stuck():
    recording = swing()
    position, velocity = recording.position.copy(), recording.velocity.copy()
    position[:, 0] = np.repeat([0.0, 0.04, 0.0, 0.04], 1000)
    velocity[:, 0] = np.random.default_rng(1).normal(0.0, 1e-3, len(velocity))
    assert not stuck(replace(recording, position=position, velocity=velocity)).any()


def test_a_pause_between_two_places_is_no_jump():
    recording = _standing(swing(), slice(1400, 2200))
    kept = recording.part(np.delete(np.arange(4000), slice(1700, 3000)))
    assert not stuck(kept).any()


def test_an_effort_that_is_held_alone_does_not_count_and_is_told():
    recording = held_effort(swing(), 0, slice(1400, 2200))
    assert np.flatnonzero(held_alone(recording)[:, 0]).tolist() == list(range(1401, 2200))
    (remark,) = efforts.unread(recording)
    assert "the effort of a stands still for 4 s while the joint moves" in remark.problem
    signals = prepare(recording)
    assert (
        not signals.seen[(signals.time > 7.2) & (signals.time < 10.8), 0].any() and signals.seen[:, 1].all()
    )


@pytest.mark.parametrize("seconds", [1.5, 9.0])
def test_live_chunks_leave_out_what_a_drive_repeats_however_long(seconds):
    last = int((6.0 + seconds) * RATE)
    recording = repeating(swing(), 0, [(1200, last)])
    chunks = Chunks(recording.joints)
    moments = []
    for rows in np.array_split(np.arange(len(recording)), 80):
        found = chunks.add(recording.time[rows], recording.position[rows], recording.effort[rows])
        moments += [one[0].time[one[1]] for one in found if one is not None]
    times = np.concatenate(moments)
    # until a first chunk has seen for how long it stays nothing tells; the rest is left out
    assert not ((times > 6.05) & (times < 6.0 + seconds)).any()
    assert (times < 5.5).any() and (times > 6.5 + seconds).any()
    # and they are counted once each, of the joint that it was
    assert last - 1200 - RATE <= chunks.repeated[0] <= last - 1200 and chunks.repeated[1] == 0


def test_a_driver_that_stands_still_makes_no_velocity_late():
    recording = swing()
    for joint in (0, 1):
        recording = repeating(recording, joint, [(1400, 2200)])
    assert reported_velocity([recording]) == []
    assert len(mended(recording)) == 3201


@pytest.mark.slow
@pytest.mark.parametrize(
    "spans", [[(1400, 1500)], [(1400, 2200)], [(k, k + 20) for k in range(200, 3800, 400)]]
)
def test_the_right_cause_is_named(spans):
    robot = Robot.bundled("arm2")
    recording = simulate(robot, [parse_spec(FRICTION, robot)], seed=3, duration=20.0, rate=RATE).recording
    found = diagnose([repeating(recording, 0, spans)], robot)
    assert [(one.effect, one.joint) for one in found.findings] == [("coulomb_friction", "arm2_joint2")]
    assert found.findings[0].parameters["coulomb"].value == pytest.approx(0.5, abs=0.05)
