"""Dry friction that comes on little by little, as simulators regularise it, is taken for what it is, and no other law is."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from bdnn_ros.diagnosis import diagnose as diagnosing
from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.recorded.creep import creeping, remarked, undisturbed
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.bristles import bristle
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import get
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import score_model
from bdnn_ros.signals import Signals, flattened, prepare
from bdnn_ros.signals.signals import friction_direction
from bdnn_ros.simulation.excitation import Trajectory, fourier, position_range
from bdnn_ros.simulation.scenario import Scenario

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import _naming_mujoco
from _naming_mujoco import drawn, made
from _naming_mujoco_robot import Real, _model

ROBOT, JOINT, OTHER, RATE = Robot.bundled("arm6"), 1, 2, 200.0
IMPEDANCE = 0.9
"""MuJoCo's of a friction constraint, by its default solimp; and the stiffness of its damping by solref, [1/s]."""
DAMPING = 2.0 / (0.95 * 0.02)


def recorded(friction, seed=1, duration=20.0, other=None, noise_of_other=0.003):
    """A recording of a robot of which one joint has a friction, given its position and velocity, (N,) each [N·m].

    Args:
        other: the same of `OTHER`.
        noise_of_other: of that joint's effort, per spread of it.
    """
    rng = np.random.default_rng(seed)
    plan = fourier(ROBOT, np.arange(0.0, duration, 1.0 / RATE), rng)
    effort = ROBOT.inverse_dynamics(plan.position, plan.velocity, plan.acceleration)
    effort[:, JOINT] += friction(plan.position[:, JOINT], plan.velocity[:, JOINT])
    if other is not None:
        effort[:, OTHER] += other(plan.position[:, OTHER], plan.velocity[:, OTHER])
    noise = rng.standard_normal((2, *effort.shape))
    noise[1, :, OTHER] *= noise_of_other / 0.003
    position = plan.position + 1e-5 * noise[0]
    return Recording(
        plan.time,
        ROBOT.joints,
        position,
        None,
        effort + 0.003 * effort.std(axis=0) * noise[1],
        urdf=ROBOT.urdf,
    )


def soft(ahead, back, positive, negative=None):
    """Friction that is all there at a velocity."""
    negative = positive if negative is None else negative
    return lambda q, v: positive * np.clip(v / ahead, 0.0, 1.0) + negative * np.clip(v / back, -1.0, 0.0)


def seen(recording) -> Signals:
    return flattened(prepare(recording), 7.0)


@pytest.mark.parametrize("creep", [(0.0, 0.0, 0.0), (0.2, 0.05, 0.0), (1e-3, 1e-3, 0.01)])
def test_direction_is_the_mean_over_a_sample_period(creep):
    """Within a period the velocity changes in proportion to time."""
    rng, rate = np.random.default_rng(0), 50.0
    velocity, acceleration = rng.uniform(-0.3, 0.3, (500, 1)), rng.uniform(-4.0, 4.0, (500, 1))
    ahead, back, early = np.maximum(creep, [1e-9, 1e-9, 0.0])
    within = (np.arange(2000) + 0.5) / 2000 - 0.5
    coming = velocity + acceleration * (early + within / rate)
    mean = np.clip(np.where(coming > 0.0, coming / ahead, coming / back), -1.0, 1.0).mean(axis=1)
    found = friction_direction(velocity, acceleration, rate, np.array([creep]))[:, 0]
    slow = np.abs(acceleration[:, 0]) / rate < 0.5 * min(ahead, back)
    assert found[slow | (ahead < 0.01)] == pytest.approx(mean[slow | (ahead < 0.01)], abs=0.05)


@pytest.mark.parametrize("creep", [0.05, 0.1, 0.3, 0.6, 0.8])
def test_the_velocity_at_which_all_of_it_is_there_is_found(creep):
    """So well that what it lacks of much friction is no friction to name; what one far off leaves has a valley, too."""
    found = creeping(seen(recorded(soft(creep, creep, 8.0))), ROBOT)
    assert found[JOINT, :2] == pytest.approx([creep, creep], rel=0.003)
    assert found[JOINT, 2] <= 0.002
    assert not np.delete(found, JOINT, axis=0).any()


def test_each_direction_has_its_own():
    found = creeping(seen(recorded(soft(0.2, 0.08, 10.0, 4.0))), ROBOT)
    assert found[JOINT, :2] == pytest.approx([0.2, 0.08], rel=0.003)


def test_what_is_not_clear_of_one_joint_by_itself_is_likely_where_another_creeps():
    noisy = {"other": soft(0.06, 0.06, 3.0), "noise_of_other": 0.2}
    assert creeping(seen(recorded(lambda q, v: 8.0 * np.sign(v), **noisy)), ROBOT) is None
    found = creeping(seen(recorded(soft(0.06, 0.06, 8.0), **noisy)), ROBOT)
    assert found[OTHER, :2] == pytest.approx([0.06, 0.06], rel=0.3)


def test_what_is_seldom_all_there_is_seen_to_be_where_another_creeps():
    seldom = float(np.quantile(np.abs(seen(recorded(soft(0.1, 0.1, 8.0))).velocity[:, OTHER]), 0.97))
    fluid = {"other": soft(seldom, seldom, 20.0)}
    assert creeping(seen(recorded(lambda q, v: 0.0 * v, **fluid)), ROBOT) is None
    found = creeping(seen(recorded(soft(0.1, 0.1, 8.0), **fluid)), ROBOT)
    assert found[OTHER, :2] == pytest.approx([seldom, seldom], rel=0.003)


def test_friction_that_comes_on_at_once_does_beside_a_joint_that_creeps():
    for size, noise in ((3.0, 0.003), (3.0, 0.05), (1.0, 0.05)):
        sharp = {"other": lambda q, v, size=size: size * np.sign(v), "noise_of_other": noise}
        found = creeping(seen(recorded(soft(0.1, 0.1, 8.0), **sharp)), ROBOT)
        assert not found[OTHER].any()


@pytest.mark.slow
def test_a_joint_that_stands_still_to_the_last_digit_has_none():
    """Its friction fell with a velocity of zero by zero, and the diagnosis broke down."""
    full = fourier(ROBOT, np.arange(0.0, 15.0, 1.0 / RATE), np.random.default_rng(1))
    moves = np.arange(ROBOT.width) == OTHER
    plan = replace(
        full,
        position=np.where(moves, full.position, full.position[0]),
        velocity=full.velocity * moves,
        acceleration=full.acceleration * moves,
    )
    rubs = ["coulomb_friction@arm6_joint2:coulomb=4"]
    run, _ = Scenario(ROBOT, effects=rubs, plan=plan, rate=RATE, seed=1, resolution=1e-3).run()
    signals = seen(run.recording)
    assert (np.ptp(signals.position, axis=0) == 0.0).any()
    assert creeping(signals, ROBOT) is None


def test_friction_falls_only_where_it_is_there():
    signals, falls = seen(recorded(soft(0.1, 0.1, 8.0))), get("stribeck_friction")
    sharp = Motion(signals, ROBOT, signals.effort)
    creeping_one = replace(sharp, signals=replace(signals, creep=np.full((ROBOT.width, 3), [0.1, 0.1, 0.0])))
    assert falls.resolved(sharp, JOINT, {"velocity": 0.19})
    assert not falls.resolved(creeping_one, JOINT, {"velocity": 0.19})
    assert falls.resolved(creeping_one, JOINT, {"velocity": 0.21})


def test_friction_that_creeps_alike_is_uneven_by_an_offset_alone():
    """Or the two would be told apart by what happens while the joint turns round."""
    signals = seen(recorded(soft(0.1, 0.1, 8.0)))
    for creep, same in (([0.1, 0.1, 0.0], True), ([0.1, 0.05, 0.0], False)):
        motion = Motion(replace(signals, creep=np.full((ROBOT.width, 3), creep)), ROBOT, signals.effort)
        ahead, back = motion.ways(JOINT)
        assert ahead + back == pytest.approx(motion.direction[:, JOINT])
        assert np.allclose(ahead - back, 1.0) is same


@pytest.mark.slow
def test_a_smooth_law_is_taken_for_the_nearest_of_these():
    """As simulators write it: tanh of the velocity."""
    examined = examine([recorded(lambda q, v: 8.0 * np.tanh(v / 0.1))], ROBOT)
    (finding,) = examined.diagnosis.findings
    assert (finding.effect, finding.joint) == ("coulomb_friction", ROBOT.joints[JOINT])
    assert finding.parameters["coulomb"].value == pytest.approx(8.0, rel=0.01)


@pytest.mark.parametrize(
    "friction",
    [
        lambda q, v: 8.0 * np.sign(v),
        lambda q, v: 8.0 * bristle(q, 0.02),
        lambda q, v: (5.0 + 8.0 * np.exp(-((v / 0.1) ** 2))) * np.sign(v),
        lambda q, v: 12.0 * v,
        lambda q, v: 12.0 * np.abs(v) * v,
        lambda q, v: 0.0 * v,
    ],
    ids=["at once", "gives way", "falls", "viscous", "drag", "none"],
)
def test_no_other_law_creeps(friction):
    assert creeping(seen(recorded(friction)), ROBOT) is None


@pytest.fixture(scope="module")
def examined():
    return examine([recorded(soft(0.15, 0.15, 8.0))], ROBOT)


@pytest.mark.slow
def test_friction_that_creeps_is_named_by_its_size_and_predicted(examined):
    (finding,) = examined.diagnosis.findings
    assert (finding.effect, finding.joint) == ("coulomb_friction", ROBOT.joints[JOINT])
    assert finding.parameters["coulomb"].value == pytest.approx(8.0, rel=0.02)
    assert [note for note in examined.diagnosis.notes if "little by little" in note]
    model = ExtendedModel.from_state(*extend(examined).to_state())
    others = [prepare(recorded(soft(0.15, 0.15, 8.0), seed=5))]
    assert score_model(model, others).nmse[JOINT] < 1e-3
    at_once = replace(model, creep=())
    assert score_model(at_once, others).nmse[JOINT] > 10.0 * score_model(model, others).nmse[JOINT]


@pytest.mark.slow
def test_a_point_has_as_much_of_it_as_its_velocity_asks_for():
    model = extend(examine([recorded(soft(0.2, 0.08, 10.0, 4.0))], ROBOT))
    still, moves = np.zeros((4, ROBOT.width)), np.zeros((4, ROBOT.width))
    moves[:, JOINT] = 0.1, 0.5, -0.04, -0.5
    rest = ROBOT.coriolis(still, moves) + ROBOT.gravity(still)
    own = (model.inverse_dynamics(still, moves, still) - rest)[:, JOINT]
    assert own - own[[1, 1, 3, 3]] == pytest.approx([-5.0, 0.0, 2.0, 0.0], abs=0.3)
    assert own[1] - own[3] == pytest.approx(14.0, rel=0.03)


@pytest.mark.slow
def test_what_changed_since_comes_on_as_it_did(examined):
    before = extend(examined)
    same = examine([recorded(soft(0.15, 0.15, 8.0), seed=5)], before.robot, model=before)
    assert same.diagnosis.verdict == "nothing_wrong"
    assert [note for note in same.diagnosis.notes if "little by little" in note]
    grown = examine([recorded(soft(0.15, 0.15, 14.0), seed=5)], before.robot, model=before)
    (finding,) = grown.diagnosis.findings
    assert (finding.effect, finding.joint) == ("coulomb_friction", ROBOT.joints[JOINT])
    assert finding.parameters["coulomb"].value == pytest.approx(6.0, rel=0.05)


@pytest.mark.parametrize(
    ("effects", "told"),
    [
        ((), False),
        (("viscous_friction", "backlash", "hysteresis"), False),
        (("coulomb_friction",), True),
        (("viscous_friction", "asymmetric_friction"), True),
        (("load_dependent_friction",), True),
        (("drift",), True),
    ],
)
def test_dry_friction_is_told_to_creep_where_there_is_some(effects, told):
    """What seems to may be a gap."""
    recording = recorded(soft(0.15, 0.15, 8.0), duration=2.0)
    creep = np.zeros((ROBOT.width, 3))
    creep[[JOINT, OTHER], :2] = 0.2
    signals = replace(seen(recording), creep=creep)
    (noted,) = remarked([recording], signals, ROBOT, [Term(get(effect), JOINT) for effect in effects])
    assert [[joint for joint in ROBOT.joints if joint in note] for note in noted.notes] == [
        [ROBOT.joints[JOINT]]
    ] * told


def test_dry_friction_that_a_robot_is_described_with_is_told_to_creep():
    recording = recorded(soft(0.15, 0.15, 8.0), duration=2.0)
    signals = replace(seen(recording), creep=np.full((ROBOT.width, 3), 0.2))
    described = ROBOT.with_joint_parameters(coulomb=np.eye(ROBOT.width)[JOINT])
    (noted,) = remarked([recording], signals, described, ())
    (note,) = noted.notes
    assert [joint for joint in ROBOT.joints if joint in note] == [ROBOT.joints[JOINT]]


def test_friction_is_not_told_to_creep_where_the_velocity_is_read_too_coarsely_to_tell():
    recording = recorded(soft(0.15, 0.15, 8.0), duration=2.0)
    signals = seen(recording)
    described = ROBOT.with_joint_parameters(coulomb=np.ones(ROBOT.width))
    creep = np.zeros((ROBOT.width, 3))
    creep[JOINT, :2], creep[OTHER, :2] = (
        5.0 * signals.velocity_noise[JOINT],
        1.5 * signals.velocity_noise[OTHER],
    )
    fast = replace(signals, creep=creep, velocity=np.minimum(np.abs(signals.velocity), 1e-4))
    (noted,) = remarked([recording], fast, described, ())
    (note,) = noted.notes
    assert [joint for joint in ROBOT.joints if joint in note] == [ROBOT.joints[JOINT]]


def test_what_seems_to_creep_is_not_told_where_no_dry_friction_is_found(monkeypatch):
    robot = Robot.bundled("arm2")
    simulated, _ = Scenario(robot, duration=12.0, rate=125.0, seed=1).run()
    seemed = np.full((robot.width, 3), [0.5, 0.5, 0.0])
    monkeypatch.setattr(diagnosing, "creeping", lambda signals, robot: seemed)
    examined = examine([simulated.recording], robot)
    assert (examined.equations.motion.signals.creep == seemed).all()
    assert not [note for note in examined.diagnosis.notes if "little by little" in note]


@pytest.fixture(scope="module")
def pushed() -> Recording:
    """Friction that creeps, 8 N·m, and something that turns the joint with 40 N·m from 8 s to 12 s."""
    recording = recorded(soft(0.1, 0.1, 8.0), duration=30.0)
    effort = recording.effort.copy()
    effort[(recording.time > 8.0) & (recording.time < 12.0), JOINT] += 40.0
    return replace(recording, effort=effort)


def test_a_push_hides_how_friction_comes_on_but_not_where_it_does_not_act(pushed):
    signals = seen(pushed)
    assert creeping(signals, ROBOT) is None
    around = (signals.time > 7.7) & (signals.time < 12.3)
    calm = undisturbed(signals, ROBOT, around)
    assert calm.creep[JOINT, :2] == pytest.approx([0.1, 0.1], rel=0.05)
    assert undisturbed(calm, ROBOT, around) is calm
    assert undisturbed(signals, ROBOT, np.zeros(len(signals), bool)) is signals
    assert undisturbed(signals, ROBOT, signals.time > 10.0) is signals


def test_what_a_medium_does_to_bodies_is_not_taken_for_friction():
    plan = points(seed=4)
    effort = ROBOT.inverse_dynamics(plan.position, plan.velocity, plan.acceleration) + in_a_medium(0.3, plan)
    noise = np.random.default_rng(4).standard_normal((2, *effort.shape))
    effort += 0.003 * effort.std(axis=0) * noise[1]
    recording = Recording(plan.time, ROBOT.joints, plan.position + 1e-5 * noise[0], None, effort)
    assert creeping(seen(recording), ROBOT) is None


def points(seed, duration=20.0, each=1.5) -> Trajectory:
    """From point to point, each joint at a constant velocity for half of the time."""
    low, high = position_range(ROBOT)
    goals = np.random.default_rng(seed).uniform(0.6 * low, 0.6 * high, (int(duration / each) + 2, len(low)))
    time, ramp = np.arange(0.0, duration, 1.0 / RATE), each / 4.0
    leg, t = (time // each).astype(int), time % each
    fast = (goals[leg + 1] - goals[leg]) / (each - ramp)
    knots = np.array([0.0, ramp, each - ramp, each])
    rate = np.interp(t, knots, [0.0, 1.0, 1.0, 0.0])
    change = np.where(t < ramp, 1.0, np.where(t > each - ramp, -1.0, 0.0)) / ramp
    way = np.where(t < ramp, t**2 / (2.0 * ramp), t - ramp / 2.0)
    way = np.where(t > each - ramp, each - ramp - (each - t) ** 2 / (2.0 * ramp), way)
    return Trajectory(time, goals[leg] + fast * way[:, None], fast * rate[:, None], fast * change[:, None])


def in_a_medium(share, plan):
    """Effort against a medium that takes a share of each body's momentum a second, and so much more of it at 1 m/s."""
    model = pinocchio.buildModelFromXML(ROBOT.urdf)
    data, effort = model.createData(), np.zeros_like(plan.position)
    for row, (q, v) in enumerate(zip(plan.position, plan.velocity, strict=True)):
        pinocchio.computeJointJacobians(model, data, q)
        pinocchio.forwardKinematics(model, data, q, v)
        for body in range(1, model.njoints):
            inertia, moved = model.inertias[body], data.v[body]
            velocity, turn = moved.linear + np.cross(moved.angular, inertia.lever), moved.angular
            force = share * (1.0 + np.linalg.norm(velocity)) * inertia.mass * velocity
            torque = share * (1.0 + np.linalg.norm(turn)) * inertia.inertia @ turn
            jacobian = pinocchio.getJointJacobian(model, data, body, pinocchio.ReferenceFrame.LOCAL)
            effort[row] += jacobian[:3].T @ force + jacobian[3:].T @ (torque + np.cross(inertia.lever, force))
    return effort


def test_what_is_never_all_there_is_not_taken_for_friction():
    """It is viscous but for the fastest moments, which may be anything's."""
    fastest = float(np.quantile(np.abs(seen(recorded(soft(0.1, 0.1, 8.0))).velocity[:, JOINT]), 0.99))
    assert creeping(seen(recorded(soft(fastest, fastest, 20.0))), ROBOT) is None


@pytest.mark.slow
def test_friction_that_creeps_is_named_by_its_size_beside_a_push(pushed):
    examined = examine([pushed], ROBOT)
    found = {one.effect: one for one in examined.diagnosis.findings}
    assert set(found) == {"coulomb_friction", "external_wrench"}
    assert found["coulomb_friction"].parameters["coulomb"].value == pytest.approx(8.0, rel=0.01)
    assert found["external_wrench"].parameters["torque"].value == pytest.approx(-40.0, rel=0.01)
    assert "comes on little by little" in examined.recordings[0].notes[-1]


@pytest.mark.slow
def test_friction_of_a_light_mujoco_joint_creeps_as_its_constraint_does(monkeypatch):
    """What MuJoCo takes for the joint's inertia is that of its first pose."""
    monkeypatch.setattr(_naming_mujoco, "SHARE", (3.0, 3.001))
    monkeypatch.setattr(_naming_mujoco, "_among", lambda name, n: (5, 6))
    draw = replace(
        drawn(3), robot="arm7", hidden="coulomb_friction", wrong=0.0, worn=False, rate=200, duration=20.0
    )
    recording, truth = made(draw)
    (one,) = truth["effects"]
    robot = Robot.bundled("arm7")
    model = _model(robot, Real.like(robot.width), 0.0, np.random.default_rng(0))
    soft_by = (1.0 - IMPEDANCE) / IMPEDANCE * model.dof_invweight0[5]
    ahead, back, early = creeping(seen(recording), robot)[5]
    assert [ahead, back] == pytest.approx([one["parameters"]["coulomb"] * soft_by / DAMPING] * 2, rel=0.1)
    assert early == pytest.approx(1.0 / DAMPING, abs=0.003)
    (finding,) = examine([recording], robot).diagnosis.findings
    assert (finding.effect, finding.joint) == ("coulomb_friction", one["joint"])
    assert finding.parameters["coulomb"].value == pytest.approx(one["parameters"]["coulomb"], rel=0.02)


@pytest.mark.slow
def test_what_a_tilted_base_asks_of_a_joint_is_not_taken_for_friction():
    """Where a joint moves as one sine, gravity that the description knows nothing of comes and goes with its velocity."""
    recording, _ = made(drawn(65914, "sines", ("arm2", "arm6", "arm7")))
    found = creeping(seen(recording), ROBOT)
    assert found[0, :2].max() < 0.01  # rad/s, with a peak of about 1


def test_a_little_less_of_much_friction_is_when_all_of_it_is_there():
    """Or what is known of that to a hundredth would pass for friction that falls, more of it, or a scale."""
    dry = ROBOT.with_joint_parameters(coulomb=40.0 * np.eye(ROBOT.width)[JOINT])
    signals = seen(recorded(soft(0.2, 0.2, 40.0)))
    creep = np.zeros((ROBOT.width, 3))
    creep[JOINT, :2] = 0.2 * 1.01
    equations = build(replace(signals, creep=creep), dry)
    noise = Noise(np.zeros((ROBOT.width, 1)), 1e-3 * equations.rows.effort_scale)
    pool = Pool(equations, noise, [], 1e-6)
    assert pool.nuisances(pool.whole)[-1] == pytest.approx(-0.4, rel=0.1)
