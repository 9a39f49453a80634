"""What changed since a model was identified: its own errors, of links and of joints alike, are no change."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.diagnosis.regression.building import IDENTIFIED, build
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.known import Known
from bdnn_ros.diagnosis.result import Finding
from bdnn_ros.effects.registry import get, parse_spec
from bdnn_ros.errors import ModelFileError
from bdnn_ros.extension.effects_file import EffectsFile
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.files import write_model_files
from bdnn_ros.extension.urdf import extended_urdf
from bdnn_ros.models import load_model, save_model
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Parameters
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mounting import tilt_of
from bdnn_ros.scores import described_effort, score_model
from bdnn_ros.signals import Signals, flattened, prepare
from bdnn_ros.simulation.excitation import Trajectory, fourier
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm2")
JOINT = "arm2_joint2"


@cache
def moved(seconds: float, *effects: str, seed: int = 0) -> Recording:
    """A recording of one worn robot with links 5 % off; another length is another motion."""
    robot = Robot.bundled("arm2")
    plan = fourier(robot, np.arange(round(seconds * 500.0)) / 500.0, np.random.default_rng(round(seconds)))
    return Scenario(robot, effects, seed=seed, wrong=0.05, worn=True, plan=plan).run()[0].recording


@pytest.fixture(scope="module")
def model() -> PhysicalModel:
    return Identifier(Robot.bundled("arm2")).fit([moved(40.0)])


def since(model: PhysicalModel, *effects: str) -> Examination:
    """The diagnosis of a new motion against the model."""
    return examine([moved(30.0, *effects)], model.robot, model=model)


def moved_errors(
    model: PhysicalModel, signals: Signals, left: LeftOpen
) -> tuple[Equations, np.ndarray, np.ndarray]:
    """The regression against a model, what some of its errors do there, and what parameters do that are moved so, rows (R, n)."""
    equations = build(signals, model.robot, model.predict(signals), Known(left))
    assert equations.errors.joints is not None
    units = 0.1 * IDENTIFIED * np.random.default_rng(1).standard_normal(equations.rigid.shape[2])
    learned = equations.errors.joints.moved(model.learned, units)
    errors = np.concatenate([equations.errors.relative @ units, equations.errors.joints.parameters @ units])
    errors[-model.robot.width :] *= -1.0  # the contract's offset counts the other way
    other = Parameters.from_vector(model.parameters.vector() + errors)
    robot = model.robot.with_inertials(other.inertials.ravel()).with_joint_parameters(
        armature=other.armature, viscous=other.viscous, coulomb=other.coulomb
    )
    after = replace(model, robot=robot, offset=other.offset, learned=learned).predict(signals)
    return equations, equations.rigid @ units, equations.decimation.as_rows(after - model.predict(signals))


@pytest.mark.slow
def test_errors_of_a_model_are_those_of_all_its_parameters(model):
    """One unit of each of them does to the effort what moved parameters do, of links and of joints."""
    signals = flattened(prepare(moved(30.0)), 5.0)
    _, found, wanted = moved_errors(model, signals, LeftOpen.plain(model.covariance))
    np.testing.assert_allclose(found, wanted, atol=0.05 * np.abs(wanted).max())


@pytest.mark.slow
def test_errors_of_a_model_are_those_of_what_its_joints_add(model):
    """Also by the weights of friction's curve; where a joint turns round nobody can say which way that pulls."""
    signals = flattened(prepare(moved(30.0)), 5.0)
    equations, found, wanted = moved_errors(model, signals, model.left_open)
    assert equations.errors.joints is not None and (equations.errors.joints.weights != 0.0).any()
    moves_on = equations.rows.sticking_doubt < 0.01
    assert moves_on.mean() > 0.5
    apart = np.abs(found - wanted)[moves_on] / np.abs(wanted).max()
    # which rows lie just beside a reversal is chance: rounding that differs moves a worst one from 1.9 to 2.4 %
    assert np.quantile(apart, 0.99) < 0.02 and apart.max() < 0.05


def test_a_model_predicts_steps_of_friction_as_soft_as_the_effort_is(model):
    """Also behind the flattened low-pass of a diagnosis, where the effort is not as soft as `smooth` would make it."""
    robot = Robot.bundled("arm2").with_joint_parameters(coulomb=np.array([2.0, 1.0]))
    plain = replace(model, robot=robot, offset=np.zeros(2), breakaway=(0, 0), learned=None, lead=0.0)
    plan = fourier(robot, np.arange(5000) / 500.0, np.random.default_rng(3))
    signals = flattened(prepare(Recording(plan.time, robot.joints, plan.position)), 4.0)
    error = plain.predict(signals) - described_effort(robot, signals)
    # some reversals graze zero: which way friction pulls there nobody can say
    usual = np.quantile(np.abs(error[signals.interior]), 0.95, axis=0)
    assert (usual < 0.02 * robot.coulomb).all()


def test_nothing_has_changed_where_only_the_motion_has(model):
    found = since(model).diagnosis
    assert (found.findings, found.verdict) == ((), "nothing_wrong")


@cache
def at_a_pace(seconds: float, pace: float, *effects: str) -> Recording:
    """A recording of a worn robot that takes its path so many times as fast as it could."""
    robot = Robot.bundled("arm2")
    rubs = f"stribeck_friction@{robot.joints[0]}:coulomb=0.5,static=0.62,velocity=0.1"
    time = np.arange(round(200.0 * seconds)) / 200.0
    path = fourier(robot, pace * time, np.random.default_rng(round(seconds)))
    plan = Trajectory(time, path.position, pace * path.velocity, pace**2 * path.acceleration)
    scenario = Scenario(robot, (rubs, *effects), seed=1, wrong=0.05, worn=True, noise=0.003, plan=plan)
    return scenario.run()[0].recording


@pytest.fixture(scope="module")
def slow() -> PhysicalModel:
    """A model of a robot that moved slowly."""
    return Identifier(Robot.bundled("arm2")).fit([at_a_pace(40.0, 0.4)])


def test_nothing_has_changed_where_a_robot_is_only_faster(slow):
    """How friction goes on beyond the speeds that the model was identified from, that motion left open."""
    found = examine([at_a_pace(30.0, 1.0)], slow.robot, model=slow).diagnosis
    assert (found.findings, found.verdict) == ((), "nothing_wrong")


@pytest.mark.slow
def test_what_changed_is_named_where_a_robot_is_faster_too(slow):
    rubs = f"coulomb_friction@{JOINT}:coulomb=0.05"
    found = examine([at_a_pace(30.0, 1.0, rubs)], slow.robot, model=slow).diagnosis
    (finding,) = found.findings
    assert (finding.effect, finding.joint) == ("coulomb_friction", JOINT)
    assert finding.parameters["coulomb"].value == pytest.approx(0.05, rel=0.2)


@pytest.mark.slow
def test_friction_that_grew_is_named_with_its_growth_alone(model):
    examination = since(model, f"coulomb_friction@{JOINT}:coulomb=0.4")
    (finding,) = examination.diagnosis.findings
    assert (finding.effect, finding.joint) == ("coulomb_friction", JOINT)
    grown = finding.parameters["coulomb"]
    assert abs(grown.value - 0.4) < 3.0 * grown.std < 0.2
    signals = [prepare(moved(25.0, f"coulomb_friction@{JOINT}:coulomb=0.4"))]
    before, after = (score_model(one, signals).nrmse_mean for one in (model, extend(examination)))
    assert after < 0.3 * before


@pytest.mark.slow
def test_friction_that_was_learned_to_grow_with_the_load_grows_with_a_payload():
    """It is no change of friction, and the extended model has it grow, too."""
    robot = Robot.bundled("arm2")

    def recorded(seconds: float, *effects: str) -> Recording:
        rubs = [f"load_dependent_friction@{joint}:ratio=0.12" for joint in robot.joints]
        time = np.arange(round(seconds * 200.0)) / 200.0
        plan = fourier(robot, time, np.random.default_rng(round(seconds)))
        scenario = Scenario(robot, (*rubs, *effects), seed=5, wrong=0.05, worn=True, noise=0.003, plan=plan)
        return scenario.run()[0].recording

    bears = "payload@arm2_link2:mass=1.5,com_x=0.1"
    before = Identifier(robot).fit([recorded(40.0)])
    assert before.learned.by_load
    examination = examine([recorded(30.0, bears)], before.robot, model=before)
    (finding,) = examination.diagnosis.findings
    told = {name: quantity.value for name, quantity in finding.parameters.items()}
    assert (finding.effect, finding.link) == ("payload", "arm2_link2")
    assert (told["mass"], told["com_x"]) == pytest.approx((1.5, 0.1), rel=0.05)
    laden = extend(examination)
    assert score_model(laden, [prepare(recorded(25.0, bears))]).nrmse_mean < 0.03
    (finding,) = examine([recorded(20.0)], laden.robot, model=laden).diagnosis.findings
    assert finding.effect == "payload"
    assert finding.parameters["mass"].value == pytest.approx(-1.5, rel=0.05)


@pytest.fixture(scope="module")
def laden() -> PhysicalModel:
    """A model of the robot while its first joint rubbed more and its second link carried something."""
    effects = (f"viscous_friction@{ARM.joints[0]}:viscous=0.8", "payload@arm2_link2:mass=0.6,com_z=0.1")
    return Identifier(ARM).fit([moved(40.0, *effects)])


@pytest.mark.slow
def test_what_became_less_is_named_with_how_much_less(laden, tmp_path):
    examination = since(laden)
    diagnosis = examination.diagnosis
    assert diagnosis.verdict == "explained"
    told = {finding.effect: finding for finding in diagnosis.findings}
    assert set(told) == {"viscous_friction", "payload"}
    lighter, smoother = told["payload"], told["viscous_friction"]
    assert (lighter.link, smoother.joint) == ("arm2_link2", ARM.joints[0])
    assert lighter.parameters["mass"].value == pytest.approx(-0.6, rel=0.1)
    assert smoother.parameters["viscous"].value == pytest.approx(-0.8, rel=0.1)
    assert "kg less than in the model" in lighter.sentence
    assert smoother.sentence.startswith(f"{ARM.joints[0]} has less viscous friction than the model")
    extended = extend(examination)
    again = Robot.from_urdf(extended_urdf(extended), ARM.joints)
    assert again.inertials[:, 0].sum() == pytest.approx(laden.robot.inertials[:, 0].sum() - 0.6, rel=0.03)
    np.testing.assert_allclose(again.inertials, extended.robot.inertials, rtol=1e-6, atol=1e-9)


def test_there_is_never_less_than_nothing():
    """Nothing of what the earlier model had none of."""
    robot = ARM.with_joint_parameters(coulomb=np.zeros(2), viscous=np.array([0.3, 0.0]))
    smoother, none = (
        get("viscous_friction").since(robot, 0, None),
        get("coulomb_friction").since(robot, 1, None),
    )
    assert smoother.coefficient_bounds == ((-0.3, np.inf),)
    assert none.coefficient_bounds == get("viscous_friction").coefficient_bounds == ((0.0, np.inf),)


@cache
def on_a_tilted_base(*effects: str, tilt: tuple[float, float] = (3.0, -4.0), seed: int = 7) -> Recording:
    leaning = f"base_tilt:roll_deg={tilt[0]},pitch_deg={tilt[1]}"
    scenario = Scenario(
        Robot.bundled("arm6"), (leaning, *effects), seed=seed, wrong=0.05, duration=15.0, rate=200.0
    )
    return scenario.run()[0].recording


@pytest.fixture(scope="module")
def leaning() -> PhysicalModel:
    return Identifier(Robot.bundled("arm6")).fit([on_a_tilted_base()])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "tilt", "changed", "near"),
    [
        ((), (3.0, -4.0), {}, 0.0),
        (
            ("payload@arm6_link6:mass=1.5,com_x=0.05,com_z=0.08",),
            (3.0, -4.0),
            {("payload", "arm6_link6"): {"mass": 1.5, "com_x": 0.05, "com_z": 0.08}},
            0.005,
        ),
        ((), (5.0, -4.0), {("base_tilt", None): {"roll_deg": 2.0, "pitch_deg": 0.0}}, 0.05),
    ],
)
def test_what_was_identified_on_a_tilted_base_is_compared_as_it_stands(leaning, effects, tilt, changed, near):
    found = examine([on_a_tilted_base(*effects, tilt=tilt)], leaning.robot, model=leaning)
    told = {
        (finding.effect, finding.link): {name: one.value for name, one in finding.parameters.items()}
        for finding in found.diagnosis.findings
    }
    assert told.keys() == changed.keys()
    for place, values in changed.items():
        assert {name: told[place][name] for name in values} == pytest.approx(values, rel=0.05, abs=near)
    standing = extend(found).robot.gravity_vector
    np.testing.assert_allclose(np.degrees(tilt_of(standing)), tilt, atol=0.1)


FIRST, SECOND = ARM.joints
RUBS = f"viscous_friction@{SECOND}:viscous=0.5"
BEARS = "payload@arm2_link2:mass=1,com_x=0.2"
OFF = f"position_offset@{FIRST}:offset=0.1"
SCALED = f"effort_scale@{SECOND}:scale=0.7"
BIASED = f"effort_offset@{SECOND}:offset=0.5"
DELAYED = "effort_delay:delay=0.02"
FILTERED = f"velocity_filter@{FIRST}:cutoff=5"
PUSHED = f"external_wrench@{SECOND}:start=5,end=9,torque=1.5"
WARMING = f"drift@{SECOND}:of=viscous,start_value=0.2,end_value=1,end=20"
WARM = f"viscous_friction@{SECOND}:viscous=1"


def extended_by(*effects: str) -> ExtendedModel:
    """The model of a diagnosis that found just these effects."""
    return ExtendedModel(ARM, tuple(parse_spec(spec, ARM) for spec in effects), np.full(2, 0.01))


@cache
def with_sensors(*effects: str) -> Recording:
    return Scenario(ARM, effects, seed=3, duration=24.0, rate=200.0).run()[0].recording


def told_at(findings: tuple[Finding, ...]) -> dict[tuple[str, str], dict[str, float]]:
    """Values by effect and place."""
    return {(f.effect, f.where): {name: q.value for name, q in f.parameters.items()} for f in findings}


def error_of(model: ExtendedModel, signals: Signals) -> np.ndarray:
    """Root mean square error of a model's prediction, low-passed, (n,) [N·m]."""
    error = signals.smooth(model.predict(signals) - signals.effort)[signals.interior]
    return np.asarray(np.sqrt(np.mean(error**2, axis=0)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "now", "changes"),
    [
        ((OFF,), (OFF, BEARS), {("payload", "arm2_link2"): {"mass": 1.0, "com_x": 0.2}}),
        (
            (OFF,),
            (f"position_offset@{FIRST}:offset=0.15",),
            {("position_offset", FIRST): {"offset": 0.05}},
        ),
        ((SCALED, BIASED), (SCALED, BIASED, RUBS), {("viscous_friction", SECOND): {"viscous": 0.5}}),
        (
            (SCALED, BIASED),
            (f"effort_scale@{SECOND}:scale=0.84", BIASED),
            {("effort_scale", SECOND): {"scale": 1.2}},
        ),
        (
            (DELAYED,),
            (DELAYED, RUBS, BEARS),
            {
                ("viscous_friction", SECOND): {"viscous": 0.5},
                ("payload", "arm2_link2"): {"mass": 1.0, "com_x": 0.2},
            },
        ),
        (
            (f"effort_delay@{SECOND}:delay=0.015", SCALED),
            (f"effort_delay@{SECOND}:delay=0.04", SCALED),
            {("effort_delay", SECOND): {"delay": 0.025}},
        ),
        ((FILTERED,), (FILTERED,), {}),
        (
            (FILTERED,),
            (f"velocity_filter@{FIRST}:cutoff=10", RUBS),
            {("velocity_filter", FIRST): {"cutoff": 10.0}, ("viscous_friction", SECOND): {"viscous": 0.5}},
        ),
        ((PUSHED,), (RUBS,), {("viscous_friction", SECOND): {"viscous": 0.5}}),
        ((WARMING,), (WARM,), {}),
        ((WARMING,), (WARM, BEARS), {("payload", "arm2_link2"): {"mass": 1.0, "com_x": 0.2}}),
    ],
)
def test_only_what_changed_is_told_beside_sensors_and_times_of_an_earlier_model(
    before, now, changes, tmp_path
):
    """Sensors are as they were, pushes are over, and the extended model holds of what there is now, in its files too."""
    recording, earlier = with_sensors(*now), extended_by(*before)
    examination = examine([recording], earlier.robot, model=earlier)
    found = told_at(examination.diagnosis.findings)
    assert found.keys() == changes.keys()
    for place, values in changes.items():
        assert {name: found[place][name] for name in values} == pytest.approx(values, rel=0.02, abs=0.006)
    model, signals = extend(examination), prepare(recording)
    least = error_of(extended_by(*now), signals)
    assert (error_of(model, signals) < 1.1 * least + 1e-3).all()
    write_model_files(model, tmp_path)
    file = EffectsFile.read(tmp_path / "effects.yaml")
    robot = file.robot(Robot.from_file(tmp_path / "extended.urdf"))
    again = (
        Scenario(robot, installed=file.effects(robot), seed=3, duration=24.0, rate=200.0).run()[0].recording
    )
    assert (error_of(model, prepare(again)) < 1.1 * least + 1e-2).all()


def test_a_low_pass_that_is_gone_is_told_and_leaves_the_model():
    earlier = extended_by(FILTERED)
    examination = examine([with_sensors()], earlier.robot, model=earlier)
    (finding,) = examination.diagnosis.findings
    assert (finding.effect, finding.joint) == ("velocity_filter", FIRST)
    assert finding.sentence.endswith(
        "is the derivative of its position, no longer behind a low-pass of 5 Hz."
    )
    assert extend(examination).effects == ()


def test_a_low_pass_that_an_identified_model_knows_is_no_change(tmp_path):
    """Nor in the diagnosis after that; a later one that differs is told as such."""
    save_model(tmp_path, Identifier(ARM).fit([with_sensors(FILTERED)]))
    before = load_model(tmp_path)
    examination = examine([with_sensors(FILTERED, RUBS)], before.robot, model=before)
    (finding,) = examination.diagnosis.findings
    assert (finding.effect, finding.joint) == ("viscous_friction", SECOND)
    later = extend(examination)
    assert [one.effect.name for one in later.effects].count("velocity_filter") == 1
    assert all(
        not f.of_velocity for f in examine([with_sensors(FILTERED)], ARM, model=later).diagnosis.findings
    )
    (gone,) = examine([with_sensors()], before.robot, model=before).diagnosis.findings
    assert gone.sentence.endswith("is the derivative of its position, no longer behind a low-pass of 5 Hz.")


def test_a_model_of_before_knows_of_no_low_passes(model):
    arrays, info = model.to_state()
    assert np.isinf(model.velocity_cutoff).all()
    old = {name: value for name, value in info.items() if name != "velocity_lags"}
    assert np.isinf(PhysicalModel.from_state(arrays, old).velocity_cutoff).all()
    with pytest.raises(ModelFileError):
        PhysicalModel.from_state(arrays, {**info, "velocity_lags": [0.1] * 3})


def test_efforts_in_other_units_are_said_to_be():
    """The errors of a model with a scale are those of the efforts that act; the extended model's noise is measured again."""
    earlier = extended_by(SCALED)
    examination = examine([with_sensors(SCALED, RUBS)], earlier.robot, model=earlier)
    (note,) = (one for one in examination.diagnosis.notes if "as they act" in one)
    assert f"0.7 at {SECOND}" in note
    acts, measured = examination.diagnosis.effort_rmse["extended"], extend(examination).noise
    assert measured == pytest.approx(acts / np.array([1.0, 0.7]), rel=1e-6)


def test_efforts_are_moved_by_known_delays_within_what_was_recorded():
    """Across a pause nothing is known of them."""
    time = np.concatenate([np.arange(100), np.arange(150, 250)]) / 100.0
    effort = np.stack([10.0 * time, np.ones_like(time)], axis=1)
    recording = Recording(time, ARM.joints, np.zeros_like(effort), effort=effort)
    delayed = extended_by(f"effort_delay@{FIRST}:delay=0.015", "effort_delay:delay=0.02").compared()
    (moved,) = delayed.acting([recording])
    np.testing.assert_allclose(moved.effort[:, 0], 10.0 * (moved.time - 0.035))
    assert moved.time[0] == 0.04 and not ((moved.time > 1.0) & (moved.time < 1.535)).any()
    assert moved.notes[-1].endswith(f"35 ms later at {FIRST}, 20 ms later at {SECOND}.")
    (alike,) = extended_by("effort_delay:delay=0.02").compared().acting([recording])
    assert alike.notes[-1].endswith("by the earlier model, 20 ms later.")


def test_what_has_ended_is_left_out_with_its_deviations():
    """A drift stays at its end, with the deviation of that; a push is over."""
    known = replace(extended_by(WARMING, PUSHED, RUBS), stds=({"end_value": 0.1}, {}, {"viscous": 0.2}))
    examination = examine([with_sensors(WARM, RUBS, BIASED)], known.robot, model=known)
    assert examination.robot.viscous.tolist() == pytest.approx([0.0, 1.5])
    assert [one.effect.name for one in extend(examination).effects] == ["effort_offset"]
