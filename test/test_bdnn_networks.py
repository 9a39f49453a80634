"""P keeps its promise for any weights; derivatives are those of autograd."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from bdnn_cases import random_field, scales
from hypothesis import given, settings
from hypothesis import strategies as st

from bdnn_ros.bdnn.field import Field
from bdnn_ros.bdnn.networks import (
    ACTIVATIONS,
    Network,
    spd_apply,
    spd_derivative,
    spd_factor,
    spd_matrix,
    spd_pull,
    spd_shift,
    vector_size,
)
from bdnn_ros.errors import UsageError


def positive_definite(matrix: np.ndarray) -> bool:
    """By Cholesky in the matrix's own precision, and by eigenvalues."""
    np.linalg.cholesky(matrix)
    return bool((np.linalg.eigvalsh(matrix) > 0.0).all())


@settings(max_examples=60, deadline=None)
@given(
    n=st.integers(1, 7),
    exponent=st.floats(-6.0, 30.0),
    seed=st.integers(0, 2**31),
    position=st.floats(allow_nan=False, allow_infinity=False, width=32),
    precision=st.sampled_from([np.float32, np.float64]),
)
def test_h_is_positive_definite_for_any_weights_and_positions(n, exponent, seed, position, precision):
    rng = np.random.default_rng(seed)
    h = Network.random(2 * n, 6, vector_size(n), rng)
    h = h.with_vector(rng.normal(size=h.vector().size) * 10.0**exponent).astype(precision)
    angle = np.full((3, n), position, precision) * rng.uniform(-1.0, 1.0, (3, n)).astype(precision)
    done = h.run(np.concatenate([np.sin(angle), np.cos(angle)], axis=1))
    matrix = spd_matrix(spd_factor(done.output, n))
    assert matrix.dtype == precision
    assert np.isfinite(matrix).all()
    np.testing.assert_allclose(matrix, np.swapaxes(matrix, 1, 2), rtol=1e-5)
    assert positive_definite(matrix)


def test_a_zero_vector_gives_the_unit_matrix_but_for_the_floor():
    matrix = spd_matrix(spd_factor(np.zeros((1, vector_size(4))), 4))
    np.testing.assert_allclose(matrix[0], np.eye(4), atol=1e-4)


def test_every_lower_triangle_is_reached():
    lower = np.tril(np.random.default_rng(0).normal(size=(3, 3)))
    vector = (lower - np.eye(3))[np.tril_indices(3)]
    np.testing.assert_allclose(spd_factor(vector[None], 3)[0], lower)


def test_p_is_applied_without_being_formed():
    rng = np.random.default_rng(1)
    factor, y = spd_factor(rng.normal(size=(5, 6)), 3), rng.normal(size=(5, 3))
    product, inner = spd_apply(factor, spd_shift(factor), y)
    np.testing.assert_allclose(product, (spd_matrix(factor) @ y[..., None])[..., 0])
    np.testing.assert_allclose(inner, (np.swapaxes(factor, 1, 2) @ y[..., None])[..., 0])


def test_the_cotangent_of_p_is_the_transpose_of_its_derivative():
    rng = np.random.default_rng(2)
    vector, change = rng.normal(size=(2, 4, 10))
    left, right = rng.normal(size=(2, 4, 4))
    factor = spd_factor(vector, 4)
    inner = [(np.swapaxes(factor, 1, 2) @ side[..., None])[..., 0] for side in (left, right)]
    pulled = spd_pull(factor, left, inner[0], right, inner[1])
    pushed = np.einsum("bi,bij,bj->b", left, spd_derivative(factor, change), right)
    np.testing.assert_allclose(np.sum(pulled * change, axis=1), pushed, rtol=1e-10)


def test_the_derivative_of_p_is_its_slope():
    rng = np.random.default_rng(3)
    vector, change = rng.normal(size=(2, 4, 6))
    step = 1e-6
    ahead, behind = (spd_matrix(spd_factor(vector + side * step * change, 3)) for side in (1, -1))
    slope = spd_derivative(spd_factor(vector, 3), change)
    np.testing.assert_allclose(slope, (ahead - behind) / (2.0 * step), atol=1e-7)


@pytest.mark.parametrize("activation", sorted(ACTIVATIONS))
def test_a_networks_derivatives_are_autograds(activation):
    rng = np.random.default_rng(4)
    network = Network.random(3, 5, 2, rng, activation)
    x, cotangent = rng.normal(size=(4, 3)), rng.normal(size=(4, 2))
    w1, b1, w2, b2 = (torch.tensor(part, requires_grad=True) for part in network.arrays)
    inputs = torch.tensor(x, requires_grad=True)
    phi = {"tanh": torch.tanh, "sigmoid": torch.sigmoid, "softplus": torch.nn.functional.softplus}[activation]
    y = network.bound * torch.tanh((phi(inputs @ w1.T + b1) @ w2.T + b2) / network.bound)
    expected = torch.autograd.grad((y * torch.tensor(cotangent)).sum(), [inputs, w1, b1, w2, b2])
    done = network.run(x)
    deltas = network.deltas(done, cotangent)
    np.testing.assert_allclose(done.output, y.detach().numpy(), rtol=1e-12)
    np.testing.assert_allclose(network.pull_inputs(deltas), expected[0].numpy(), rtol=1e-10)
    for ours, theirs in zip(network.weight_gradient(done, deltas), expected[1:], strict=True):
        np.testing.assert_allclose(ours, theirs.numpy(), rtol=1e-10)
    jacobian = network.input_jacobian(done)
    np.testing.assert_allclose(np.einsum("bo,boi->bi", cotangent, jacobian), expected[0].numpy(), rtol=1e-10)


def test_both_directions_of_a_field_are_each_others_inverse():
    field = random_field(3)
    rng = np.random.default_rng(5)
    state, effort = rng.normal(size=(6, 6)), rng.normal(size=(6, 3)) * field.scales.effort
    acceleration = field.acceleration(state, effort).acceleration
    np.testing.assert_allclose(field.effort(state, acceleration).effort, effort, rtol=1e-9)


def test_the_gradient_of_the_effort_is_its_slope():
    field = random_field(3)
    rng = np.random.default_rng(6)
    state, acceleration, cotangent = rng.normal(size=(4, 6)), rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    parts = field.effort_gradient(field.effort(state, acceleration), cotangent)
    gradient = np.concatenate([part.ravel() for part in parts])
    direction, step = rng.normal(size=gradient.size), 1e-6
    sides = [
        np.sum(
            cotangent
            * field.with_vector(field.vector() + s * step * direction).effort(state, acceleration).effort
        )
        for s in (1, -1)
    ]
    assert (sides[0] - sides[1]) / (2.0 * step) == pytest.approx(gradient @ direction, rel=1e-6)


def test_the_derivative_of_h_is_its_slope():
    field = random_field(3)
    position, step = np.random.default_rng(7).normal(size=(4, 3)), 1e-6
    slope = field.inverse_inertia_derivative(position)
    for k in range(3):
        change = step * np.eye(3)[k]
        difference = field.inverse_inertia(position + change) - field.inverse_inertia(position - change)
        np.testing.assert_allclose(slope[..., k], difference / (2.0 * step), atol=1e-6)


def test_weights_can_be_changed_in_place_through_their_vector():
    vector = random_field(2).vector()
    field = random_field(2).with_vector(vector)
    before = field.bias(np.zeros((1, 4)))
    vector += 0.1
    assert not np.allclose(field.bias(np.zeros((1, 4))), before)


def test_an_unknown_activation_is_named():
    with pytest.raises(UsageError, match="step"):
        Field.random(scales(2), 4, np.random.default_rng(0), "step")
