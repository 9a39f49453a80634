"""What a motion leaves open of an identified model: friction's curve, at speeds that it did not show."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bdnn_ros.errors import ModelFileError
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.dictionary import CURVE_FEATURES, curve
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import parameter_names
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory, fourier
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm2")
COULOMB, STATIC, VELOCITY, VISCOUS = 0.5, 0.55, 0.1, 0.2
WORN = (
    f"stribeck_friction@{ARM.joints[0]}:coulomb={COULOMB},static={STATIC},velocity={VELOCITY}",
    f"viscous_friction@{ARM.joints[0]}:viscous={VISCOUS}",
)


@cache
def identified(pace: float = 1.0) -> PhysicalModel:
    """The model of a joint with a little more friction where it is slow, which moves at a pace."""
    time = np.arange(8000) / 200.0
    path = fourier(ARM, pace * time, np.random.default_rng(40))
    plan = Trajectory(time, path.position, pace * path.velocity, pace**2 * path.acceleration)
    return Identifier(ARM).fit([Scenario(ARM, WORN, noise=0.003, plan=plan).run()[0].recording])


def friction_left_open(model: PhysicalModel, speed: np.ndarray) -> np.ndarray:
    """Root mean square of what is not known of the first joint's friction at some speeds, (N,) [N·m]."""
    left, names = model.left_open, parameter_names(model.joints)
    columns = np.zeros((len(speed), len(left.covariance)))
    columns[:, names.index(f"{model.joints[0]}.viscous")] = speed
    columns[:, names.index(f"{model.joints[0]}.coulomb")] = 1.0
    own = len(names) + np.flatnonzero((left.joints == 0) & (left.places < CURVE_FEATURES))
    columns[:, own] = np.array(curve(speed / left.scale_velocity[0], np.ones_like(speed))).T
    return np.sqrt(np.einsum("ri,ij,rj->r", columns, left.covariance, columns))


def error_of_friction(model: PhysicalModel, speed: np.ndarray) -> np.ndarray:
    """How far the first joint's friction is off at some speeds, (N,) [N·m]."""
    true = COULOMB + (STATIC - COULOMB) * np.exp(-((speed / VELOCITY) ** 2)) + VISCOUS * speed
    still, moving = np.zeros((len(speed), 2)), np.stack([speed, 0.0 * speed], axis=1)
    return model.friction(still, moving)[:, 0] - model.offset[0] - true


def test_a_curve_that_was_not_worth_learning_is_open_by_as_much_as_it_is():
    model, speed = identified(), np.array([0.005, 0.01, 0.02, 0.04, 0.5, 1.0, 2.0])
    assert model.learned is None
    error, open_ = np.abs(error_of_friction(model, speed)), friction_left_open(model, speed)
    assert error[0] > 0.6 * (STATIC - COULOMB)  # nothing of it is in the model
    assert (error < 2.0 * open_).all()
    assert (open_ < 2.0 * (STATIC - COULOMB)).all()


def test_the_faster_a_joint_could_go_the_more_is_open_beyond_what_it_has_shown():
    model = identified(0.3)
    usual, fast = friction_left_open(model, np.array([0.3, 6.0]))
    assert fast > 5.0 * usual
    error = np.abs(error_of_friction(model, np.array([0.3, 6.0])))
    assert (error < 3.0 * np.array([usual, fast])).all()


def test_a_file_keeps_what_is_left_open():
    model = identified()
    arrays, info = model.to_state()
    again = PhysicalModel.from_state(arrays, json.loads(json.dumps(info)))
    np.testing.assert_array_equal(again.left_open.covariance, model.left_open.covariance)
    assert again.left_open.places.tolist() == model.left_open.places.tolist()
    wrong = arrays["left_open.places"] + 1000
    with pytest.raises(ModelFileError):
        PhysicalModel.from_state({**arrays, "left_open.places": wrong}, info)


def test_a_file_of_before_leaves_open_what_its_covariance_says():
    arrays, info = replace(identified(), open=None).to_state()
    again = PhysicalModel.from_state(arrays, info)
    assert again.open is None and len(again.left_open.joints) == 0
    np.testing.assert_array_equal(again.left_open.covariance, again.covariance)
    assert isinstance(again.left_open, LeftOpen)
