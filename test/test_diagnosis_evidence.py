"""Evidence of sets of effects: against the closed form, brute force, and itself."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_cases import equations_of, term, white
from scipy.optimize import minimize, minimize_scalar

from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.effects.rigid import HEAVY
from bdnn_ros.robot import Robot

J1, J2 = "arm2_joint1", "arm2_joint2"
TRUE = (f"viscous_friction@{J1}:viscous=0.8", f"effort_offset@{J2}:offset=0.05")
SPECS = (
    *TRUE,
    f"coulomb_friction@{J1}:coulomb=1",
    f"effort_offset@{J1}:offset=1",
    f"drift@{J2}:of=offset,start_value=0.1,end_value=0.2,start=0,end=12",
    f"asymmetric_friction@{J2}:positive=1,negative=1",
    f"stribeck_friction@{J1}:coulomb=0.5,static=1,velocity=0.1",
)
VISCOUS, OFFSET2, COULOMB, OFFSET1, DRIFT, ASYMMETRIC, STRIBECK = range(len(SPECS))
FREE = (OFFSET2, OFFSET1, DRIFT)
"""Terms without bounds."""
STD, LINK_ERROR = 0.02, 0.05


def pool_of(
    terms: list[Term], seed: int = 0, specs: tuple[str, ...] = TRUE, error: float = LINK_ERROR
) -> Pool:
    """Candidates on a recording with true effects and white noise."""
    equations = equations_of(specs)
    noise, model = white(equations, STD, seed)
    equations = equations.with_target(equations.rows.target + noise)
    return Pool(equations, model, terms, error)


@pytest.fixture(scope="module")
def terms() -> list[Term]:
    robot = Robot.bundled("arm2")
    return [term(spec, robot)[0] for spec in SPECS]


@pytest.fixture(scope="module")
def pool(terms) -> Pool:
    return pool_of(terms)


def design(pool: Pool, chosen: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whitened columns (rows, P), target (rows,), and the prior's precisions (P,)."""
    index = pool.columns_of(chosen)
    columns = pool.white[:, :, index].reshape(-1, len(index))
    return columns, pool.white_target.ravel(), pool.precision[index]


def brute_force(
    columns: np.ndarray, target: np.ndarray, precision: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Posterior mode inside bounds, by a general optimiser in scaled units."""
    scale = 1.0 / np.sqrt(np.sum(columns**2, axis=0) + precision)
    tall, prior = columns * scale, precision * scale**2

    def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
        error = target - tall @ x
        return 0.5 * float(error @ error + x @ (prior * x)), -tall.T @ error + prior * x

    best = minimize(
        loss,
        np.clip(np.zeros(len(low)), low / scale, high / scale),
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low / scale, high / scale, strict=True)),
        options={"ftol": 1e-15, "gtol": 1e-9, "maxiter": 20000, "maxfun": 100000, "maxcor": 30},
    )
    return best.x * scale


@pytest.mark.parametrize("chosen", [(), (VISCOUS,), FREE])
def test_a_fit_is_bayesian_linear_regression(pool, chosen):
    columns, target, precision = design(pool, chosen)
    fit = pool.fit(chosen)
    assert ((fit.coefficients > pool.lower[pool.columns_of(chosen)]).all()) and fit.terms == chosen
    posterior = np.linalg.inv(columns.T @ columns + np.diag(precision))
    np.testing.assert_allclose(fit.covariance, posterior, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(fit.coefficients, posterior @ columns.T @ target, rtol=1e-6, atol=1e-9)
    marginal = np.eye(len(target)) + columns @ np.diag(1.0 / precision) @ columns.T
    sign, volume = np.linalg.slogdet(marginal)
    assert sign > 0.0
    equations = pool.equations
    history = equations.whitening.history(1)
    stds = pool.noise.of(equations.whitening.recent_sticking_doubt(1), np.maximum(history, 0))[history >= 0]
    expected = -0.5 * (target @ np.linalg.solve(marginal, target) + volume)
    # a constant of the data and the noise model: the same whatever is chosen
    constant = fit.evidence - expected
    assert constant == pytest.approx(
        pool.fit((VISCOUS, *FREE)).evidence - evidence_of(pool, (VISCOUS, *FREE))
    )
    assert constant == pytest.approx(-np.log(stds).sum(), rel=1e-9)


def evidence_of(pool: Pool, chosen: tuple[int, ...]) -> float:
    """Log marginal likelihood of the whitened target, by its determinant."""
    columns, target, precision = design(pool, chosen)
    marginal = np.eye(len(target)) + columns @ np.diag(1.0 / precision) @ columns.T
    return float(-0.5 * (target @ np.linalg.solve(marginal, target) + np.linalg.slogdet(marginal)[1]))


@pytest.mark.parametrize("company", [(), (VISCOUS,), (VISCOUS, OFFSET2)])
def test_gains_are_differences_of_evidence(pool, company):
    fit = pool.fit(company)
    candidates = [c for c in (VISCOUS, *FREE) if c not in company]
    gains = pool.gains(fit, candidates)
    for c, gain in zip(candidates, gains, strict=True):
        grown = pool.fit((*company, c))
        index = pool.columns_of(grown.terms)
        assert (grown.coefficients > pool.lower[index]).all()  # no bound is active
        assert gain == pytest.approx(grown.evidence - fit.evidence, abs=1e-6)


def test_the_gain_of_a_term_outside_the_pool_is_the_same(pool, terms):
    fit = pool.fit((VISCOUS,))
    for c in range(1, len(terms)):
        outside = pool.gain_of(fit, terms[c], pool.equations.columns.of(terms[c]))[0]
        assert outside == pytest.approx(pool.gains(fit, [c])[0], rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("one", [COULOMB, ASYMMETRIC, STRIBECK])
def test_a_lone_bounded_term_gains_what_the_bounded_fit_gains_or_less(pool, one):
    """Others stay where they are when a bound stops a candidate, so that its gain is never overstated."""
    fit = pool.fit((VISCOUS, OFFSET2))
    exact = pool.fit((VISCOUS, OFFSET2, one)).evidence - fit.evidence
    assert pool.gains(fit, [one])[0] == pytest.approx(exact, abs=1e-6)


@pytest.mark.parametrize(
    "specs, chosen",
    [
        ((f"effort_offset@{J1}:offset=0.2", f"effort_offset@{J2}:offset=-0.1"), (VISCOUS, ASYMMETRIC)),
        (TRUE, (COULOMB, STRIBECK, ASYMMETRIC)),
        ((), (VISCOUS, COULOMB, ASYMMETRIC, STRIBECK)),
    ],
)
def test_bounds_hold_and_the_rest_gives_way_best(terms, specs, chosen):
    pool = pool_of(terms, seed=3, specs=specs)
    fit = pool.fit(chosen)
    index = pool.columns_of(chosen)
    low, high = pool.lower[index], pool.upper[index]
    assert (fit.coefficients >= low).all() and (fit.coefficients <= high).all()
    columns, target, precision = design(pool, chosen)
    best = brute_force(columns, target, precision, low, high)
    ours, theirs = (target - columns @ x for x in (fit.coefficients, best))
    loss = 0.5 * (ours @ ours + fit.coefficients @ (precision * fit.coefficients))
    assert fit.loss == pytest.approx(loss, rel=1e-9)
    assert loss <= 0.5 * (theirs @ theirs + best @ (precision * best)) + 1e-3
    np.testing.assert_allclose(columns @ fit.coefficients, columns @ best, atol=0.05)


def test_friction_that_drives_is_refused(terms):
    pool = pool_of(terms)
    pool.equations = pool.equations.with_target(-pool.equations.columns.of(terms[VISCOUS])[:, :, 0])
    pool = Pool(pool.equations, pool.noise, terms, 1e-6)
    assert pool.part(pool.fit((VISCOUS,)), VISCOUS)[0][0] == 0.0
    assert pool.gains(pool.fit(()), [VISCOUS])[0] < 0.0


@pytest.mark.parametrize("chosen", [(), (VISCOUS, OFFSET2), (VISCOUS, COULOMB, STRIBECK)])
def test_held_out_errors_are_those_of_refits(pool, chosen):
    columns, target, precision = design(pool, chosen)
    index, equations = pool.columns_of(chosen), pool.equations
    block = np.repeat(equations.rows.block, equations.rows.width)
    errors = pool.held_out(chosen)
    assert errors.shape == (equations.rows.blocks,)
    for b in range(equations.rows.blocks):
        kept = block != b
        best = brute_force(columns[kept], target[kept], precision, pool.lower[index], pool.upper[index])
        error = target[~kept] - columns[~kept] @ best
        assert errors[b] == pytest.approx(0.5 * float(error @ error), rel=1e-3)


def same(one: Pool, other: Pool, *sets: tuple[int, ...]) -> None:
    """Asserts that two pools say the same."""
    for key in ("gram", "moment", "power", "precision", "white"):
        np.testing.assert_allclose(getattr(one, key), getattr(other, key), rtol=1e-9, atol=1e-9, err_msg=key)
    assert (one.terms, one.link_error) == (other.terms, other.link_error)
    for chosen in sets:
        assert one.fit(chosen).evidence == pytest.approx(other.fit(chosen).evidence, abs=1e-6)
        np.testing.assert_allclose(one.held_out(chosen), other.held_out(chosen), rtol=1e-6)


def test_replacing_a_shape_is_rebuilding(pool, terms):
    before = pool.fit((STRIBECK,)).evidence
    moved = terms[STRIBECK].shaped({"velocity": 0.3})
    rebuilt = Pool(pool.equations, pool.noise, [*terms[:STRIBECK], moved], LINK_ERROR)
    same(pool.replacing({STRIBECK: moved}), rebuilt, (), (STRIBECK,), (VISCOUS, STRIBECK))
    assert pool.fit((STRIBECK,)).evidence == before and pool.terms[STRIBECK] == terms[STRIBECK]


def test_believing_otherwise_is_rebuilding(pool, terms):
    same(pool.with_link_error(0.3), Pool(pool.equations, pool.noise, terms, 0.3), (), (VISCOUS, OFFSET2))
    assert pool.link_error == LINK_ERROR


def test_the_evidence_prefers_what_is_true(pool):
    best = pool.fit((VISCOUS, OFFSET2)).evidence
    assert best > pool.fit((VISCOUS,)).evidence + 10.0
    assert best > pool.fit((OFFSET2,)).evidence + 10.0
    for more in (COULOMB, OFFSET1, DRIFT, STRIBECK):
        assert pool.fit((VISCOUS, OFFSET2, more)).evidence < best


def test_no_set_of_terms_exceeds_the_most_that_all_of_them_can(pool):
    most = pool.evidence_bound(range(len(pool.terms)))
    for chosen in (
        (),
        (VISCOUS, OFFSET2),
        (VISCOUS, OFFSET2, DRIFT, STRIBECK),
        tuple(range(len(pool.terms))),
    ):
        assert pool.fit(chosen).evidence < most
    assert pool.evidence_bound(()) < pool.fit((VISCOUS, OFFSET2)).evidence


def test_errors_of_the_links_of_the_believed_size_leave_nothing_to_find(terms):
    errors = LINK_ERROR * np.random.default_rng(7).standard_normal(20)
    equations = equations_of(errors=errors)
    noise, model = white(equations, STD, 1)
    equations = equations.with_target(equations.rows.target + noise)
    pool = Pool(equations, model, terms, LINK_ERROR)
    alone = pool.fit(())
    assert (pool.gains(alone, range(len(terms))) < 3.0).all()
    assert np.sum(pool.residual(alone) ** 2) < 1.2 * np.sum(noise**2)


def test_contributions_add_up(pool, terms):
    chosen = (OFFSET2, VISCOUS)
    fit, equations = pool.fit(chosen), pool.equations
    links = equations.rigid.shape[2]
    total = equations.rigid @ fit.coefficients[:links]
    total = total + equations.nuisances.along(equations.motion) @ fit.coefficients[links : pool.base]
    for c in chosen:
        coefficients, covariance = pool.part(fit, c)
        assert covariance.shape == (1, 1)
        total = total + equations.columns.of(terms[c]) @ coefficients
    np.testing.assert_allclose(pool.contribution(fit), total, atol=1e-9)
    np.testing.assert_allclose(pool.residual(fit), equations.rows.target - total, atol=1e-9)
    blur = equations.nuisances.along(equations.motion)[:, :, 1:3] @ fit.coefficients[links + 1 : links + 3]
    np.testing.assert_allclose(pool.contribution(fit) - pool.contribution(fit, blur=False), blur, atol=1e-9)
    with pytest.raises(KeyError):
        pool.part(fit, COULOMB)


def test_a_payload_may_as_well_have_no_inertia_of_its_own(terms) -> None:
    """Its fit is the likeliest one, its evidence the mean of all; a heavy payload is another kind."""
    payload, _ = term("payload@arm2_link2:mass=1", Robot.bundled("arm2"))
    pool = pool_of([*terms, payload])
    last = len(terms)
    index = pool.columns_of([VISCOUS, last])
    own = np.flatnonzero(np.isin(index, pool.slots[last][4:]))
    known = pool.precision[index] * np.where(np.isin(np.arange(len(index)), own), 1e8, 1.0)
    slot = np.isin(index, pool.slots[last])
    each = [
        one * np.where(slot & ~np.isin(np.arange(len(index)), own), size**-2.0, 1.0)
        for size in (1.0, HEAVY)
        for one in (pool.precision[index], known)
    ]
    ends = pool.lower[index], pool.upper[index]
    fits = [pool._fit((VISCOUS, last), index, one, *ends) for one in each]
    both = pool.fit([VISCOUS, last])
    evidence = [fit.evidence for fit in fits]
    assert both.evidence == pytest.approx(np.logaddexp.reduce(evidence) - np.log(4.0))
    np.testing.assert_allclose(both.coefficients, fits[int(np.argmax(evidence))].coefficients, rtol=1e-9)
    for least in fits[1::2]:
        np.testing.assert_allclose(least.coefficients[own], 0.0, atol=1e-6)
    gain = pool.gains(pool.fit([VISCOUS]), [last])[0]
    assert gain == pytest.approx(both.evidence - pool.fit([VISCOUS]).evidence, abs=2.0)


def test_a_shape_is_sought_beside_others_as_they_are_with_it():
    """Without the bristle a rotor would be negative; held at its bound it had the bristle break away later."""
    specs = (f"hysteresis@{J1}:force=3,breakaway=0.04", f"armature@{J1}:armature=0.05")
    equations = equations_of(specs)
    bristle, rotor = (term(spec, equations.motion.robot)[0] for spec in specs)
    terms = [bristle.shaped({"breakaway": 0.07}), rotor]
    pool = Pool(equations, white(equations, STD, 0)[1], terms, LINK_ERROR)
    assert pool.coefficients(pool.fit([1]), 1) == 0.0 < pool.coefficients(pool.whole, 1)

    def lost(breakaway: float) -> float:
        return -pool.replacing({0: pool.terms[0].shaped({"breakaway": breakaway})}).whole.evidence

    best = minimize_scalar(lost, bounds=(0.01, 0.2), method="bounded").x
    found = Candidates.of(equations.motion.robot).refined(equations, pool, pool.whole, 0)
    assert dict(found.shape)["breakaway"] == pytest.approx(best, rel=2e-3)
