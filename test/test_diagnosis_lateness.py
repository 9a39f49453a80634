"""Efforts that come late are moved to when they acted, and told; what acts late is a cause and stays one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.recorded.lateness import Lateness, lateness, without_lateness
from bdnn_ros.effects.bristles import bristle
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.models import load_model, save_model
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import score_model
from bdnn_ros.signals import prepare
from bdnn_ros.signals.kernels import lagging
from bdnn_ros.simulation.excitation import fourier
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.simulate import simulate


def late(recording: Recording, seconds: float) -> Recording:
    samples = round(seconds * recording.rate)
    effort = recording.require_effort()
    return replace(recording.part(slice(samples, None)), effort=effort[: len(effort) - samples])


def smoothed(recording: Recording, lag: float) -> Recording:
    """Efforts behind exponential smoothing of a time constant [s], begun anew after each gap."""
    share = 1.0 / (1.0 + lag * recording.rate)
    parts = [recording.require_effort()[rows] for rows in recording.segments()]
    done = [lfilter([share], [1.0, share - 1.0], part - part[0], axis=0) + part[0] for part in parts]
    return replace(recording, effort=np.concatenate(done))


def extended(robot: Robot) -> Callable[[Sequence[Recording]], ExtendedModel]:
    """What diagnoses recordings of a robot and extends it."""
    return lambda recordings: extend(examine(recordings, robot))


@pytest.mark.parametrize("name, seed", [("arm2", 1), ("arm6", 2), ("arm7", 3)])
@pytest.mark.parametrize("seconds", [0.0, 0.02, 0.05, 0.12])
def test_lateness_is_found_to_some_milliseconds(name, seed, seconds):
    robot = Robot.bundled(name)
    recording = Scenario(robot, seed=seed, duration=15.0, worn=True, wrong=0.05).run()[0].recording
    found = lateness(prepare(late(recording, seconds)), robot)
    assert max(seconds - 0.005, 0.0) <= found.delay <= seconds and not found.lag


def test_joints_that_stand_still_have_no_say():
    """Nor has their sensors' noise: half of the joints move, and all of these are late."""
    robot = Robot.bundled("arm6")
    still = np.arange(robot.width) >= 3
    plan = fourier(robot, np.arange(15 * 250) / 250.0, np.random.default_rng(3))
    position = np.where(still, plan.position[0], plan.position)
    velocity, acceleration = (np.where(still, 0.0, one) for one in (plan.velocity, plan.acceleration))
    effort = robot.inverse_dynamics(position, velocity, acceleration)
    effort += 0.3 * np.std(effort, axis=0) * np.sign(velocity)
    effort += still * 2.0 * np.random.default_rng(1).standard_normal(effort.shape)
    recording = late(Recording(plan.time, robot.joints, position, None, effort), 0.016)
    found = lateness(prepare(recording), robot)
    assert 0.011 <= found.delay <= 0.016 and not found.lag


@pytest.mark.parametrize("name, seed", [("arm2", 1), ("arm6", 2), ("arm7", 3)])
@pytest.mark.parametrize("lag", [0.03, 0.05, 0.12])
def test_a_lag_is_told_from_a_delay_and_found_to_some_milliseconds(name, seed, lag):
    robot = Robot.bundled(name)
    recording = Scenario(robot, seed=seed, duration=15.0, worn=True, wrong=0.05).run()[0].recording
    found = lateness(prepare(smoothed(recording, lag)), robot)
    assert lag - 0.006 <= found.lag <= lag and not found.delay


def test_what_smoothing_did_is_taken_back():
    recording = simulate(Robot.bundled("arm2"), seed=1, duration=3.0).recording
    gap = np.r_[0:500, 700:1500]
    recording = recording.part(gap)
    (back,), _ = without_lateness([smoothed(recording, 0.05)], Lateness(lag=0.05))
    kept = np.isin(recording.time, back.time)
    assert kept.sum() == len(recording) - 2  # what came before a piece's first effort is not known
    np.testing.assert_allclose(back.require_effort(), recording.require_effort()[kept], atol=1e-9)
    assert "of about 3.1 Hz" in back.notes[-1]


@pytest.mark.parametrize(
    "specs",
    [
        ["effort_delay:delay=0.05"],
        ["joint_elasticity@arm2_joint2:stiffness=300"],
        ["viscous_friction@arm2_joint1:viscous=10", "viscous_friction@arm2_joint2:viscous=5"],
    ],
    ids=["effort acts late", "soft gear", "friction above all"],
)
def test_what_acts_late_or_with_speed_is_no_lateness(specs):
    robot = Robot.bundled("arm2")
    effects = [parse_spec(spec, robot) for spec in specs]
    recording = simulate(robot, effects, seed=1, duration=15.0).recording
    assert lateness(prepare(recording), robot) == Lateness()


@pytest.mark.parametrize("name", ["arm2", "arm6"])
@pytest.mark.parametrize("breakaway", [0.001, 0.004, 0.02])
def test_friction_that_comes_on_along_the_way_is_no_lateness(name, breakaway):
    """Where slow joints turn round their bristles bend first, so that friction turns late without being late."""
    robot, time = Robot.bundled(name), np.arange(8000) / 200.0
    rate = 0.8 * (1.0 + 0.13 * np.arange(robot.width))
    phase = time[:, None] * rate + 1.1 * np.arange(robot.width)
    position, velocity, acceleration = (
        0.5 * np.sin(phase),
        0.5 * rate * np.cos(phase),
        -0.5 * rate**2 * np.sin(phase),
    )
    effort = robot.rigid_effort(position, velocity, acceleration)
    size = 0.3 * np.std(effort, axis=0)
    effort += size * np.stack([bristle(q, breakaway) for q in position.T], axis=1) + 0.2 * size * velocity
    rng = np.random.default_rng(0)
    position += 1e-5 * rng.standard_normal(position.shape)
    effort += 0.005 * np.std(effort, axis=0) * rng.standard_normal(effort.shape)
    recording = Recording(time, robot.joints, position, velocity, effort)
    assert lateness(prepare(recording), robot) == Lateness()


def test_efforts_move_within_their_pieces():
    time = np.concatenate([np.arange(100), np.arange(200, 300)]) / 100.0
    effort = np.arange(200.0)[:, None]
    recording = Recording(time, ("a",), np.zeros((200, 1)), effort=effort)
    (moved,), _ = without_lateness([recording], Lateness(delay=0.05))
    np.testing.assert_array_equal(moved.time, np.concatenate([time[:95], time[100:195]]))
    np.testing.assert_array_equal(
        moved.require_effort()[:, 0], np.concatenate([effort[5:100, 0], effort[105:, 0]])
    )
    assert "comes about 51 ms after the motion" in moved.notes[0]
    assert without_lateness([recording], Lateness()) == ([recording], Lateness())


def test_what_is_taken_back_is_what_the_efforts_move_by():
    """Whole samples, though a lateness is none; nothing where pieces are too short for it."""
    recording, fast = (
        Recording(np.arange(n) / n, ("a",), np.zeros((n, 1)), effort=np.arange(float(n))[:, None])
        for n in (50, 100)
    )
    by_two = Lateness(delay=0.0335)
    (moved,), back = without_lateness([recording], by_two)
    assert moved.require_effort()[0, 0] == 2.0
    assert back.delay == pytest.approx(0.04)
    assert without_lateness([recording, fast], by_two)[1].delay == pytest.approx((0.04 + 2 * 0.03) / 3)
    short = recording.part(slice(0, 2))
    assert without_lateness([short], by_two) == ([short], Lateness())
    assert without_lateness([recording], Lateness(lag=0.03))[1] == Lateness(lag=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("build", [lambda robot: Identifier(robot).fit, extended])
def test_a_model_predicts_efforts_that_come_late_by_no_whole_samples(build):
    """Its lead counted all of the delay, where whole samples were taken back: off by a third of one."""
    robot = Robot.bundled("arm2")
    recording = Scenario(robot, seed=6, duration=30.0, worn=True, rate=500.0).run()[0].recording
    effort = np.stack([np.interp(recording.time - 0.0345, recording.time, e) for e in recording.effort.T], 1)
    seldom = replace(recording, effort=effort, velocity=None).part(slice(50, None, 10))
    model = build(robot)([seldom])
    assert model.lead == pytest.approx(-0.0345, abs=0.003)
    assert score_model(model, [prepare(seldom)]).nrmse_mean < 0.025


@pytest.mark.slow
def test_the_same_is_named_and_the_extended_model_predicts_what_is_recorded():
    robot = Robot.bundled("arm6")
    spec = parse_spec("viscous_friction@arm6_joint2:viscous=8.0", robot)
    recording = late(simulate(robot, [spec], seed=1, duration=20.0).recording, 0.06)
    examination = examine([recording], robot)
    (finding,) = examination.diagnosis.findings
    assert (finding.effect, finding.joint) == ("viscous_friction", "arm6_joint2")
    assert finding.parameters["viscous"].value == pytest.approx(8.0, rel=0.02)
    assert any("after the motion it belongs to" in note for note in examination.recordings[0].notes)
    assert score_model(extend(examination), [prepare(recording)]).nrmse_mean < 0.02


def test_info_tells_of_it(tmp_path, capsys):
    robot = Robot.bundled("arm2")
    recording = Scenario(robot, seed=11, duration=15.0, worn=True).run()[0].recording
    for name, one, words in (
        ("as-it-is", recording, ""),
        ("late", late(recording, 0.05), "after the motion it belongs to"),
        ("slow", smoothed(recording, 0.05), "a low-pass of first order"),
    ):
        assert main(["info", str(bags.write(one, tmp_path / name))]) == 0
        out = " ".join(capsys.readouterr().out.split())
        assert words in out
        assert words or not ("after the motion" in out or "first order" in out)


@pytest.mark.slow
def test_friction_behind_a_slow_effort_sensor_is_named_as_what_it_is():
    robot = Robot.bundled("arm6")
    specs = ["coulomb_friction@arm6_joint3:coulomb=6", "viscous_friction@arm6_joint2:viscous=8"]
    effects = [parse_spec(spec, robot) for spec in specs]
    recording = smoothed(simulate(robot, effects, seed=1, duration=20.0).recording, 0.06)
    examination = examine([recording], robot)
    found = {(f.effect, f.joint): f.parameters for f in examination.diagnosis.findings}
    assert set(found) == {("coulomb_friction", "arm6_joint3"), ("viscous_friction", "arm6_joint2")}
    assert found["coulomb_friction", "arm6_joint3"]["coulomb"].value == pytest.approx(6.0, rel=0.05)
    assert found["viscous_friction", "arm6_joint2"]["viscous"].value == pytest.approx(8.0, rel=0.05)
    assert any("low-pass of first order" in note for note in examination.diagnosis.notes)
    assert score_model(extend(examination), [prepare(recording)]).nrmse_mean < 0.05


@pytest.mark.slow
def test_what_is_identified_predicts_efforts_as_late_as_they_came():
    robot = Robot.bundled("arm6")
    recording = Scenario(robot, seed=6, duration=20.0, worn=True, wrong=0.05).run()[0].recording
    before = score_model(Identifier(robot).fit([recording]), [prepare(recording)]).nrmse_mean
    model = Identifier(robot).fit([late(recording, 0.06)])
    assert model.lead == pytest.approx(-0.06, abs=0.004)
    assert score_model(model, [prepare(late(recording, 0.06))]).nrmse_mean < before + 0.02


@pytest.mark.slow
def test_what_is_identified_predicts_efforts_as_slow_as_they_came(tmp_path):
    robot = Robot.bundled("arm6")
    recording = Scenario(robot, seed=6, duration=20.0, worn=True, wrong=0.05).run()[0].recording
    slow = smoothed(recording, 0.06)
    before = score_model(Identifier(robot).fit([recording]), [prepare(recording)]).nrmse_mean
    model = Identifier(robot).fit([slow])
    assert model.lag == pytest.approx(0.06, abs=0.004)
    again = load_model(save_model(tmp_path, model))
    assert score_model(again, [prepare(slow)]).nrmse_mean < before + 0.02


def test_a_lag_is_a_low_pass_of_first_order():
    time = np.arange(0.0, 20.0, 0.005)
    wave = np.sin(2.0 * np.pi * 1.5 * time)[:, None]
    slow = lagging(wave, 0.08, 200.0)[2000:, 0]
    gain = 1.0 / (1.0 + 2j * np.pi * 1.5 * 0.08)
    expected = np.imag(gain * np.exp(2j * np.pi * 1.5 * time))[2000:]
    np.testing.assert_allclose(slow, expected, atol=2e-3)
    np.testing.assert_allclose(lagging(np.full((50, 2), 3.0), 0.08, 200.0), 3.0)  # at rest from the first
