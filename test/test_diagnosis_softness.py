"""Efforts that were low-passed before they were recorded are told, and what is sharp is softened alike; soft gears are not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.recorded.softness import Softness, softened, softness
from bdnn_ros.diagnosis.sentences import Kind
from bdnn_ros.effects.bristles import bristle
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, flattened, prepare
from bdnn_ros.signals.lowpasses import Lowpass, Restored
from bdnn_ros.simulation.excitation import smooth_step
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.simulate import simulate


def lowpassed(recording: Recording, cutoff: float, order: int = 2) -> Recording:
    """All signals behind a zero-phase Butterworth low-pass [Hz]."""
    sos = butter(order, cutoff, fs=recording.rate, output="sos")

    def passed(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else sosfiltfilt(sos, values, axis=0)

    position, velocity, effort = map(passed, (recording.position, recording.velocity, recording.effort))
    assert position is not None
    return replace(recording, position=position, velocity=velocity, effort=effort)


def seen(recording: Recording) -> Signals:
    return flattened(prepare(recording), 7.0)


@cache
def recorded(name: str) -> Recording:
    """A worn robot, its links a little off."""
    seed = {"arm2": 11, "arm6": 2, "arm7": 31}[name]
    return Scenario(Robot.bundled(name), seed=seed, duration=15.0, worn=True, wrong=0.05).run()[0].recording


@pytest.mark.parametrize("name", ["arm2", "arm6", "arm7"])
def test_no_lowpass_is_found_where_there_was_none(name):
    assert softness(seen(recorded(name)), Robot.bundled(name)) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, cutoff, order",
    [
        *(("arm2", 1.5, 2), ("arm2", 3.0, 2), ("arm2", 3.0, 4), ("arm2", 5.0, 2)),
        *(("arm6", 3.0, 4), ("arm6", 5.0, 2), ("arm7", 1.5, 2), ("arm7", 3.0, 2)),
    ],
)
def test_a_lowpass_before_the_recording_is_found(name, cutoff, order):
    found = softness(seen(lowpassed(recorded(name), cutoff, order)), Robot.bundled(name))
    assert found is not None and found.motion
    assert found.lowpass.cutoff == pytest.approx(cutoff, rel=0.05)
    assert found.lowpass.order == order


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, cutoff, order",
    [
        *(("arm2", 3.0, 2), ("arm2", 3.0, 4), ("arm2", 5.0, 2)),
        *(("arm6", 3.0, 2), ("arm7", 3.0, 4)),
    ],
)
def test_a_lowpass_of_the_efforts_alone_is_told_from_one_of_the_motion_too(name, cutoff, order):
    recording = recorded(name)
    softer = replace(recording, effort=lowpassed(recording, cutoff, order).effort)
    found = softness(seen(softer), Robot.bundled(name))
    assert found is not None and not found.motion
    assert found.lowpass.cutoff == pytest.approx(cutoff, rel=0.05)
    assert found.lowpass.order == order


@pytest.mark.parametrize(
    "specs",
    [
        [
            "hysteresis@arm2_joint1:force=0.5,breakaway=0.05",
            "hysteresis@arm2_joint2:force=0.05,breakaway=0.05",
        ],
        ["joint_elasticity@arm2_joint1:stiffness=30", "joint_elasticity@arm2_joint2:stiffness=8"],
        ["viscous_friction@arm2_joint1:viscous=1", "coulomb_friction@arm2_joint2:coulomb=0.05"],
        [],
    ],
    ids=["gives way little by little", "soft gears", "friction", "nothing"],
)
def test_what_is_soft_in_the_robot_is_no_lowpass(specs):
    robot = Robot.bundled("arm2")
    effects = [parse_spec(spec, robot) for spec in specs]
    recording = simulate(robot, effects, seed=1, duration=15.0).recording
    assert softness(seen(recording), robot) is None


def test_a_joint_that_moves_at_the_end_alone_hides_no_lowpass():
    robot = Robot.bundled("arm2")
    recording = recorded("arm2")
    position, late = recording.position.copy(), int(0.95 * len(recording))
    position[:late, 1] = position[late, 1]
    found = softness(seen(lowpassed(replace(recording, position=position, velocity=None), 3.0)), robot)
    assert found is not None and found.lowpass.cutoff == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("travel", [0.0005, 0.002, 0.005])
def test_what_rests_between_its_moves_is_no_lowpass(travel):
    """Where it starts a joint bears little by little what friction will ask of it, in time as in travel."""
    robot, rate, rng = Robot.bundled("arm6"), 200.0, np.random.default_rng(1)
    low, high = np.maximum(robot.limits.lower, -1.2), np.minimum(robot.limits.upper, 1.2)
    points = rng.uniform(low, high, (13, robot.width))
    step, speed, change = smooth_step(np.arange(500) / 500)
    rest = np.zeros((200, robot.width))
    position, velocity, acceleration = [], [], []
    for start, end in pairwise(points):
        way, lasts = end - start, len(step) / rate
        position += [start + np.outer(step, way), end + rest]
        velocity += [np.outer(speed, way) / lasts, rest]
        acceleration += [np.outer(change, way) / lasts**2, rest]
    q, v, a = map(np.concatenate, (position, velocity, acceleration))
    effort = robot.inverse_dynamics(q, v, a)
    scale = effort.std(axis=0)
    effort += 0.3 * scale * np.stack([bristle(one, travel) for one in q.T], axis=1)
    effort += 0.005 * scale * rng.standard_normal(effort.shape)
    time, noise = np.arange(len(q)) / rate, 1e-5 * rng.standard_normal(q.shape)
    recording = Recording(time, robot.joints, q + noise, None, effort, urdf=robot.urdf)
    assert softness(seen(recording), robot) is None


@pytest.mark.parametrize("cutoff, order", [(1.5, 2), (3.0, 4), (5.0, 2)])
def test_what_was_let_through_is_given_back(cutoff, order):
    robot = Robot.bundled("arm2")
    recording = Scenario(robot, seed=11, duration=15.0, worn=True).run()[0].recording
    lowpass = Lowpass(cutoff, order)
    back = softened(seen(lowpassed(recording, cutoff, order)), Softness(lowpass, motion=True))
    whole = seen(recording)
    assert 8.0 < back.time[-1] - back.time[0] < 15.0  # ends, of which part was never recorded, are left out
    kept = np.isin(whole.time, back.time)
    assert back.cutoff < Restored(lowpass).edge
    for name in ("position", "velocity", "acceleration", "effort"):
        expected = whole.through(getattr(whole, name), Restored(lowpass))[kept]
        error = np.std(getattr(back, name) - expected, axis=0) / np.std(expected, axis=0)
        assert np.all(error < 0.02), name


def test_half_of_a_segment_stays_that_is_too_short_to_leave_its_ends_out():
    robot = Robot.bundled("arm2")
    recording = Scenario(robot, seed=11, duration=15.0, worn=True).run()[0].recording
    short = seen(recording).between(5.0, 7.0)
    back = softened(short, Softness(Lowpass(0.7, 4), motion=True))
    assert len(back) == pytest.approx(len(short) / 2, abs=2)


def test_info_tells_of_it(tmp_path, capsys):
    robot = Robot.bundled("arm2")
    recording = Scenario(robot, seed=11, duration=15.0, worn=True).run()[0].recording
    for one, told in ((recording, False), (lowpassed(recording, 3.0), True)):
        path = bags.write(one, tmp_path / str(told))
        assert main(["info", str(path)]) == 0
        assert ("efforts were low-passed at about" in capsys.readouterr().out) == told


@pytest.mark.slow
@pytest.mark.parametrize("start, named", [(17.0, ["external_wrench"]), (19.5, [])])
def test_what_pushes_in_the_last_half_second_alone_may_be_what_a_filter_made_of_the_end(start, named):
    robot = Robot.bundled("arm2")
    push = parse_spec(f"external_wrench@arm2_joint1:torque=1.5,start={start},end=20", robot)
    recording = simulate(robot, [push], seed=3, duration=20.0, rate=200.0).recording
    diagnosis = examine([recording], robot).diagnosis
    assert [finding.effect for finding in diagnosis.findings] == named
    assert (Kind.AT_AN_END in diagnosis.kinds) == (not named)


@pytest.mark.slow
def test_friction_behind_a_lowpass_is_named_as_what_it_is():
    robot = Robot.bundled("arm2")
    specs = [
        *("coulomb_friction@arm2_joint1:coulomb=0.6", "coulomb_friction@arm2_joint2:coulomb=0.08"),
        *("viscous_friction@arm2_joint1:viscous=0.3", "viscous_friction@arm2_joint2:viscous=0.04"),
    ]
    effects = [parse_spec(spec, robot) for spec in specs]
    recording = simulate(robot, effects, seed=4, duration=30.0).recording
    diagnosis = examine([lowpassed(recording, 2.5)], robot).diagnosis
    assert {(f.effect, f.joint) for f in diagnosis.findings} == {
        (e.effect.name, robot.joints[e.target]) for e in effects
    }
    for finding in diagnosis.findings:
        (truth,) = (
            e for e in effects if (e.effect.name, robot.joints[e.target]) == (finding.effect, finding.joint)
        )
        for name, quantity in finding.parameters.items():
            assert quantity.value == pytest.approx(truth.values[name], rel=0.1)
    assert any("low-passed at about" in note for note in diagnosis.notes)
