"""What the data cannot tell or does oddly: each remark on data made for it, and silence on good data."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from bdnn_ros.checks import data
from bdnn_ros.checks.believed import further_off
from bdnn_ros.checks.velocities import odd_velocity
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.parameters import Spread
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.signals.unmeasured import AT_LIMIT
from bdnn_ros.simulation.excitation import fourier

RATE = 200.0


def worn(robot):
    n = robot.width
    return robot.with_joint_parameters(np.full(n, 0.1), np.full(n, 2.0), np.full(n, 1.0))


def along(robot, time, position, velocity, acceleration, noise=0.002):
    """What a worn robot's sensors report along a motion."""
    generator = np.random.default_rng(0)
    effort = worn(robot).inverse_dynamics(position, velocity, acceleration)
    effort = effort + noise * np.ptp(effort, axis=0) * generator.normal(size=effort.shape)
    seen = position + 2e-5 * generator.normal(size=position.shape)
    return Recording(time, robot.joints, seen, velocity, effort, name="motion")


def good(robot, duration=10.0):
    plan = fourier(robot, np.arange(0.0, duration, 1.0 / RATE), np.random.default_rng(1))
    return along(robot, plan.time, plan.position, plan.velocity, plan.acceleration)


def remarks(robot, recording):
    return data.check([recording], robot, Identifier(robot).fit([recording]))


@pytest.fixture(scope="module")
def robot():
    return Robot.bundled("arm6")


@pytest.fixture(scope="module")
def recording(robot):
    return good(robot)


@pytest.fixture(scope="module")
def model(robot, recording):
    return Identifier(robot).fit([recording])


@pytest.mark.parametrize("name", ["arm2", "arm6", "arm7"])
def test_good_data_is_not_remarked_on(name):
    assert remarks(Robot.bundled(name), good(Robot.bundled(name))) == []


@pytest.mark.parametrize(("shift", "times"), [(0.05, None), (0.5, "times as far from the description")])
def test_bodies_further_off_than_believed_are_told(robot, recording, shift, times):
    urdf = ElementTree.fromstring(robot.urdf)
    origin = urdf.find(f".//link[@name='{robot.moving_link(robot.joints[2])}']/inertial/origin")
    x, y, z = map(float, origin.get("xyz").split())
    origin.set("xyz", f"{x + shift} {y} {z}")
    other = Robot.from_urdf(ElementTree.tostring(urdf, encoding="unicode"))
    found = list(further_off(other, Identifier(other).fit([recording])))
    assert len(found) == bool(times)
    if times:
        assert times in found[0].problem and "--spread inertial=" in found[0].remedy
        wider = Spread(inertial=float(found[0].remedy.partition("inertial=")[2].split()[0]))
        assert list(further_off(other, Identifier(other, spread=wider).fit([recording]), wider)) == []


@pytest.mark.slow
def test_every_remark_says_what_to_do(robot, recording):
    still = recording.position.copy()
    still[:, 3] = 0.5
    found = remarks(robot, replace(recording, position=still, velocity=None))
    assert [one.about for one in found] == [robot.joints[3], ""]
    for remark in found:
        assert remark.problem.endswith(".")
        assert remark.remedy.endswith(".")
        assert str(remark) == f"{remark.problem} {remark.remedy}"


def test_degrees_are_beyond_the_limits(robot, recording):
    position = recording.position.copy()
    position[:, 2] = np.degrees(position[:, 2])
    (found,) = data.beyond(replace(recording, position=position), robot)
    assert found.about == robot.joints[2] and "radians" in found.remedy
    assert f"{position[:, 2].max():.3g}, its limits are" in found.problem
    assert list(data.beyond(recording, robot)) == []
    position = recording.position.copy()
    position[len(position) // 2, 2] *= 1e10  # one reading, which is mended
    assert list(data.beyond(replace(recording, position=position), robot)) == []


def test_data_is_checked_without_a_model_as_with_one(robot, recording):
    assert data.check_data([recording], robot) == []
    odd = replace(recording, position=recording.position * [1, 1, 100, 1, 1, 0], velocity=None)
    found = data.check_data([odd], robot)
    assert [one.about for one in found] == ["", robot.joints[2]]
    assert "hard to tell apart" in found[0].problem and "in degrees" in found[1].problem


def test_a_doubtful_description_is_told_before_all_else(robot, recording, model):
    flat = robot.urdf.replace('iyy="0.07879254"', 'iyy="0.7879254"')
    doubtful = Robot.from_urdf(flat)
    for found in (
        data.check_data([recording], doubtful),
        data.check([recording], doubtful, model),
    ):
        assert found[0].about == "arm6_link3" and "No body can have" in found[0].problem


@pytest.mark.parametrize("resting", [[3], [1, 4]], ids=["one", "two"])
def test_joints_at_rest_are_named_in_one_sentence_with_all_that_is_unknown(robot, resting):
    plan = fourier(robot, np.arange(0.0, 10.0, 1.0 / RATE), np.random.default_rng(1))
    q, v, a = (x.copy() for x in (plan.position, plan.velocity, plan.acceleration))
    q[:, resting], v[:, resting], a[:, resting] = 0.5, 0.0, 0.0
    joints = ", ".join(robot.joints[k] for k in resting)
    found = [one for one in remarks(robot, along(robot, plan.time, q, v, a)) if one.about]
    assert [one.about for one in found] == [joints]
    for word in ("rotor inertia", "viscous friction", "Coulomb friction", joints):
        assert word in found[0].problem


def test_small_slow_motion_leaves_inertias_open(robot):
    time = np.arange(0.0, 10.0, 1.0 / RATE)
    rate = np.arange(1.0, 7.0) ** 0.5
    angle = rate * time[:, None]
    q, v, a = 0.02 * np.sin(angle), 0.02 * rate * np.cos(angle), -0.02 * rate**2 * np.sin(angle)
    found = [c for c in remarks(robot, along(robot, time, q, v, a)) if "inertial parameters" in c.problem]
    assert len(found) == 1
    assert " % of the effort of arm6_joint" in found[0].problem
    assert "bdnn excite" in found[0].remedy


def test_joints_that_move_alike_cannot_be_told_apart(robot):
    time = np.arange(0.0, 10.0, 1.0 / RATE)
    angle, rate = np.tile(2.0 * np.pi * 0.3 * time[:, None], 6), 2.0 * np.pi * 0.3
    alike = along(robot, time, np.sin(angle), rate * np.cos(angle), -(rate**2) * np.sin(angle))
    assert data.condition(robot, [prepare(alike)]) > data.ILL_CONDITIONED
    assert any("hard to tell apart" in one.problem for one in remarks(robot, alike))


def test_the_condition_is_that_of_independent_columns():
    """By singular values of the columns that remain when those without effort of their own are left out."""
    robot = Robot.bundled("arm2")
    recording = good(robot)
    signals = prepare(recording)
    value = data.condition(robot, [signals])
    assert 1.0 <= value < 100.0
    assert data.condition(robot, [signals, signals]) == pytest.approx(value, rel=0.2)


def test_a_base_that_leans_is_told(robot):
    (found,) = (
        one
        for one in remarks(robot, good(robot.tilted(np.radians(2.0), np.radians(-3.0))))
        if "base" in one.problem
    )
    told = re.match(r"The base is tilted: roll ([\d.-]+)° .*, pitch ([\d.-]+)°", found.problem)
    assert told and [float(angle) for angle in told.groups()] == pytest.approx([2.0, -3.0], abs=0.05)


@pytest.mark.parametrize(
    ("angles", "said"),
    [((0.0, 40.0), "roll 0°, pitch 40°: so large a tilt is only estimated"), ((0.0, 80.0), "on its side")],
)
def test_a_base_that_stands_otherwise_is_told_once_and_not_too_exactly(robot, angles, said):
    (found,) = (
        one for one in remarks(robot, good(robot.tilted(*np.radians(angles)))) if "base" in one.problem
    )
    assert said in found.problem and "±" not in found.problem and "description" in str(found)


def test_a_zero_that_is_off_is_told(robot):
    off = replace(robot, zeros=np.eye(robot.width)[1] * 0.06)
    (found,) = (one for one in remarks(robot, good(off)) if "position" in one.problem)
    assert found.about == robot.joints[1]
    assert (
        found.problem.startswith(f"{robot.joints[1]} reports its position +0.0")
        and " rad (±" in found.problem
    )


@pytest.mark.parametrize(("delay", "words"), [(0.012, "ms behind"), (-0.012, "ms ahead of")])
def test_an_effort_apart_from_the_motion_is_measured(robot, recording, delay, words):
    moved = np.stack([np.interp(recording.time - delay, recording.time, e) for e in recording.effort.T], 1)
    found = [one for one in remarks(robot, replace(recording, effort=moved)) if "effort is" in one.problem]
    assert len(found) == 1
    assert words in found[0].problem
    assert float(found[0].problem.split()[3]) == pytest.approx(12.0, abs=1.0)


def test_a_cut_effort_is_remarked_on_but_not_one_beyond_the_limit(robot, recording):
    limit = robot.limits.effort[1]
    grown = recording.effort.copy()
    grown[:, 1] *= 2.0 * limit / np.abs(grown[:, 1]).max()
    assert list(data.saturated(replace(recording, effort=grown), robot)) == []
    cut = np.clip(grown, -robot.limits.effort, robot.limits.effort)
    found = list(data.saturated(replace(recording, effort=cut), robot))
    assert [one.about for one in found] == [robot.joints[1]]
    share = 100.0 * np.mean(np.abs(grown[:, 1]) >= AT_LIMIT * limit)
    assert f"{share:.0f} % of the time" in found[0].problem


def test_velocity_in_degrees_is_found(recording):
    wrong = recording.velocity.copy()
    wrong[:, 2] = np.degrees(wrong[:, 2])
    odd = replace(recording, velocity=wrong)
    found = list(odd_velocity(odd, prepare(odd)))
    assert [one.about for one in found] == [recording.joints[2]]
    assert "57.3" in found[0].problem
    assert "unit" in found[0].remedy


def test_a_velocity_behind_a_low_pass_is_found(recording):
    keep = np.exp(-2.0 * np.pi * 8.0 / RATE)
    wrong = recording.velocity.copy()
    wrong[:, 4] = lfilter([1.0 - keep], [1.0, -keep], wrong[:, 4])
    odd = replace(recording, velocity=wrong)
    found = list(odd_velocity(odd, prepare(odd)))
    assert [one.about for one in found] == [recording.joints[4]]
    assert float(found[0].problem.split("low-pass of ")[1].split()[0]) == pytest.approx(8.0, abs=1.5)


def test_velocities_behind_low_passes_are_one_remark(recording):
    wrong = recording.velocity.copy()
    for joint, cutoff in ((1, 8.0), (4, 8.0), (5, 16.0)):
        keep = np.exp(-2.0 * np.pi * cutoff / RATE)
        wrong[:, joint] = lfilter([1.0 - keep], [1.0, -keep], wrong[:, joint])
    odd = replace(recording, velocity=wrong)
    (found,) = odd_velocity(odd, prepare(odd))
    assert found.about == ", ".join(recording.joints[joint] for joint in (1, 4, 5))
    low, high = found.problem.split("low-passes of ")[1].split(" Hz")[0].split(" to ")
    assert (float(low), float(high)) == (pytest.approx(8.0, abs=1.5), pytest.approx(16.0, abs=6.0))


def test_a_velocity_of_which_a_finding_tells_is_no_remark_as_well(robot, recording):
    wrong = recording.velocity * np.where(np.arange(recording.width) == 2, 3.0, 1.0)
    keep = np.exp(-2.0 * np.pi * 8.0 / RATE)
    wrong[:, [1, 4]] = lfilter([1.0 - keep], [1.0, -keep], wrong[:, [1, 4]], axis=0)
    odd, joints = replace(recording, velocity=wrong), recording.joints
    for told, left in (((joints[1],), [joints[2], joints[4]]), (joints[1:3], [joints[4]]), (joints, [])):
        assert [one.about for one in data.check_data([odd], robot, told=told)] == left


def test_a_good_or_missing_velocity_is_not_odd(recording):
    noise = 1e-3 * np.random.default_rng(0).normal(size=recording.velocity.shape)
    noisy = replace(recording, velocity=recording.velocity + noise)
    assert list(odd_velocity(noisy, prepare(noisy))) == []
    silent = replace(recording, velocity=None)
    assert list(odd_velocity(silent, prepare(silent))) == []


def test_a_delay_of_half_a_period_is_a_held_command(model, recording):
    held = replace(model, lead=0.5 / RATE)
    assert list(data.delayed(held, [recording])) == []
    assert len(list(data.delayed(replace(model, lead=1.0 / RATE), [recording]))) == 1


def test_an_uncertain_delay_is_not_told(model, recording):
    apart = replace(model, lead=0.02)
    assert len(list(data.delayed(apart, [recording]))) == 1
    assert list(data.delayed(replace(apart, lead_std=0.008), [recording])) == []
    assert list(data.delayed(replace(apart, lead_std=0.002), [recording])) == []


def test_a_motion_that_tells_nothing_apart_tells_no_delay(model, recording):
    apart = replace(model, lead=0.02)
    poor = recording.position.copy()
    poor[:, 1:] = poor[:1, 1:]
    alone = replace(recording, position=poor, velocity=None)
    for one, told in ((recording, True), (alone, False)):
        remarks = [str(remark) for remark in data.check([one], model.robot, apart)]
        assert any("ahead of the motion" in remark for remark in remarks) is told
