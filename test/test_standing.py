"""A joint that stands: static friction holds anything, and a flip of one count is no motion."""

import numpy as np
import pytest

from bdnn_ros.checks.data import unexcited
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.parameters import Parameters, of_robot, parameter_names, prior
from bdnn_ros.physical.presliding import directions
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare

COUNT = 2.0 * np.pi / 2**15
COULOMB, VISCOUS = np.array([0.5, 0.5]), np.array([0.05, 0.05])
"""Of the real robot, in units of what is believed at first; its description names none."""
HELD = 0.9
"""Share of the second joint's friction that the brake of its controller has left in it."""
RATE, SECONDS = 250.0, 30.0


def held(seed=0, flips=8):
    """The first joint of two moves; the second stands, held by friction, and its encoder flips by a count now and then."""
    generator, robot = np.random.default_rng(seed), Robot.bundled("arm2")
    usual = Parameters.from_vector(np.sqrt(np.diagonal(prior(robot).covariance)))
    real = robot.with_joint_parameters(np.zeros(2), VISCOUS * usual.viscous, COULOMB * usual.coulomb)
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    angle = 2.0 * np.pi * np.array([[0.31], [0.47], [0.83]]) * time
    position, velocity, acceleration = np.zeros((3, len(time), 2))
    size = 0.6 / np.array([[0.31], [0.47], [0.83]]) / (2.0 * np.pi)
    rate = 2.0 * np.pi * np.array([[0.31], [0.47], [0.83]])
    position[:, 0] = (size * np.sin(angle)).sum(axis=0)
    velocity[:, 0] = (size * rate * np.cos(angle)).sum(axis=0)
    acceleration[:, 0] = -(size * rate**2 * np.sin(angle)).sum(axis=0)
    position[:, 1] = 0.4
    effort = real.inverse_dynamics(position, velocity, acceleration)
    seen = np.round(position / COUNT) * COUNT
    for begin in generator.uniform(2.0, SECONDS - 2.0, flips):
        flipped = (time > begin) & (time < begin + generator.uniform(0.05, 0.6))
        seen[flipped, 1] += COUNT
    effort[:, 1] -= HELD * real.coulomb[1]
    effort += 0.1 * generator.normal(size=effort.shape) * real.coulomb
    return robot, real, Recording(time, robot.joints, seen, None, effort, urdf="", name="held")


def test_a_flip_of_one_count_between_rests_is_no_motion():
    _, _, recording = held()
    state = directions(prepare(recording))
    assert state.stands[:, 1].all() and (state.doubt[:, 1] == 1.0).all()
    assert not state.joints[:, 1].any()
    assert state.stands[:, 0].mean() < 0.05


@pytest.mark.parametrize("seed", range(2))
def test_what_a_joint_holds_at_rest_says_neither_offset_nor_friction(seed):
    robot, real, recording = held(seed)
    identifier = Identifier(robot)
    model = identifier.fit([recording])
    off = model.parameters.vector() - of_robot(real).vector()
    deviation = model.std.vector()
    names = parameter_names(robot.joints)
    worst = {name: float(z) for name, z in zip(names, np.abs(off) / deviation, strict=True) if z > 3.0}
    assert worst == {}
    before = np.sqrt(np.diagonal(prior(robot).covariance))
    unknown = dict(zip(names, deviation / before, strict=True))
    assert min(unknown[f"{robot.joints[1]}.{kind}"] for kind in ("coulomb", "viscous", "offset")) > 0.5
    # what moves is known as well as ever
    assert unknown[f"{robot.joints[0]}.coulomb"] < 0.02
    (told,) = (remark for remark in unexcited(robot, model) if remark.about == robot.joints[1])
    assert "Coulomb friction" in told.problem
