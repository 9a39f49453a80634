"""Pieces of motion and trajectories: smooth, at rest at their ends, inside every limit."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import sliding_arm

from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import UsageError
from bdnn_ros.excitation.bounds import Bounds
from bdnn_ros.excitation.motions import changed, drawn, retouched, swinging
from bdnn_ros.excitation.routes import joined
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory


@pytest.fixture(scope="module", params=["arm2", "arm7"])
def robot(request) -> Robot:
    return Robot.bundled(request.param)


def pieces(bounds: Bounds, count: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        piece = drawn(bounds, 4.0, np.ones(bounds.width), rng)
        if piece is not None:
            found += [piece, changed(bounds, piece, rng)]
    return [piece for piece in found if piece is not None]


def swings(bounds: Bounds, count: int):
    """Motions of one piece, and each with a joint or two moving otherwise."""
    rng, found = np.random.default_rng(1), []
    for duration in np.tile([1.5, 6.0, 24.0], count):
        piece = swinging(bounds, duration, rng)
        if piece is not None:
            found += [piece, retouched(bounds, piece, 1.0, rng)]
    return [piece for piece in found if piece is not None]


def consistent(motion: Trajectory) -> None:
    """Velocity and acceleration are the derivatives of the position."""
    step = motion.time[1] - motion.time[0]
    scale = np.abs(motion.acceleration).max() + 1e-9
    for value, rate in ((motion.position, motion.velocity), (motion.velocity, motion.acceleration)):
        slope = (value[2:] - value[:-2]) / (2.0 * step)
        assert np.abs(slope - rate[1:-1]).max() < 20.0 * step * scale


@pytest.mark.parametrize("made", [pieces, swings])
def test_pieces_keep_all_limits_and_rest_at_their_ends(robot: Robot, made) -> None:
    bounds = Bounds.of(robot)
    found = made(bounds, 12)
    assert len(found) >= 12
    moving = np.zeros(robot.width, bool)
    for piece in found:
        motion = piece.at(np.linspace(0.0, piece.duration, 2001))
        assert bounds.kept_by(motion, 1e-2)
        consistent(motion)
        np.testing.assert_allclose(motion.velocity[[0, -1]], 0.0, atol=1e-9)
        np.testing.assert_allclose(motion.acceleration[[0, -1]], 0.0, atol=1e-6)
        moving |= np.ptp(motion.position, axis=0) > 0.01
    assert moving.all()


def test_pieces_are_of_many_tempos(robot: Robot) -> None:
    """Friction needs slow stretches and fast ones, small reversals and wide ones."""
    found = pieces(Bounds.of(robot), 40)
    peaks = np.concatenate([np.abs(p.coarse.velocity).max(axis=0) for p in found])
    widths = np.concatenate([np.ptp(p.coarse.position, axis=0) for p in found])
    peaks, widths = peaks[peaks > 1e-9], widths[peaks > 1e-9]
    assert np.quantile(peaks, 0.9) > 20.0 * np.quantile(peaks, 0.1)
    assert np.quantile(widths, 0.1) < 0.1 and widths.max() > 1.0


def test_joined_pieces_are_one_smooth_motion(robot: Robot) -> None:
    bounds = Bounds.of(robot, velocity=0.5, acceleration=4.0)
    trajectory = joined(bounds, pieces(bounds, 6)[:4], 200.0)
    assert trajectory is not None
    np.testing.assert_allclose(np.diff(trajectory.time), 0.005, atol=1e-9)
    consistent(trajectory)
    assert bounds.kept_by(trajectory, 2e-2)
    np.testing.assert_allclose(trajectory.velocity[[0, -1]], 0.0, atol=1e-6)
    assert np.abs(trajectory.velocity).max() <= 0.5 * robot.limits.velocity.max()


def test_a_narrow_range_is_kept(robot: Robot) -> None:
    joint = robot.joints[1]
    bounds = Bounds.of(robot, margin=0.0, ranges={joint: (0.1, 0.3)})
    found = pieces(bounds, 6)
    assert len(found) >= 6 and any(np.ptp(piece.coarse.position[:, 1]) > 0.05 for piece in found)
    for piece in found:
        assert piece.coarse.position[:, 1].min() >= 0.1 - 1e-6
        assert piece.coarse.position[:, 1].max() <= 0.3 + 1e-6


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"margin": 0.6}, "A margin of 0.6 makes no sense. Use a share from 0 to 0.49."),
        ({"velocity": 0.0}, "A velocity of 0 makes no sense. Use a share above 0, at most 1."),
        ({"effort": 1.5}, "An effort of 1.5 makes no sense. Use a share above 0, at most 1."),
        ({"acceleration": -1.0}, "An acceleration of -1"),
        ({"ranges": {"elbow": (0, 1)}}, "elbow"),
        ({"ranges": {"arm2_joint1": (1, 1)}}, "The range 1 to 1"),
        ({"ranges": {"arm2_joint1": (math.nan, 1)}}, "The range nan"),
        ({"ranges": {"arm2_joint1": (0, math.nan)}}, "to nan"),
    ],
)
def test_limits_that_make_no_sense_are_refused(options: dict, says: str) -> None:
    with pytest.raises(UsageError, match=re.escape(says)):
        Bounds.of(Robot.bundled("arm2"), **options)


def test_a_robot_too_weak_to_hold_itself_gets_no_piece() -> None:
    robot = Robot.bundled("arm7")
    bounds = Bounds.of(robot, effort=0.01)
    rng = np.random.default_rng(0)
    assert all(drawn(bounds, 4.0, np.ones(7), rng) is None for _ in range(5))


def test_room_is_what_the_description_gives() -> None:
    """A missing limit is half a turn from zero, or a turn from the other one; no joint needs more than a turn."""
    robot = Robot.bundled("arm6")
    lower, upper = (
        np.array([-2.0, 3.5, -np.inf, 1.0, -6.28, -np.inf]),
        np.array([1.0, 6.0, 2.0, np.inf, 6.28, np.inf]),
    )
    bounds = Bounds.of(replace(robot, limits=replace(robot.limits, lower=lower, upper=upper)), margin=0.0)
    turn = 2.0 * np.pi
    np.testing.assert_allclose(bounds.lower, [-2.0, 3.5, 2.0 - turn, 1.0, -np.pi, -np.pi])
    np.testing.assert_allclose(bounds.upper, [1.0, 6.0, 2.0, 1.0 + turn, np.pi, np.pi])


@pytest.mark.parametrize(
    ("limit", "asked", "room"),
    [
        (6.28, (3.5, 5.0), (3.5, 5.0)),
        (6.28, (2.0, 6.0), (2.0, 6.0)),
        (6.28, (-4.0, 4.0), (-4.0, 4.0)),
        (6.28, (2.0, 9.0), (2.0, 6.28)),
        (np.inf, (3.5, 5.0), (3.5, 5.0)),
        (np.inf, (3.5, np.inf), (3.5, 3.5 + 2.0 * np.pi)),
    ],
)
def test_a_range_may_be_anywhere_inside_the_limits(limit, asked, room) -> None:
    """It was cut to the turn about the middle that is taken where no range is given: 3.5 to 5 of ±6.28 was no room."""
    robot = Robot.bundled("arm2")
    limits = replace(robot.limits, lower=np.full(2, -limit), upper=np.full(2, limit))
    bounds = Bounds.of(replace(robot, limits=limits), margin=0.0, ranges={robot.joints[0]: asked})
    np.testing.assert_allclose([bounds.lower[0], bounds.upper[0]], room)
    np.testing.assert_allclose([bounds.lower[1], bounds.upper[1]], [-np.pi, np.pi])


def test_a_long_axis_has_all_its_room() -> None:
    robot = sliding_arm()
    wide = np.where(robot.slides, 20.0, 1.0)
    bounds = Bounds.of(replace(robot, limits=replace(robot.limits, lower=0.0 * wide, upper=wide)))
    np.testing.assert_allclose(bounds.lower, 0.05 * wide)
    np.testing.assert_allclose(bounds.upper, 0.95 * wide)
    assert robot.slides.any()


def test_limits_of_effort_are_kept_by_all_that_the_model_knows() -> None:
    """Friction, scales and offsets of an extended model are none of its robot's."""
    robot = Robot.bundled("arm2")
    specs = ("coulomb_friction@arm2_joint2:coulomb=1.5", "effort_scale@arm2_joint1:scale=0.7")
    model = ExtendedModel(robot, tuple(parse_spec(spec, robot) for spec in specs), np.zeros(2))
    asked = []
    for bounds in (Bounds.of(robot, effort=0.6, model=model), Bounds.of(robot, effort=0.6)):
        motions = [piece.coarse for piece in swings(bounds, 2)]
        efforts = [model.inverse_dynamics(one.position, one.velocity, one.acceleration) for one in motions]
        asked.append(np.abs(np.concatenate(efforts)).max(axis=0) / robot.limits.effort)
    assert (asked[0] <= 0.6 * 1.01).all() and (asked[1] > 0.65).any()
