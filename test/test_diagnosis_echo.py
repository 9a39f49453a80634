"""What noise of the effort seems to gain through a column that is made from it, against the theory of prediction."""

from __future__ import annotations

import numpy as np
import pytest
from test_diagnosis_still import holding

from bdnn_ros.diagnosis.regression import building
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.registry import get
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare

ELASTICITY = get("joint_elasticity")


@pytest.fixture(scope="module")
def equations():
    robot = Robot.bundled("arm2")
    return build(prepare(holding(robot, 1)), robot)


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_noise_gains_the_mean_logarithm_of_what_is_taken_from_it(equations, share):
    """Kolmogorov and Szegő: whatever the noise, over the frequencies that its rows hold."""
    motion, signals = equations.motion, equations.motion.signals
    shape = ELASTICITY.shapes(motion, 0)[2]
    at = share * shape["compliance"]
    term = Term(ELASTICITY, 0).shaped({**shape, "at": at})
    inertia, _, cutoff = ELASTICITY.echo(motion, 0, dict(term.shape))
    middle = np.zeros((len(motion.time), 1))
    middle[len(middle) // 2] = 1.0
    rows_apart = np.median(np.diff(motion.time[equations.rows.samples]))
    frequencies = np.arange(0.01, 0.5 / rows_apart, 0.01)
    turns = np.exp(-2j * np.pi * np.outer(frequencies, motion.time - motion.time[len(middle) // 2]))
    passed = np.abs(turns @ signals.passed(middle, cutoff)[:, 0])
    left = 1.0 - at * inertia * (2.0 * np.pi * frequencies) ** 2 * passed
    expected = -np.mean(np.log(left)) * equations.whitening.full()[:, 0].sum()
    assert at * equations.noise_gain(term, 1).sum() == pytest.approx(expected, rel=0.15)


def test_it_is_evaluated_at_the_estimate(equations):
    """The best low-pass may lie far below the natural frequency: the gear is not as soft as that."""
    shape = ELASTICITY.shapes(equations.motion, 0)[3]
    assert ELASTICITY.relinearised(np.array([0.1 * shape["compliance"]]), shape)["at"] < shape["at"]
    assert ELASTICITY.relinearised(np.array([9.0 * shape["compliance"]]), shape) == shape
    moved = ELASTICITY.relinearised(np.array([0.1 * shape["compliance"]]), shape)
    rigid, soft = (Term(ELASTICITY, 0).shaped(one) for one in (moved, shape))
    assert 0.0 < equations.noise_gain(rigid, 1).sum() < 0.8 * equations.noise_gain(soft, 1).sum()


def test_a_joint_that_moves_for_a_few_rows_is_not_compared(monkeypatch):
    """The noise of so few is whatever a change leaves there: each would seem to explain it all."""
    robot = Robot.bundled("arm2")
    recording = holding(robot, 1)
    recording.position[2000:2060, 1] += 0.5 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 60)))
    signals = prepare(recording)
    seen = build(signals, robot).usable.sum(axis=0)
    assert seen[1] == 0 < seen[0]
    monkeypatch.setattr(building, "FEWEST_ROWS", 0)
    assert 0 < build(signals, robot).usable[:, 1].sum() < 10
    monkeypatch.undo()
    recording.position[2000:3000, 1] += 0.5 * np.sin(np.linspace(0.0, 6.0 * np.pi, 1000))
    assert build(prepare(recording), robot).usable[:, 1].sum() > 9
