"""Parameters and linear coefficients are two forms of one thing; columns are exact where they say so."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from effect_cases import SPECS, linear, motion, robot
from hypothesis import given, settings
from hypothesis import strategies as st

from bdnn_ros.effects.bristles import bristle
from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import get, parse_spec
from bdnn_ros.effects.rigid import slots


@pytest.fixture(scope="module")
def arm():
    return robot()


@pytest.fixture(scope="module")
def path(arm):
    return motion(arm)


@pytest.mark.parametrize("spec", SPECS)
def test_values_and_coefficients_are_inverse(spec, arm):
    one = parse_spec(spec, arm).within(8.0)
    coefficients, shape = linear(one)
    assert one.effect.values(coefficients, shape) == pytest.approx(one.values, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("spec", SPECS)
def test_coefficients_respect_their_bounds(spec, arm):
    one = parse_spec(spec, arm).within(8.0)
    coefficients, shape = linear(one)
    bounds = one.effect.coefficient_bounds
    assert len(coefficients) == len(bounds)
    assert all(low <= c <= high for c, (low, high) in zip(coefficients, bounds, strict=True))
    assert one.effect.shape_allowed(shape)


@pytest.mark.parametrize("spec", SPECS)
def test_columns_have_the_shapes_of_coefficients_and_grid(spec, arm, path):
    one = parse_spec(spec, arm).within(8.0)
    coefficients, shape = linear(one)
    columns = one.effect.columns(path, one.target, shape, one.link)
    assert columns.shape == (len(path.time), arm.width, len(coefficients))
    assert np.isfinite(columns).all()
    for tried in one.effect.shapes(path, one.target, one.link):
        assert set(tried) == set(shape)
        assert one.effect.shape_allowed(tried)


@pytest.mark.parametrize("spec", SPECS)
def test_relinearised_at_its_coefficients_the_shape_is_its_own(spec, arm):
    one = parse_spec(spec, arm).within(8.0)
    coefficients, shape = linear(one)
    assert one.effect.relinearised(coefficients, shape) == pytest.approx(shape)


@pytest.mark.parametrize("name", ["payload", "link_inertia", "base_tilt"])
def test_rigid_effects_add_what_the_changed_bodies_do(name, arm, path):
    one = parse_spec(next(spec for spec in SPECS if spec.startswith(name)), arm)
    coefficients, shape = linear(one)
    plant = Plant(arm)
    one.install(plant)
    changed = plant.robot.rigid_effort(path.position, path.velocity, path.acceleration) - path.link_load
    added = one.effect.columns(path, one.target, shape, one.link) @ coefficients
    assert added == pytest.approx(changed, abs=1e-10)


def test_a_payload_is_a_body_with_second_moments_of_its_own(arm, path):
    one = parse_spec(next(spec for spec in SPECS if spec.startswith("payload")), arm)
    coefficients, shape = linear(one)
    body, parameters = one.effect.general(arm, one.link)
    general = path.regressor[:, :, slots(body)] @ parameters
    origin = one.effect.columns(path, one.target, dict.fromkeys(shape, 0.0), one.link)
    assert general[..., :4] == pytest.approx(origin[..., :4])
    exact = one.effect.columns(path, one.target, shape, one.link) @ coefficients
    tall = general.reshape(-1, general.shape[2])
    fitted, *_ = np.linalg.lstsq(tall, exact.ravel(), rcond=None)
    assert tall @ fitted == pytest.approx(exact.ravel(), abs=1e-9)


def test_a_tilted_base_turns_gravity_as_the_contract_says(arm):
    plant = Plant(arm)
    parse_spec("base_tilt:roll_deg=5,pitch_deg=-3", arm).install(plant)
    roll, pitch = math.radians(5.0), math.radians(-3.0)
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    tilt = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    assert plant.robot.gravity_vector == pytest.approx(tilt.T @ [0.0, 0.0, -9.81])


def test_a_base_that_is_tilted_already_tilts_further(arm, path):
    """Also where errors of the bodies are counted as they hang on the further tilt."""
    stands = arm.tilted(math.radians(10.0), math.radians(45.0))
    further = arm.tilted(math.radians(11.0), math.radians(48.0))
    changed = further.gravity(path.position) - stands.gravity(path.position)
    coefficients, shape = linear(parse_spec("base_tilt:roll_deg=1,pitch_deg=3", arm))
    for seen in (replace(path, robot=stands), replace(path, robot=further, level=stands)):
        columns = get("base_tilt").columns(seen, -1, shape)
        assert columns @ coefficients == pytest.approx(changed, abs=1e-9)


def test_a_payload_weighs_what_it_weighs(arm):
    """Lifted without rotation the base joints feel m·g times the lever: power balance of a slow rise."""
    one = parse_spec("payload@arm7_hand:mass=2,com_z=0.1", arm)
    plant = Plant(arm)
    one.install(plant)
    position = np.array([[0.3, 0.4, -0.2, -1.5, 0.3, 1.2, 0.5]])
    extra = plant.robot.gravity(position) - arm.gravity(position)
    jacobian = arm.link_jacobian(position, "arm7_hand")[0]
    rotation = _rotation(arm, position[0], "arm7_hand")
    offset = rotation @ np.array([0.0, 0.0, 0.1])
    lever = jacobian[:3] - np.cross(offset, jacobian[3:].T).T
    assert extra[0] == pytest.approx(2.0 * 9.81 * lever[2], abs=1e-9)


def _rotation(arm, position, link):
    import pinocchio as pin

    model, _ = arm.pinocchio_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, position)
    return data.oMf[model.getFrameId(link)].rotation


def test_a_position_offset_is_exact_at_its_own_shape(arm, path):
    one = parse_spec("position_offset@arm7_joint2:offset=0.3", arm)
    coefficients, shape = linear(one)
    added = one.effect.columns(path, one.target, shape, None) @ coefficients
    true = path.position.copy()
    true[:, 1] -= 0.3
    expected = arm.rigid_effort(true, path.velocity, path.acceleration) - path.link_load
    assert added == pytest.approx(expected, abs=1e-10)


def test_each_of_two_position_offsets_gets_half_of_what_both_do_together(arm, path):
    """What is left is of third order: a tenth of what either leaves that takes the other joint's zero for right."""
    zeros = np.array([0.0, 0.05, 0.0, -0.06, 0.0, 0.0, 0.0])

    def left(motion):
        added = 0.0
        for joint in np.flatnonzero(zeros):
            one = parse_spec(f"position_offset@{arm.joints[joint]}:offset={zeros[joint]}", arm)
            coefficients, shape = linear(one)
            added = added + one.effect.columns(motion, one.target, shape, None) @ coefficients
        true = arm.rigid_effort(path.position - zeros, path.velocity, path.acceleration)
        return np.std(true - path.link_load - added)

    assert left(path.with_robot(arm, zeros)) < 0.1 * left(path)


def test_a_tilt_about_the_first_joints_axis_and_its_zero_are_one(arm, path):
    """Whichever of them a robot that stands tilted was taken for."""
    lying = arm.tilted(math.pi / 2.0, 0.0)  # its first axis is horizontal now
    standing = lying.tilted(math.pi / 2.0 + 0.06, 0.0)
    one = parse_spec(f"position_offset@{arm.joints[0]}:offset=0.05", arm)
    _, shape = linear(one)
    level, taken = (replace(path, robot=lying), replace(path, robot=standing, level=lying))
    expected = one.effect.columns(level, 0, shape, None)
    np.testing.assert_allclose(one.effect.columns(taken, 0, shape, None), expected, atol=1e-9)
    second = parse_spec(f"position_offset@{arm.joints[1]}:offset=0.05", arm)
    assert not np.allclose(*(second.effect.columns(one, 1, shape, None) for one in (level, taken)), rtol=1e-3)


def test_a_delay_is_exact_at_its_own_shape(arm, path):
    one = parse_spec("effort_delay:delay=0.05", arm)
    coefficients, shape = linear(one)
    added = one.effect.columns(path, one.target, shape, None) @ coefficients
    steps = round(0.05 * path.signals.rate)
    assert added[:-steps] == pytest.approx(path.load[steps:] - path.load[:-steps], abs=1e-6)


def test_a_wrench_asks_of_the_joints_what_it_does_at_the_link(arm, path):
    """By virtual work: minus the Jacobian's transpose times the wrench, low-passed as the effort."""
    one = parse_spec("external_wrench@arm7_hand:start=-1,end=100,force_x=3,force_z=-5,torque_y=2", arm)
    coefficients, shape = linear(one)
    added = one.effect.columns(path, one.target, shape, one.link) @ coefficients
    wrench = np.array([3.0, 0.0, -5.0, 0.0, 2.0, 0.0])
    expected = path.signals.smooth(
        -np.einsum("nij,i->nj", arm.link_jacobian(path.position, "arm7_hand"), wrench)
    )
    assert added == pytest.approx(expected, abs=1e-9)


@given(st.lists(st.floats(-0.2, 0.2), min_size=2, max_size=60), st.floats(1e-3, 0.2))
@settings(max_examples=60, deadline=None)
def test_the_bristle_stays_bounded_and_follows_dahl(steps, breakaway):
    position = np.cumsum([0.0, *steps])
    fine = np.interp(np.linspace(0, len(steps), 40 * len(steps) + 1), np.arange(len(steps) + 1), position)
    bend = bristle(position, breakaway)
    assert np.abs(bend).max() <= 1.0
    assert bristle(fine, breakaway)[::40] == pytest.approx(bend, abs=1e-9)


def test_the_bristle_slides_after_its_breakaway():
    bend = bristle(np.array([0.0, 0.02, 0.5]), 0.02)
    assert bend[1:] == pytest.approx([1.0 - math.exp(-1.0), 1.0])


def test_the_gear_of_a_planned_motion_carries_no_friction(arm):
    """It is lost before: an elastic joint or a gap is sized by what bends it."""
    worn = arm.with_joint_parameters(coulomb=np.full(arm.width, 3.0), armature=np.full(arm.width, 0.2))
    path = motion(worn)
    rigid = worn.rigid_effort(path.position, path.velocity, path.acceleration)
    assert path.gear_load == pytest.approx(rigid)
    assert np.stack([path.carried(joint) for joint in range(arm.width)], axis=1) == pytest.approx(rigid)
    assert not np.allclose(path.load, rigid)


def test_what_a_motion_does_not_show_of_a_push_is_not_told_as_nothing():
    values = dict.fromkeys(get("external_wrench").parts, 1.0) | {"start": 2.0, "end": 3.0}
    values |= {"force_y": math.nan, **dict.fromkeys(("point_x", "point_y", "point_z"), 0.0)}
    assert "(1, ?, 1) N and (1, 1, 1) N·m" in get("external_wrench").sentence("hand", values)
    force = next(p for p in get("external_wrench").parameters if p.name == "force_y")
    assert force.seen(0.0, 90.0) and force.seen(500.0, 400.0)
    assert not force.seen(0.0, 2000.0) and not force.seen(230.0, 1100.0)


@pytest.mark.parametrize("middle", [0.0, 3.0, -6.0, 125.0])
def test_what_a_spring_may_do_does_not_hang_on_where_a_joint_has_its_zero(middle, path):
    """Far from it stiffness and rest had to be small for what they do together to be usual: masses took a spring's place."""
    position = path.position.copy()
    position[:, 1] += middle - position[:, 1].mean()
    usual = 6.0 / np.sqrt(np.mean(position[:, 1] ** 2)), 6.0
    moved = replace(path, signals=replace(path.signals, position=position))
    stiffness, constant = get("joint_spring").spread(np.array(usual), moved, 1)
    assert stiffness * np.std(position[:, 1]) == pytest.approx(6.0)
    assert constant == pytest.approx(np.hypot(6.0, middle * stiffness)), (
        "a rest at the middle is as likely as any"
    )


def test_a_spring_across_a_joint_that_stays_at_zero_may_be_as_usual(path):
    """A gripper's finger: nothing of it is shown, and the spread that nothing is divided by was none."""
    position = path.position.copy()
    position[:, 1] = 0.0
    held = replace(path, signals=replace(path.signals, position=position))
    np.testing.assert_array_equal(get("joint_spring").spread(np.array([5.0, 6.0]), held, 1), [5.0, 6.0])


def test_a_push_is_believed_to_be_no_stronger_than_the_robot_is_heavy(path):
    """Where a force passes by the only axis it acts on, a thousand newtons of it are no push."""
    usual = np.array([1e5, 1e5, 3.0, 40.0, 40.0, 40.0])
    mass = path.robot.inertials[:, 0].sum()

    def spread(kilograms: float) -> np.ndarray:
        weighing = replace(path, robot=path.robot.with_inertials(kilograms / mass * path.robot.inertials))
        return get("external_wrench").spread(usual, weighing, 1)

    np.testing.assert_allclose(spread(1.0), [100.0, 100.0, 3.0, 40.0, 40.0, 40.0])
    np.testing.assert_allclose(spread(20.0), [196.2, 196.2, 3.0, 40.0, 40.0, 40.0], rtol=1e-3)


@pytest.mark.parametrize("std, shown", [(0.2, True), (0.7, False)])
def test_a_payload_is_shown_by_a_mass_that_is_surely_there(std, shown):
    """What turns a link's inertia alone is a rotor as well."""
    values = {"mass": 1.0, "com_x": 0.0, "com_y": 0.0, "com_z": 0.5}
    assert get("payload").shown(values, {**dict.fromkeys(values, 0.4), "mass": std}) is shown


def test_a_stribeck_velocity_is_slow():
    """A law that falls over the whole range of speeds is drag by another name."""
    law = get("stribeck_friction")
    assert law.shape_allowed({"velocity": 0.3}) and not law.shape_allowed({"velocity": 0.66})


@pytest.mark.parametrize(
    "force, breakaway, shown", [(0.1, 0.002, True), (0.1, 0.003, False), (0.3, 0.002, False)]
)
def test_a_bristle_is_shown_by_a_force_and_a_travel_that_are_well_known(force, breakaway, shown):
    """A joint that creeps looks like a short one."""
    stds = {"force": force, "breakaway": breakaway}
    assert get("hysteresis").shown({"force": 1.0, "breakaway": 0.01}, stds) is shown


@pytest.mark.parametrize(
    "breakaway, shown", [(0.001, False), (0.0011, False), (0.0025, True), (0.2985, True), (0.2999, False)]
)
def test_a_bristle_as_short_or_as_long_as_any_that_is_tried_is_none(breakaway, shown):
    """However well its travel is known: it would rather be shorter, dry friction, or longer, a spring."""
    values, stds = {"force": 1.0, "breakaway": breakaway}, {"force": 0.01, "breakaway": 1e-4}
    assert get("hysteresis").shown(values, stds) is shown


@pytest.mark.parametrize(
    "static, std, velocity, shown",
    [
        (2.0, 0.5, 0.1, True),
        (2.0, 1.1, 0.1, True),
        (2.0, 0.5, 0.49, False),
        (2.0, 0.5, 0.02, False),
        (-1.0, 0.5, 0.1, True),
    ],
)
def test_friction_falls_at_a_velocity_that_is_at_no_end_however_high_it_is_at_rest(
    static, std, velocity, shown
):
    """Be it less than a model has."""
    values = {"coulomb": 1.0 if static > 0.0 else 0.0, "static": static, "velocity": velocity}
    assert get("stribeck_friction").shown(values, {"coulomb": 0.01, "static": std, "velocity": 0.02}) is shown


@pytest.mark.parametrize(
    "name, values",
    [
        ("stribeck_friction", {"coulomb": 1.0, "static": 3.0, "velocity": 0.1}),
        ("hysteresis", {"force": 3.0, "breakaway": 0.1}),
    ],
)
def test_friction_that_is_more_than_was_ever_measured_is_not_shown(name, values):
    """A joint that is held by more does not move."""
    law, stds = get(name), dict.fromkeys(values, 1e-3)
    assert law.shown(values, stds, most=3.1) and not law.shown(values, stds, most=2.9)


@pytest.mark.parametrize("periods, shown", [(3.0, False), (3.02, False), (3.2, True)])
def test_a_ripple_of_as_few_periods_as_any_that_are_tried_is_not_shown(periods, shown):
    """A cable that pulled at one end of a joint's range was a spring and a cogging with three periods."""
    values = {"amplitude": 1.0, "periods_per_rev": periods, "phase": 0.0}
    assert get("cogging").shown(values, dict.fromkeys(values, 0.05)) is shown


@pytest.mark.parametrize("crossing, shown", [(5e-4, True), (0.4, True), (0.499, False)])
def test_a_gap_that_is_never_crossed_is_not_shown(crossing, shown):
    """A short way across is that of a small gap."""
    assert get("backlash").shown({"gap": 0.3, "crossing": crossing}, {"gap": 0.01, "crossing": 0.01}) is shown


@pytest.mark.parametrize(("stiffness", "less"), [(3.01, False), (-3.01, True)])
def test_a_spring_is_less_by_its_stiffness_wherever_it_rests(stiffness, less):
    """A preloaded one rests further off than a specification takes."""
    said = get("joint_spring").sentence("elbow", {"stiffness": stiffness, "rest": -11.9})
    assert said.startswith(
        "elbow has less of a spring than the model"
        if less
        else "elbow has a spring that the model leaves out"
    )


@pytest.mark.parametrize(
    ("positive", "negative", "said"),
    [
        (-0.1, 0.7, "differs from the model in asymmetric Coulomb friction"),
        (-0.1, -0.7, "has less asymmetric Coulomb friction than the model"),
        (-0.1, 0.0, "has less asymmetric Coulomb friction than the model"),
        (0.1, 0.7, "has asymmetric Coulomb friction that the model leaves out"),
    ],
)
def test_friction_that_grew_one_way_and_fell_the_other_is_not_called_less(positive, negative, said):
    sentence = get("asymmetric_friction").sentence("elbow", {"positive": positive, "negative": negative})
    assert sentence.startswith(f"elbow {said} (positive {positive:.3f}".rstrip("0"))


def test_what_a_motion_does_not_show_of_a_tilt_or_a_centre_is_not_told_as_a_number():
    tilt, payload = get("base_tilt"), get("payload")
    assert "roll ?, pitch -3.10°" in tilt.sentence("The base", {"roll_deg": math.nan, "pitch_deg": -3.1})
    roll, (_, _, _, com_z) = tilt.parameters[0], payload.parameters
    assert roll.seen(1.45, 0.8) and roll.seen(8.0, 3.4) and not roll.seen(1.45, 3.4)
    assert com_z.seen(0.0, 0.02) and com_z.seen(0.3, 0.07) and not com_z.seen(0.0, 0.068)
    assert set(tilt.parts) == {p.name for p in tilt.parameters}
