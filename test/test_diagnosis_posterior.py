"""Parameters with their uncertainty: linear propagation, and intervals that hold what they promise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import coloured, equations_of, signals_of, term

from bdnn_ros.diagnosis.judging.posterior import Estimate, estimates, excesses
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.result import Quantity
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.settling import settled
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import get
from bdnn_ros.robot import Robot

J1, J2 = "arm2_joint1", "arm2_joint2"
AR = np.array([0.4, 0.0, 0.1])
LINK_ERROR = 0.05


def draws(specs: Sequence[str], std: float, count: int, refine: bool = False) -> list[list[Estimate]]:
    """Estimates of the same effects from so many draws of noise and of errors of the links."""
    robot = Robot.bundled("arm2")
    terms = [term(spec, robot)[0] for spec in specs]
    result = []
    for seed in range(count):
        errors = LINK_ERROR * np.random.default_rng([seed, 1]).standard_normal(20)
        equations = equations_of(specs, errors=errors)
        equations = equations.with_target(equations.rows.target + coloured(equations, AR, std, seed))
        pool = Pool(equations, Noise(np.tile(AR, (2, 1)), np.full(2, std)), terms, LINK_ERROR)
        every = range(len(terms))
        for one in every if refine else ():
            moved = Candidates.of(robot).refined(equations, pool, pool.fit(every), one)
            pool = pool.replacing({one: moved})
        result.append(estimates(pool, pool.fit(every)))
    return result


def scores(found: list[list[Estimate]], which: int, name: str, truth: float) -> np.ndarray:
    """Errors per standard deviation of one parameter."""
    quantities = [one[which].quantities[name] for one in found]
    return np.array([(q.value - truth) / q.std for q in quantities])


def test_intervals_of_linear_effects_hold_the_truth():
    specs = (
        f"viscous_friction@{J1}:viscous=0.5",
        f"coulomb_friction@{J2}:coulomb=0.05",
        f"effort_offset@{J1}:offset=0.4",
    )
    found = draws(specs, std=0.02, count=60)
    for which, (name, truth) in enumerate((("viscous", 0.5), ("coulomb", 0.05), ("offset", 0.4))):
        z = scores(found, which, name, truth)
        assert np.mean(np.abs(z) < 1.96) >= 0.85  # 95 % less three standard deviations of 60 draws
        assert 0.7 < np.sqrt(np.mean(z**2)) < 1.3
        assert abs(z.mean()) < 0.5


def test_intervals_of_shapes_hold_the_truth():
    specs = (f"stribeck_friction@{J1}:coulomb=0.8,static=1.6,velocity=0.15",)
    found = draws(specs, std=0.05, count=20, refine=True)
    for name, truth in (("coulomb", 0.8), ("static", 1.6), ("velocity", 0.15)):
        z = scores(found, 0, name, truth)
        assert np.mean(np.abs(z) < 1.96) >= 0.75
        assert 0.5 < np.sqrt(np.mean(z**2)) < 1.7


@pytest.mark.parametrize(
    "spec",
    [
        f"stribeck_friction@{J1}:coulomb=0.8,static={{}},velocity=0.15",
        f"asymmetric_friction@{J1}:positive=0.8,negative={{}}",
        f"drift@{J1}:of=coulomb,start_value=0.8,end_value={{}},start=0,end=12",
    ],
)
def test_what_a_law_says_beyond_a_simpler_one_is_counted_in_its_deviations(spec):
    """About one of them where it says nothing, by each of some draws of noise, and many where it says a lot."""
    one, _ = term(spec.format(0.8), Robot.bundled("arm2"))
    plain, rich = ([excess_of(one, spec.format(other), seed) for seed in range(8)] for other in (0.8, 1.2))
    assert 0.3 < np.sqrt(np.mean(np.square(plain))) < 2.0
    assert min(rich) > 6.0


def test_a_law_that_settles_into_nothing_simpler_says_all_of_it_by_itself():
    one, _ = term(f"coulomb_friction@{J1}:coulomb=0.8", Robot.bundled("arm2"))
    assert excess_of(one, f"coulomb_friction@{J1}:coulomb=0.8", 0) == np.inf


def excess_of(one: Term, spec: str, seed: int) -> float:
    """The excess that a law shows where another acts, in white noise."""
    equations = equations_of([spec])
    noise = 0.02 * np.random.default_rng(seed).standard_normal(equations.rows.target.shape)
    equations = equations.with_target(equations.rows.target + noise)
    pool = Pool(equations, Noise(np.zeros((2, 1)), np.full(2, 0.02)), [one], LINK_ERROR)
    return excesses(pool)[0]


@pytest.mark.parametrize("scale", [0.6, 1.5])
@pytest.mark.parametrize(
    "spec",
    [
        f"effort_delay@{J1}:delay=0.03",
        "effort_delay:delay=0.03",
        f"joint_elasticity@{J1}:stiffness=400",
    ],
)
def test_what_is_made_of_an_effort_in_the_wrong_unit_is_told_as_without_it(spec, scale):
    plain, scaled = (told_beside_a_scale(spec, one) for one in (1.0, scale))
    assert abs(plain.value - float(spec.split("=")[1])) < plain.std
    assert scaled.value == pytest.approx(plain.value, rel=0.02)
    assert scaled.std == pytest.approx(plain.std, rel=0.1)


def told_beside_a_scale(spec: str, scale: float) -> Quantity:
    """What a fit tells of an effect beside a scale of the first joint's effort, where measured(t) = acting(t + delay) / scale."""
    robot, signals = Robot.bundled("arm2"), signals_of()
    (one, coefficients), per = term(spec, robot), np.array([scale, 1.0])
    motion = Motion(signals, robot, signals.effort)
    for _ in range(4):  # the load that bends a gear holds what its bending adds
        added = one.effect.columns(motion, one.target, dict(one.shape), one.link) @ coefficients
        motion = replace(motion, signals=replace(signals, effort=signals.effort + added))
    equations = build(replace(signals, effort=motion.signals.effort / per), robot)
    terms = [one] if scale == 1.0 else [one, Term(get("effort_scale"), 0)]
    noise = Noise(np.zeros((2, 1)), 1e-3 * np.std(signals.effort, axis=0) / per)
    pool = settled(Candidates.of(robot), equations, Pool(equations, noise, terms, 1e-3))
    return next(iter(estimates(pool, pool.whole)[0].quantities.values()))


def test_an_unknown_shape_widens_its_coefficients():
    spec = f"stribeck_friction@{J1}:coulomb=0.8,static=1.6,velocity=0.15"
    equations = equations_of([spec])
    one, _ = term(spec, Robot.bundled("arm2"))
    pool = Pool(equations, Noise(np.zeros((2, 1)), np.full(2, 0.05)), [one], LINK_ERROR)
    fit = pool.fit([0])
    (estimate,) = estimates(pool, fit)
    known = pool.part(fit, 0)[1]
    assert estimate.covariance.shape == (3, 3)
    assert (np.diag(estimate.covariance)[:2] > 1.001 * np.diag(known)).all()
    np.testing.assert_allclose(estimate.covariance, estimate.covariance.T, rtol=1e-6)


@pytest.mark.parametrize("slowest", [0.0, 0.2])
def test_what_of_a_law_is_told_by_its_tail_alone_is_an_extrapolation(slowest):
    coulomb, static, velocity = 0.8, 1.6, 0.1
    spec = f"stribeck_friction@{J1}:coulomb={coulomb},static={static},velocity={velocity}"
    equations = equations_of([spec])
    speed = np.abs(equations.motion.velocity[equations.rows.samples])
    equations.use_rows(equations.usable & (speed > slowest))
    one, _ = term(spec, Robot.bundled("arm2"))
    pool = Pool(equations, Noise(np.zeros((2, 1)), np.full(2, 1e-4)), [one], LINK_ERROR)
    (estimate,) = estimates(pool, pool.fit([0]))
    tail = np.exp(-((speed[:, 0][equations.usable[:, 0]].min() / velocity) ** 2))
    least = (1.0 - tail) * (static - coulomb) / np.sqrt(3.0)
    told = estimate.quantities["static"].std
    assert told > 0.9 * least if slowest else told < 0.1 * (static - coulomb)
    assert estimate.quantities["coulomb"].std < 0.02 * coulomb


def test_without_shapes_it_is_the_fits_covariance():
    specs = (f"viscous_friction@{J1}:viscous=0.5", f"effort_offset@{J2}:offset=0.1")
    equations, robot = equations_of(specs), Robot.bundled("arm2")
    terms = [term(spec, robot)[0] for spec in specs]
    pool = Pool(equations, Noise(np.zeros((2, 1)), np.full(2, 0.05)), terms, LINK_ERROR)
    fit = pool.fit((1, 0))
    for estimate, chosen in zip(estimates(pool, fit), (1, 0), strict=True):
        coefficients, covariance = pool.part(fit, chosen)
        assert estimate.term == terms[chosen]
        np.testing.assert_allclose(estimate.coefficients, coefficients)
        np.testing.assert_allclose(estimate.covariance, covariance, rtol=1e-5)


def of(one, coefficients, covariance):
    """An estimate whose blocks agree as well as the noise lets them."""
    return Estimate(one, coefficients, covariance, covariance, covariance)


def test_uncertainty_passes_through_what_a_parameter_is_made_of():
    robot = Robot.bundled("arm2")
    elastic, _ = term(f"joint_elasticity@{J1}:stiffness=500", robot)
    quantity = of(elastic, np.array([2e-3]), np.diag([1e-8, 0.0, 0.0])).quantities["stiffness"]
    assert quantity.value == pytest.approx(500.0)
    inexact = elastic.effect.idealised * 2e-3
    assert quantity.std == pytest.approx(np.hypot(1e-4, inexact) / 2e-3**2, rel=1e-2)  # |d(1/x)/dx| = 1/x²
    stribeck, _ = term(f"stribeck_friction@{J1}:coulomb=1,static=2,velocity=0.1", robot)
    covariance = np.diag([0.01, 0.04, 0.0004])
    quantities = of(stribeck, np.array([1.0, 1.0]), covariance).quantities
    assert quantities["coulomb"].std == pytest.approx(np.hypot(0.1, Effect.idealised), rel=1e-3)
    assert quantities["static"].std == pytest.approx(np.sqrt(0.05 + 2 * Effect.idealised**2), rel=1e-3)
    assert quantities["velocity"].std == pytest.approx(np.hypot(0.02, Effect.idealised * 0.1), rel=1e-3)
    assert [quantities[p.name].unit for p in get("stribeck_friction").parameters] == ["N*m", "N*m", "rad/s"]


def test_where_blocks_disagree_more_than_the_noise_says_the_interval_is_theirs():
    """A cause that comes and goes is not known to the last digit, however white each stretch of it is."""
    spec = f"viscous_friction@{J1}:viscous=0.5"
    equations, (one, _) = equations_of([spec]), term(spec, Robot.bundled("arm2"))
    column = equations.columns.of(one)[:, :, 0]
    comes_and_goes = np.where(equations.rows.block % 2 == 0, 1.3, 0.7)[:, None]
    equations = equations.with_target(equations.rows.target + 0.5 * column * (comes_and_goes - 1.0))
    pool = Pool(equations, Noise(np.zeros((2, 1)), np.full(2, 0.01)), [one], LINK_ERROR)
    (estimate,) = estimates(pool, pool.fit([0]))
    assert estimate.robust[0, 0] > 4.0 * estimate.covariance[0, 0]
    assert estimate.quantities["viscous"].std >= np.sqrt(estimate.robust[0, 0])


def test_what_a_body_weighs_bears_twice_the_errors_of_the_links():
    """Not what else there is: of the links' errors the prior says nothing to a drive."""
    specs = ("payload@arm2_link2:mass=0.8,com_x=0.02,com_z=0.06", f"viscous_friction@{J1}:viscous=0.5")
    robot = Robot.bundled("arm2")
    equations, terms = equations_of(specs), [term(spec, robot)[0] for spec in specs]
    noise = Noise(np.zeros((2, 1)), np.full(2, 0.02))
    pool = Pool(equations, noise, terms, LINK_ERROR)
    payload, viscous = estimates(pool, pool.whole)
    wider, _ = estimates(pool.with_link_error(2.0 * LINK_ERROR), pool.whole)
    np.testing.assert_allclose(payload.doubting, wider.covariance, rtol=1e-6, atol=1e-12)
    assert payload.doubting[0, 0] > 1.5 * payload.covariance[0, 0]
    assert payload.quantities["mass"].std >= np.sqrt(payload.doubting[0, 0])
    np.testing.assert_array_equal(viscous.doubting, viscous.covariance)


@pytest.mark.parametrize("force, shown", [(0.32, True), (0.28, False), (0.0, False)])
@pytest.mark.parametrize("widest", ["covariance", "robust"])
def test_what_lies_within_three_deviations_of_nothing_is_not_shown(force, shown, widest):
    """By either covariance."""
    estimate = _coulomb_of(force, **{widest: 0.1})
    assert estimate._distance(getattr(estimate, widest)) == pytest.approx(force / 0.1)
    assert estimate.shown is shown


@pytest.mark.parametrize(
    "effect, distance", [("effort_offset@{}:offset=1", 3.0), ("quadratic_drag@{}:drag=1", 4.0)]
)
def test_what_is_not_common_lies_further_from_nothing_than_what_is(effect, distance):
    """Half the square of its deviations pays for what it costs to be believed."""
    one, _ = term(effect.format(J1), Robot.bundled("arm2"))
    for coefficient, clear in ((1.01 * distance, True), (0.99 * distance, False)):
        assert of(one, np.array([coefficient]), np.eye(1)).clear is clear


@pytest.mark.parametrize("share, shown", [(1.1, True), (0.9, False)])
def test_friction_that_holds_more_than_the_joint_ever_bore_is_not_shown(share, shown):
    """What was never measured at the joint is told of a few slow moments."""
    equations, robot = equations_of([]), Robot.bundled("arm2")
    one, _ = term(f"stribeck_friction@{J1}:coulomb=1,static=2,velocity=0.1", robot)
    signals = equations.motion.signals
    effort = np.tile([share, 9.0], (len(signals), 1)) * [2.0, 1.0]
    equations.use_motion(replace(equations.motion, signals=replace(signals, effort=effort)))
    pool = Pool(equations, Noise(np.zeros((2, 1)), np.full(2, 0.01)), [one], LINK_ERROR)
    (found,) = estimates(pool, pool.whole)
    known = replace(found, coefficients=np.ones(2), covariance=1e-6 * np.eye(3), robust=1e-6 * np.eye(3))
    assert replace(known, doubting=known.covariance).shown is shown


@pytest.mark.parametrize("force, shown", [(0.22, True), (0.18, False)])
def test_what_lies_within_two_deviations_where_links_are_doubted_is_not_shown(force, shown):
    """Three of what the links' errors seem to be are less than two of twice as much."""
    assert _coulomb_of(force, doubting=0.1).shown is shown


def _coulomb_of(force: float, **spread: float) -> Estimate:
    """Coulomb friction known to a hundredth [N·m] but for one covariance."""
    coulomb, _ = term(f"coulomb_friction@{J1}:coulomb=1", Robot.bundled("arm2"))
    known = {"covariance": 0.01, "robust": 0.01, "doubting": 0.01} | spread
    return Estimate(coulomb, np.array([force]), **{name: np.array([[std**2]]) for name, std in known.items()})


def test_what_lies_far_from_nothing_in_one_direction_is_shown():
    """Neither of two forces is known, their sum is."""
    uneven, _ = term(f"asymmetric_friction@{J1}:positive=1,negative=1", Robot.bundled("arm2"))
    covariance = np.array([[1.0, -0.999], [-0.999, 1.0]])
    estimate = of(uneven, np.array([0.5, 0.5]), covariance)
    assert estimate._distance(covariance) == pytest.approx(1.0 / np.sqrt(0.002))
    assert estimate.clear and not estimate.shown  # alike both ways it is Coulomb friction
    assert of(uneven, np.array([0.4, 0.6]), covariance).shown


def test_a_tilt_across_the_plane_of_an_arm_is_to_either_side():
    """It takes of the weight, as much to the left as to the right: the sign that a search began with was told as known."""
    found = draws(["base_tilt:roll_deg=-8,pitch_deg=4"], std=0.005, count=6, refine=True)
    for (estimate,) in found:
        roll, pitch = (estimate.quantities[name] for name in ("roll_deg", "pitch_deg"))
        assert roll.std > abs(roll.value) and not get("base_tilt").parameters[0].seen(roll.value, roll.std)
        assert abs(pitch.value - 4.0) < 3.0 * pitch.std < 3.0
        assert estimate.clear
