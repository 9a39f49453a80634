"""Scores: known errors, and rollouts of robots whose motion is known."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from bag_cases import PENDULUM

from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.rollout import Step, _rosenbrock, _runge_kutta
from bdnn_ros.scores import (
    Scores,
    rollout_error,
    score,
    score_description,
    score_model,
    without_effort,
)
from bdnn_ros.signals import Signals, prepare
from bdnn_ros.signals.kernels import lagging
from bdnn_ros.simulation.excitation import fourier


class Model(Robot):
    """A robot that predicts along a motion."""

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort, (N, n) [N·m]."""
        return self.inverse_dynamics(signals.position, signals.velocity, signals.acceleration)


@pytest.fixture
def pendulum() -> Model:
    """A pendulum."""
    return Model.from_urdf(PENDULUM)


def driven(model: Robot, duration: float = 20.0) -> Signals:
    """The motion of a robot along a sinusoid, and the effort that it takes."""
    time = np.arange(0.0, duration, 0.002)
    q = 0.8 * np.sin(1.7 * time)[:, None]
    v, a = 0.8 * 1.7 * np.cos(1.7 * time)[:, None], -(1.7**2) * q
    return prepare(Recording(time, model.joints, q, v, model.inverse_dynamics(q, v, a)))


def test_known_errors_have_known_scores() -> None:
    rng = np.random.default_rng(0)
    measured = rng.normal(size=(100_000, 2)) * [2.0, 5.0] + 30.0
    predicted = measured + rng.normal(size=measured.shape) * [0.2, 2.5]
    found = score(measured, predicted, ("a", "b"))
    np.testing.assert_allclose(found.rmse, [0.2, 2.5], rtol=0.02)
    np.testing.assert_allclose(found.nrmse, [0.1, 0.5], rtol=0.02)
    np.testing.assert_allclose(found.nmse, found.nrmse**2)
    assert found.nrmse_mean == pytest.approx(np.mean(found.nrmse))
    assert score(measured, measured, ("a", "b")).nrmse_mean == 0.0
    mean = np.broadcast_to(measured.mean(axis=0), measured.shape)
    np.testing.assert_allclose(score(measured, mean, ("a", "b")).nrmse, 1.0)


def test_json_is_as_the_contract_says() -> None:
    found = score(np.array([[1.0, 5.0], [3.0, 5.0]]), np.array([[1.0, 5.0], [2.0, 6.0]]), ("a", "b"))
    text = json.dumps(found.as_json(), allow_nan=False)
    assert json.loads(text) == {
        "joints": ["a", "b"],
        "rmse": pytest.approx([0.5**0.5, 0.5**0.5]),
        "nrmse": [pytest.approx(0.5**0.5), None],
        "nmse": [pytest.approx(0.5), None],
        "nrmse_mean": pytest.approx(0.5**0.5),
    }
    steady = score(np.ones((3, 1)), np.ones((3, 1)), ("a",))
    assert steady.as_json()["nrmse_mean"] is None


def test_no_sample_is_no_score() -> None:
    with pytest.raises(RecordingError, match="No sample is left"):
        score(np.empty((0, 2)), np.empty((0, 2)), ("a", "b"))


def test_the_true_model_scores_well_and_a_wrong_one_as_expected(pendulum: Model) -> None:
    signals = driven(pendulum)
    assert score_model(pendulum, [signals]).nrmse[0] < 1e-3
    heavier = pendulum.with_inertials(1.2 * pendulum.inertials)
    found = score_model(heavier, [signals, signals])
    assert isinstance(found, Scores)
    assert signals.effort is not None
    inside = signals.smooth(signals.effort)[signals.interior]
    assert found.rmse[0] == pytest.approx(0.2 * np.sqrt(np.mean(inside**2)), rel=1e-2)
    with pytest.raises(RecordingError, match="no effort"):
        score_model(pendulum, [replace(signals, effort=None)])


def test_a_description_s_dry_friction_is_as_soft_as_the_measured_effort() -> None:
    """Its steps were sharper than those that both low-passes leave: a right description seemed eight times worse than a model."""
    robot = Robot.from_urdf(PENDULUM)
    rough = robot.with_joint_parameters(coulomb=robot.coulomb + 3.0)
    signals = driven(rough)
    described = score_description(rough, [signals]).nrmse[0]
    assert described == pytest.approx(score_model(ExtendedModel(rough, (), np.zeros(1)), [signals]).nrmse[0])


@pytest.mark.parametrize("late", [0.15, -0.15])
def test_where_a_lead_leaves_the_motion_nothing_is_predicted_nor_scored(late: float) -> None:
    """A spline that went on beyond a piece's first sample grew with the cube of the time to it."""
    robot, rng = Robot.bundled("arm2"), np.random.default_rng(1)
    time = np.arange(2400) / 100.0
    motion = fourier(robot, time, np.random.default_rng(0))
    position = motion.position + 5e-5 * rng.standard_normal(motion.position.shape)
    effort = robot.inverse_dynamics(motion.position, motion.velocity, motion.acceleration)
    then = np.clip(time - late, 0.0, time[-1])
    moved = np.stack([np.interp(then, time, column) for column in effort.T], axis=1)
    recording = Recording(time, robot.joints, position, None, moved).part(time % 4.0 < 3.6)
    model = ExtendedModel(robot, (), np.zeros(2), lead=-late)
    assert score_model(model, [prepare(recording)]).nrmse_mean < 0.01
    assert (np.abs(model.predict(prepare(recording))) < np.abs(effort).max(axis=0) + effort.std(axis=0)).all()


def test_the_true_model_rolls_out_along_the_motion(pendulum: Model) -> None:
    signals = driven(pendulum)
    found = rollout_error(pendulum, signals, 0.5)
    assert found.horizon == pytest.approx(0.5, abs=0.01)
    assert found.windows == pytest.approx(len(signals) / signals.rate / found.horizon, abs=2)
    assert found.position[0] < 1e-3


def test_a_constant_push_moves_by_half_its_acceleration_times_time_squared(pendulum: Model) -> None:
    """A second's rollout of a wrong effort: the error is that of a uniform acceleration for a short time."""
    signals = driven(pendulum)
    assert signals.effort is not None
    pushed = replace(signals, effort=signals.effort + 0.5)
    horizon, inertia = 0.1, float(pendulum.mass_matrix(np.zeros(1))[0, 0])
    found = rollout_error(pendulum, pushed, horizon)
    assert found.position[0] == pytest.approx(0.5 * 0.5 / inertia * found.horizon**2, rel=0.05)


def test_a_rollout_that_diverges_is_told_as_such(pendulum: Model) -> None:
    signals = driven(pendulum)
    unstable = pendulum.with_joint_parameters(viscous=np.array([-1e4]))
    found = rollout_error(unstable, signals, 1.0)
    assert found.position.tolist() == [np.inf]
    assert found.as_json()["position"] == [None]


@pytest.mark.parametrize("viscous", [50.0, 1e4])
def test_damping_that_outruns_the_samples_does_not_run_away(pendulum: Model, viscous: float) -> None:
    """Efforts of the true motion: it is found again, however fast the friction brakes the link."""
    damped = pendulum.with_joint_parameters(viscous=np.array([viscous]))
    found = rollout_error(damped, driven(damped), 0.5)
    assert found.position[0] < 2e-3


def test_the_implicit_step_is_of_second_order(pendulum: Model) -> None:
    """Half the step, a quarter of the error, against Runge-Kutta with steps much shorter."""
    q, v, u = np.array([[0.7]]), np.array([[1.5]]), np.array([[2.0]])

    def after(step: Step, steps: int) -> float:
        now = q, v
        for _ in range(steps):
            now = step(pendulum, *now, u, u, 0.2 / steps)
        return float(now[0][0, 0])

    exact = after(_runge_kutta, 400)
    errors = [abs(after(_rosenbrock, steps) - exact) for steps in (40, 80, 160)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.2)


def test_horizons(pendulum: Model) -> None:
    signals = driven(pendulum, 4.0)
    assert rollout_error(pendulum, signals, 100.0).windows == 1
    assert rollout_error(pendulum, signals, np.inf).windows == 1
    assert rollout_error(pendulum, signals, 1e-9).horizon == pytest.approx(1.0 / signals.rate)
    with pytest.raises(UsageError, match="is no time"):
        rollout_error(pendulum, signals, 0.0)
    with pytest.raises(RecordingError, match="no effort"):
        rollout_error(pendulum, replace(signals, effort=None), 0.5)


def test_rollouts_stay_within_the_pieces(pendulum: Model) -> None:
    signals = driven(pendulum)
    chosen = np.ones(len(signals), bool)
    chosen[1000:1100] = False
    assert rollout_error(pendulum, signals.rows(chosen), 0.5).position[0] < 1e-3


@pytest.mark.filterwarnings("error")
def test_a_constant_effort_has_a_mean_that_is_not_known() -> None:
    """And finding that out warns of nothing."""
    measured = np.ones((50, 2))
    assert np.isnan(score(measured, measured + 0.1, ("a", "b")).nmse_mean)
    measured[::2, 1] = 0.0
    scores = score(measured, measured + 0.1, ("a", "b"))
    assert scores.nmse_mean == scores.nmse[1]


def swinging(robot: Model, duration: float) -> Recording:
    """Both joints of a model of two, exactly as it has them."""
    time = np.arange(0.0, duration, 0.005)
    q = np.sin(np.outer(time, [1.7, 2.3]))
    v, a = np.cos(np.outer(time, [1.7, 2.3])) * [1.7, 2.3], -q * np.square([1.7, 2.3])
    return Recording(time, robot.joints, q, v, robot.inverse_dynamics(q, v, a))


@pytest.mark.filterwarnings("error")
def test_a_joint_without_a_measured_effort_has_no_score_and_leaves_none_to_roll_out() -> None:
    robot = Model.from_urdf(Robot.bundled("arm2").urdf)
    whole = swinging(robot, 10.0)
    none = replace(whole, effort=whole.require_effort() * [1.0, 0.0])
    known, unknown = (prepare(recording, 10.0) for recording in (whole, none))
    assert (without_effort(known), without_effort(unknown)) == ([], ["arm2_joint2"])
    found, expected = score_model(robot, [unknown]), score_model(robot, [known])
    assert found.rmse[0] == expected.rmse[0]
    assert np.isnan([found.rmse[1], found.nrmse[1], found.nmse[1]]).all()
    assert (found.in_mean, expected.in_mean) == (1, 2)
    assert found.nrmse_mean == found.nrmse[0] and found.as_json()["rmse"][1] is None
    assert score_description(robot, [unknown]).as_json() == found.as_json()
    rollout = rollout_error(robot, unknown, 0.25)
    nothing = {"horizon": rollout.horizon, "windows": 0, "lost": 0, "position": [None, None]}
    assert rollout.as_json() == nothing
    assert rollout_error(robot, known, 0.25).windows > 0


def test_no_motion_is_rolled_out_along_an_effort_that_was_held() -> None:
    """A driver that is stuck for three seconds repeats itself, a sensor at its limit does; the motion goes on."""
    robot = Model.from_urdf(Robot.bundled("arm2").urdf)
    whole = swinging(robot, 12.0)

    effort = whole.require_effort()
    within = ((whole.time >= 5.0) & (whole.time < 8.0))[:, None]
    stuck = prepare(replace(whole, effort=np.where(within, effort[1000], effort)))
    plain, some = (rollout_error(robot, signals, 0.25) for signals in (prepare(whole), stuck))
    assert plain.windows - 16 <= some.windows <= plain.windows - 12
    assert (some.position < 2.0 * plain.position).all() and (some.position < 0.01).all()
    assert rollout_error(robot, stuck, 100.0).horizon == pytest.approx(5.0, abs=0.5)
    half = np.stack([whole.time < 7.0, whole.time > 6.0], axis=1)
    saturated = prepare(replace(whole, effort=np.where(half, effort.max(axis=0) + 1.0, effort)))
    never = rollout_error(robot, saturated, 0.25)
    assert never.windows == 0 and np.isnan(never.position).all()


@pytest.mark.parametrize(
    ("late", "lag", "delay"), [(0.06, 0.0, 0.0), (-0.06, 0.0, 0.0), (0.0, 0.06, 0.0), (0.0, 0.0, 0.06)]
)
def test_a_rollout_is_driven_by_the_effort_as_it_acted(late: float, lag: float, delay: float) -> None:
    """Efforts that come late, slowly or early, one in another scale: a right model errs as that of the undelayed twin does."""
    robot = Model.from_urdf(Robot.bundled("arm2").urdf)
    whole = swinging(robot, 16.0)
    effort = whole.require_effort()
    scaled = (
        Installed(get("effort_scale"), 0, None, {"scale": 1.25}),
        Installed(get("effort_offset"), 0, None, {"offset": 0.5}),
    )
    delayed = (Installed(get("effort_delay"), 1, None, {"delay": delay}),) if delay else ()
    model = ExtendedModel(robot, (*scaled, *delayed), np.zeros(2), lead=-late, lag=lag)

    measured = lagging(effort, lag, 200.0) if lag else effort
    then = whole.time[:, None] + [-late, delay - late]
    measured = np.stack([np.interp(then[:, j], whole.time, measured[:, j]) for j in range(2)], axis=1)
    measured[:, 0] = (measured[:, 0] - 0.5) / 1.25
    # beyond the recording nothing is known of an effort that moves; a gap makes two pieces
    inside = ((whole.time > 0.5) & (whole.time < 15.5)) & (np.abs(whole.time - 8.0) > 0.5)
    twin, told = (prepare(each.part(inside)) for each in (whole, replace(whole, effort=measured)))
    expected, found = rollout_error(robot, twin, 0.25), rollout_error(model, told, 0.25)
    assert expected.windows - 2 <= found.windows <= expected.windows
    assert (found.position < 1.5 * expected.position + 1e-4).all()
    assert (
        rollout_error(replace(model, effects=scaled, lead=0.0, lag=0.0), told, 0.25).position > 0.005
    ).any()


def test_an_effort_that_was_held_drives_no_rollout_at_the_time_at_which_it_acted() -> None:
    """The samples that are left out are those whose own effort, some time away, was not measured."""
    robot = Model.from_urdf(Robot.bundled("arm2").urdf)
    whole = swinging(robot, 12.0)
    effort = whole.require_effort()
    late = np.stack([np.interp(whole.time - 0.5, whole.time, column) for column in effort.T], axis=1)
    within = ((whole.time >= 5.5) & (whole.time < 8.5))[:, None]
    stuck = prepare(replace(whole, effort=np.where(within, late[1100], late)))
    found = rollout_error(ExtendedModel(robot, (), np.zeros(2), lead=-0.5), stuck, 0.25)
    assert found.windows > 20 and (found.position < 0.01).all()


def test_a_motion_of_one_sample_has_no_rollout(pendulum):
    time = np.arange(500) / 100.0
    whole = prepare(Recording(time, pendulum.joints, np.sin(time)[:, None], None, np.sin(time)[:, None]))
    short = rollout_error(pendulum, whole.rows(np.arange(len(whole)) == 50), 0.1)
    assert short.windows == 0 and np.isnan(short.position).all()


def test_a_rollout_that_runs_away_takes_no_other_s_error(pendulum, monkeypatch):
    """One in a hundred made every joint's error infinite; how many there are is told."""
    time = np.arange(1000) / 100.0
    signals = prepare(Recording(time, pendulum.joints, np.sin(time)[:, None], None, np.sin(time)[:, None]))

    def ends(model, signals, effort, starts, steps):
        end = signals.position[starts + steps] + 0.1
        end[: ends.lost] = np.inf
        return end

    monkeypatch.setattr("bdnn_ros.scores.integrated", ends)
    for ends.lost, error in ((3, 0.1), (10**6, np.inf)):
        found = rollout_error(pendulum, signals, 0.5)
        assert found.lost == min(ends.lost, found.windows) and found.position[0] == pytest.approx(error)
