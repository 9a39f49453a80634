"""The regression of a diagnosis: exact without noise, white after whitening, blocks that are blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import CUTOFF, RATE, coloured, equations_of, signals_of, term, white
from scipy.linalg import toeplitz

from bdnn_ros.diagnosis.recorded.joining import concatenated
from bdnn_ros.diagnosis.recorded.lowpass import CUTOFF_OF_USUAL, quiet_cutoff
from bdnn_ros.diagnosis.regression.building import (
    BLOCK_SECONDS,
    LEAST_MOTION,
    LEAST_VALUES,
    MOST_BLOCKS,
    build,
    least_motion,
)
from bdnn_ros.diagnosis.regression.coloring import noise_of, without_trends
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.known import Known
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import RecordingError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.physical.parameters import PER_JOINT
from bdnn_ros.recording import Recording
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import flattened, prepare, usual_cutoff
from bdnn_ros.signals.lowpasses import Lowpass
from bdnn_ros.simulation.perturbation import wrong_robot
from bdnn_ros.simulation.simulate import simulate

J1, J2 = "arm2_joint1", "arm2_joint2"
AR = np.array([0.5, -0.2, 0.1])
SPECS = (
    f"coulomb_friction@{J1}:coulomb=1.3",
    f"viscous_friction@{J2}:viscous=0.4",
    f"effort_offset@{J1}:offset=-0.7",
    f"stribeck_friction@{J2}:coulomb=0.5,static=1.2,velocity=0.1",
    f"external_wrench@{J1}:start=3,end=6,torque=2",
    "base_tilt:roll_deg=3,pitch_deg=-2",
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.bundled("arm2")


@pytest.fixture(scope="module")
def plain() -> Equations:
    return equations_of()


@pytest.mark.parametrize("spec", SPECS)
def test_without_noise_the_target_is_the_column_times_its_coefficient(robot, spec):
    equations = equations_of([spec])
    one, coefficients = term(spec, robot)
    np.testing.assert_allclose(equations.rows.target, equations.columns.of(one) @ coefficients, atol=1e-9)


@pytest.mark.parametrize(
    "spec", [f"effort_offset@{J1}:offset=1", f"drift@{J1}:of=offset,start_value=1,end_value=2"]
)
def test_an_offset_may_be_a_share_of_what_a_joint_bears(robot, plain, spec):
    """However little that goes up and down: what acts as the joint moves, friction say, would show in that."""
    bearing = equations_of([f"effort_offset@{J1}:offset=-300"])
    friction, _ = term(SPECS[0], robot)
    one, _ = term(spec, robot)
    believed, before = (each.spread(one, each.columns.of(one)) for each in (bearing, plain))
    assert (believed > 3.0 * before).all()
    np.testing.assert_allclose(believed / before, bearing.rows.effort_size[0] / plain.rows.effort_size[0])
    assert bearing.rows.effort_size[0] == pytest.approx(300.0, rel=0.1)
    same = [each.spread(friction, each.columns.of(friction)) for each in (bearing, plain)]
    np.testing.assert_allclose(*same)


def test_errors_of_the_links_are_in_the_rigid_columns():
    errors = np.random.default_rng(0).normal(size=2 * PER_LINK) * 0.1
    equations = equations_of(errors=errors)
    np.testing.assert_allclose(equations.rows.target, equations.rigid @ errors, atol=1e-9)
    assert np.abs(equations.rows.target).max() > 0.1


def test_a_model_in_the_simulations_place(robot):
    signals = signals_of()
    other = described_effort(robot, signals) + 2.0
    np.testing.assert_allclose(build(signals, robot, other).rows.target, -2.0, atol=1e-9)


def test_the_first_relative_unit_scales_a_link_as_a_whole(robot):
    relative = relative_inertials(robot)
    for link in range(robot.width):
        rows = slice(link * PER_LINK, (link + 1) * PER_LINK)
        np.testing.assert_allclose(relative[rows, link * PER_LINK], robot.inertials[link], atol=1e-9)
    assert np.linalg.matrix_rank(relative) == robot.width * PER_LINK


def test_whitening_some_joints_is_whitening_all_of_them(plain):
    noise = Noise(np.tile(AR, (2, 1)), np.array([0.3, 2.0]))
    values = np.random.default_rng(2).standard_normal((*plain.rows.target.shape, 3))
    for joints in (np.array([1]), np.array([0, 1]), np.array([], int)):
        some = plain.whitening.of(values[:, joints], noise, joints)
        np.testing.assert_array_equal(some, plain.whitening.of(values, noise)[:, joints])


@pytest.mark.parametrize("name", ["arm2", "arm6", "arm7"])
def test_links_that_are_off_by_a_share_are_off_by_about_that_in_each_unit(name):
    """Masses, centres and extents are off by 5 %, with a clip at 10 %: no unit is so small that it is off by much more."""
    robot, share = Robot.bundled(name), 0.05
    units = np.linalg.inv(relative_inertials(robot))
    rng = np.random.default_rng(5)
    wrong = np.array([wrong_robot(robot, share, rng).inertials.ravel() for _ in range(40)])
    errors = (wrong - robot.inertials.ravel()) @ units.T
    sizes = np.sqrt(np.mean(errors**2, axis=0)).reshape(-1, PER_LINK)
    assert sizes[:, 0] == pytest.approx(share, rel=0.3)
    assert sizes[:, 1:4].max() < 2.0 * share
    assert np.median(sizes.max(axis=1)) < 2.0 * share


@pytest.mark.parametrize("name", ["arm6", "arm7"])
@pytest.mark.parametrize("seed", [1, 2])
def test_noise_of_the_position_is_weighed_down_by_itself(name, seed):
    """It is no slow effort sensor and no elastic joint, though it makes the effort look stiffer than it is."""
    robot = Robot.bundled(name)
    truth = wrong_robot(robot, 0.05, np.random.default_rng(seed))
    recording = simulate(truth, duration=20.0, seed=seed).recording
    signals = flattened(prepare(recording), quiet_cutoff([recording], robot))
    equations = build(signals, robot)
    soft = [one for one in Candidates.of(robot).terms if one.effect.name == "joint_elasticity"]
    terms = [one.shaped(one.effect.shapes(equations.motion, one.target)[0]) for one in soft]
    pool = Pool(equations, Noise(np.zeros((robot.width, 1)), 0.01 * equations.rows.effort_scale), terms, 0.05)
    for _ in range(3):
        noise = noise_of(equations, pool.residual(pool.fit(())), np.full(robot.width, 1e-9))
        pool = Pool(equations, noise, terms, 0.05)
    fit, links = pool.fit(()), equations.rigid.shape[2]
    std = float(np.sqrt(fit.covariance[links + 2, links + 2]))
    slow, jitter = fit.coefficients[links + 1 : links + 3]
    assert jitter > 5.0 * std and abs(slow) < 0.3 * jitter
    assert pool.gains(fit, range(len(terms))).max() < 2.0


def test_whitening_gives_back_what_the_noise_was_made_of(plain):
    std = np.array([0.3, 2.0])
    rng = np.random.default_rng(1)
    innovations = rng.standard_normal(plain.rows.target.shape)
    noise = np.zeros_like(innovations)
    for k in range(len(noise)):
        past = [AR[i] * noise[k - 1 - i] for i in range(3) if k > i]
        noise[k] = std * innovations[k] + np.sum(past, axis=0)
    full = plain.whitening.full()
    whitened = plain.whitening.of(noise, Noise(np.tile(AR, (2, 1)), std))
    np.testing.assert_allclose(whitened[full], innovations[full], atol=1e-9)
    assert not whitened[~plain.usable].any()


def test_the_noise_model_is_found_and_makes_the_residual_white():
    equations = equations_of(duration=40.0)
    residual = coloured(equations, AR, 0.2)
    noise = noise_of(equations, residual, np.full(2, 1e-6))
    rows = equations.whitening.full().sum(axis=0).min()
    np.testing.assert_allclose(noise.coefficients, np.tile(AR, (2, 1)), atol=4.0 / np.sqrt(rows))
    np.testing.assert_allclose(noise.std, 0.2, rtol=4.0 / np.sqrt(2.0 * rows))
    good = equations.whitening.full().all(axis=1)
    whitened = equations.whitening.of(residual, noise)[good]
    correlation = [np.mean(whitened[lag:] * whitened[:-lag], axis=0) for lag in range(1, 7)]
    assert np.abs(correlation).max() < 4.0 / np.sqrt(rows)
    raw = np.mean(residual[1:] * residual[:-1], axis=0) / np.mean(residual**2, axis=0)
    assert raw.min() > 0.3  # it was not white before


def test_a_random_walk_stays_stable(plain):
    residual = np.cumsum(np.random.default_rng(2).standard_normal(plain.rows.target.shape), axis=0)
    noise = noise_of(plain, residual, np.full(2, 1e-6))
    for a in noise.coefficients:
        assert np.abs(np.roots([1.0, *-a])).max() < 0.99


def test_noise_never_falls_below_its_floor(plain):
    noise = noise_of(plain, np.zeros_like(plain.rows.target), np.array([0.1, 0.2]))
    np.testing.assert_allclose(noise.std, [0.1, 0.2])


def test_rows_know_how_much_of_their_noise_was_seen(plain):
    equations = replace(plain, rows=replace(plain.rows, usable=np.ones_like(plain.usable)))
    row = 40
    equations.usable[row, 1] = False
    history = equations.whitening.history(3)
    np.testing.assert_array_equal(history[row : row + 5, 1], [-1, 0, 1, 2, 3])
    assert (history[row - 1 : row + 5, 0] == 3).all()
    for run in equations.rows.runs:
        np.testing.assert_array_equal(history[run.start : run.start + 3, 0], [0, 1, 2])


def test_squares_and_scales_are_the_gaussian_likelihood_across_gaps(plain):
    """Whitening row by row gives what the whole covariance matrix of what is left of the noise gives."""
    equations = replace(plain, rows=replace(plain.rows, usable=np.ones_like(plain.usable)))
    equations.usable[[30, 32, 33, 50], 0] = False
    std = 0.4
    noise = Noise(np.tile(AR, (2, 1)), np.full(2, std))
    residual = np.random.default_rng(5).standard_normal(plain.rows.target.shape)
    history = equations.whitening.history(3)
    scales = noise.of(np.zeros_like(equations.usable), np.maximum(history, 0))
    squares = np.sum(equations.whitening.of(residual, noise)[:, 0] ** 2)
    logs = np.sum(np.log(scales[equations.usable[:, 0], 0]))
    response = [1.0]
    for k in range(1, 400):
        response.append(sum(AR[i] * response[k - 1 - i] for i in range(3) if k > i))
    lags = [std**2 * np.dot(response[: 400 - k], response[k:]) for k in range(400)]
    wanted_squares = wanted_logs = 0.0
    broken = np.flatnonzero(~equations.usable[:, 0])
    for run in equations.rows.runs:
        inside = broken[(broken >= run.start) & (broken < run.stop)]
        for piece in np.split(np.arange(run.start, run.stop), inside - run.start):
            piece = piece[equations.usable[piece, 0]]
            covariance = toeplitz(lags[: len(piece)])
            wanted_squares += residual[piece, 0] @ np.linalg.solve(covariance, residual[piece, 0])
            wanted_logs += 0.5 * np.linalg.slogdet(covariance)[1]
    np.testing.assert_allclose(squares, wanted_squares, rtol=1e-6)
    np.testing.assert_allclose(logs, wanted_logs, rtol=1e-6)


def test_a_straight_line_in_each_block_is_taken_out(plain):
    rng = np.random.default_rng(3)
    lines = np.empty_like(plain.rows.target)
    for b in range(plain.rows.blocks):
        rows = np.flatnonzero(plain.rows.block == b)
        lines[rows] = rng.normal(size=2) + np.outer(np.arange(len(rows)), rng.normal(size=2))
    noise, _ = white(plain, 1.0)
    np.testing.assert_allclose(without_trends(plain, lines), 0.0, atol=1e-9)
    once = without_trends(plain, noise + lines)
    np.testing.assert_allclose(once, without_trends(plain, noise), atol=1e-9)
    np.testing.assert_allclose(without_trends(plain, once), once, atol=1e-9)
    assert noise.std() > once.std() > 0.8 * noise.std()


def test_blocks_are_runs_of_about_two_seconds_that_cover_everything(plain):
    time = plain.rows.time
    assert (np.diff(plain.rows.block) >= 0).all()
    np.testing.assert_array_equal(np.unique(plain.rows.block), np.arange(plain.rows.blocks))
    for b in range(plain.rows.blocks):
        assert np.ptp(time[plain.rows.block == b]) <= BLOCK_SECONDS
    assert plain.rows.blocks == np.ceil(np.ptp(time) / BLOCK_SECONDS)


@pytest.fixture(scope="module")
def in_turn() -> Equations:
    """Of a six-axis arm whose joints move one after the other, each twice for 1.5 s."""
    arm = Robot.bundled("arm6")
    time = np.arange(round(27.0 * RATE)) / RATE
    middle = 0.5 * (np.maximum(arm.limits.lower, -2.0) + np.minimum(arm.limits.upper, 2.0))
    position = np.tile(middle, (len(time), 1))
    for k in range(2 * arm.width):
        since = np.clip(time - 1.0 - 2.0 * k, 0.0, 1.5)
        position[:, k % arm.width] += 0.3 * (1.0 - np.cos(2.0 * np.pi * since / 1.5))
    recording = Recording(time, arm.joints, position, np.gradient(position, time, axis=0), 0.0 * position)
    signals = flattened(prepare(recording), CUTOFF)
    return build(replace(signals, effort=described_effort(arm, signals), unmeasured=None), arm)


def test_joints_that_move_one_after_the_other_move_in_several_blocks(in_turn):
    """Blocks of two seconds would leave a joint's only motion out of the search, or out of what is held out."""
    blocks = [len(np.unique(in_turn.rows.block[in_turn.usable[:, j]])) for j in range(in_turn.rows.width)]
    assert (in_turn.rows.moving < 4.0).all() and min(blocks) >= 4
    time = in_turn.rows.time
    lengths = [np.ptp(time[in_turn.rows.block == b]) for b in range(in_turn.rows.blocks)]
    assert 0.4 < np.median(lengths) < 1.0


def in_time(equations: Equations) -> tuple[set[str], int]:
    """What changes with time or winds with the position of the candidates, and how many kinds there are of all."""
    names = {term.effect.name for term in Candidates.shown_by(equations).terms}
    return names & {"external_wrench", "drift", "cogging"}, len(names)


def test_of_joints_that_move_now_and_then_nothing_is_told_that_changes_with_time(in_turn, plain):
    (seldom, less), (always, more) = in_time(in_turn), in_time(plain)
    assert not seldom and always == {"external_wrench", "drift", "cogging"} and more - less == 3


def test_nor_where_the_low_pass_leaves_few_values_of_a_motion(plain):
    signals, robot = plain.motion.signals, plain.motion.robot
    low = 0.9 * LEAST_VALUES / (2.0 * plain.rows.moving.max())
    slow = replace(signals, cutoff=low, own=Lowpass(low, 0))
    assert plain.rows.moving.max() > LEAST_MOTION and plain.rows.moving.max() < least_motion(slow)
    assert not in_time(build(slow, robot))[0]


def test_a_long_recording_has_longer_blocks(robot):
    signals = signals_of(duration=2.0 * MOST_BLOCKS + 20.0)
    equations = build(signals, robot)
    time = equations.rows.time
    lengths = [np.ptp(time[equations.rows.block == b]) for b in range(equations.rows.blocks)]
    assert equations.rows.blocks == MOST_BLOCKS
    assert min(lengths) > BLOCK_SECONDS
    assert np.ptp(lengths) < 0.1 * BLOCK_SECONDS


def test_a_long_pause_does_not_make_blocks_long(robot):
    signals = signals_of()
    half = len(signals) // 2
    paused = replace(
        signals,
        time=signals.time + np.where(np.arange(len(signals)) < half, 0.0, 1e6),
        segments=(slice(0, half), slice(half, len(signals))),
    )
    equations = build(paused, robot)
    time = equations.rows.time
    assert equations.rows.blocks >= build(signals, robot).rows.blocks
    for run in equations.rows.runs:
        for b in np.unique(equations.rows.block[run]):
            assert np.ptp(time[run][equations.rows.block[run] == b]) <= BLOCK_SECONDS


def test_two_recordings_share_no_run_and_no_block(robot):
    parts = [signals_of(seed=0), signals_of(seed=1)]
    equations = build(concatenated(parts), robot)
    assert len(equations.rows.runs) == 2
    first, second = (set(equations.rows.block[run].tolist()) for run in equations.rows.runs)
    assert len(first & second) <= 1  # one may lie across the seam


def test_a_better_load_renews_only_columns_made_from_it():
    load_made = f"load_dependent_friction@{J2}:ratio=0.2"
    equations = equations_of()
    robot = equations.motion.robot
    (of_load, _), (other, _) = term(load_made, robot), term(SPECS[0], robot)
    before = equations.columns.of(of_load).copy(), equations.columns.of(other)
    equations.update_load(2.0 * equations.motion.load, equations.decimation.simulated.drive)
    np.testing.assert_allclose(equations.columns.of(of_load), 2.0 * before[0], atol=1e-9)
    assert equations.columns.of(other) is before[1]


@pytest.mark.parametrize("what", ["no effort", "no motion"])
def test_it_refuses_what_cannot_be_diagnosed(robot, what):
    signals = signals_of()
    if what == "no effort":
        signals = replace(signals, effort=None)
    else:
        still = np.zeros_like(signals.position)
        signals = replace(signals, velocity=still, acceleration=still)
    with pytest.raises(RecordingError):
        build(signals, robot)


@pytest.fixture(scope="module")
def quiet() -> Recording:
    return simulate(Robot.bundled("arm2"), duration=10.0, rate=250.0).recording


def test_more_noise_of_the_position_asks_for_a_lower_cutoff(robot, quiet):
    rng = np.random.default_rng(4)
    noise = rng.standard_normal(quiet.position.shape)
    noisy = [replace(quiet, position=quiet.position + std * noise) for std in (0.0, 1e-4, 3e-4, 1e-3, 3e-3)]
    chosen = [quiet_cutoff([recording], robot) for recording in noisy]
    assert chosen == sorted(chosen, reverse=True)
    assert chosen[0] > chosen[-1]


def test_more_noise_of_the_effort_allows_a_higher_cutoff(robot, quiet):
    assert quiet.effort is not None
    rng = np.random.default_rng(5)
    position = quiet.position + 5e-4 * rng.standard_normal(quiet.position.shape)
    noise = quiet.effort.std(axis=0) * rng.standard_normal(quiet.position.shape)
    chosen = [
        quiet_cutoff([replace(quiet, position=position, effort=quiet.effort + share * noise)], robot)
        for share in (0.0, 0.01, 0.1, 1.0)
    ]
    assert chosen == sorted(chosen)
    assert chosen[0] < chosen[-1] <= CUTOFF_OF_USUAL * usual_cutoff(quiet.rate)


def test_the_worst_recording_decides(robot, quiet):
    noise = 3e-3 * np.random.default_rng(6).standard_normal(quiet.position.shape)
    noisy = replace(quiet, position=quiet.position + noise)
    assert quiet_cutoff([quiet, noisy], robot) == quiet_cutoff([noisy], robot)


def test_rows_are_thinned_to_what_the_low_pass_leaves(plain):
    spacing = np.diff(plain.rows.time)
    assert spacing.max() < 1.0 / (2.0 * CUTOFF)
    assert spacing.min() > 1.0 / (4.0 * CUTOFF)


def test_what_acts_only_in_held_out_rows_is_believed_to_be_as_small_as_anywhere(robot):
    equations = equations_of()
    push, _ = term(f"external_wrench@{J1}:start=3,end=6,torque=2", robot)
    columns = equations.columns.of(push)
    everywhere = equations.spread(push, columns)
    time = equations.rows.time
    equations.use_rows(equations.usable & ~((time > 2.5) & (time < 6.5))[:, None])
    assert np.abs(columns[equations.usable]).max() < 1e-3 * np.abs(columns).max()
    assert equations.spread(push, columns) == pytest.approx(everywhere)


def test_masses_of_a_description_are_believed_half_as_well_as_shapes_until_both_are_usual(plain, robot):
    masses = np.arange(robot.width * PER_LINK) % PER_LINK == 0
    for error, of_masses in ((0.01, 0.02), (0.02, 0.04), (0.05, 0.05), (0.1, 0.1)):
        assert plain.errors.spread(error) == pytest.approx(np.where(masses, of_masses, error))
    known = build(
        plain.motion.signals,
        robot,
        known=Known(LeftOpen.plain(np.eye(robot.width * (PER_LINK + PER_JOINT)))),
    )
    assert known.errors.spread(0.02) == pytest.approx(0.02)


def test_links_are_off_by_shares_of_their_own_beneath_a_load():
    robot = Robot.bundled("arm2")
    (load,) = (parse_spec("payload@arm2_link2:mass=3,com_x=0.1,com_y=0,com_z=0", robot),)
    model = ExtendedModel(robot, (load,), np.ones(2))
    known = model.compared()
    assert known.unloaded is not None
    assert known.robot.inertials[1, 0] == pytest.approx(robot.inertials[1, 0] + 3.0)
    equations = build(signals_of(), known.robot, known=known.of_model)
    np.testing.assert_allclose(equations.errors.relative, relative_inertials(robot))
