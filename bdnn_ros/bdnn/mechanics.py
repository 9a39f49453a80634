"""Mechanics of a model: its matrices, energies and powers, and whether they are those of a real machine.

Works on any `Dynamics`; ∂M/∂q is taken from the model if it provides it, otherwise by finite differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.bdnn.cores import DIFFERENCE, prior_derivative
from bdnn_ros.dynamics import Dynamics

POSES = 500
PATH_STEPS = 20
"""Points of the line integral of gravity that gives the potential energy."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(PATH_STEPS)


@dataclass(frozen=True)
class Parts:
    """The parts of an effort, (..., n) each [N·m].

    Attributes:
        inertial: M q̈.
        coriolis: C q̇.
        gravity: g.
        friction: the rest, with what an effort's sensor makes of it all.
        mass_matrix: M, (..., n, n) [kg·m²].
    """

    inertial: np.ndarray
    coriolis: np.ndarray
    gravity: np.ndarray
    friction: np.ndarray
    mass_matrix: np.ndarray

    @property
    def effort(self) -> np.ndarray:
        """Their sum."""
        return self.inertial + self.coriolis + self.gravity + self.friction


@dataclass(frozen=True)
class Consistency:
    """Whether a model behaves like a machine, over random motions in a range.

    Attributes:
        smallest_eigenvalue: of M [kg·m²].
        condition: largest of M's condition numbers.
        asymmetry: of M, relative.
        skewness: |Ṁ − 2C + (Ṁ − 2C)ᵀ| over |Ṁ|: 0 where C is that of M.
        gravity_curl: |∂g/∂q − (∂g/∂q)ᵀ| over |∂g/∂q|: 0 where gravity has a potential.
        passive: share of the motions in which friction takes energy out.
        created_power: largest power that friction puts in, over the mean power it takes out.
    """

    smallest_eigenvalue: float
    condition: float
    asymmetry: float
    skewness: float
    gravity_curl: float
    passive: float
    created_power: float

    @property
    def sound(self) -> bool:
        """Whether M is positive-definite and symmetric, and friction is passive (up to 1 % of the motions)."""
        return self.smallest_eigenvalue > 0.0 and self.asymmetry < 1e-6 and self.passive > 0.99


def mass_matrix_derivative(model: Dynamics, position: np.ndarray) -> np.ndarray:
    """∂M/∂q_k at [..., k], (..., n, n, n) [kg·m²/rad]."""
    own = getattr(model, "mass_matrix_derivative", None)
    if own is not None:
        return np.asarray(own(position))
    rows = np.reshape(position, (-1, np.shape(position)[-1]))
    return prior_derivative(model, rows).reshape(*np.shape(position), rows.shape[1], rows.shape[1])


def coriolis_matrix(model: Dynamics, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """C(q, q̇) by Christoffel's symbols of M, so that Ṁ − 2C is skew, (..., n, n) [N·m·s/rad].

    C_ij = ½ Σ_k (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i) q̇_k.
    """
    change = mass_matrix_derivative(model, position)
    rate = np.einsum("...ijk,...k->...ij", change, velocity)
    turned = np.einsum("...ikj,...k->...ij", change, velocity)
    return 0.5 * (rate + turned - np.swapaxes(turned, -1, -2))


def parts(model: Dynamics, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> Parts:
    """The effort of a motion split into its parts, which add up to the inverse dynamics."""
    matrix = model.mass_matrix(position)
    inertial = (matrix @ np.asarray(acceleration)[..., None])[..., 0]
    coriolis, gravity = model.coriolis(position, velocity), model.gravity(position)
    # `friction` is that without acceleration, and the load that an acceleration asks for may make more of it
    rest = model.inverse_dynamics(position, velocity, acceleration) - (inertial + coriolis + gravity)
    return Parts(inertial, coriolis, gravity, rest, matrix)


def odd_friction(model: Dynamics, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """The part of friction that changes sign with the velocity, (..., n) [N·m]: it dissipates; the rest is an offset."""
    ahead, back = model.friction(position, velocity), model.friction(position, -np.asarray(velocity))
    return 0.5 * (ahead - back)


def kinetic_energy(model: Dynamics, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """½ q̇ᵀ M q̇ [J], (...)."""
    return 0.5 * np.einsum("...i,...ij,...j->...", velocity, model.mass_matrix(position), velocity)


def potential_energy(
    model: Dynamics, position: np.ndarray, reference: np.ndarray | None = None
) -> np.ndarray:
    """Work against gravity from a reference pose along a straight line in joint space [J], (...).

    Exact in so far as gravity has a potential, see `Consistency.gravity_curl`.

    Args:
        reference: where the energy is zero, (n,); None is all angles zero.
    """
    position = np.asarray(position, float)
    start = np.zeros(position.shape[-1]) if reference is None else np.asarray(reference, float)
    path = position - start
    share = 0.5 * (_NODES + 1.0)
    along = start + share.reshape(-1, *[1] * path.ndim) * path
    work = np.sum(model.gravity(along) * path, axis=-1)
    return np.asarray(np.tensordot(0.5 * _WEIGHTS, work, axes=1))


def power_balance(
    model: Dynamics, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
) -> dict[str, np.ndarray]:
    """Where the power of the drives goes [W], (...): kinetic energy, potential energy, friction; and the remainder.

    `left` is zero for a machine: q̇ᵀu = d/dt (½ q̇ᵀM q̇) + q̇ᵀg + q̇ᵀ friction needs q̇ᵀ(Ṁ − 2C)q̇ = 0.
    """
    each = parts(model, position, velocity, acceleration)
    rate = np.einsum("...ijk,...k->...ij", mass_matrix_derivative(model, position), velocity)
    inertial, drive, potential, friction = (
        np.sum(velocity * part, axis=-1) for part in (each.inertial, each.effort, each.gravity, each.friction)
    )
    kinetic = inertial + 0.5 * np.einsum("...i,...ij,...j->...", velocity, rate, velocity)
    left = drive - kinetic - potential - friction
    return {"drive": drive, "kinetic": kinetic, "potential": potential, "friction": friction, "left": left}


def consistency(
    model: Dynamics,
    lower: np.ndarray,
    upper: np.ndarray,
    velocity: np.ndarray,
    *,
    poses: int = POSES,
) -> Consistency:
    """Whether a model behaves like a machine within a range of motion.

    Args:
        lower, upper: of the position, (n,) [rad].
        velocity: largest of each joint, (n,) [rad/s].
        poses: number of random motions.
    """
    rng = np.random.default_rng(0)
    q = rng.uniform(lower, upper, (poses, len(lower)))
    v = rng.uniform(-1.0, 1.0, q.shape) * velocity
    mass = model.mass_matrix(q)
    eigenvalues = np.linalg.eigvalsh(mass)
    rate = np.einsum("...ijk,...k->...ij", mass_matrix_derivative(model, q), v)
    skew = rate - 2.0 * coriolis_matrix(model, q, v)
    slope = _gravity_slope(model, q)
    power = np.sum(v * odd_friction(model, q, v), axis=-1)
    taken = float(np.mean(np.maximum(power, 0.0)))
    return Consistency(
        smallest_eigenvalue=float(eigenvalues[:, 0].min()),
        condition=float(np.max(eigenvalues[:, -1] / np.maximum(eigenvalues[:, 0], 1e-300))),
        asymmetry=_relative(mass - np.swapaxes(mass, -1, -2), mass),
        skewness=_relative(skew + np.swapaxes(skew, -1, -2), rate),
        gravity_curl=_relative(slope - np.swapaxes(slope, -1, -2), slope),
        passive=float(np.mean(power >= 0.0)),
        created_power=max(float(-power.min()), 0.0) / max(taken, 1e-12),
    )


def _gravity_slope(model: Dynamics, position: np.ndarray) -> np.ndarray:
    """∂g/∂q by central differences, (B, n, n)."""
    columns = []
    for k in range(position.shape[1]):
        change = np.zeros(position.shape[1])
        change[k] = DIFFERENCE
        columns.append(
            (model.gravity(position + change) - model.gravity(position - change)) / (2.0 * DIFFERENCE)
        )
    return np.stack(columns, axis=-1)


def _relative(difference: np.ndarray, whole: np.ndarray) -> float:
    return float(np.linalg.norm(difference) / max(float(np.linalg.norm(whole)), 1e-300))
