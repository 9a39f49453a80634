"""What a diagnosis makes of the friction of an identified model: straight in the robot, the rest in what its joints add."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.diagnosis.regression.joint_errors import JointErrors
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.urdf import joints_of
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.sums import FAST
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory, fourier
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm2")
FIRST, SECOND = ARM.joints
COULOMB, STATIC, VELOCITY, VISCOUS = 0.5, 0.8, 0.3, 0.2
WORN = (
    f"stribeck_friction@{FIRST}:coulomb={COULOMB},static={STATIC},velocity={VELOCITY}",
    f"viscous_friction@{FIRST}:viscous={VISCOUS}",
    f"coulomb_friction@{SECOND}:coulomb=0.3",
)


@cache
def rubbing(seconds: float, pace: float) -> Recording:
    """A recording of a robot whose first joint has more friction where it is slow, which moves at a pace."""
    time = np.arange(round(200.0 * seconds)) / 200.0
    path = fourier(ARM, pace * time, np.random.default_rng(round(seconds)))
    plan = Trajectory(time, path.position, pace * path.velocity, pace**2 * path.acceleration)
    return Scenario(ARM, WORN, seed=1, noise=0.003, plan=plan).run()[0].recording


@pytest.fixture(scope="module")
def faster() -> Examination:
    """A robot that was identified slow and is faster: the motion tells what its friction's curve was left open by."""
    model = Identifier(ARM).fit([rubbing(40.0, 0.2)])
    return examine([rubbing(30.0, 1.0)], model.robot, model=model)


@pytest.fixture(scope="module")
def model(faster) -> ExtendedModel:
    return extend(faster)


def left_by(model: ExtendedModel, examination: Examination) -> np.ndarray:
    """Root mean square error of the effort along the motion, (n,) [N·m]."""
    equations = examination.equations
    signals = equations.motion.signals
    error = signals.smooth(signals.effort - model.predict(signals))[equations.rows.samples]
    return np.sqrt(np.mean(np.where(equations.usable, error, 0.0) ** 2, axis=0))


def test_a_robot_has_the_friction_that_describes_it_best_without_what_its_joints_add(faster, model):
    learned, signals = model.beyond.learned, faster.equations.motion.signals
    assert np.abs(learned.weights[0]).max() > 0.05  # there is a curve
    v, way = signals.velocity[:, 0], signals.sign[:, 0]
    fast = np.abs(v) > FAST * learned.scales.velocity[0]

    def straight(friction: np.ndarray) -> np.ndarray:
        """Viscous and Coulomb friction and offset that describe it best."""
        columns = np.stack([v, way, np.ones(len(v))], axis=1)
        return np.linalg.lstsq(columns[fast], friction[fast], rcond=None)[0]

    load = model.robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    added = learned.effort(signals.position, signals.velocity, signals.sign, load)[:, 0]
    assert (np.abs(straight(added)) < 0.1 * np.array([VISCOUS, COULOMB, COULOMB])).all()
    true = (COULOMB + (STATIC - COULOMB) * np.exp(-((v / VELOCITY) ** 2))) * way + VISCOUS * v
    viscous, coulomb, _ = straight(true)
    joints = joints_of(model)
    assert joints.viscous[0] == pytest.approx(viscous, rel=0.1)
    assert joints.coulomb[0] == pytest.approx(coulomb, rel=0.1)
    plain, whole = (left_by(one, faster) for one in (replace(model, beyond=None), model))
    assert (plain < whole + 0.1 * COULOMB).all()


def test_that_changes_nothing_of_what_a_model_predicts(faster, model, monkeypatch):
    monkeypatch.setattr(JointErrors, "handed_back", lambda self, columns, usable, learned: np.zeros((3, 2)))
    before, signals = extend(faster), faster.equations.motion.signals
    assert np.abs(joints_of(before).viscous - joints_of(model).viscous).max() > 0.01
    was, now = before.predict(signals), model.predict(signals)
    assert np.abs(now - was).max() < 1e-3 * was.std()
