"""A reported velocity that lags: found with its cut-off, and nothing where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import check_contract
from scipy.signal import lfilter

from bdnn_ros.checks.velocities import odd_velocity
from bdnn_ros.cli.diagnose import verdict_lines
from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.recorded.velocity_filter import reported_velocity
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.excitation import fourier
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.sensors import Noise
from bdnn_ros.simulation.simulate import simulate

J1, J2 = "arm2_joint1", "arm2_joint2"


def recorded(*specs: str, seed: int = 0, **noise: object) -> Recording:
    """A short simulated recording."""
    robot = Robot.bundled("arm2")
    effects = [parse_spec(spec, robot) for spec in specs]
    sensors = Noise(**noise)  # type: ignore[arg-type]
    return simulate(robot, effects, seed=seed, duration=10.0, rate=250.0, noise=sensors).recording


@pytest.mark.parametrize("joint", [J1, J2])
@pytest.mark.parametrize("cutoff", [3.0, 8.0, 20.0])
def test_a_filter_is_found_with_its_cutoff(joint, cutoff):
    (finding,) = reported_velocity([recorded(f"velocity_filter@{joint}:cutoff={cutoff}")])
    assert (finding.effect, finding.joint, finding.link) == ("velocity_filter", joint, None)
    quantity = finding.parameters["cutoff"]
    assert quantity.value == pytest.approx(cutoff, rel=0.05)
    assert abs(quantity.value - cutoff) < 4.0 * quantity.std
    assert quantity.unit == "Hz"
    assert (
        finding.share > 0.5 and joint in finding.sentence and f"{quantity.value:.3g} Hz" in finding.sentence
    )


def test_two_filters_are_two_findings():
    specs = (f"velocity_filter@{J1}:cutoff=4", f"velocity_filter@{J2}:cutoff=9")
    found = {f.joint: f.parameters["cutoff"].value for f in reported_velocity([recorded(*specs)])}
    assert found == {J1: pytest.approx(4.0, rel=0.05), J2: pytest.approx(9.0, rel=0.05)}


@pytest.mark.parametrize("source", ["sensor", "differentiated"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nothing_where_the_velocity_is_the_positions_derivative(source, seed):
    assert reported_velocity([recorded(seed=seed, velocity_source=source)]) == []


def test_recordings_without_a_velocity_leave_the_others_checked():
    """What a driver does shows in any recording that tells of it, as if it were the only one."""
    filtered = recorded(f"velocity_filter@{J1}:cutoff=6")
    silent = replace(recorded(seed=1), velocity=None)
    assert reported_velocity([silent, filtered]) == reported_velocity([filtered]) != []
    assert reported_velocity([silent, silent]) == []


def test_a_filtered_difference_is_found():
    spec = f"velocity_filter@{J2}:cutoff=6"
    found = reported_velocity([recorded(spec, velocity_source="differentiated")])
    assert [f.joint for f in found] == [J2]
    assert found[0].parameters["cutoff"].value == pytest.approx(6.0, rel=0.1)


def test_without_a_reported_velocity_there_is_nothing_to_say():
    filtered = recorded(f"velocity_filter@{J1}:cutoff=5")
    assert reported_velocity([replace(filtered, velocity=None)]) == []


def test_an_effect_in_the_effort_is_none_in_the_velocity():
    assert reported_velocity([recorded(f"coulomb_friction@{J1}:coulomb=3", "effort_delay:delay=0.02")]) == []


def test_a_noisy_velocity_is_not_a_filtered_one():
    recording = recorded()
    assert recording.velocity is not None
    noise = 0.05 * np.random.default_rng(1).standard_normal(recording.velocity.shape)
    assert reported_velocity([replace(recording, velocity=recording.velocity + noise)]) == []


@pytest.mark.parametrize("gain", [-1.0, -0.3])
@pytest.mark.parametrize("speed", [8.0, 20.0])
def test_a_velocity_of_the_wrong_sign_is_not_a_filtered_one(gain, speed):
    """A low-pass that lets nothing through would err less than none, and says nothing."""
    time, robot = np.arange(0.0, 20.0, 0.005), Robot.bundled("arm2")
    angle = speed * time[:, None] * [1.0, 1.3] + 0.4 * np.sin(0.5 * time)[:, None]
    rate = speed * np.array([1.0, 1.3]) + 0.2 * np.cos(0.5 * time)[:, None]
    velocity = 0.5 * rate * np.cos(angle)
    noise = 2e-5 * np.random.default_rng(0).standard_normal(angle.shape)
    recording = Recording(
        time, robot.joints, 0.5 * np.sin(angle) + noise, gain * velocity, np.ones_like(angle)
    )
    assert reported_velocity([recording]) == []
    assert reported_velocity([recording], before=np.array([5.0, 2.0])) == []
    (said,) = odd_velocity(recording, prepare(recording))
    assert said.about == ", ".join(robot.joints)
    assert (
        "opposite sign of their" if gain == -1.0 else f"{gain:.2f} times their positions'"
    ) in said.problem


@pytest.mark.parametrize("rule", ["zero-order hold", "backward Euler", "bilinear"])
@pytest.mark.parametrize("cutoff", [4.0, 9.0])
def test_the_interval_holds_whatever_rule_the_drivers_filter_was_made_by(rule, cutoff):
    plain = recorded(seed=4)
    assert plain.velocity is not None
    period, lag = 1.0 / 250.0, 1.0 / (2.0 * np.pi * cutoff)
    top, bottom = {
        "zero-order hold": ([1.0 - np.exp(-period / lag)], [1.0, -np.exp(-period / lag)]),
        "backward Euler": ([period / (lag + period)], [1.0, -lag / (lag + period)]),
        "bilinear": ([1.0, 1.0], [1.0 + 2.0 * lag / period, 1.0 - 2.0 * lag / period]),
    }[rule]
    velocity = plain.velocity.copy()
    velocity[:, 0] = lfilter(top, bottom, velocity[:, 0])
    (finding,) = reported_velocity([replace(plain, velocity=velocity)])
    quantity = finding.parameters["cutoff"]
    assert abs(quantity.value - cutoff) < 2.0 * quantity.std < 0.25 * cutoff


@pytest.mark.parametrize("payload", [True, False])
def test_a_filtered_velocity_explains_nothing_of_an_effort(payload):
    """A load that one joint alone does not tell counted as explained once another cause was named."""
    robot, time = Robot.bundled("arm2"), np.arange(0.0, 20.0, 0.005)
    full, moves = fourier(robot, time, np.random.default_rng(3)), np.array([False, True])
    plan = replace(
        full,
        position=np.where(moves, full.position, full.position[0]),
        velocity=full.velocity * moves,
        acceleration=full.acceleration * moves,
    )
    effects = [f"velocity_filter@{J2}:cutoff=4", *["payload@arm2_link2:mass=1"] * payload]
    run, _ = Scenario(robot, effects=effects, plan=plan, rate=200.0, seed=1).run()
    examination = examine([run.recording], robot)
    without = examine([replace(run.recording, velocity=None)], robot).diagnosis
    told = examination.diagnosis
    assert [f.effect for f in told.findings] == ["velocity_filter"] and without.findings == ()
    assert told.notes == without.notes and told.unexplained_sentence == without.unexplained_sentence
    assert without.verdict == ("cannot_tell" if payload else "nothing_wrong")
    assert told.verdict == ("cannot_tell" if payload else "explained")
    first = verdict_lines(examination)[0]
    assert first.startswith("The simulation disagrees" if payload else "The simulation agrees")
    assert first.endswith("of a reported velocity only:")


def test_it_comes_last_as_it_removes_nothing_of_the_efforts_error():
    specs = (f"viscous_friction@{J1}:viscous=2", f"velocity_filter@{J2}:cutoff=5")
    examination = examine([recorded(*specs)], Robot.bundled("arm2"))
    report = examination.diagnosis.as_json()
    check_contract(report)
    rubs, lags = report["findings"]
    assert rubs["effect"] == "viscous_friction" and rubs["share"] > 0.5
    assert lags["effect"] == "velocity_filter" and lags["share"] == 0.0
    (said,) = [line for line in verdict_lines(examination) if "low-pass" in line]
    much = 100.0 * examination.diagnosis.findings[1].share
    assert much > 50.0 and f"{much:.1f} % of the velocity's squared error" in said
