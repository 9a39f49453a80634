"""The extended model against closed forms, axioms, and its own parts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bdnn_ros.bdnn import modelfile
from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.judging.posterior import estimates
from bdnn_ros.diagnosis.recorded.lateness import Lateness
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.coloring import noise_of
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.registry import Installed, parse_spec
from bdnn_ros.errors import ModelFileError, UsageError
from bdnn_ros.extension import extended
from bdnn_ros.extension.extend import _bodies, corrected_links, extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.identified import of_physical
from bdnn_ros.models import Model, load_model, save_model
from bdnn_ros.physical.consistency import feasible
from bdnn_ros.physical.couplings import CoupledMotors, Coupling
from bdnn_ros.physical.dictionary import CURVE_FEATURES, FEATURES, GROUPS, Scales
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals, prepare
from bdnn_ros.simulation.simulate import simulate

TIMELESS = (
    "coulomb_friction@arm7_joint4:coulomb=1.3",
    "viscous_friction@arm7_joint2:viscous=0.7",
    "stribeck_friction@arm7_joint1:coulomb=1.0,static=1.8,velocity=0.1",
    "asymmetric_friction@arm7_joint3:positive=0.8,negative=0.3",
    "load_dependent_friction@arm7_joint2:ratio=0.15",
    "quadratic_drag@arm7_joint5:drag=0.4",
    "armature@arm7_joint6:armature=0.05",
    "payload@arm7_link7:mass=1.5,com_x=0.02,com_z=0.1",
    "link_inertia@arm7_link4:scale=1.2",
    "base_tilt:roll_deg=3,pitch_deg=-4",
    "joint_spring@arm7_joint4:stiffness=3.0,rest=-1.5",
    "effort_offset@arm7_joint5:offset=0.4",
    "effort_scale@arm7_joint5:scale=0.8",
    "cogging@arm7_joint1:amplitude=0.5,periods_per_rev=12,phase=0.4",
    "position_offset@arm7_joint4:offset=0.05",
)
SHARP = (
    "coulomb_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "cogging",
    "effort_scale",
)
WORN_WRIST = (("coulomb_friction", "coulomb=0.2"), ("armature", "armature=0.03"))
TIMED = (
    "hysteresis@arm7_joint1:force=0.9,breakaway=0.03",
    "effort_delay:delay=0.012",
    "external_wrench@arm7_joint3:start=1.0,end=2.0,torque=2.0",
    "drift@arm7_joint2:of=viscous,start_value=0.1,end_value=1.0,start=0,end=4",
    "joint_elasticity@arm7_joint2:stiffness=900",
    "backlash@arm7_joint4:gap=0.01",
)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.bundled("arm7")


def motion(robot: Robot, duration: float = 4.0, rate: float = 100.0) -> Signals:
    """Sines of every joint about the middle of its range, derivatives exact."""
    time = np.arange(0.0, duration, 1.0 / rate)
    rate_ = 2.0 + np.arange(robot.width) * 0.3
    centre = 0.5 * (robot.limits.lower + robot.limits.upper)
    angle = time[:, None] * rate_
    return Signals(
        time=time,
        joints=robot.joints,
        position=centre + 0.4 * np.sin(angle),
        velocity=0.4 * rate_ * np.cos(angle),
        acceleration=-0.4 * rate_**2 * np.sin(angle),
        effort=None,
        reported_velocity=None,
        rate=rate,
        cutoff=10.0,
        segments=(slice(0, len(time)),),
        position_noise=np.zeros(robot.width),
        raw_rate=rate,
    )


def with_effects(robot: Robot, *specs: str) -> ExtendedModel:
    return ExtendedModel(robot, tuple(parse_spec(spec, robot) for spec in specs), np.zeros(robot.width))


def test_without_effects_it_is_the_robot(robot: Robot) -> None:
    model, signals = with_effects(robot), motion(robot)
    state = (signals.position, signals.velocity, signals.acceleration)
    np.testing.assert_allclose(model.inverse_dynamics(*state), robot.inverse_dynamics(*state))
    np.testing.assert_allclose(model.predict(signals), robot.rigid_effort(*state), atol=1e-9)


@pytest.mark.parametrize("spec", TIMELESS)
def test_a_point_and_a_motion_agree(robot: Robot, spec: str) -> None:
    model, plain, signals = with_effects(robot, spec), with_effects(robot), motion(robot, 2.0, rate=1000.0)
    state = (signals.position, signals.velocity, signals.acceleration)
    point = model.inverse_dynamics(*state) - plain.inverse_dynamics(*state)
    along = model.predict(signals) - plain.predict(signals)
    if spec.split("@")[0] in SHARP:  # steps and ripples are low-passed along a motion, as the effort was
        point, along = signals.smooth(point)[signals.interior], along[signals.interior]
        # 1.5 % is left at the reversals where the load's own step is low-passed twice, below 1 % elsewhere
        assert np.sqrt(np.mean((point - along) ** 2)) < 0.02 * np.sqrt(np.mean(point**2))
    else:
        np.testing.assert_allclose(point, along, atol=2e-6 * np.abs(plain.predict(signals)).max())


@pytest.mark.parametrize("spec", TIMED)
def test_what_needs_a_motion_counts_in_predict_only(robot: Robot, spec: str) -> None:
    model, signals = with_effects(robot, spec), motion(robot)
    state = (signals.position, signals.velocity, signals.acceleration)
    np.testing.assert_allclose(model.inverse_dynamics(*state), robot.inverse_dynamics(*state), atol=1e-9)
    assert np.abs(model.predict(signals) - with_effects(robot).predict(signals)).max() > 0.01


def test_forward_inverts_inverse(robot: Robot) -> None:
    model, signals = with_effects(robot, *TIMELESS), motion(robot, 1.0)
    effort = model.inverse_dynamics(signals.position, signals.velocity, signals.acceleration)
    again = model.forward_dynamics(signals.position, signals.velocity, effort)
    np.testing.assert_allclose(again, signals.acceleration, atol=1e-6)


def test_parts_add_up_to_the_effort_that_acts(robot: Robot) -> None:
    model, signals = with_effects(robot, *TIMELESS), motion(robot, 1.0)
    q, v, zero = signals.position, signals.velocity, np.zeros_like(signals.position)
    parts = model.coriolis(q, v) + model.gravity(q) + model.friction(q, v)
    np.testing.assert_allclose(parts, model.inverse_dynamics(q, v, zero), atol=1e-9)
    mass = model.mass_matrix(q)
    np.testing.assert_allclose(mass, np.swapaxes(mass, 1, 2), atol=1e-12)
    assert (np.linalg.eigvalsh(mass)[:, 0] > 0.0).all()


def test_the_contract_joins_scale_offset_and_delay(robot: Robot) -> None:
    """scale · measured(t - delay) + offset is the effort that acts."""
    specs = (
        "effort_scale@arm7_joint2:scale=0.8",
        "effort_offset@arm7_joint2:offset=2",
        "effort_delay:delay=0.02",
    )
    signals = motion(robot)
    acting = with_effects(robot).predict(signals)
    measured = with_effects(robot, *specs).predict(signals)
    late = np.roll(measured, 2, axis=0)[2:-5]
    np.testing.assert_allclose(0.8 * late[:, 1] + 2.0, acting[2:-5, 1], atol=1e-4)
    np.testing.assert_allclose(late[:, 0], acting[2:-5, 0], atol=1e-4)


def test_one_state_or_none(robot: Robot) -> None:
    model = with_effects(robot, *TIMELESS)
    q = np.full(7, 0.1)
    assert model.inverse_dynamics(q, q, q).shape == (7,)
    assert model.mass_matrix(q).shape == (7, 7)
    assert model.inverse_dynamics(np.empty((0, 7)), np.empty((0, 7)), np.empty((0, 7))).shape == (0, 7)


def test_files_keep_everything(robot: Robot, tmp_path) -> None:
    signals = motion(robot)
    model = with_effects(robot, *TIMELESS, *TIMED)
    model = replace(
        model,
        bare=robot.with_inertials(1.05 * robot.inertials),
        noise=np.arange(7.0),
        stds=({"coulomb": 0.1}, *({} for _ in model.effects[1:])),
        lead=0.003,
        lag=0.02,
    )
    again = load_model(save_model(tmp_path, model))
    assert isinstance(again, ExtendedModel)
    np.testing.assert_array_equal(again.predict(signals), model.predict(signals))
    np.testing.assert_array_equal(again.noise, model.noise)
    assert again.stds == model.stds and (again.lead, again.lag) == (model.lead, model.lag)
    assert not np.allclose(replace(again, lag=0.0).predict(signals), again.predict(signals))


def test_a_damaged_file_is_refused(robot: Robot, tmp_path) -> None:
    arrays, info = with_effects(robot, TIMELESS[0]).to_state()
    info["effects"][0]["joint"] = "elbow"
    modelfile.save(tmp_path, "extended", arrays, info)
    with pytest.raises(ModelFileError, match=r"damaged: effect 1 of 1: .* no joint 'elbow'"):
        load_model(tmp_path)


@pytest.mark.parametrize("known", [1, 3])
def test_uncertainties_without_their_effects_are_refused(robot: Robot, known: int) -> None:
    arrays, info = with_effects(robot, *TIMELESS[:2]).to_state()
    info["stds"] = known * [{}]
    with pytest.raises(ModelFileError, match="damaged at or near its entry stds"):
        ExtendedModel.from_state(arrays, info)


def test_a_link_is_possible_without_what_hangs_from_it() -> None:
    """A payload is written as a body of its own."""
    arm = Robot.bundled("arm2")
    payload = parse_spec("payload@arm2_link2:mass=2,com_x=0.2,com_y=0.2,com_z=0.2", arm)
    errors = np.zeros(20)
    errors[[14, 16, 19]] = -1.5 * arm.inertials[1, [4, 6, 9]] - 0.01
    corrected = corrected_links(arm, [payload], np.eye(20), errors, np.diag(np.full(20, 0.01**2)))
    assert not feasible(arm.inertials + errors.reshape(2, PER_LINK))
    assert feasible(corrected.inertials)


def test_corrected_links_stay_feasible(robot: Robot) -> None:
    """A belief that the last link weighs less than nothing makes it light and leaves the others."""
    relative = relative_inertials(robot)
    errors = np.zeros(70)
    errors[60] = -1.2  # its first unit scales mass and inertia
    corrected = corrected_links(robot, [], relative, errors, np.diag(np.full(70, 0.3**2)))
    assert feasible(corrected.inertials)
    moved = np.linalg.solve(relative, (corrected.inertials - robot.inertials).ravel()) / 0.3
    assert np.linalg.norm(moved[:60]) < 1.0  # in standard deviations: a nominal link is close to an edge
    assert 0.0 < corrected.inertials[6, 0] < 0.5 * robot.inertials[6, 0]


def test_links_may_be_corrected_by_more_errors_than_they_have_parameters(robot: Robot) -> None:
    """As those of an identified model are, of which some are its joints'."""
    relative, errors, spread = relative_inertials(robot), np.zeros(70), np.full(70, 0.3**2)
    errors[60] = -1.2
    twice, share = np.concatenate([relative, relative], axis=1) / np.sqrt(2.0), np.sqrt(0.5)
    both = corrected_links(robot, [], twice, share * np.tile(errors, 2), np.diag(np.tile(spread, 2)))
    once = corrected_links(robot, [], relative, errors, np.diag(spread))
    np.testing.assert_allclose(both.inertials, once.inertials, rtol=1e-6, atol=1e-9)


def test_links_are_feasible_together_with_the_effects_on_them(robot: Robot) -> None:
    shrunk = [parse_spec("link_inertia@arm7_link4:scale=0.1", robot)]
    errors = np.zeros(70)
    errors[30:40] = -0.3
    corrected = corrected_links(
        robot, shrunk, relative_inertials(robot), errors, np.diag(np.full(70, 0.05**2))
    )
    model = ExtendedModel(corrected, tuple(shrunk), np.zeros(7))
    assert feasible(model.robot.inertials)


def _examination(
    robot: Robot,
    signals: Signals,
    terms: list[Term],
    model: Model | None = None,
    link_error: float = 0.06,
    share: float = 1e-3,
) -> SimpleNamespace:
    """What `extend` reads of an examination, for terms that are known."""
    equations = build(signals, robot, None if model is None else model.predict(signals))
    noise = noise_of(equations, share * equations.rows.target, 1e-4 * equations.rows.effort_scale)
    pool = Pool(equations, noise, terms, link_error)
    fit = pool.whole
    return SimpleNamespace(
        robot=robot,
        equations=equations,
        pool=pool,
        fit=fit,
        estimates=tuple(estimates(pool, fit)),
        diagnosis=SimpleNamespace(findings=()),
        test=equations.rows.block % 5 == 2,
        extended=pool.residual(fit),
        model=model,
        late=Lateness(),
        networks=(),
    )


def test_extend_predicts_what_the_diagnosis_fitted() -> None:
    """On a robot with wrong links, friction and an offset, the extended model reaches the fit's own error."""
    robot = Robot.bundled("arm2")
    real = robot.with_inertials(robot.inertials * np.array([[1.05], [0.93]]))
    truth = with_effects(
        real, "coulomb_friction@arm2_joint1:coulomb=0.8", "effort_offset@arm2_joint2:offset=0.2"
    )
    signals = motion(robot, 30.0)
    signals = replace(signals, effort=truth.predict(signals))
    terms = [Term(e.effect, e.target, e.link) for e in truth.effects]
    examination = _examination(robot, signals, terms)
    model = extend(examination)
    assert [e.effect.name for e in model.effects] == ["coulomb_friction", "effort_offset"]
    assert model.effects[0].values["coulomb"] == pytest.approx(0.8, rel=0.02)
    assert model.stds[0]["coulomb"] > 0.0
    inside = signals.interior

    def error(values: np.ndarray) -> float:
        return float(np.sqrt(np.mean((signals.smooth(values - signals.effort)[inside]) ** 2)))

    before = error(robot.rigid_effort(signals.position, signals.velocity, signals.acceleration))
    fitted = float(np.sqrt(np.mean(examination.pool.residual(examination.fit) ** 2)))
    assert error(model.predict(signals)) < max(1.05 * fitted, 2e-3 * before)


def test_how_a_payload_turns_moves_no_mass() -> None:
    """By the fit it turns as no body can; the effort says little of that, and no link is surer of it."""
    robot, body = Robot.bundled("arm6"), 4
    load = parse_spec("payload@arm6_link5:mass=0.7,com_z=0.3", robot)
    signals = motion(robot, 10.0)
    signals = replace(signals, effort=ExtendedModel(robot, (load,), np.zeros(6)).predict(signals))
    terms = [Term(load.effect, load.target, load.link).shaped(load.effect.coefficients(load.values)[1])]
    examination = _examination(robot, signals, terms, share=0.1)
    relative, errors, covariance = _bodies(examination)
    turning = slice(body * PER_LINK + 4, (body + 1) * PER_LINK)
    np.testing.assert_array_equal(relative[turning, 60:], np.eye(6))
    as_found = np.linalg.inv(
        np.linalg.inv(covariance)[:60, :60]
    )  # of the links, had they to follow the payload's
    held, free = (
        np.diag(columns @ own @ columns.T)[turning]
        for columns, own in ((relative[:, :60], as_found), (relative, covariance))
    )
    assert (free > held).all() and errors.shape == (66,)
    errors[:] = 0.0
    errors[60:] = [0.0, 0.014, 0.003, -0.013, 0.007, 0.0]  # products of inertia without any moment
    loose = np.diag(np.concatenate([np.full(60, 0.05**2), np.full(6, 0.02**2)]))
    corrected = corrected_links(robot, [load], relative, errors, loose)
    assert feasible(corrected.inertials)
    np.testing.assert_allclose(corrected.inertials[:, 0], robot.inertials[:, 0], rtol=0.02)


def test_offsets_beside_a_scale_follow_the_contract() -> None:
    """The regression's offset is that of the measured effort; the contract's acts behind the scale."""
    robot = Robot.bundled("arm2")
    truth = with_effects(robot, "effort_scale@arm2_joint1:scale=0.8", "effort_offset@arm2_joint1:offset=1.0")
    signals = motion(robot, 30.0)
    signals = replace(signals, effort=truth.predict(signals))
    terms = [Term(e.effect, e.target, e.link) for e in truth.effects]
    model = extend(_examination(robot, signals, terms))
    found: dict[str, Installed] = {e.effect.name: e for e in model.effects}
    assert found["effort_scale"].values["scale"] == pytest.approx(0.8, abs=0.02)
    assert found["effort_offset"].values["offset"] == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("spec", [TIMELESS[4], TIMELESS[12], *TIMED])
def test_a_prediction_does_not_look_at_the_measured_effort(robot: Robot, spec: str) -> None:
    model, signals = with_effects(robot, spec), motion(robot, 2.0)
    known = replace(signals, effort=1e3 * np.sin(50.0 * signals.position))
    np.testing.assert_array_equal(model.predict(known), model.predict(signals))


def test_what_changed_since_comes_on_top_of_the_earlier_model() -> None:
    """Against an identified robot with an offset and a tilt, only the new payload and tilt are found."""
    robot = Robot.bundled("arm2")
    earlier = replace(
        with_effects(
            robot.with_inertials(1.1 * robot.inertials),
            "effort_offset@arm2_joint1:offset=0.5",
            "base_tilt:pitch_deg=3",
        ),
        lead=0.001,
    )
    truth = replace(earlier, effects=(*earlier.effects, parse_spec("payload@arm2_link2:mass=0.5", robot)))
    signals = motion(robot, 30.0)
    signals = replace(signals, effort=truth.predict(signals))
    terms = [
        Term(e.effect, e.target, e.link, (("com_x", 0.0), ("com_y", 0.0), ("com_z", 0.0)))
        for e in truth.effects[2:]
    ]
    # links that were identified are known better than a description's
    model = extend(_examination(earlier.robot, signals, terms, earlier, link_error=0.02))
    assert [e.effect.name for e in model.effects] == ["effort_offset", "payload"]
    np.testing.assert_allclose(model.robot.gravity_vector, earlier.robot.gravity_vector)
    assert model.effects[1].values["mass"] == pytest.approx(0.5, rel=0.1)
    assert model.lead == pytest.approx(0.001, abs=1e-4)
    assert not model.stds[0] and model.stds[1]["mass"] > 0.0
    left = signals.smooth(model.predict(signals) - signals.effort)[signals.interior]
    assert np.sqrt(np.mean(left**2)) < 0.01 * np.std(signals.effort)


def test_two_tilts_are_one_and_a_physical_model_keeps_its_offset() -> None:
    robot = Robot.bundled("arm2")
    signals = motion(robot, 30.0)
    physical = PhysicalModel(robot, np.array([0.4, 0.0]), np.eye(28), np.zeros(2))
    truth = with_effects(robot, "effort_offset@arm2_joint1:offset=-0.4", "base_tilt:pitch_deg=4")
    signals = replace(signals, effort=truth.predict(signals))
    np.testing.assert_allclose(
        physical.predict(signals),
        with_effects(robot, "effort_offset@arm2_joint1:offset=-0.4").predict(signals),
    )
    tilt = truth.effects[1]
    terms = [Term(tilt.effect, -1, None, (("pitch_deg", 4.0), ("roll_deg", 0.0)))]
    model = extend(_examination(robot, signals, terms, physical))
    assert [e.effect.name for e in model.effects] == ["effort_offset", "base_tilt"]
    assert model.effects[0].values["offset"] == pytest.approx(-0.4)
    earlier = with_effects(robot, "base_tilt:pitch_deg=2.5", "effort_offset@arm2_joint1:offset=-0.4")
    terms = [Term(tilt.effect, -1, None, (("pitch_deg", 1.5), ("roll_deg", 0.0)))]
    again = extend(_examination(earlier.robot, signals, terms, earlier))
    assert [e.effect.name for e in again.effects] == ["effort_offset", "base_tilt"]
    assert again.effects[1].values["pitch_deg"] == pytest.approx(4.0, abs=0.1)


def test_a_model_with_networks_cannot_be_extended(robot: Robot) -> None:
    other = SimpleNamespace(predict=lambda signals: np.zeros_like(signals.position))
    signals = motion(robot, 30.0)
    signals = replace(signals, effort=with_effects(robot).predict(signals))
    with pytest.raises(UsageError, match="learned more"):
        extend(_examination(robot, signals, [], other))  # type: ignore[arg-type]


def test_what_an_identified_model_learned_stays(tmp_path) -> None:
    """Motors that turn with two joints and learned friction are kept beside the effects found on top."""
    robot = Robot.bundled("arm2").with_joint_parameters(np.full(2, 0.1), np.full(2, 0.2), np.full(2, 0.3))
    motors = CoupledMotors(
        (Coupling(0, 1),), np.array([[0.2, 0.3, 0.4]]), np.zeros((1, CURVE_FEATURES)), np.array([5.0])
    )
    rng, scales = np.random.default_rng(0), Scales(np.array([5.0, 2.0]), np.array([6.0, 9.0]))
    weights = 0.1 * rng.normal(size=(2, FEATURES))
    learned = LocalResiduals((tuple(GROUPS),) * 2, weights, rng.normal(size=(2, 3)), scales)
    earlier = PhysicalModel(robot, np.array([0.1, -0.1]), np.eye(28), np.zeros(2), 0, (3, 4), motors, learned)
    signals = motion(robot, 30.0)
    payload = parse_spec("payload@arm2_link2:mass=0.5", robot)
    base = of_physical(earlier)
    np.testing.assert_allclose(base.predict(signals), earlier.predict(signals), atol=1e-9)
    truth = replace(base, effects=(*base.effects, payload))
    signals = replace(signals, effort=truth.predict(signals))
    terms = [
        Term(payload.effect, payload.target, payload.link, (("com_x", 0.0), ("com_y", 0.0), ("com_z", 0.0)))
    ]
    model = extend(_examination(robot, signals, terms, earlier))
    left = signals.smooth(model.predict(signals) - signals.effort)[signals.interior]
    assert np.sqrt(np.mean(left**2)) < 0.01 * np.std(signals.effort)
    again = load_model(save_model(tmp_path, model))
    np.testing.assert_array_equal(again.predict(signals), model.predict(signals))

    state = (signals.position[::50], signals.velocity[::50], signals.acceleration[::50])
    effort = model.inverse_dynamics(*state)
    np.testing.assert_allclose(model.forward_dynamics(*state[:2], effort), state[2], atol=1e-8)
    assert (np.linalg.eigvalsh(model.mass_matrix(state[0]))[:, 0] > 0.0).all()
    without = replace(model, beyond=None)
    assert np.abs(without.inverse_dynamics(*state) - effort).max() > 0.1


@pytest.mark.slow
def test_dry_friction_turns_round_before_a_joint_that_sticks():
    """What the fit says of sticking is in the model, in its file, and in what it predicts."""
    robot = Robot.bundled("arm6")
    worn = [parse_spec(f"{name}@{robot.joints[5]}:{value}", robot) for name, value in WORN_WRIST]
    recording = simulate(robot, worn, seed=3, duration=20.0).recording
    model = extend(examine([recording], robot))
    assert model.sticking[5] > 0.0
    arrays, info = model.to_state()
    assert ExtendedModel.from_state(arrays, info).sticking == model.sticking
    signals = prepare(recording)

    def left(one: ExtendedModel) -> float:
        error = signals.smooth(signals.effort - one.predict(signals))[signals.interior, 5]
        return float(np.sqrt(np.mean(error**2)))

    assert left(model) < 0.9 * left(replace(model, sticking=()))


def test_friction_that_comes_on_little_by_little_does_so_wherever_it_is_held(robot: Robot) -> None:
    """At an instant as along a motion: of the robot's own friction there is as much as of the same that was found."""
    creep = ((0.2, 0.4, 0.0), (0.2, 0.0, 0.0), *((0.0, 0.0, 0.0),) * 5)
    own = robot.with_joint_parameters(coulomb=np.full(robot.width, 2.0))
    held = ExtendedModel(own, (), np.zeros(robot.width), creep=creep)
    found = with_effects(robot, *(f"coulomb_friction@{joint}:coulomb=2" for joint in robot.joints))
    found = replace(found, creep=creep)
    still, none = np.zeros(robot.width), np.full(robot.width, 2.0)
    for speed, share in ((0.1, (0.5, 0.5)), (-0.1, (-0.25, -1.0)), (0.3, (1.0, 1.0)), (0.0, (0.0, 0.0))):
        slow = np.full(robot.width, speed)
        expected = 2.0 * np.array([*share, *np.sign(slow[2:])])
        for model in (held, found):
            np.testing.assert_allclose(model.friction(still, slow), expected, atol=1e-9)
            back = model.forward_dynamics(still, slow, model.inverse_dynamics(still, slow, none))
            np.testing.assert_allclose(back, none, rtol=1e-9)
    steady = motion(robot)
    steady = replace(steady, velocity=np.full_like(steady.velocity, 0.1))
    at_once = replace(held, bare=robot)
    along = (held.predict(steady) - at_once.predict(steady)).mean(axis=0)
    assert along[:2] == pytest.approx([1.0, 1.0], rel=0.05)


@pytest.mark.slow
def test_a_push_without_a_name_is_not_in_the_model():
    """At its time nothing pushes in another recording: it was in the files, and nothing told of it."""
    arm = Robot.bundled("arm2")
    push = parse_spec("external_wrench@arm2_joint2:torque=3,start=9,end=11", arm)
    examination = examine([simulate(arm, [push], seed=2, duration=20.0, rate=100.0).recording], arm)
    assert [one.effect.name for one in extend(examination).effects] == ["external_wrench"]
    silent = replace(examination, diagnosis=replace(examination.diagnosis, findings=()))
    assert extend(silent).effects == ()


@pytest.mark.parametrize("times", [1.0, 1e8])
def test_friction_in_proportion_to_a_load_is_found_as_soon_whatever_the_load(
    times: float, monkeypatch
) -> None:
    """Large loads change by rounding alone to the last round."""
    robot = Robot.bundled("arm2")
    heavy = robot.with_inertials(robot.inertials * times)
    ratio = parse_spec("load_dependent_friction@arm2_joint1:ratio=0.3", robot)
    model, rounds = ExtendedModel(heavy, (ratio,), np.zeros(2)), []
    resistance = ExtendedModel._resistance
    monkeypatch.setattr(
        ExtendedModel, "_resistance", lambda self, *a: rounds.append(1) or resistance(self, *a)
    )
    state = np.random.default_rng(1).uniform(0.2, 1.0, (3, 2))
    effort = model.inverse_dynamics(*state)
    assert len(rounds) < 25
    load = heavy.inverse_dynamics(*state)[0]
    np.testing.assert_allclose(effort[0], load + 0.3 * abs(effort[0]), rtol=1e-9)


def test_friction_that_takes_nine_tenths_of_a_load_is_settled(robot: Robot, monkeypatch) -> None:
    """The largest ratio that may be: each round of a fixed point leaves nine tenths of what the one before did."""
    model = with_effects(robot, "load_dependent_friction@arm7_joint2:ratio=0.9")
    signals = motion(robot)
    state = signals.position, signals.velocity, signals.acceleration
    rigid, way = robot.inverse_dynamics(*state)[:, 1], np.sign(signals.velocity[:, 1])
    expected = rigid / (1.0 - 0.9 * way * np.sign(rigid))
    np.testing.assert_allclose(model.inverse_dynamics(*state)[:, 1], expected, rtol=1e-12)
    predicted = model.predict(signals)
    monkeypatch.setattr(extended, "LOAD_ROUNDS", 2 * extended.LOAD_ROUNDS)
    np.testing.assert_allclose(model.predict(signals), predicted, rtol=0.0, atol=1e-8)
