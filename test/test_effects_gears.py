"""Gears that are loose or bend: closed forms of a motor on its way across its gap, and gears of another simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import CUTOFF, term
from mujoco_cases import geared

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.judging.identifiability import TIE, judge
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.search import Search
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.effects.backlash import _sides
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import flattened, prepare
from bdnn_ros.simulation.simulate import simulate

PERIOD = 0.001


def test_a_load_that_goes_on_at_its_rate_parts_motor_and_link_with_the_cube_of_time():
    time = np.arange(-0.5, 0.5, PERIOD)
    rate, crossing = -60.0, 0.02
    where = _sides(-time, rate * time, crossing, early=0, period=PERIOD)
    within = (6.0 * crossing / -rate) ** (1.0 / 3.0)
    travel = np.where(time > 0.0, rate * np.maximum(time, 0.0) ** 3 / 6.0, 0.0)
    expected = np.where(time < within, 1.0 + 2.0 * travel / crossing, -1.0)
    assert where == pytest.approx(expected, abs=0.05)
    assert (where[time > within + 0.01] == -1.0).all()


def test_a_motor_that_turns_back_in_its_gap_meets_the_side_it_came_from():
    time = np.arange(0.0, 2.0, PERIOD)
    parting = -0.02 * np.sin(2.0 * np.pi * time)
    load = np.where(time < 0.1, 1.0, np.where(time < 0.3, -1.0, 1.0))
    where = _sides(load, parting + 0.05 * (time > 0.5), 0.02, early=0, period=PERIOD)
    assert where[time < 0.1] == pytest.approx(1.0)
    assert -0.9 < where.min() < 0.99
    assert where[-1] == 1.0


def test_a_jump_that_shows_before_the_load_is_gone_counts_from_where_the_motor_leaves():
    time = np.arange(-0.5, 0.5, PERIOD)
    parting = np.where(time < -0.02, 1.0, -50.0)
    late, early = (_sides(-time, parting, 0.02, early=k, period=PERIOD) for k in (0, 40))
    first = [float(time[np.flatnonzero(where < 0.99)[0]]) for where in (late, early)]
    assert first == pytest.approx([0.003, -0.017], abs=0.002)


def test_a_motor_that_is_never_unloaded_stays_on_its_side():
    load = 2.0 + np.sin(np.arange(0.0, 3.0, PERIOD))
    for sign in (1.0, -1.0):
        assert (_sides(sign * load, sign * load, 0.02, early=20, period=PERIOD) == sign).all()


@pytest.mark.parametrize("pose, listed", [(-0.6, True), (1.2, False)])
def test_a_gap_that_is_never_crossed_is_a_rival_of_a_wrong_zero_beside_a_soft_gear(pose, listed):
    """It has no way across that a soft gear could mend: the weight keeps the link on one side of it all the time."""
    robot = Robot.bundled("arm6")
    time = np.arange(0.0, 20.0, 0.005)
    swing = np.sin(2.0 * np.pi * np.outer(time, [0.31, 0.23, 0.4, 0.5, 0.6, 0.7]) + np.arange(6.0))
    position = np.array([0.0, pose, 1.0, 0.0, 0.5, 0.0]) + 0.3 * swing
    recording = Recording(time, robot.joints, position, None, np.zeros_like(position))
    signals = flattened(prepare(recording), CUTOFF)
    signals = replace(signals, effort=described_effort(robot, signals), unmeasured=None)
    motion = Motion(signals, robot, signals.effort)
    specs = (
        "position_offset@{}:offset=-0.01",
        "joint_elasticity@{}:stiffness=6000",
        "backlash@{}:gap=0.02",
        "effort_offset@{}:offset=1",
    )
    terms, values = zip(*(term(spec.format("arm6_joint2"), robot) for spec in specs), strict=True)
    crossed = np.ptp(motion.gear_load[:, 1]) > np.abs(motion.gear_load[:, 1]).max()
    assert crossed != listed, "the pose does not show what it is there for"
    effort = signals.effort.copy()
    for one, coefficients in zip(terms[:2], values[:2], strict=True):
        effort += one.effect.columns(motion, 1, dict(one.shape)) @ coefficients
    equations = build(replace(signals, effort=effort), robot)
    pool = Pool(equations, Noise(np.zeros((6, 3)), 0.01 * equations.rows.effort_scale), terms, 0.02)
    search = Search(equations, Candidates.of(robot), lambda said: None)
    judged, _ = judge(search, Selection(pool, (0, 1), pool.fit((0, 1))))
    rivals = {rival.effect.name: probability for rival, probability in judged.rivals}
    assert (rivals.get("backlash", 0.0) > TIE) == listed


def loose(robot: Robot, joint: int, gap: float, rotor: float, seed: int) -> Recording:
    """A motor with a rotor of its own before a link that may lag by half the gap."""
    return geared(
        robot, joint, rotor, seed, range=[-0.5 * gap, 0.5 * gap], limited=1, solref_limit=[0.002, 1.0]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, joint, gap, rotor, seed", [("arm7", 6, 0.03, 0.003, 15), ("arm6", 0, 0.02, 0.37, 3)]
)
def test_a_gap_before_a_heavy_rotor_is_no_spring_and_no_delay(name, joint, gap, rotor, seed):
    """Crossings take as long as controller and rotor make them: a tenth of a second and more."""
    robot = Robot.bundled(name)
    findings = diagnose([loose(robot, joint, gap, rotor, seed)], robot).findings
    values = {finding.effect: next(iter(finding.parameters.values())).value for finding in findings}
    assert {finding.joint for finding in findings} == {robot.joints[joint]}
    assert values == {"backlash": pytest.approx(gap, rel=0.12), "armature": pytest.approx(rotor, rel=0.1)}


@pytest.mark.slow
def test_a_worn_gear_that_bends_leaves_nothing_unexplained():
    """What bends it most is faster than the motion, and its load goes on while the motor sticks."""
    robot = Robot.bundled("arm6")
    recording = geared(robot, 1, 0.5, 7, wear=(5.0, 4.0), spring=(3000.0, 0.6), duration=30.0)
    found = diagnose([recording], robot)
    values = {one.effect: next(iter(one.parameters.values())).value for one in found.findings}
    assert found.verdict == "explained" and {one.joint for one in found.findings} == {"arm6_joint2"}
    assert values == {
        "coulomb_friction": pytest.approx(5.0, rel=0.03),
        "viscous_friction": pytest.approx(4.0, rel=0.03),
        "armature": pytest.approx(0.5, rel=0.03),
        "joint_elasticity": pytest.approx(3000.0, rel=0.12),
    }


@pytest.mark.slow
def test_a_gap_of_a_milliradian_is_looked_for():
    robot = Robot.bundled("arm2")
    loose = parse_spec("backlash@arm2_joint1:gap=0.001", robot)
    (finding,) = diagnose([simulate(robot, [loose], seed=1, duration=30.0).recording], robot).findings
    assert (finding.effect, finding.joint) == ("backlash", "arm2_joint1")
    assert finding.parameters["gap"].value == pytest.approx(0.001, rel=0.2)
