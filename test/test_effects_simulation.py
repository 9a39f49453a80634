"""What an effect's columns say is what it does to a simulated robot's measured effort."""

from __future__ import annotations

import numpy as np
import pytest
from effect_cases import SPECS, linear, robot

from bdnn_ros.effects.drawing import contribution, planned
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed, parse_spec
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.signals import prepare
from bdnn_ros.simulation import Simulated, simulate
from bdnn_ros.simulation.sensors import Noise

RATE, SECONDS = 500.0, 10.0
QUIET = Noise.of(0.0)
TOLERANCE = {
    "joint_elasticity": 0.08,  # the columns leave out a rotor of 0.2 % of the inertia, and low-pass the load
    "backlash": 0.15,  # a loose gear gives a little once it has been crossed
}
DRY = ("coulomb_friction", "stribeck_friction", "asymmetric_friction", "load_dependent_friction", "drift")
"""These stick, so that the direction of motion says little near a reversal."""


@pytest.fixture(scope="module")
def arm():
    return robot()


def explained(arm, simulated: Simulated, one: Installed | None) -> tuple[np.ndarray, np.ndarray, Motion]:
    """Measured effort less the description's, what the columns make of it, and the motion, (N, n)."""
    signals = prepare(simulated.recording)
    rigid = arm.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    motion = Motion(signals, arm, rigid)
    added = np.zeros_like(rigid)
    if one is not None:
        coefficients, shape = linear(one)
        for _ in range(2):  # the load that some columns are made from holds the effect itself
            added = one.effect.columns(motion, one.target, shape, one.link) @ coefficients
            acting = one.effect.name in ("load_dependent_friction",)
            motion = motion.with_load(rigid + added if acting else rigid)
    # A command acts from its stamp on for a sample: on average half a sample later.
    lead = motion.derivative(rigid + added) * 0.5 / simulated.recording.rate
    measured = signals.smooth(signals.effort - rigid - lead)
    return measured, signals.smooth(added), motion


def test_without_effects_nothing_is_left(arm):
    simulated = simulate(arm, seed=1, duration=SECONDS, rate=RATE, noise=QUIET)
    measured, _, motion = explained(arm, simulated, None)
    left = np.sqrt(np.mean(measured[motion.signals.interior] ** 2, axis=0))
    assert (left < 1.5e-3 * np.std(simulated.effort, axis=0)).all()


@pytest.mark.parametrize("spec", [spec for spec in SPECS if not spec.startswith("velocity_filter")])
def test_columns_explain_the_measured_effort(spec, arm):
    one = parse_spec(spec, arm)
    simulated = simulate(arm, [one], seed=1, duration=SECONDS, rate=RATE, noise=QUIET)
    one = simulated.effects[0]
    measured, added, motion = explained(arm, simulated, one)
    joint = int(np.argmax(np.std(added, axis=0) / np.std(simulated.effort, axis=0)))
    rows = motion.signals.interior & ~near_reversals(motion, joint, one)
    size = np.sqrt(np.mean(added[rows, joint] ** 2))
    left = np.sqrt(np.mean((measured - added)[rows, joint] ** 2))
    assert size > 0.01 * np.std(simulated.effort[:, joint])
    assert left < TOLERANCE.get(one.effect.name, 0.02) * size


def test_a_loose_motor_leaves_its_link_behind_until_it_has_crossed_its_gap(arm):
    spec = "backlash@arm7_joint6:gap=0.01"
    one = parse_spec(spec, arm)
    simulated = simulate(arm, [one], seed=1, duration=SECONDS, rate=RATE, noise=QUIET)

    def left(crossing: float) -> float:
        measured, added, motion = explained(arm, simulated, parse_spec(f"{spec},crossing={crossing}", arm))
        assert len(np.flatnonzero(np.diff(np.sign(motion.gear_load[:, one.target])))) > 5
        rows = motion.signals.interior
        return float(np.std((measured - added)[rows, one.target]) / np.std(measured[rows, one.target]))

    assert left(0.01) < 0.3
    assert left(0.004) > 0.45
    assert left(0.025) > 0.45


def near_reversals(motion: Motion, joint: int, one: Installed) -> np.ndarray:
    """Samples within 0.15 s of a reversal of a joint with dry friction, (N,) bool."""
    near = np.zeros(len(motion.time), bool)
    if one.effect.name not in DRY:
        return near
    direction = np.sign(motion.velocity[:, joint])
    for turn in np.flatnonzero(direction[1:] != direction[:-1]):
        near |= np.abs(motion.time - motion.time[turn]) < 0.15
    return near


def test_a_velocity_filter_shows_in_the_reported_velocity_only(arm):
    one = parse_spec("velocity_filter@arm7_joint1:cutoff=5", arm)
    simulated = simulate(arm, [one], seed=1, duration=SECONDS, rate=RATE, noise=QUIET)
    plain = simulate(arm, seed=1, duration=SECONDS, rate=RATE, noise=QUIET)
    assert simulated.recording.effort == pytest.approx(plain.recording.effort)
    signals = prepare(simulated.recording)
    added = np.zeros_like(signals.velocity)
    added[:, 0] = -signals.derivative(signals.reported_velocity)[:, 0] / (2.0 * np.pi * 5.0)
    left = (signals.reported_velocity - signals.velocity - added)[signals.interior]
    size = np.std(added[signals.interior, 0])
    assert np.std(left[:, 0]) < 0.02 * size
    assert np.std(left[:, 1:], axis=0).max() < 0.02 * size


def test_a_wrong_zero_shifts_the_measured_position(arm):
    one = parse_spec("position_offset@arm7_joint3:offset=0.1", arm)
    simulated = simulate(arm, [one], seed=1, duration=3.0, rate=RATE, noise=QUIET)
    shift = simulated.recording.position - simulated.position
    assert shift == pytest.approx(np.broadcast_to([0, 0, 0.1, 0, 0, 0, 0], shift.shape))


@pytest.mark.parametrize("kind", ["coulomb", "viscous", "offset"])
def test_a_drift_is_held_before_and_after_its_time(arm, kind):
    one = parse_spec(f"drift@arm7_joint2:of={kind},start_value=1,end_value=3,start=2,end=6", arm)
    plant = Plant(arm, duration=10.0)
    one.install(plant)
    if kind == "coulomb":
        levels = [plant.dry[0][1](time, 1.0, 0.0, 1.0) for time in (0.0, 2.0, 4.0, 6.0, 10.0)]
    else:
        levels = [abs(plant.efforts[0][1](time, 0.0, 1.0, 0.0)) for time in (0.0, 2.0, 4.0, 6.0, 10.0)]
    assert levels == pytest.approx([1.0, 1.0, 2.0, 3.0, 3.0])
    motion = planned(arm, np.arange(0.0, 10.0, 0.01), np.ones((3, 1000, arm.width)))
    added = np.abs(contribution(one, motion)[:, one.target])
    assert added[[0, 200, 400, 600, 999]] == pytest.approx([1.0, 1.0, 2.0, 3.0, 3.0], abs=0.02)


def test_a_drift_that_outlasts_the_recording_gets_part_of_the_way(arm):
    one = parse_spec("drift@arm7_joint2:of=offset,start_value=0,end_value=1,end=20", arm).within(10.0)
    plant = Plant(arm, duration=10.0)
    one.install(plant)
    assert plant.efforts[0][1](10.0, 0.0, 0.0, 0.0) == pytest.approx(-0.5)


@pytest.mark.parametrize(
    "specs",
    [
        ("joint_spring:stiffness=60,rest=0.2",),
        ("cogging:amplitude=3,periods_per_rev=24",),
        ("joint_spring:stiffness=60,rest=0.2", "joint_elasticity:stiffness=5000"),
    ],
)
def test_springs_and_ripples_are_told_as_their_joint_reports_its_position(arm, specs):
    joint = arm.joints[1]
    told = [spec.replace(":", f"@{joint}:") for spec in (*specs, "position_offset:offset=0.06")]
    effects = [parse_spec(spec, arm) for spec in told]
    simulated = simulate(arm, effects, seed=1, duration=SECONDS, rate=RATE, noise=QUIET)
    signals = prepare(simulated.recording)
    model = ExtendedModel(arm, tuple(effects), np.zeros(arm.width))
    left = signals.smooth(model.predict(signals) - signals.effort)[signals.interior, 1]
    assert np.sqrt(np.mean(left**2)) < 0.02 * np.std(simulated.effort[:, 1])
