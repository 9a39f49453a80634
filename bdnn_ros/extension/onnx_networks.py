"""Effort of BDNNs in operations that `symbols` turns into ONNX graphs: networks, P, and the linear systems they need."""

from __future__ import annotations

import numpy as np

from bdnn_ros.bdnn.cores import NetworkCore, PriorCore, angles
from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.networks import SPD_FLOOR, Network, lower_indices
from bdnn_ros.errors import DataError
from bdnn_ros.extension.onnx_bodies import Array, inertial_effort, physical_effort, rigid_effort
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot


def bdnn_effort(model: BDNN, q: Array, v: Array, a: Array) -> Array:
    """As `BDNN.inverse_dynamics`."""
    if isinstance(model.core, NetworkCore):
        return _network_core(model.core, q, v, a)
    if isinstance(model.core, PriorCore):
        return _prior_core(model.core, q, v, a)
    raise DataError(f"No ONNX graph is known for a {type(model.core).__name__}.", "")


def _network_core(core: NetworkCore, q: Array, v: Array, a: Array) -> Array:
    """H⁻¹ q̈ + R with H = F P(h) F."""
    field, n = core.field, len(core.joints)
    inputs = field.bias_inputs(np.concatenate([q, v], axis=1))
    matrix = _spd(network(field.h, inputs[:, : 2 * n]), n)
    inertial = solved(matrix, a / field.gain) / field.gain
    return inertial + field.scales.effort * network(field.r, inputs)


def _prior_core(core: PriorCore, q: Array, v: Array, a: Array) -> Array:
    """M q̈ of the prior, corrected where there is an h, and its bias with the local networks'."""
    prior = core.prior
    if not isinstance(prior, (Robot, PhysicalModel)):
        raise DataError(f"No ONNX graph is known for a BDNN on a {type(prior).__name__}.", "")
    robot = prior if isinstance(prior, Robot) else prior.robot
    still, direction = 0.0 * q, np.tanh(v / core.slow)
    load = rigid_effort(robot, q, still, still)
    if isinstance(prior, Robot):
        bias = rigid_effort(robot, q, v, still) + robot.viscous * v + robot.coulomb * direction
    else:
        bias = physical_effort(prior, q, v, still)
    inertial = inertial_effort(prior, q, a) if core.h is None else _corrected(core.h, prior, q, a)
    return inertial + bias + _local(core.local, q, v, direction, load)


def _corrected(h: Network, prior: Robot | PhysicalModel, q: Array, a: Array) -> Array:
    """L P(h)⁻¹ Lᵀ q̈ with the prior's M = L Lᵀ."""
    n = q.shape[1]
    columns = [inertial_effort(prior, q, 0.0 * q + unit) for unit in np.eye(n)]
    root = cholesky(np.stack(columns, axis=2))
    inner = solved(_spd(network(h, angles(q)), n), (a[:, None, :] @ root)[:, 0, :])
    return (inner[:, None, :] @ np.swapaxes(root, 1, 2))[:, 0, :]


def _local(local: LocalNetworks, q: Array, v: Array, direction: Array, load: Array) -> Array:
    if not local.output_weights[:, 1:].any():
        return local.output_weights[:, 0]
    return local(q, v, direction, load)


def network(net: Network, inputs: Array) -> Array:
    """As `Network.run`, the output only."""
    hidden = _activated(inputs @ net.hidden_weights.T + net.hidden_bias, net.activation)
    return net.bound * np.tanh((hidden @ net.output_weights.T + net.output_bias) / net.bound)


def _activated(z: Array, activation: str) -> Array:
    if activation == "tanh":
        return np.tanh(z)
    if activation == "sigmoid":
        return 0.5 + 0.5 * np.tanh(0.5 * z)
    if activation == "softplus":
        return np.maximum(z, 0.0) + np.log(1.0 + np.exp(-np.abs(z)))
    raise DataError(f"No ONNX graph is known for the activation {activation}.", "")


def _spd(vector: Array, n: int) -> Array:
    """P of vectors (N, n(n+1)/2), (N, n, n); as `networks.spd_matrix`."""
    rows, columns = lower_indices(n)
    place = np.zeros((len(rows), n * n))
    place[np.arange(len(rows)), rows * n + columns] = 1.0
    flat = vector @ place + np.eye(n).ravel()
    factor = flat.reshape(-1, n, n)
    shift = SPD_FLOOR * (1.0 + np.sum(flat * flat, axis=1))
    return factor @ np.swapaxes(factor, 1, 2) + shift[:, None, None] * np.eye(n)


def solved(matrix: Array, right: Array) -> Array:
    """x with A x = b, for positive-definite A (N, n, n) and b (N, n): Gauss and Jordan's elimination."""
    n = right.shape[1]
    both = np.concatenate([matrix, right[:, :, None]], axis=2)
    for k, unit in enumerate(np.eye(n)):
        row = both[:, [k], :] / both[:, [k], :][:, :, [k]]
        both = both - (both[:, :, [k]] - unit[:, None]) @ row
    return both[:, :, n]


def cholesky(matrix: Array) -> Array:
    """L with L Lᵀ = A, for positive-definite A (N, n, n), column by column."""
    left, columns = matrix, []
    for k in range(matrix.shape[1]):
        column = left[:, :, [k]] / np.sqrt(left[:, [k], :][:, :, [k]])
        columns.append(column[:, :, 0])
        left = left - column @ np.swapaxes(column, 1, 2)
    return np.stack(columns, axis=2)
