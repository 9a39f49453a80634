"""What is learned beside the parameters: only what the motion shows, and for good."""

import numpy as np
import pytest

from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.dictionary import HARMONICS, group_slices
from bdnn_ros.physical.presliding import BREAKAWAYS
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import score_model
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.excitation import Trajectory
from bdnn_ros.simulation.sensors import Noise
from bdnn_ros.simulation.simulate import simulate

WAVE = 13
HEIGHT = 0.5
STRIBECK = 1.0


def robot():
    nominal = Robot.bundled("arm2")
    n = nominal.width
    return nominal.with_joint_parameters(np.full(n, 0.1), np.full(n, 1.0), np.full(n, 2.0))


def beside(position, velocity):
    """Cogging and a Stribeck effect."""
    return HEIGHT * np.sin(WAVE * position) + STRIBECK * np.exp(-((velocity / 0.1) ** 2)) * np.sign(velocity)


def moved(seconds, seed, middle=0.0, size=1.0, extra=beside):
    """What sensors report of a motion of ±1.6 rad about a position, or of `size` times that."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, 0.002)
    rate = 2.0 * np.pi * generator.uniform(0.1, 0.8, (4, 2))
    angle = rate * time[:, None, None] + generator.uniform(0.0, 2.0 * np.pi, (4, 2))
    reach = 0.4 * size
    position = middle + (reach * np.sin(angle)).sum(axis=1)
    velocity = (reach * rate * np.cos(angle)).sum(axis=1)
    acceleration = -(reach * rate**2 * np.sin(angle)).sum(axis=1)
    measured = robot().inverse_dynamics(position, velocity, acceleration) + extra(position, velocity)
    measured = measured + 0.005 * np.ptp(measured, axis=0) * generator.standard_normal(measured.shape)
    seen = position + 5e-5 * generator.standard_normal(position.shape)
    return Recording(time, Robot.bundled("arm2").joints, seen, None, measured, name="moved")


@pytest.fixture(scope="module")
def identified():
    identifier = Identifier(Robot.bundled("arm2"))
    return identifier, identifier.fit([moved(40.0, 1)])


@pytest.mark.slow
def test_of_all_waves_the_one_that_is_there_is_learned(identified):
    structure = identified[0].structure
    for groups, relevance in zip(structure.groups, structure.relevance, strict=True):
        waves = relevance[group_slices()["position"]][:HARMONICS]
        assert "position" in groups
        assert int(np.argmax(waves)) + 1 == WAVE
        assert sorted(waves)[-2] < 0.3 * max(waves)


def test_what_is_learned_of_the_position_holds_where_the_joint_has_not_been(identified):
    _, model = identified
    tested = prepare(moved(20.0, 2, middle=2.4))
    error = score_model(model, [tested]).rmse
    assert (error < 0.25 * HEIGHT).all(), error


def test_friction_that_turns_round_between_two_samples_is_no_curve():
    """Its time is known to a sample only, which a rounder friction would explain."""
    identifier = Identifier(Robot.bundled("arm2"))
    identifier.fit([moved(40.0, 11, extra=lambda position, velocity: np.zeros_like(position))])
    assert identifier.structure.groups == ((), ())


@pytest.mark.slow
def test_what_wide_motion_told_is_not_pulled_over_by_a_narrow_one():
    """Narrow and slow, friction turns round where the position's noise hides it."""

    def motion(seconds, seed, size=1.0):
        return moved(seconds, seed, size=size, extra=lambda position, velocity: np.zeros_like(position))

    identifier, others = Identifier(Robot.bundled("arm2")), [prepare(motion(30.0, 3))]
    before = score_model(identifier.fit([motion(30.0, 4)]), others).nmse
    after = score_model(identifier.fit([motion(60.0, 5, size=0.05)]), others).nmse
    assert (after < 1.1 * before).all()


def pick_and_place(seed):
    """A joint that goes from place to place, speeding up and slowing down evenly, and pauses at each."""
    generator, time = np.random.default_rng(seed), np.arange(0.0, 12.0, 0.004)
    position, velocity, acceleration = np.zeros((3, len(time), 1))
    start, place = 0.4, 0.0
    while start < time[-1]:
        lasts, way = generator.uniform(0.5, 1.0), generator.uniform(-1.0, 1.0) - place
        x = ((time - start) / lasts).clip(0.0, 1.0)
        first, moves = x < 0.5, (x > 0.0) & (x < 1.0)
        position[:, 0] += way * np.where(first, 2.0 * x**2, 1.0 - 2.0 * (1.0 - x) ** 2)
        velocity[:, 0] += way / lasts * 4.0 * np.minimum(x, 1.0 - x)
        acceleration[:, 0] += way / lasts**2 * np.where(first, 4.0, -4.0) * moves
        start, place = start + lasts + generator.uniform(0.3, 1.0), place + way
    return Trajectory(time, position, velocity, acceleration)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("coulomb", "breakaway"), [(2.0, 0.0), (0.0, 0.01)])
def test_what_sticks_where_it_stops_has_no_breakaway_but_what_has_one_is_seen_to(seed, coulomb, breakaway):
    """In a pause the controller leaves friction anywhere within its limits, the same way each time."""
    description = Robot.bundled("arm2", ("arm2_joint1",))
    real = description.with_joint_parameters(np.array([0.1]), np.array([1.0]), np.array([coulomb]))
    bristle = f"hysteresis@arm2_joint1:force=2,breakaway={breakaway}"
    effects = [parse_spec(bristle, description)] if breakaway else []
    plan, noise = pick_and_place(seed), Noise.of(0.002)
    moved = simulate(description, effects, seed=seed, plan=plan, noise=noise, reality=real)
    identifier = Identifier(description)
    identifier.fit([moved.recording])
    assert [BREAKAWAYS[k] for k in identifier.structure.breakaway] == [breakaway]
    assert identifier.structure.groups == ((),)
