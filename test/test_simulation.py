"""Simulated recordings: what is recorded is what happened, and the same seed gives the same recording."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from effect_cases import motion as planned_motion

from bdnn_ros import bags
from bdnn_ros.effects.drawing import CONTACT, contribution, draw
from bdnn_ros.effects.environment import POINT, TORQUE
from bdnn_ros.effects.registry import EFFECTS, parse_spec
from bdnn_ros.errors import DataError, UsageError
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation import Scenario, simulate
from bdnn_ros.simulation.control import BEHIND
from bdnn_ros.simulation.excitation import fourier
from bdnn_ros.simulation.perturbation import worn_robot, wrong_robot
from bdnn_ros.simulation.sensors import Noise

QUIET = Noise.of(0.0)


@pytest.mark.parametrize("name", ["arm2", "arm6", "arm7"])
@pytest.mark.parametrize("rate", [100.0, 1000.0])
def test_inverse_dynamics_of_the_recorded_motion_is_the_recorded_effort(name, rate):
    robot = Robot.bundled(name)
    simulated = simulate(robot, seed=2, duration=8.0, rate=rate, noise=QUIET)
    signals = prepare(simulated.recording)
    rigid = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    lead = np.gradient(rigid, 1.0 / signals.rate, axis=0) * 0.5 / rate
    left = signals.smooth(signals.effort - rigid - lead)[signals.interior]
    assert (np.sqrt(np.mean(left**2, axis=0)) < 4e-3 * np.std(simulated.effort, axis=0)).all()


def test_the_robot_follows_its_plan_within_its_limits():
    robot = Robot.bundled("arm7")
    effects = [
        parse_spec("coulomb_friction@arm7_joint2:coulomb=3", robot),
        parse_spec("base_tilt:roll_deg=4", robot),
    ]
    simulated = simulate(robot, effects, seed=3, duration=10.0, rate=500.0)
    assert np.abs(simulated.position - simulated.plan.position).max() < 0.02
    assert (simulated.position > robot.limits.lower).all()
    assert (simulated.position < robot.limits.upper).all()
    assert (np.abs(simulated.velocity) < robot.limits.velocity).all()
    assert (np.abs(simulated.effort) <= robot.limits.effort).all()


def test_a_robot_follows_its_plan_against_the_friction_its_description_has():
    plain = Robot.bundled("arm6")
    friction = 0.3 * plain.limits.effort
    robot = plain.with_joint_parameters(coulomb=friction, viscous=0.1 * friction)
    time = np.arange(2500) / 500.0
    simulated = simulate(robot, plan=fourier(plain, time, np.random.default_rng(1)), noise=QUIET)
    assert np.abs(simulated.position - simulated.plan.position).max() < BEHIND


@pytest.mark.parametrize(
    "specs",
    [
        ["asymmetric_friction@arm6_joint6:positive=3,negative=1", "effort_scale@arm6_joint6:scale=0.8"],
        ["effort_offset@arm6_joint6:offset=-3"],
        ["hysteresis@arm6_joint6:force=2,breakaway=0.01", "joint_spring@arm6_joint6:stiffness=2,rest=0.1"],
    ],
)
def test_a_light_wrist_follows_its_plan_against_effects_that_its_controller_knows(specs):
    """A thousandth of them would do to hold it off its plan: its loop is as stiff as its link is heavy."""
    robot = Robot.bundled("arm6")
    effects = [parse_spec(spec, robot) for spec in specs]
    moved = simulate(robot, effects, known=effects, duration=2.0, rate=200.0, noise=QUIET)
    assert np.abs(moved.position - moved.plan.position).max() < 0.1 * BEHIND
    rigid = robot.inverse_dynamics(moved.plan.position, moved.plan.velocity, moved.plan.acceleration)[:, 5]
    assert np.abs(moved.effort[:, 5]).max() > 10.0 * np.abs(rigid).max()  # they do act


def test_a_push_is_known_to_no_controller():
    robot = Robot.bundled("arm6")
    push = parse_spec("external_wrench@arm6_joint2:torque=20,start=0.5,end=1", robot)
    knowing, ignorant = (
        simulate(robot, [push], known=known, duration=2.0, rate=100.0) for known in ([push], [])
    )
    np.testing.assert_array_equal(knowing.effort, ignorant.effort)


def test_a_command_stays_within_the_effort_limits():
    robot = Robot.bundled("arm2")
    limits = replace(robot.limits, effort=np.array([1.02, 1.0]) * 11.9)
    weak = replace(robot, limits=limits)
    simulated = simulate(weak, seed=0, duration=4.0, rate=200.0, noise=QUIET)
    loaded = [parse_spec("payload@arm2_tool:mass=0.5", weak)]
    heavy = simulate(weak, loaded, duration=4.0, noise=QUIET, plan=simulated.plan)
    assert (np.abs(heavy.effort) <= limits.effort).all()


def test_the_motion_does_not_depend_on_the_noise():
    robot = Robot.bundled("arm2")
    quiet = simulate(robot, seed=4, duration=3.0, rate=200.0, noise=QUIET)
    noisy = simulate(robot, seed=4, duration=3.0, rate=200.0)
    assert (quiet.position == noisy.position).all()
    noise = noisy.recording.effort - quiet.recording.effort
    assert np.std(noise, axis=0) == pytest.approx(0.005 * np.ptp(quiet.effort, axis=0), rel=0.15)


def test_the_same_seed_writes_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        scenario = Scenario(
            Robot.bundled("arm2"), hide=2, seed=7, duration=3.0, rate=100.0, worn=True, wrong=0.05
        )
        bags.write(scenario.run()[0].recording, tmp_path / name / "bag")
    first, second = ((tmp_path / name / "bag" / "bag.mcap").read_bytes() for name in ("one", "two"))
    assert first == second


def test_other_seeds_hide_other_effects():
    robot = Robot.bundled("arm7")
    found = {
        str(Scenario(robot, hide=1, seed=seed, duration=2.0, rate=100.0).run()[1]["effects"])
        for seed in range(5)
    }
    assert len(found) == 5


def test_a_delay_holds_the_effort_back_to_the_step():
    robot = Robot.bundled("arm2")
    late = parse_spec("effort_delay@arm2_joint1:delay=0.013", robot)
    simulated = simulate(robot, [late], seed=1, duration=10.0, rate=500.0, noise=QUIET)
    signals = prepare(simulated.recording)
    rigid = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    rows, rate = signals.interior, np.gradient(rigid, 1.0 / signals.rate, axis=0)
    lead = [
        np.sum((signals.effort - rigid)[rows, j] * rate[rows, j]) / np.sum(rate[rows, j] ** 2)
        for j in range(2)
    ]
    assert lead == pytest.approx([0.013 + 0.001, 0.001], abs=3e-4)


def test_scale_and_offset_are_the_contracts():
    """At rest: gravity = scale · measured + offset."""
    robot = Robot.bundled("arm2")
    effects = [
        parse_spec("effort_scale@arm2_joint1:scale=0.8", robot),
        parse_spec("effort_offset@arm2_joint1:offset=0.7", robot),
    ]
    still = np.tile([0.9, 0.3], (400, 1))
    plan = replace(
        simulate(robot, duration=2.0, rate=200.0).plan,
        position=still,
        velocity=0 * still,
        acceleration=0 * still,
    )
    simulated = simulate(robot, effects, noise=QUIET, plan=plan)
    acting = robot.gravity(simulated.position[-1])
    assert 0.8 * simulated.effort[-1, 0] + 0.7 == pytest.approx(acting[0], rel=1e-6)
    assert simulated.effort[-1, 1] == pytest.approx(acting[1], rel=1e-4)


def test_effects_too_strong_for_the_drives_are_said_to_be():
    robot = Robot.bundled("arm2")
    heavy = parse_spec("payload@arm2_tool:mass=30", robot)
    with pytest.raises(DataError, match=r"too strong for the drives of arm2_joint1.*higher effort limits"):
        simulate(robot, [heavy], duration=4.0, rate=200.0)


def test_a_joint_that_is_lost_within_its_limits_is_named_and_no_drive_is_blamed():
    robot = Robot.bundled("arm6")
    offset = parse_spec("effort_offset@arm6_joint6:offset=-3", robot)
    with pytest.raises(DataError, match=r"arm6_joint6 went astray.*too strong for its position loop") as told:
        simulate(robot, [offset], duration=2.0, rate=200.0)
    assert "limits" not in str(told.value)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "beside",
    [
        "coulomb_friction@arm2_joint1:coulomb=1",
        "stribeck_friction@arm2_joint1:coulomb=1,static=2,velocity=0.1",
        "backlash@arm2_joint1:gap=0.01",
    ],
)
def test_a_robot_that_runs_away_is_told_in_one_sentence(beside):
    robot = Robot.bundled("arm2")
    effects = [parse_spec(spec, robot) for spec in ("quadratic_drag@arm2_joint1:drag=1e9", beside)]
    with pytest.raises(DataError, match="too strong"):
        simulate(robot, effects, duration=3.0, rate=100.0)


def tipped(**option: object) -> Scenario:
    """A scenario of an arm whose last link's mass was forgotten."""
    robot = Robot.bundled("arm2")
    root = ElementTree.fromstring(robot.urdf)
    for name in (robot.moving_link("arm2_joint2"), "arm2_tool"):
        for link in root.findall(f"link[@name='{name}']"):
            for inertial in link.findall("inertial"):
                link.remove(inertial)
    return Scenario(
        Robot.from_urdf(ElementTree.tostring(root, encoding="unicode")), duration=2.0, rate=100.0, **option
    )


@pytest.mark.parametrize(
    ("effects", "remedy"),
    [
        ((), "an <inertial>, or the joint a rotor: --worn, or --effect armature@arm2_joint2:"),
        (("joint_elasticity@arm2_joint2:stiffness=300",), r"an <inertial>\.$"),
    ],
)
def test_a_joint_that_moves_nothing_is_named(effects, remedy):
    with pytest.raises(UsageError, match=f"Nothing that arm2_joint2 moves has any inertia.*{remedy}"):
        tipped(effects=effects).run()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "option",
    [{"worn": True}, {"effects": ["payload@arm2_link2:mass=0.5,com_x=0.1"]}],
    ids=["worn", "payload"],
)
def test_a_link_that_is_described_without_mass_moves_where_there_is_some(option):
    simulated, _ = tipped(**option).run()
    assert np.abs(simulated.position - simulated.plan.position).max() < 0.2


@pytest.mark.parametrize(
    ("duration", "rate"), [(0.5, 100.0), (10.0, 10.0), (10.0, 5000.0), (float("nan"), 100.0)]
)
def test_durations_and_rates_out_of_range_are_refused(duration, rate):
    with pytest.raises(UsageError, match="cannot be simulated"):
        simulate(Robot.bundled("arm2"), duration=duration, rate=rate)


@pytest.mark.parametrize("name", ["arm2", "arm6", "arm7"])
def test_a_wrong_robot_has_bodies_that_can_be(name):
    robot = Robot.bundled(name)
    for seed in range(20):
        wrong = wrong_robot(robot, 0.1, np.random.default_rng(seed))
        for parameters in wrong.inertials:
            inertia = pin.Inertia.FromDynamicParameters(parameters)
            moments = np.linalg.eigvalsh(inertia.inertia)
            assert inertia.mass > 0.0
            assert moments[0] > 0.0
            assert moments[0] + moments[1] > moments[2]


def test_a_wrong_robot_may_have_moments_just_below_zero():
    """Estimates of real robots have, and nothing else refuses them."""
    robot = Robot.from_urdf(Robot.bundled("arm2").urdf)
    inertials = robot.inertials.copy()
    centre = pin.Inertia.FromDynamicParameters(inertials[1])
    centre.inertia = np.diag([-1e-5, 2e-3, 2e-3])
    inertials[1] = centre.toDynamicParameters()
    wrong = wrong_robot(robot.with_inertials(inertials), 0.1, np.random.default_rng(0))
    assert not np.allclose(wrong.inertials[1], inertials[1])
    assert np.isfinite(wrong.mass_matrix(np.zeros(2))).all()


def test_a_wrong_robot_is_off_by_its_share():
    robot = Robot.bundled("arm7")
    ratios = [wrong_robot(robot, 0.05, np.random.default_rng(s)).inertials[:, 0] for s in range(60)]
    assert np.std(ratios / robot.inertials[:, 0]) == pytest.approx(0.05, rel=0.2)
    assert (wrong_robot(robot, 0.0, np.random.default_rng(0)).inertials == robot.inertials).all()


def test_a_worn_robot_has_friction_and_rotors_everywhere():
    robot = Robot.bundled("arm6")
    worn = worn_robot(robot, np.ones(6), np.random.default_rng(0))
    assert (worn.coulomb > 0.004 * robot.limits.effort).all()
    assert (worn.coulomb < 0.021 * robot.limits.effort).all()
    assert (worn.armature > 0.0).all()
    assert (worn.viscous > 0.0).all()
    endless = replace(robot, limits=replace(robot.limits, effort=np.full(6, np.inf)))
    assert np.isfinite(worn_robot(endless, np.ones(6), np.random.default_rng(0)).coulomb).all()


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_a_drawn_effect_matters_and_is_possible(name):
    motion = planned_motion(Robot.bundled("arm7"))
    one = draw(np.random.default_rng(11), motion, [name], least=0.05, most=0.3)
    assert one.effect.name == name
    for parameter in one.effect.parameters:
        assert parameter.lower <= one.values[parameter.name] <= parameter.upper
    if not one.effect.kinematic:
        added = np.sqrt(np.mean(contribution(one, motion) ** 2, axis=0))
        shares = added / np.std(motion.load, axis=0)
        carried = name in ("payload", "link_inertia")
        assert 0.04 < (shares[np.argmax(added)] if carried else shares.max()) < 0.35
        assert (np.abs(motion.load + contribution(one, motion)) < motion.robot.limits.effort).all()


def test_a_drawn_push_acts_at_a_known_place_or_is_a_force_at_any():
    motion, places = planned_motion(Robot.bundled("arm6")), []
    for seed in range(40):
        one = draw(np.random.default_rng(seed), motion, ["external_wrench"])
        if one.link is None:
            continue
        point = np.array([one.values[axis] for axis in POINT])
        known = [np.array(list(p.values())) for p in one.effect.points(motion.robot, one.link)]
        at = [k for k, place in enumerate(known) if np.allclose(place, point)]
        places.append(at[0] if at else "anywhere")
        assert at or (np.abs(point).max() <= CONTACT and not any(one.values[axis] for axis in TORQUE))
    assert set(places) == {0, 1, "anywhere"}


def test_a_drawn_gap_is_crossed():
    """One that is not is a wrong zero, and no motion of the kind could tell."""
    motion = planned_motion(Robot.bundled("arm7"), seed=1)
    crossed = {j for j in range(7) if np.ptp(np.sign(motion.gear_load[:, j])) == 2}
    drawn = {draw(np.random.default_rng(seed), motion, ["backlash"]).target for seed in range(15, 20)}
    assert drawn <= crossed < set(range(7))


def test_the_same_effect_is_not_drawn_twice_at_one_place():
    motion = planned_motion(Robot.bundled("arm2"))
    rng, found = np.random.default_rng(0), []
    for _ in range(2):
        found.append(draw(rng, motion, ["coulomb_friction"], beside=found))
    assert {one.target for one in found} == {0, 1}
    with pytest.raises(DataError, match="No effect reaches"):
        draw(rng, motion, ["coulomb_friction"], beside=found)


def test_a_scenarios_truth_says_everything():
    scenario = Scenario(
        Robot.bundled("arm2"),
        effects=["coulomb_friction@arm2_joint1:coulomb=0.5"],
        hide=1,
        hidden_names=["payload"],
        seed=1,
        duration=2.0,
        rate=100.0,
        worn=True,
        wrong=0.05,
        name="arm2",
    )
    simulated, truth = scenario.run()
    assert [entry["effect"] for entry in truth["effects"]] == ["coulomb_friction", "payload"]
    assert truth["effects"][0]["joint"] == "arm2_joint1"
    assert truth["effects"][1]["link"] in ("arm2_link1", "arm2_link2")
    assert truth["worn"]["arm2_joint2"]["coulomb"] > 0.0
    assert simulated.real.coulomb[1] == truth["worn"]["arm2_joint2"]["coulomb"]
    assert set(truth["links"]) == {"arm2_joint1", "arm2_joint2"}
    assert simulated.recording.urdf == scenario.robot.urdf


@pytest.mark.parametrize(
    ("option", "says"),
    [({"wrong": 0.9}, "off by"), ({"hide": 99}, "cannot be hidden"), ({"hide": -1}, "cannot be hidden")],
)
def test_scenarios_that_make_no_sense_are_refused(option, says):
    with pytest.raises(UsageError, match=says):
        Scenario(Robot.bundled("arm2"), **option).run()


@pytest.mark.parametrize(
    "specs",
    [
        ("base_tilt:roll_deg=5", "base_tilt:pitch_deg=5"),
        ("link_inertia@arm2_link2:scale=1.2", "link_inertia@arm2_joint2:mass=3"),
        ("velocity_filter@arm2_joint1:cutoff=5", "velocity_filter@arm2_joint1:cutoff=9"),
    ],
)
def test_two_effects_that_contradict_each_other_are_refused(specs):
    with pytest.raises(UsageError, match=r"is given twice, .* Give it once"):
        Scenario(Robot.bundled("arm2"), specs, duration=2.0).run()


def test_joints_whose_limits_leave_no_room_are_named():
    """As in a file of an exporter that knows no limits."""
    robot = Robot.bundled("arm2")
    limits = replace(robot.limits, lower=np.zeros(2), upper=np.array([0.0, 1.0]))
    with pytest.raises(UsageError, match="leave arm2_joint1 no room"):
        Scenario(replace(robot, limits=limits)).run()


@pytest.mark.parametrize(
    "carried", ["mass=1,com_x=0.05", "mass=3,com_x=0.02", "mass=1.5,com_x=0.05,com_z=0.08"]
)
def test_a_light_wrist_moves_what_it_carries(carried):
    """Its own link is a hundredth of that: a loop made for the link alone lost it, and the drives were blamed."""
    robot = Robot.bundled("arm6")
    moved = simulate(robot, [parse_spec(f"payload@arm6_link6:{carried}", robot)], seed=0, duration=6.0)
    assert np.abs(moved.position - moved.plan.position).max() < 0.6
    assert np.abs(moved.effort[:, 5]).max() < robot.limits.effort[5]
