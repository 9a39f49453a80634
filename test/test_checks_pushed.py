"""A contact: something pushes one joint for a while, and neither bodies nor friction explain it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros import bags
from bdnn_ros.checks.pushed import push, pushed
from bdnn_ros.cli.main import main
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.excitation import fourier

ARM = Robot.bundled("arm6")
TIME = np.arange(0.0, 40.0, 0.005)
BEGIN, END = 12.0, 22.0
JOINT = 1


def plan(seed: int = 0):
    return fourier(ARM, TIME, np.random.default_rng(seed))


def worn(seed: int = 0) -> Recording:
    """A robot with joints that wear: Stribeck friction, cogging, rotors and links that are off."""
    motion, generator = plan(seed), np.random.default_rng([seed, 1])
    off = ARM.with_inertials(ARM.inertials * generator.uniform(0.85, 1.15, (ARM.width, 1)))
    effort = off.inverse_dynamics(motion.position, motion.velocity, motion.acceleration)
    size, v = effort.std(axis=0), motion.velocity
    effort += size * (0.2 * np.tanh(v / 0.01) * (1.0 + 0.4 * np.exp(-((v / 0.2) ** 2))) + 0.1 * v)
    effort += 0.05 * size * np.sin(12.0 * motion.position)
    effort += 0.02 * size * generator.normal(size=effort.shape)
    seen = motion.position + 2e-5 * generator.normal(size=effort.shape)
    return Recording(TIME, ARM.joints, seen, None, effort, urdf=ARM.urdf, name="worn")


def also(recording: Recording, effort: np.ndarray) -> Recording:
    """The recording with more effort."""
    return replace(recording, effort=recording.require_effort() + effort)


def contact(recording: Recording, forever: bool = False) -> np.ndarray:
    """What something soft adds to one joint's effort beyond the middle of its motion, for a time."""
    effort, q = np.zeros(recording.position.shape), recording.position[:, JOINT]
    there = ((TIME > BEGIN) & (TIME < END)) | forever
    stiff = 2.0 * recording.require_effort()[:, JOINT].std() / np.ptp(q)
    effort[:, JOINT] = stiff * np.maximum(q - np.median(q), 0.0) * there
    return effort


@pytest.mark.parametrize("seed", range(2))
def test_what_pushes_a_joint_for_a_while_is_told_with_its_time(seed):
    recording = worn(seed)
    touched = also(recording, contact(recording))
    (told,) = pushed(touched, prepare(touched), ARM)
    assert told.about == ARM.joints[JOINT]
    found = push(prepare(touched), ARM)
    assert found is not None and found.joint == JOINT
    assert BEGIN - 0.5 < found.begin < found.end < END + 0.5


@pytest.mark.parametrize("seed", range(2))
def test_what_a_worn_robot_has_of_its_own_is_no_push(seed):
    recording, motion = worn(seed), plan(seed)
    assert push(prepare(recording), ARM) is None
    direction = np.tanh(motion.velocity / 0.01)
    size, hump = recording.require_effort().std(axis=0), np.exp(-(((TIME - 17.0) / 5.0) ** 2))[:, None]
    ramp, state = (TIME / TIME[-1])[:, None], (motion.position, motion.velocity, motion.acceleration)
    inertials = ARM.inertials.copy()
    inertials[-1, :4] += [0.5, 0.01, 0.01, 0.04]
    load = ARM.with_inertials(inertials).rigid_effort(*state) - ARM.rigid_effort(*state)
    while_ = ((TIME > BEGIN) & (TIME < END))[:, None]
    for own in (
        0.2 * size * hump * direction,  # friction that comes and goes
        0.3 * size * ramp,  # an offset that drifts
        ARM.tilted(0.05, -0.03).rigid_effort(*state) - ARM.rigid_effort(*state),
        load * while_,  # all joints feel a load
        contact(recording, forever=True),  # a spring of the joint's own
    ):
        assert push(prepare(also(recording, own)), ARM) is None


def test_identify_and_info_say_where_something_pushes(tmp_path, capsys):
    recording = worn()
    bag = str(bags.write(also(recording, contact(recording)), tmp_path / "bag"))
    for verb in (["info"], ["identify", "--out", str(tmp_path / "out")]):
        capsys.readouterr()
        assert main([*verb, bag]) == 0
        said = "".join(capsys.readouterr())
        assert f"something seems to push {ARM.joints[JOINT]}: neither bodies nor friction explain" in said
