"""A model of the same joints in another order: it answers, predicts and is learned on from alike."""

from __future__ import annotations

import numpy as np
import pytest
from live_support import motion, real_robot

from bdnn_ros.errors import ModelFileError
from bdnn_ros.online.learning import Learning
from bdnn_ros.online.order import predicted, require_joints
from bdnn_ros.online.serving import Served
from bdnn_ros.physical.couplings import CoupledMotors, Coupling
from bdnn_ros.physical.dictionary import FEATURES, GROUPS, Scales
from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import prior
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare

ARM = Robot.bundled("arm6")
ORDER = np.array([3, 5, 0, 1, 4, 2])
TURNED = tuple(ARM.joints[k] for k in ORDER)


@pytest.fixture(scope="module")
def model() -> PhysicalModel:
    """One with everything that ties a joint to the next, and a covariance without symmetry between joints."""
    rng = np.random.default_rng(0)
    real, n = real_robot(ARM), ARM.width
    motors = CoupledMotors(
        (Coupling(4, 1),), np.array([[0.1, 0.2, 0.3]]), rng.normal(size=(1, 8)) * 0.1, np.array([5.0])
    )
    scales = Scales(rng.uniform(1.0, 2.0, n), rng.uniform(1.0, 2.0, n))
    weights = 0.1 * rng.normal(size=(n, FEATURES))
    learned = LocalResiduals((tuple(GROUPS),) * n, weights, 0.1 * rng.normal(size=(n, 3)), scales)
    spread = prior(ARM).covariance
    noise, breakaway = rng.uniform(0.01, 0.1, n), (0, 1, 2, 3, 0, 1)
    return PhysicalModel(real, rng.normal(size=n), 0.01 * spread, noise, 3, breakaway, motors, learned, 0.01)


def test_answers_are_the_models_in_our_order(model):
    q, v, a = np.random.default_rng(1).uniform(-1.0, 1.0, (3, ARM.width))
    own, ours = Served(model, 1, 0.0), Served(model, 1, 0.0, joints=TURNED)
    assert own.joints == ARM.joints and ours.joints == TURNED
    told, expected = ours.parts(q[ORDER], v[ORDER], a[ORDER]), own.parts(q, v, a)
    for name in ("effort", "std", "inertial", "coriolis", "gravity", "friction", "learned"):
        np.testing.assert_array_equal(getattr(told, name), getattr(expected, name)[ORDER], err_msg=name)
    np.testing.assert_array_equal(told.mass_matrix, expected.mass_matrix[ORDER][:, ORDER])
    np.testing.assert_allclose(told.mass_matrix @ a[ORDER], told.inertial)
    np.testing.assert_allclose(ours.forward_dynamics(q[ORDER], v[ORDER], told.effort), a[ORDER], atol=1e-6)


def test_along_a_motion_too(model):
    recording = motion(real_robot(ARM), 4.0, 250.0, noise=0.002)
    expected = model.predict(prepare(recording))
    told = predicted(model, prepare(recording.select(TURNED)))
    np.testing.assert_allclose(told, expected[:, ORDER], atol=1e-9)
    assert np.abs(told - expected).max() > 1.0


def learned(robot: Robot, resume: PhysicalModel | None, duration: float, seed: int) -> Learning:
    recording = motion(real_robot(ARM), duration, 250.0, seed=seed, noise=0.002).select(robot.joints)
    learning = Learning(robot, resume=resume)
    for _ in learning.take(recording.time, recording.position, recording.require_effort()):
        pass
    return learning


def test_learning_goes_on_from_it():
    """The first error is the model's own, and what is learned on is the same robot."""
    before = learned(ARM, None, 6.0, 0).served.model
    own = learned(ARM, before, 4.0, 1)
    ours = learned(Robot.from_urdf(ARM.urdf, TURNED), before, 4.0, 1)
    assert ours.served.model.joints == TURNED and ours.served.number == own.served.number
    np.testing.assert_allclose(ours.errors[0].squared, own.errors[0].squared[ORDER], rtol=1e-6)
    assert np.all(ours.errors[0].nmse < 0.05)
    expected, told = {}, {}
    for table, version in ((expected, own.served), (told, ours.served)):
        table.update({name: (value, std) for name, value, std in version.model.table()})
    assert told.keys() == expected.keys()
    for name, (value, std) in expected.items():
        # not the same number: what may tie a joint to the next is other joints' in another order
        assert told[name][0] == pytest.approx(value, abs=0.2 * std), name
        assert told[name][1] == pytest.approx(std, rel=0.2), name


def test_other_joints_are_refused_with_what_to_set(model):
    require_joints(model, TURNED, TURNED, "kept")
    part = ARM.joints[:3]
    with pytest.raises(ModelFileError, match=r"in use are .* set to \[arm6_joint1, arm6_joint2, .*joint6\]"):
        require_joints(model, part, ARM.joints, "kept")
    with pytest.raises(ModelFileError, match="Load a model of this robot"):
        require_joints(model, part, part, "kept")
