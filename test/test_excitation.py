"""What a motion is expected to tell apart, against least squares; and the search for the best one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from excitation_cases import finding, place, write_diagnosis

from bdnn_ros.effects.registry import get
from bdnn_ros.errors import DataError, UsageError
from bdnn_ros.excitation import choice
from bdnn_ros.excitation.bounds import Bounds
from bdnn_ros.excitation.choice import excite
from bdnn_ros.excitation.motions import Piece
from bdnn_ros.excitation.rivals import Case, read_case
from bdnn_ros.excitation.separation import LINK_ERROR, STAMP_ERROR, THINNING, Design, left_out, motion_of
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory

JOINTS = ("arm2_joint1", "arm2_joint2")
COULOMB = place("coulomb_friction", JOINTS[0])


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.bundled("arm2")


def case_of(robot: Robot, tmp_path: Path, *findings: dict) -> Case:
    return read_case(write_diagnosis(tmp_path / "diagnosis.json", robot.joints, *findings), robot)


def ramps(*speeds: float) -> Piece:
    """Joint 1 goes to and fro at these speeds, joint 2 hangs still."""
    signed = np.array(speeds) * (-1.0) ** np.arange(len(speeds))
    when = np.linspace(0.0, 4.0, len(speeds) + 1)
    none = np.zeros((2, 1))
    speed = np.column_stack([np.append(signed, 0.0), np.zeros(len(speeds) + 1)])
    return Piece(4.2, np.array([0.1, 0.0]), none, none + 1.0, none, when, speed, 0.05)


def test_evidence_is_what_least_squares_leaves(robot: Robot, tmp_path: Path) -> None:
    viscous = finding(place("viscous_friction", JOINTS[1]), {"viscous": 0.2})
    case = case_of(
        robot, tmp_path, finding(COULOMB, {"coulomb": 0.7}, place("viscous_friction", JOINTS[0])), viscous
    )
    design = Design(robot, np.array([0.05, 0.05]), case)
    piece = ramps(0.2, 0.3, 1.0, 0.5)
    found = design.evidence(design.gram(piece))
    motion = motion_of(robot, piece)
    smooth, joint1, joint2 = motion.signals.smooth, motion.joint_column, motion.joint_column
    prior = np.concatenate([np.full(20, LINK_ERROR), [STAMP_ERROR, 1e9, 1e9]])
    columns = np.concatenate(
        [
            motion.regressor @ design.relative,
            motion.load_rate[..., None],
            joint1(0, motion.velocity[:, 0]),
            joint2(1, motion.velocity[:, 1]),
        ],
        axis=2,
    )
    rows = np.array([smooth(c) for c in np.moveaxis(columns, 2, 0)])[:, ::THINNING] / 0.05
    target = 0.7 * smooth(get("coulomb_friction").columns(motion, 0, {})[..., 0])[::THINNING] / 0.05
    tall = np.concatenate([rows.reshape(len(rows), -1).T, np.diag(1.0 / prior)])
    wanted = np.concatenate([target.ravel(), np.zeros(len(prior))])
    residual = np.linalg.lstsq(tall, wanted, rcond=None)[1]
    assert found[0] == pytest.approx(0.5 * float(residual[0]), rel=1e-3)


def test_one_speed_cannot_tell_coulomb_from_viscous_and_two_can(robot: Robot, tmp_path: Path) -> None:
    question = finding(COULOMB, {"coulomb": 0.3}, place("viscous_friction", JOINTS[0]))
    design = Design(robot, np.array([0.05, 0.05]), case_of(robot, tmp_path, question))
    one = design.evidence(design.gram(ramps(0.3, 0.3, 0.3, 0.3)))[0]
    two = design.evidence(design.gram(ramps(0.05, 0.05, 0.6, 0.6)))[0]
    assert two > 10.0 * one


def test_slow_motion_tells_stribeck_from_the_coulomb_friction_it_contains(
    robot: Robot, tmp_path: Path
) -> None:
    question = finding(COULOMB, {"coulomb": 0.3}, place("stribeck_friction", JOINTS[0]))
    design = Design(robot, np.array([0.05, 0.05]), case_of(robot, tmp_path, question))
    fast = design.evidence(design.gram(ramps(1.0, 1.0, 1.2, 1.2)))[0]
    slow = design.evidence(design.gram(ramps(0.03, 0.03, 1.2, 1.2)))[0]
    assert slow > 10.0 * fast


def test_a_rival_has_the_same_columns_in_every_piece(robot: Robot, tmp_path: Path) -> None:
    """Which Stribeck velocities can be looked for depends on how quick a piece is: Gram matrices differed in size."""
    question = finding(COULOMB, {"coulomb": 0.3}, place("stribeck_friction", JOINTS[0]))
    design = Design(robot, np.array([0.05, 0.05]), case_of(robot, tmp_path, question))
    gentle, quick = ramps(0.2), ramps(1.0, 5.0, 5.0, 5.0)
    tried = [get("stribeck_friction").shapes(motion_of(robot, piece), 0) for piece in (gentle, quick)]
    assert len(tried[0]) > len(tried[1])
    total = design.gram(gentle) + design.gram(quick)
    assert np.isfinite(design.evidence(total)).all() and np.isfinite(design.value(total))


def test_information_adds_up(robot: Robot, tmp_path: Path) -> None:
    question = finding(COULOMB, {"coulomb": 0.3}, place("viscous_friction", JOINTS[0]))
    design = Design(robot, np.array([0.05, 0.05]), case_of(robot, tmp_path, question))
    a, b = design.gram(ramps(0.3, 0.3)), design.gram(ramps(1.0, 1.0))
    assert design.evidence(a + b)[0] > design.evidence(a)[0] + design.evidence(b)[0]
    np.testing.assert_allclose(
        design.evidence(np.array([a, b]))[:, 0], [design.evidence(g)[0] for g in (a, b)]
    )
    assert design.value(a + b) > design.value(a)


@pytest.mark.slow
def test_a_motion_settles_what_was_open(robot: Robot, tmp_path: Path) -> None:
    payload = finding(
        place("payload", link="arm2_link2"),
        {"mass": 0.5, "com_x": 0.0, "com_y": 0.0, "com_z": -0.1},
        place("base_tilt", p=0.3),
    )
    friction = finding(
        COULOMB, {"coulomb": 0.3}, *(place(f"{k}_friction", JOINTS[0]) for k in ("viscous", "stribeck"))
    )
    case = case_of(robot, tmp_path, payload, friction)
    bounds = Bounds.of(robot)
    told: list[str] = []
    found = excite(robot, case, bounds=bounds, duration=20.0, seed=3, progress=told.append)
    assert len(found.separations) == 3 and all(one.settled for one in found.separations)
    assert bounds.kept_by(found.trajectory, 2e-2)
    assert 12.0 < found.trajectory.time[-1] <= 20.5
    assert told
    again = excite(robot, case, bounds=bounds, duration=20.0, seed=3)
    np.testing.assert_array_equal(again.trajectory.position, found.trajectory.position)


def test_without_questions_it_shows_all_parameters(robot: Robot) -> None:
    """The six base parameters of a planar arm under gravity, well conditioned."""
    found = excite(robot, duration=16.0, seed=1)
    assert not found.separations
    motion = found.trajectory
    regressor = robot.regressor(motion.position, motion.velocity, motion.acceleration)
    columns = regressor.reshape(-1, 20)
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-6 * size.max()] / size[size > 1e-6 * size.max()]
    singular = np.linalg.svd(columns, compute_uv=False)
    assert singular[5] > 0.05 * singular[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arm2", "arm7"])
def test_a_short_motion_takes_its_time_and_tells_more_than_what_is_joined(name: str):
    """Ways from piece to piece take the time: a motion of 5 s was one piece of 1.25 s."""
    robot, duration = Robot.bundled(name), 5.0
    found = excite(robot, duration=duration, seed=2).trajectory
    assert found.time[-1] == pytest.approx(duration, abs=0.02)
    bounds = Bounds.of(robot)
    assert bounds.kept_by(found, 1e-2)
    joined = excite_joined(robot, bounds, duration)
    assert expected_error(robot, found) < 0.7 * expected_error(robot, joined)


def excite_joined(robot: Robot, bounds: Bounds, duration: float) -> Trajectory:
    """What pieces would make."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choice, "LONGEST", 0.0)
        return excite(robot, bounds=bounds, duration=duration, seed=2).trajectory


def expected_error(robot: Robot, motion: Trajectory) -> float:
    """Mean variance of the effort at random states that least squares with a weak prior leaves, by the motion alone."""
    rng, n = np.random.default_rng(0), robot.width
    states = rng.uniform(-1.0, 1.0, (3, 200, n)) * np.array([2.0, 2.0, 4.0])[:, None, None]

    def columns(q, v, a):
        own = np.concatenate([np.eye(n) * v[:, None], np.eye(n) * np.sign(v)[:, None]], axis=2)
        return np.concatenate([robot.regressor(q, v, a), own], axis=2)

    seen = columns(motion.position, motion.velocity, motion.acceleration).reshape(-1, 12 * n)
    asked = columns(*states).reshape(-1, 12 * n)
    known = seen.T @ seen + 1e-3 * np.eye(12 * n)
    return float(np.mean(np.sum(asked * np.linalg.solve(known, asked.T).T, axis=1)))


@pytest.mark.parametrize("effort", [0.5, 0.6, 0.7])
def test_an_arm_that_cannot_be_held_stretched_out_moves_where_it_can(
    robot: Robot, monkeypatch, effort
) -> None:
    """It may hang or stand: pieces of both were chosen, and then there was no way between them."""
    monkeypatch.setattr(choice, "DRAWS", 40)
    monkeypatch.setattr(choice, "CHANGES", 10)
    bounds = Bounds.of(robot, effort=effort)
    found = excite(robot, bounds=bounds).trajectory
    assert bounds.kept_by(found, 2e-2)
    assert 20.0 < found.time[-1] <= 30.5
    np.testing.assert_array_equal(excite(robot, bounds=bounds).trajectory.position, found.position)


def test_what_cannot_be_reached_is_left_out(robot: Robot, monkeypatch) -> None:
    """A piece far away goes, those near one another stay, and in the order that has a way."""
    bounds = Bounds.of(robot)
    search = choice._Search(
        robot, bounds, Design(robot, np.ones(2)), 60.0, np.random.default_rng(0), lambda text: None
    )
    for first in (0.0, 2.5, 0.2, 0.4):
        search._take(replace(ramps(0.3, 0.3), centre=np.array([first, 0.0])))

    def one_way(_: Bounds, start: np.ndarray, end: np.ndarray) -> tuple[float, bool]:
        away = float((end - start)[0])
        return abs(away), -1.0 < away < 0.1

    monkeypatch.setattr(choice, "way", one_way)
    assert search._ordered([0, 1, 2, 3])[0] == [3, 2, 0]
    assert search._short_enough([0, 1, 2, 3]) == [search.pieces[k] for k in (3, 2, 0)]


def test_what_acts_for_a_time_or_on_the_velocity_is_not_asked(robot: Robot, tmp_path: Path) -> None:
    case = case_of(
        robot,
        tmp_path,
        finding(
            place("drift", JOINTS[0]),
            {"start_value": 0.1, "end_value": 0.5},
            place("viscous_friction", JOINTS[0]),
        ),
        finding(place("velocity_filter", JOINTS[1]), {"cutoff": 8.0}),
        finding(COULOMB, {"coulomb": 0.3}, place("external_wrench", link="arm2_link2")),
    )
    assert case.questions[0].finding.effect.variant == "viscous"
    design = Design(robot, np.array([0.05, 0.05]), case)
    design.gram(ramps(0.3, 0.6))
    assert design.pairs == [] and not design.asked
    said = left_out(case, robot)
    assert len(said) == 3 and "repeat the same motion" in said[0] and "velocity" in said[1]


@pytest.mark.slow
def test_a_weak_robot_is_told_so() -> None:
    robot = Robot.bundled("arm7")
    with pytest.raises(DataError, match="No motion"):
        excite(robot, bounds=Bounds.of(robot, effort=0.005), duration=8.0)


@pytest.mark.parametrize("options", [{"duration": 1.0}, {"rate": 5.0}, {"duration": float("nan")}])
def test_senseless_requests_are_refused(robot: Robot, options: dict) -> None:
    with pytest.raises(UsageError):
        excite(robot, **options)


def test_every_effect_of_the_registry_can_be_asked_for(robot: Robot, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(choice, "DRAWS", 6)
    monkeypatch.setattr(choice, "CHANGES", 2)
    from bdnn_ros.effects.registry import ALL

    rivals = []
    for effect in ALL:
        target, link = effect.places(robot)[0]
        joint = JOINTS[target] if link is None and target >= 0 else None
        rivals.append(place(effect.name, joint, link, 0.1))
    case = case_of(robot, tmp_path, finding(COULOMB, {"coulomb": 0.3}, *rivals))
    found = excite(robot, case, duration=8.0)
    assert len(found.separations) >= 18
    assert np.isfinite([one.evidence for one in found.separations]).all()
