"""Motions as labs record them keep a robot's limits, and causes are named from them, too."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros.checks.conventions import breaches
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from _naming_judging import judge
from _naming_motions import MOTIONS, planned
from _naming_mujoco import drawn, made

ARM = Robot.bundled("arm6")
TIME = np.arange(12000) / 1000.0


@pytest.mark.slow
@pytest.mark.parametrize("name", MOTIONS)
def test_a_motion_keeps_the_limits_and_is_smooth(name):
    plan = planned(name, ARM, TIME, np.random.default_rng(3))
    assert (plan.position >= ARM.limits.lower).all() and (plan.position <= ARM.limits.upper).all()
    assert (np.abs(plan.velocity) <= ARM.limits.velocity).all()
    for value, rate in ((plan.position, plan.velocity), (plan.velocity, plan.acceleration)):
        inside = np.gradient(value, TIME, axis=0)[1:-1]
        np.testing.assert_allclose(inside, rate[1:-1], atol=1e-2 * np.abs(rate).max())
    assert (plan.position.std(axis=0) > 0.05).all()


def test_joints_take_turns():
    plan = planned("in_turn", ARM, TIME, np.random.default_rng(3))
    moving = np.abs(plan.velocity) > 1e-3
    assert moving.sum(axis=1).max() == 1 and moving.any(axis=0).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed, briefly", [(60250, True), (60253, False)])
def test_a_cause_is_named_of_joints_that_move_one_after_the_other(seed, briefly):
    draw = drawn(seed, "in_turn")
    recording, truth = made(draw)
    report = diagnose([recording], Robot.bundled(draw.robot)).as_json()
    outcome = judge(truth, report["findings"], Robot.bundled(draw.robot))
    assert outcome["hidden"][0]["first"] and not outcome["false"]
    assert any("changes with time" in note for note in report["notes"]) is briefly


@pytest.mark.slow
@pytest.mark.parametrize("seed", [61257, 61855])
def test_what_changes_with_time_gets_no_other_name_of_joints_that_move_one_after_the_other(seed):
    """A drift on a joint that moves thrice, a push while a few joints move: friction and offsets may pass for either."""
    draw = drawn(seed, "in_turn")
    recording, _ = made(draw)
    report = diagnose([recording], Robot.bundled(draw.robot)).as_json()
    assert (report["findings"], report["verdict"]) == ([], "cannot_tell")


def test_gravity_is_not_left_out_where_a_sine_makes_of_it_what_a_rotor_does():
    """What a rotor, friction and the other joint make of the effort is then anything, and gravity still explains most of it."""
    draw = drawn(60225, "sines")
    robot = Robot.bundled(draw.robot)
    recording, _ = made(draw)
    assert not list(breaches(prepare(recording), robot))
