"""What an arm carries: its mass and centre among links that are a little wrong themselves."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from bdnn_ros.diagnosis.diagnose import diagnose, examine
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.gains import rms
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import get, parse_spec
from bdnn_ros.extension.extend import extend
from bdnn_ros.robot import Robot
from bdnn_ros.signals import flattened, prepare
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.sensors import Noise as SensorNoise
from bdnn_ros.simulation.simulate import simulate

QUIET, NOISE = SensorNoise.of(0.0), SensorNoise.of(0.005)
LOW = 5.0
"""A low-pass that diagnoses use [Hz]."""


def test_a_payload_is_weighed_though_its_link_turns_about_its_origin():
    """Its mass is in the second moment alone; a mass that carries them at a fixed centre gives way to that centre."""
    robot = Robot.bundled("arm6")
    one = parse_spec("payload@arm6_link2:mass=4,com_x=0.03,com_y=-0.05,com_z=0.12", robot)
    recording = simulate(robot, [one], seed=1, duration=20.0, noise=QUIET).recording
    equations = build(flattened(prepare(recording), LOW), robot)
    candidates = Candidates.of(robot)
    (term,) = (t for t in candidates.terms if (t.effect.name, t.link) == ("payload", "arm6_link2"))
    noise = Noise(np.zeros((robot.width, 3)), 1e-3 * equations.rows.effort_scale)
    pool = Pool(equations, noise, [term.shaped({f"com_{axis}": 0.0 for axis in "xyz"})], 1e-3)
    for _ in range(3):
        pool = pool.replacing({0: candidates.refined(equations, pool, pool.fit([0]), 0)})
    found = pool.terms[0].effect.values(pool.coefficients(pool.fit([0]), 0), dict(pool.terms[0].shape))
    for key, value in one.values.items():
        assert found[key] == pytest.approx(value, rel=0.1), key


def test_a_payload_is_within_reach_or_not_known_to_be_beyond_it():
    payload = get("payload")
    at = np.array([0.1, 0.0, 0.0, 0.4])
    assert not payload.believable(at)
    assert not payload.believable(at, np.array([0.1, 0.0, 0.0, 0.0]))
    assert payload.believable(at, np.array([0.2, 0.0, 0.0, 0.0]))
    values = payload.values(at, {})
    assert values["com_z"] == pytest.approx(1.0) and values["mass"] == pytest.approx(0.4)


@pytest.mark.slow
def test_a_long_tool_is_a_payload_however_the_links_seem_without_it():
    """Beyond reach it was none, and the links' masses that made up for it left the next payload no spread at all."""
    robot = Robot.bundled("arm6")
    tool = ("payload@arm6_link6:mass=1,com_z=0.6,com_x=0.02",)
    simulated, _ = Scenario(robot, effects=tool, seed=4, wrong=0.03, duration=12.0, rate=200.0).run()
    (found,) = diagnose([simulated.recording], robot).findings
    assert (found.effect, found.link) == ("payload", "arm6_link6")
    assert found.parameters["mass"].value == pytest.approx(1.0, rel=0.05)
    assert found.parameters["com_z"].value == pytest.approx(0.6, rel=0.05)


def test_a_payload_is_expected_by_what_the_robot_weighs_as_described():
    payload, robot = get("payload"), Robot.bundled("arm2")
    signals = prepare(simulate(robot, [], seed=1, duration=4.0, noise=QUIET).recording)
    spreads = [
        payload.spread(
            np.ones(10), Motion(signals, robot.with_inertials(size * robot.inertials), signals.effort), 0
        )
        for size in (1.0, -2.0)
    ]
    np.testing.assert_array_equal(*spreads)
    assert (spreads[0] > 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("worn", [False, True])
def test_a_payload_far_from_a_light_wrist_has_its_centre(worn):
    """A point mass at the flange would turn the wrist less than this one does: no mass, says a search that begins there."""
    robot = Robot.bundled("arm6")
    carried = "payload@arm6_link6:mass=0.5,com_x=0.01,com_y=-0.051,com_z=0.128"
    simulated, _ = Scenario(robot, effects=(carried,), seed=5, wrong=0.05, worn=worn).run()
    (found,) = (f for f in diagnose([simulated.recording], robot).findings if f.effect == "payload")
    assert found.link == "arm6_link6"
    assert found.parameters["mass"].value == pytest.approx(0.5, rel=0.15)
    height = found.parameters["com_z"]
    # less sure than of a point: what is carried may be as large as a box, which turns about itself as well
    assert height.value == pytest.approx(0.128, abs=2.0 * height.std) and height.std < 0.02


@pytest.mark.slow
def test_a_point_that_all_links_of_a_wrist_turn_about_is_on_any_of_them():
    """That its inertia is seen to be nothing on the last one does not speak against that."""
    robot, links = Robot.bundled("arm6"), {"arm6_link4", "arm6_link5", "arm6_link6"}
    simulated, _ = Scenario(robot, effects=("payload@arm6_link6:mass=1.5",), seed=0, worn=True).run()
    (found,) = (f for f in diagnose([simulated.recording], robot).findings if f.effect == "payload")
    rivals = {r.link: r.probability for r in found.rivals if r.effect == "payload"}
    assert {found.link, *rivals} == links
    assert found.probability + sum(rivals.values()) > 0.95 and min(rivals.values()) > 0.05


@pytest.mark.slow
def test_a_tool_on_the_axis_of_a_flange_hangs_there_as_likely_as_on_the_link_before():
    """That its centre is seen to be on that axis spoke against the flange alone: 0.95 said the link before, with no rival."""
    robot = Robot.bundled("arm6")
    tool = ("payload@arm6_link6:mass=1,com_z=0.05",)
    simulated, _ = Scenario(robot, effects=tool, seed=7, wrong=0.05, duration=15.0, rate=200.0).run()
    (found,) = (f for f in diagnose([simulated.recording], robot).findings if f.effect == "payload")
    each = {found.link: found.probability} | {
        r.link: r.probability for r in found.rivals if r.effect == "payload"
    }
    assert each["arm6_link6"] > 0.3 and sum(each.values()) > 0.9


@pytest.mark.slow
def test_what_an_arm_carries_is_not_believed_smaller_where_only_its_wrist_shows_it():
    """A kilogram is twenty times what a light wrist does, and a twentieth of what the arm is."""
    robot, masses = Robot.bundled("arm7"), []
    for seed, mass in ((4, 3.0), (6, 2.0)):
        carried = f"payload@arm7_link7:mass={mass},com_x=0.02,com_y=-0.03,com_z=0.08"
        scenario = Scenario(robot, effects=(carried,), seed=seed, wrong=0.05, duration=15.0, rate=200.0)
        simulated, _ = scenario.run()
        (found,) = (f for f in diagnose([simulated.recording], robot).findings if f.effect == "payload")
        assert np.hypot(found.parameters["com_x"].value - 0.02, found.parameters["com_y"].value + 0.03) < 0.01
        masses.append(found.parameters["mass"].value / mass)
    assert np.mean(masses) == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("mass, size", [(0.6, (0.16, 0.08, 0.05)), (1.5, (0.3, 0.3, 0.2))])
def test_what_is_carried_is_no_point_and_still_weighed_right(mass, size):
    """What turns about its own centre is not put down to the link, which would grow by mass that the payload has."""
    robot = Robot.bundled("arm6")
    body, rotation, translation = robot.body_of("arm6_link6")
    at = rotation @ np.array([0.02, -0.03, 0.08]) + translation
    box = pin.Inertia.FromBox(mass, *size)
    box.lever = at
    inertials = robot.inertials.copy()
    inertials[body] += box.toDynamicParameters()
    recording = simulate(robot.with_inertials(inertials), [], seed=3, duration=20.0, noise=NOISE).recording
    found = examine([recording], robot)
    (payload,) = found.diagnosis.findings
    assert (payload.effect, payload.link) == ("payload", "arm6_link6")
    assert payload.parameters["mass"].value == pytest.approx(mass, rel=0.02)
    signals = found.equations.motion.signals
    left = found.equations.decimation.as_rows(signals.effort - extend(found).predict(signals))
    assert rms(left, found.equations.usable) == pytest.approx(
        rms(found.pool.residual(found.fit, blur=False), found.equations.usable), rel=0.02
    )


@pytest.mark.slow
def test_a_payload_of_which_the_first_moment_alone_is_known_is_not_passed_over():
    """A link whose centre of mass is elsewhere does the same: no name for it, and not nothing wrong either."""
    robot = Robot.bundled("arm6")
    carried = "payload@arm6_link4:mass=0.1,com_x=-0.1,com_y=0.06"
    simulated, _ = Scenario(robot, effects=(carried,), seed=3, wrong=0.05).run()
    diagnosis = diagnose([simulated.recording], robot)
    assert not diagnosis.findings and diagnosis.verdict == "cannot_tell"
    (note,) = (one for one in diagnosis.notes if one.startswith("Surely something is there"))
    assert "a payload at arm6_link4, mass 0." in note and "centre of mass" in note
