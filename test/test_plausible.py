"""Models as no robot can be are refused; those that only a description makes odd are not."""

from __future__ import annotations

import re

import numpy as np
import pytest

from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.errors import ModelFileError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.models import build_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2").with_joint_parameters(np.full(2, 0.1), np.full(2, 0.2), np.full(2, 0.3))
DAMAGED = [
    (
        "coulomb",
        1,
        -5.0,
        "The {kind} model is damaged: {joint} has Coulomb friction of -5 N·m, which cannot be.",
    ),
    ("viscous", 1, -5.0, "{joint} has viscous friction of -5 N·m·s/rad"),
    ("armature", 1, -0.5, "{joint} has armature of -0.5 kg·m²"),
    ("inertials", 10, -30.0, "The body that {joint} moves weighs -30"),
    ("inertials", 11, 1e3, "The body that {joint} moves has some of its mass below zero"),
]


def state_of(robot: Robot, kind: str) -> tuple[dict[str, np.ndarray], dict[str, object]]:
    """Of a model of a kind."""
    if kind == "physical":
        return PhysicalModel(robot, np.zeros(2), np.eye(28), np.zeros(2)).to_state()
    load = Installed(
        get("payload"), 1, robot.links[-1], {"mass": -0.1, "com_x": 0.0, "com_y": 0.0, "com_z": 0.0}
    )
    return ExtendedModel(robot, (load,), np.zeros(2)).to_state()


@pytest.mark.parametrize("kind", ["physical", "extended"])
@pytest.mark.parametrize(("name", "at", "value", "said"), DAMAGED)
def test_what_no_robot_has_is_refused(kind: str, name: str, at: int, value: float, said: str) -> None:
    """They were taken, and a diagnosis against them named payloads that nobody hung."""
    arrays, info = state_of(ARM, kind)
    assert build_model(kind, arrays, info).joints == ARM.joints
    values = arrays[name].copy()
    values.flat[at] = value
    said = said.format(kind=kind, joint=ARM.joints[1])
    with pytest.raises(ModelFileError, match=re.escape(said)):
        build_model(kind, {**arrays, name: values}, info)


@pytest.mark.parametrize(
    ("row", "column", "value"), [(3, 3, -1.0), (3, 4, 0.5), (slice(3, 5), slice(3, 5), 2.0 - np.eye(2))]
)
def test_what_is_no_covariance_is_refused(row: object, column: object, value: object) -> None:
    arrays, info = state_of(ARM, "physical")
    covariance = arrays["covariance"].copy()
    covariance[row, column] = value
    with pytest.raises(ModelFileError, match="The physical model is damaged: Its covariance is none"):
        build_model("physical", {**arrays, "covariance": covariance}, info)


@pytest.mark.parametrize("kind", ["physical", "extended"])
def test_what_the_description_says_is_taken(kind: str) -> None:
    """Descriptions of real robots have links without mass, inertias of no body, and damping below zero."""
    nominal = Robot.bundled("arm2")
    urdf = re.sub(r'ixx="[^"]*"', 'ixx="3"', nominal.urdf)
    urdf = re.sub(r'damping="[^"]*"', 'damping="-0.1"', urdf)
    bodiless = re.sub(r"<inertial>.*?</inertial>", "", nominal.urdf, flags=re.DOTALL)
    for text in (urdf, bodiless):
        robot = Robot.from_urdf(text)
        model = PhysicalModel(robot, np.zeros(2), np.zeros((28, 28)), np.zeros(2))
        arrays, info = (model if kind == "physical" else ExtendedModel(robot, (), np.zeros(2))).to_state()
        assert build_model(kind, arrays, info).joints == robot.joints
