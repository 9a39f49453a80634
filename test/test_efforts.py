"""Efforts that are not all of the N·m that drive the joints, and how a user says so."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.efforts import EffortConvention
from bdnn_ros.errors import UsageError
from bdnn_ros.online.serving import Settings
from bdnn_ros.online.session import Session
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.feed import Feed
from bdnn_ros.online.stream.intake import CommandIntake, Intake
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.simulate import simulate

MS = 1_000_000


@pytest.fixture(scope="module")
def arm() -> Robot:
    return Robot.bundled("arm2")


@pytest.fixture(scope="module")
def plain(arm: Robot) -> Recording:
    return simulate(arm, seed=3, duration=15.0).recording


def test_rules_multiply_and_gravity_is_added(arm):
    rng = np.random.default_rng(0)
    position, effort = rng.standard_normal((2, 5, 2))
    plain = EffortConvention.of([], arm.joints)
    np.testing.assert_array_equal(plain.acting(position, effort), effort)
    rules = ["10", "arm2_joint2=-2"]
    np.testing.assert_array_equal(
        EffortConvention.of(rules, arm.joints).acting(position, effort), effort * [10.0, -2.0]
    )
    whole = EffortConvention.of(rules, arm.joints, arm).acting(position, effort)
    np.testing.assert_allclose(whole, effort * [10.0, -2.0] + arm.gravity(position))
    turned = EffortConvention.of(rules[::-1], arm.joints)  # the order makes no difference
    np.testing.assert_array_equal(turned.factors, [10.0, -2.0])
    silent = Recording(np.arange(3.0), arm.joints, np.zeros((3, 2)))
    assert plain.applied(silent) is silent


@pytest.mark.parametrize(
    "rule, sentence",
    [
        ("arm2_joint9=2", "there is no joint 'arm2_joint9'"),
        ("=2", "there is no joint ''"),
        ("arm2_joint1=", "not a number"),
        ("arm2_joint1=zwei", "not a number"),
        ("0", "other than zero"),
        ("inf", "other than zero"),
    ],
)
def test_a_bad_rule_gets_a_sentence(arm, rule, sentence):
    with pytest.raises(UsageError, match=sentence):
        EffortConvention.of([rule], arm.joints)


@pytest.mark.parametrize(
    "rules, whom", [(["arm2_joint1=2", "3", "arm2_joint1=2"], "arm2_joint1"), (["2", "2"], "all joints")]
)
def test_a_second_factor_for_the_same_is_refused(arm, rules, whom):
    with pytest.raises(UsageError, match=f"Two effort factors are given for {whom}"):
        EffortConvention.of(rules, arm.joints)


def findings(path) -> list[tuple[str, str]]:
    return [(f["effect"], f["joint"]) for f in json.loads((path / "diagnosis.json").read_text())["findings"]]


@pytest.mark.slow
def test_a_bag_of_currents_is_refused_and_read_once_the_user_says_what_they_are(arm, tmp_path, capsys):
    recording = simulate(arm, seed=3, duration=15.0).recording
    currents = replace(recording, effort=recording.require_effort() / [12.0, -9.0])
    bag, out = bags.write(currents, tmp_path / "bag"), tmp_path / "out"
    assert main(["diagnose", str(bag), "--out", str(out)]) == 1
    assert "arm2_joint2 have the wrong sign" in capsys.readouterr().err and not out.exists()
    turned = ["--effort-factor", "arm2_joint2=-1"]
    assert main(["diagnose", str(bag), "--out", str(out), *turned]) == 1
    assert "another unit" in capsys.readouterr().err and not out.exists()
    assert main(["info", str(bag), "--json", *turned]) == 0
    assert any("another unit" in concern for concern in json.loads(capsys.readouterr().out)["concerns"])
    rules = ["--effort-factor", "arm2_joint1=12", "--effort-factor", "arm2_joint2=-9"]
    assert main(["diagnose", str(bag), "--out", str(out), *rules]) == 0
    assert findings(out) == []
    assert main(["diagnose", str(bag), "--out", str(out), "--effort-factor", "wrist=2"]) == 2
    assert "no joint 'wrist'" in capsys.readouterr().err


def test_gravity_that_a_controller_adds_is_added_to_a_bag(arm, plain, tmp_path, capsys):
    effort = plain.require_effort() - arm.gravity(plain.position)
    bag, out = bags.write(replace(plain, effort=effort), tmp_path / "bag"), tmp_path / "out"
    assert main(["diagnose", str(bag), "--out", str(out)]) == 1
    assert "leave gravity out" in capsys.readouterr().err
    assert main(["diagnose", str(bag), "--out", str(out), "--add-gravity"]) == 0
    assert findings(out) == []


def test_gravity_needs_a_description(plain, tmp_path, capsys):
    bag = bags.write(replace(plain, urdf=None), tmp_path / "bag")
    assert main(["info", str(bag), "--add-gravity"]) == 2
    assert "--add-gravity needs a robot description" in capsys.readouterr().err


def test_a_live_stream_is_converted_as_a_bag_is(arm):
    settings = Settings(effort_factors=("arm2_joint2=-9", "another_arm_joint=3"), add_gravity=True)
    ring = Ring.create(100, 6)
    intake = Intake(arm.joints, ring)
    feed = Feed(arm.joints, ring, convention=settings.convention(arm))
    for k in range(50):
        intake.take(list(arm.joints), [0.3, 0.1 * k], [], [1.0, 2.0], (k + 1) * MS, (k + 1) * MS)
    samples = feed.read(100)
    np.testing.assert_allclose(samples.effort - arm.gravity(samples.position), np.tile([1.0, -18.0], (50, 1)))
    ring.close()


@pytest.mark.parametrize("reported", [np.nan, 0.0])
def test_gravity_is_no_effort_of_a_joint_without_a_sensor(arm, plain, reported):
    effort = plain.require_effort() - arm.gravity(plain.position)
    effort[:, 1] = reported
    ring = Ring.create(16384, 6)
    intake = Intake(arm.joints, ring)
    for time, position, said in zip(plain.time, plain.position, effort, strict=True):
        stamp = 10**18 + round(time * 1e9)
        intake.take(list(arm.joints), position, [], said, stamp, stamp)
    convention = Settings(add_gravity=True).convention(arm)
    live = Feed(arm.joints, ring, convention=convention).recording(0.0)
    known = np.column_stack([plain.require_effort()[-len(live) :, 0], np.zeros(len(live))])
    assert len(live) > 0.3 * len(plain)
    np.testing.assert_allclose(live.effort, known)
    samples = Feed(arm.joints, ring, convention=convention).read(len(live)).with_effort()
    np.testing.assert_allclose(samples.effort, known)
    if reported == 0.0:
        whole = EffortConvention.of([], arm.joints, arm).applied(replace(plain, effort=effort))
        np.testing.assert_allclose(whole.effort, known)
        commanded = EffortConvention.of([], arm.joints, arm).applied(replace(plain, effort=effort), True)
        np.testing.assert_allclose(commanded.effort[:, 1], arm.gravity(plain.position)[:, 1])
    ring.close()


def test_a_message_without_efforts_makes_no_sensor(arm, plain):
    effort = plain.require_effort() * [1.0, 0.0]
    effort[0] = np.nan
    sensed = EffortConvention.of([], arm.joints, arm).sensed(plain.position, effort, False)
    assert np.isnan(sensed[0]).all() and not sensed[1:, 1].any()
    np.testing.assert_allclose(sensed[1:, 0], (effort + arm.gravity(plain.position))[1:, 0])


def test_gravity_is_added_where_a_joint_is_commanded_no_effort(arm):
    states, commands = Ring.create(100, 6), Ring.create(100, 2)
    intake, orders = Intake(arm.joints, states, needs_effort=False), CommandIntake(arm.joints, commands)
    feed = Feed(arm.joints, states, commands, convention=Settings(add_gravity=True).convention(arm))
    for k in range(50):
        orders.take([1.0, 0.0], (k + 1) * MS)
        intake.take(list(arm.joints), [0.3, 0.1 * k], [], [], (k + 1) * MS, (k + 1) * MS)
    live = feed.recording(0.0)
    np.testing.assert_allclose(live.effort - arm.gravity(live.position), np.tile([1.0, 0.0], (50, 1)))
    states.close()
    commands.close()


def test_a_factor_of_a_joint_that_the_robot_lacks_is_refused_at_once(arm):
    session = Session(Settings(effort_factors=("wrist=2",)))
    with pytest.raises(UsageError, match="no joint 'wrist'"):
        session.set_robot(arm)
