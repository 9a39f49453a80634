"""Noise of joints that may stick: where it is doubted, how much, and what stays sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.regression.building import (
    DWELLING_WIDTHS,
    STICKING_WIDTHS,
    near_creeping,
    sticking_doubt_of,
)
from bdnn_ros.diagnosis.regression.noise import Noise, slipping
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation import simulate
from bdnn_ros.simulation.perturbation import wrong_robot
from bdnn_ros.simulation.sensors import Noise as Sensors


@pytest.mark.parametrize("slip", [0.0, 0.3, 2.0])
def test_what_a_joint_slips_by_is_found_beside_its_other_noise(slip):
    rng = np.random.default_rng(0)
    doubt = rng.uniform(0.0, 0.5, 4000) ** 2
    values = 0.01 * rng.standard_normal(4000) + slip * doubt * rng.standard_normal(4000)
    assert slipping(values, doubt, 0.01) == pytest.approx(slip, rel=0.15, abs=0.02)


def test_rows_are_sure_where_slip_is_less_than_the_other_noise():
    noise = Noise(np.zeros((2, 3)), np.array([0.1, 0.1]), np.array([1.0, 0.0]))
    doubt = np.array([[0.05, 0.05], [0.2, 0.2]])
    assert noise.sure(doubt).tolist() == [[True, True], [False, True]]
    stds = noise.of(doubt, np.full((2, 2), 3))
    assert stds == pytest.approx(np.sqrt([[0.0125, 0.01], [0.05, 0.01]]))


def test_a_direction_is_doubted_at_reversals_and_not_between():
    robot = Robot.bundled("arm2")
    signals = prepare(simulate(robot, seed=1, duration=10.0, noise=Sensors.of(0.0)).recording)
    doubt, sticking = sticking_doubt_of(signals), near_creeping(signals, STICKING_WIDTHS)
    for j in range(2):
        v = signals.velocity[:, j]
        turning = np.flatnonzero(v[1:] * v[:-1] < 0.0)
        far = np.min(np.abs(signals.time[:, None] - signals.time[turning]), axis=1) > 8.0 * signals.kernel_std
        fast = far & (np.abs(v) > 0.3 * v.std())
        assert fast.any() and doubt[fast, j].max() < 1e-3
        assert doubt[turning, j].min() > 0.1
        assert not sticking[fast, j].any()


def test_a_joint_dwells_wherever_it_sticks_and_not_the_other_way_round():
    """What it bears while it creeps tells its causes; only where it stays for long nothing tells anything."""
    signals = prepare(simulate(Robot.bundled("arm2"), seed=1, duration=10.0).recording)
    creeping = np.zeros(signals.velocity.shape, bool)
    begin = len(creeping) // 2
    for j, widths in enumerate((1.0, 4.0)):
        creeping[begin : begin + round(widths * signals.kernel_std * signals.rate), j] = True
    still = replace(
        signals,
        velocity=np.where(creeping, 0.0, np.copysign(1.0, signals.velocity)),
        acceleration=np.ones(creeping.shape),
    )
    dwelling, sticking = near_creeping(still, DWELLING_WIDTHS), near_creeping(still, STICKING_WIDTHS)
    assert dwelling.any(axis=0).tolist() == [True, True]
    assert sticking.any(axis=0).tolist() == [False, True]
    assert not (sticking & ~dwelling).any()


@pytest.fixture(scope="module")
def sticky():
    """An examination of a robot whose description knows its dry friction, which is most of two joints' effort."""
    robot = Robot.bundled("arm6").with_joint_parameters(
        armature=np.zeros(6), viscous=np.full(6, 0.1), coulomb=np.array([1.0, 1.0, 1.0, 1.0, 0.8, 0.8])
    )
    reality = wrong_robot(robot, 0.05, np.random.default_rng(4))
    simulated = simulate(robot, reality=reality, seed=6, duration=15.0)
    assert (np.abs(np.sign(np.diff(simulated.motor_position[:, 4:], axis=0))).mean(axis=0) < 0.99).all()
    return examine([simulated.recording], robot)


@pytest.mark.slow
def test_friction_that_holds_a_joint_is_neither_a_finding_nor_an_error_of_the_model(sticky):
    diagnosis = sticky.diagnosis
    assert diagnosis.findings == () and diagnosis.verdict == "nothing_wrong"
    left = sticky.extended / sticky.equations.rows.effort_scale
    held = sticky.test[:, None] & sticky.equations.usable
    assert np.sqrt(np.mean(left[:, 4:][held[:, 4:]] ** 2)) < 0.02
    assert sticky.pool.noise.slip[4:].min() > 0.05
