"""A chain learned from effort: its derivatives, its bodies, its URDF, and that it is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from bdnn_cases import signals, worn

from bdnn_ros.bdnn import chain as chains
from bdnn_ros.bdnn.bodies import Belief, columns, fit, quadratic
from bdnn_ros.bdnn.chain import Search
from bdnn_ros.bdnn.kinematics import Kinematics
from bdnn_ros.bdnn.refinement import Refinement, get_chain
from bdnn_ros.bdnn.samples import Samples, samples_of, scales_of, shortened
from bdnn_ros.errors import RecordingError
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.bodies import pseudo_inertia
from bdnn_ros.signals import MINIMUM_SAMPLES

N = 3


def bodies(rng: np.random.Generator, count: int = N) -> np.ndarray:
    """Inertial parameters of some points of mass, (count, PER_LINK)."""
    points = [
        pin.Inertia(float(mass), place, np.zeros((3, 3))).toDynamicParameters()
        for mass, place in zip(
            rng.uniform(0.2, 2.0, 8 * count), 0.3 * rng.normal(size=(8 * count, 3)), strict=True
        )
    ]
    return np.array(points).reshape(count, 8, PER_LINK).sum(axis=1)


def motion(rng: np.random.Generator, count: int = 6, n: int = N) -> tuple[np.ndarray, ...]:
    return tuple(rng.normal(size=(3, count, n)))


@pytest.mark.parametrize("negative", [False, True], ids=["real bodies", "negative masses"])
def test_moving_the_axes_changes_the_effort_as_the_jacobian_says(negative):
    rng = np.random.default_rng(0)
    kinematics, inertials, moved = Kinematics.random(N, rng), bodies(rng), motion(rng)
    if negative:
        inertials[1] *= -1.0
    jacobian = kinematics.jacobian(inertials, *moved)
    for k in range(6 * N):
        step = 1e-6 * np.eye(6 * N)[k]
        ahead, behind = (
            kinematics.moved(side * step).regressor(*moved) @ inertials.ravel() for side in (1, -1)
        )
        np.testing.assert_allclose(jacobian[:, :, k], (ahead - behind) / 2e-6, atol=1e-5)


def test_the_urdf_of_a_chain_is_the_chain():
    rng = np.random.default_rng(1)
    kinematics, inertials, moved = Kinematics.random(N, rng), bodies(rng), motion(rng)
    robot = Robot.from_urdf(kinematics.urdf(("a", "b", "c"), inertials))
    assert robot.joints == ("a", "b", "c")
    np.testing.assert_allclose(
        robot.rigid_effort(*moved), kinematics.regressor(*moved) @ inertials.ravel(), atol=1e-9
    )


def belief(n: int = N) -> Belief:
    rng = np.random.default_rng(2)
    return Belief(bodies(rng, n), rng.uniform(0.1, 1.0, (3, n)), np.ones(n), 2.0, 0.5)


def test_a_body_whose_thickness_is_rounding_is_at_the_edge():
    """Its pseudo-inertia's smallest eigenvalue is above zero by chance: the curvature there is noise."""
    believed = belief(1)
    thin = believed.reference.copy()
    thin[:PER_LINK] = [1.0, 0.0, 0.0, 0.0, 1e-15, 0.0, 1.0, 0.0, 0.0, 1.0]
    assert np.linalg.eigvalsh(pseudo_inertia(thin[None, :PER_LINK]))[0, 0] > 0.0
    assert believed.nats(thin) == np.inf
    thin[4] = 1e-9
    assert np.isfinite(believed.nats(thin))


def test_newton_stops_where_curvature_is_lost():
    believed = belief(1)
    size = believed.reference.size
    none = quadratic(np.zeros((1, 1, size)), np.zeros((1, 1)), np.ones(1))
    lost = replace(none, gram=-1e9 * np.eye(size))
    np.testing.assert_array_equal(fit(lost, believed, believed.reference), believed.reference)


def test_slopes_of_the_belief_are_its_derivatives():
    believed = belief()
    theta = believed.reference * 1.2
    gradient, hessian = believed.slopes(theta)
    rng = np.random.default_rng(3)
    direction, step = rng.normal(size=theta.size) * np.abs(theta) * 0.01, 1e-4
    ahead, behind = theta + step * direction, theta - step * direction
    slope = (believed.nats(ahead) - believed.nats(behind)) / (2.0 * step)
    assert slope == pytest.approx(gradient @ direction, rel=1e-5)
    bend = (believed.slopes(ahead)[0] - believed.slopes(behind)[0]) / (2.0 * step)
    np.testing.assert_allclose(bend, hessian @ direction, rtol=1e-4, atol=1e-7)


def test_nothing_is_believed_more_than_the_reference():
    believed = belief()
    reference = believed.reference
    assert believed.nats(reference) == pytest.approx(0.0, abs=1e-9)
    rng = np.random.default_rng(4)
    for _ in range(20):
        other = reference * (1.0 + 0.02 * rng.normal(size=reference.size))
        assert believed.nats(other) > 0.0


def test_what_cannot_exist_is_not_believed():
    believed = belief()
    for index, value in ((0, -1.0), (PER_LINK * N, -1e-9), (PER_LINK * N + N, 0.0)):
        theta = believed.reference.copy()
        theta[index] = value
        assert believed.nats(theta) == np.inf


def test_belief_in_a_body_does_not_depend_on_its_frame():
    believed = belief()
    placement = pin.SE3.Random()

    def turned(inertials: np.ndarray) -> np.ndarray:
        return np.array(
            [placement.act(pin.Inertia.FromDynamicParameters(row)).toDynamicParameters() for row in inertials]
        )

    inertials = believed.inertials * np.array([1.3, 0.8, 1.1])[:, None]
    rest = believed.reference[PER_LINK * N :]
    here = believed.nats(np.concatenate([inertials.ravel(), rest]))
    there = replace(believed, inertials=turned(believed.inertials))
    assert there.nats(np.concatenate([turned(inertials).ravel(), rest])) == pytest.approx(here, rel=1e-9)


def samples(name: str, seconds: float = 12.0, **options: object) -> Samples:
    return samples_of([signals(worn(name), seconds, 0, **options)])


def test_where_all_was_measured_nothing_is_weighed():
    """To the last digit: what is seen counts one, and errors are plain means."""
    whole = signals(worn("arm2"), 8.0, 0)
    data, scales = samples_of([whole]), scales_of(samples_of([whole]))
    rows = np.flatnonzero(whole.interior)[:: max(int(np.sqrt(2.0) * whole.kernel_std * whole.rate), 1)]
    np.testing.assert_array_equal(data.effort, whole.smooth(whole.effort)[rows])
    np.testing.assert_array_equal(scales.effort, np.std(data.effort, axis=0))
    assert data.seen.all() and data.seen.shape == data.effort.shape
    kinematics = Kinematics.random(2, np.random.default_rng(0))
    chain = chains.descend(data, kinematics, 3, lambda: False)
    regressor = kinematics.regressor(data.position, data.velocity, data.acceleration)
    np.testing.assert_array_equal(columns(regressor, data)[:, :, : 2 * PER_LINK], regressor)
    errors = (chain.effort(data) - data.effort) / scales.effort
    np.testing.assert_array_equal(chain.error(data), np.mean(errors**2, axis=0))
    noise = np.sqrt(np.mean((chain.effort(data) - data.effort) ** 2, axis=0))
    np.testing.assert_array_equal(chains.noise_of(data, chain), noise)


def test_what_was_not_measured_has_no_part_in_a_chain():
    """Whatever stands there."""
    whole = signals(worn("arm2"), 8.0, 0)
    late, later = (np.arange(len(whole)) > share * len(whole) for share in (0.5, 0.6))

    def told(value: float, *joints: int) -> Samples:
        where = np.zeros(whole.position.shape, bool)
        where[np.ix_(late, joints)] = True
        effort = np.where(where & later[:, None], value, whole.effort)
        return samples_of([replace(whole, unmeasured=where, effort=effort)])

    assert len(told(0.0, 0, 1)) < 0.6 * len(samples_of([whole])) and told(0.0, 0, 1).seen.all()
    start, ends = Kinematics.random(2, np.random.default_rng(0)), []
    for data in (told(0.0, 1), told(1e3, 1)):
        assert not data.seen.all() and not data.effort[~data.seen].any()
        chain, believed = chains.descend(data, start, 5, lambda: False), chains.generic(data)
        ends.append(chains.refine(data, chains.feasible(data, chain, believed), believed))
    np.testing.assert_allclose(ends[1].parameters, ends[0].parameters, rtol=1e-6)
    assert ends[1].cost == pytest.approx(ends[0].cost, rel=1e-6)


def test_bodies_of_known_axes_are_fitted_and_could_exist():
    robot, data = worn("arm6"), samples("arm6", 20.0)
    generic = chains.generic(data)
    design = columns(robot.regressor(data.position, data.velocity, data.acceleration), data)
    theta = fit(quadratic(design, data.effort, 0.01 * np.std(data.effort, axis=0)), generic)
    assert (np.linalg.eigvalsh(pseudo_inertia(theta[:60].reshape(6, 10)))[:, 0] > 0.0).all()
    assert (theta[60:78] > 0.0).all()
    error = np.mean((design @ theta - data.effort) ** 2, axis=0) / np.var(data.effort, axis=0)
    assert (error < 2e-3).all()
    np.testing.assert_allclose(theta[66:72], robot.viscous, rtol=0.1)
    np.testing.assert_allclose(theta[72:78], robot.coulomb, rtol=0.05)


def test_no_data_leaves_the_reference():
    generic = chains.generic(samples("arm2"))
    empty = quadratic(np.zeros((1, 2, 28)), np.zeros((1, 2)), np.ones(2))
    np.testing.assert_allclose(fit(empty, generic), generic.reference, rtol=1e-3, atol=1e-6)


def test_a_chain_is_found_and_made_real():
    robot, data = worn("arm2"), samples("arm2")
    search = Search(data, np.random.default_rng(0))
    while not search.settled and search.starts < 10:
        search.try_once(lambda: False)
    assert search.found[0].cost < 1e-3
    refinement, generic = Refinement(search.found[0]), chains.generic(data)
    while not refinement.finished:
        refinement.advance(data, generic)
    found = refinement.best
    assert found is not None
    assert found.cost < 1e-3
    inertials = found.parameters[:20].reshape(2, 10)
    learned = Robot.from_urdf(found.kinematics.urdf(robot.joints, inertials))
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 2))
    mass = learned.mass_matrix(q) + np.diag(found.parameters[20:22])
    assert np.linalg.norm(mass - robot.mass_matrix(q)) < 0.03 * np.linalg.norm(mass)
    assert np.linalg.norm(learned.gravity(q) - robot.gravity(q)) < 0.02 * np.linalg.norm(robot.gravity(q))


def test_a_step_of_refinement_never_loses():
    data = samples("arm2")
    search = Search(data, np.random.default_rng(1))
    search.try_once(lambda: False)
    generic = chains.generic(data)
    chain = chains.feasible(data, search.found[0], generic)
    for _ in range(4):
        noise = chains.noise_of(data, chain)
        better = chains.refine(data, chain, generic)
        if better is None:
            break
        error = np.sum(((better.effort(data) - data.effort) / noise) ** 2) / 2.0 + generic.nats(
            better.parameters
        )
        before = np.sum(((chain.effort(data) - data.effort) / noise) ** 2) / 2.0 + generic.nats(
            chain.parameters
        )
        assert error < before + 1.0  # the belief in short links may take a little
        chain = better


def test_a_refinement_survives_its_state():
    data, arrays = samples("arm2"), {}
    search = Search(data, np.random.default_rng(2))
    search.try_once(lambda: False)
    refinement, generic = Refinement(search.found[0]), chains.generic(data)
    for _ in range(3):
        refinement.advance(data, generic)
    info = refinement.to_state("x", arrays)
    again = Refinement.from_state("x", arrays, info)
    for one in (refinement, again):
        one.advance(data, generic)
    np.testing.assert_array_equal(again.reached[0].parameters, refinement.reached[0].parameters)
    np.testing.assert_array_equal(get_chain("x.origin", arrays).parameters, search.found[0].parameters)


def test_samples_need_effort_and_length():
    full = signals(worn("arm2"), 4.0, 0)
    with pytest.raises(RecordingError, match="no effort"):
        samples_of([replace(full, effort=None)])
    with pytest.raises(RecordingError, match="too few"):
        samples_of([full.rows(np.arange(len(full)) < 100)])


def test_signals_are_shortened_in_proportion():
    parts = [signals(worn("arm2"), 4.0, 0), signals(worn("arm2"), 2.0, 1)]
    short = shortened(parts, sum(map(len, parts)) // 2)
    for whole, part in zip(parts, short, strict=True):
        assert len(part) == pytest.approx(len(whole) / 2, abs=2)
    assert shortened(parts, 10**6) == parts
    assert [len(part) for part in shortened(parts, 10)] == [MINIMUM_SAMPLES]
