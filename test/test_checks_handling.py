"""A load that is picked up and put down again and again: noticed, and left out of what is diagnosed."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros import bags
from bdnn_ros.checks.handling import Handling, handling, unloaded
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm6")


def worn(*effects: str, robot: Robot = ARM, duration: float = 40.0, rate: float = 200.0) -> Recording:
    scenario = Scenario(robot, effects, seed=5, duration=duration, rate=rate, worn=True, wrong=0.05)
    return scenario.run()[0].recording


def carrying(
    recording: Recording,
    mass: float,
    period: float,
    share: float = 0.5,
    robot: Robot = ARM,
    centre: tuple[float, float, float] = (0.02, 0.03, 0.06),
) -> Recording:
    """The recording with what a point mass on the last link asks for, for a share of each period [s]."""
    inertial, at = np.zeros((robot.width, 10)), np.array(centre)
    moments = mass * (at @ at * np.eye(3) - np.outer(at, at))
    inertial[-1] = [mass, *(mass * at), *moments[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    signals = prepare(recording)
    more = signals.smooth(
        robot.with_inertials(inertial).rigid_effort(signals.position, signals.velocity, signals.acceleration)
    )
    there = recording.time % period > (1.0 - share) * period
    asked = np.stack([np.interp(recording.time, signals.time, one) for one in more.T], axis=1)
    return replace(recording, effort=recording.require_effort() + there[:, None] * asked)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return worn()


@pytest.mark.slow
def test_a_load_that_comes_and_goes_is_noticed_with_its_times(recording):
    found = handling(prepare(carrying(recording, 2.0, 8.0)), ARM)
    assert found is not None and found.link == "arm6_link6" and found.mass == pytest.approx(2.0, rel=0.15)
    assert np.round(found.times[1:4], 0).tolist() == [[12.0, 16.0], [20.0, 24.0], [28.0, 32.0]]


@pytest.mark.parametrize("period, share", [(8.0, 0.0), (8.0, 1.0), (40.0, 0.5), (20.0, 0.1)])
def test_no_load_one_that_stays_and_one_or_two_pushes_are_none(recording, period, share):
    assert handling(prepare(carrying(recording, 2.0, period, share)), ARM) is None


def test_what_lifts_twice_is_no_load_before_between_and_after(recording):
    assert handling(prepare(carrying(recording, -2.0, 15.0, 0.3)), ARM) is None


@pytest.mark.parametrize("off, told", [(0.5, True), (0.7, False)])
def test_what_hangs_further_off_than_a_metre_in_all_is_no_load(off, told):
    """Though it does not along any axis."""
    time = np.arange(0.0, 16.0, 0.01)
    angle = np.sin(time[:, None] * np.linspace(0.7, 1.7, 6)) + 0.3 * np.sin(
        3.0 * time[:, None] + np.arange(6)
    )
    velocity = np.gradient(angle, time, axis=0)
    effort = ARM.rigid_effort(angle, velocity, np.gradient(velocity, time, axis=0))
    effort += 0.2 * np.random.default_rng(0).normal(size=effort.shape)
    moves = Recording(time, ARM.joints, angle, None, effort)
    found = handling(prepare(carrying(moves, 1.0, 4.0, centre=(off, off, off))), ARM)
    assert (found is not None) == told


@pytest.mark.parametrize(
    "effect",
    [
        "backlash@arm6_joint4:gap=0.02",
        "stribeck_friction@arm6_joint6:coulomb=0.5,static=1.5,velocity=0.05",
        "joint_spring@arm6_joint5:stiffness=4,rest=0.5",
        "drift@arm6_joint2:of=coulomb,start_value=2,end_value=8",
        "payload@arm6_link6:mass=2,com_x=0.05",
        "external_wrench@arm6_link6:start=10,end=14,force_z=-20",
    ],
)
def test_no_other_cause_is_taken_for_one(effect):
    assert handling(prepare(worn(effect, duration=16.0, rate=100.0)), ARM) is None


def test_when_it_is_there_takes_no_memory_for_each_time() -> None:
    """A mask for each time took 10 GB in two hours."""
    time = np.arange(0.0, 400.0, 0.01)
    times = tuple((2.0 * k + 0.25, 2.0 * k + 0.75) for k in range(200))
    tracemalloc.start()
    there = Handling("hand", 1.0, 0.9, times).there(time)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(there, np.round(time % 2.0, 6) <= 1.0)
    assert peak < 10 * len(time)


@pytest.mark.slow
def test_what_was_recorded_without_it_is_diagnosed(tmp_path, capsys):
    """With it a push, a payload elsewhere, offsets and ripples were named instead, after minutes."""
    robot = Robot.bundled("arm2")
    loaded = carrying(worn(robot=robot, duration=32.0), 1.0, 8.0, robot=robot)
    (free,) = unloaded([loaded], robot)
    assert 0.4 < free.recorded / loaded.recorded < 0.6 and "picks up about 1" in free.notes[-1]
    assert {f.effect for f in diagnose([free], robot).findings} == {
        *("coulomb_friction", "viscous_friction", "armature")
    }
    bag = str(bags.write(loaded, tmp_path / "bag"))
    assert main(["info", bag]) == 0
    assert "no one model is right of all of it" in capsys.readouterr().out
