"""The networks of a BDNN, and the map P from a vector to a symmetric positive-definite matrix.

Plain NumPy: every derivative is written by hand, as in appendix A of the paper (Li, Zhao, Lan et al.,
"Bidirectional dynamic neural networks with physical analyzability", Nonlinear Dynamics 111, 2023). Arrays
keep their precision: float32 in, float32 out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from bdnn_ros.errors import UsageError, listed

SPD_FLOOR = 1e-5
"""Least eigenvalue of P(v), relative to 1 + |L|²: far enough above float32's rounding to survive it."""
OUTPUT_BOUND = 100.0
"""Outputs bend at this size, so that no weights can overflow P."""


def _tanh(z: np.ndarray) -> np.ndarray:
    return np.asarray(np.tanh(z, out=z))


def _tanh_slope(value: np.ndarray) -> np.ndarray:
    slope = value * value
    return np.asarray(np.subtract(1.0, slope, out=slope))


def _sigmoid(z: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * np.tanh(0.5 * z)


def _softplus(z: np.ndarray) -> np.ndarray:
    return np.logaddexp(z, np.zeros((), z.dtype))


ACTIVATIONS: dict[str, tuple[Callable[[np.ndarray], np.ndarray], Callable[[np.ndarray], np.ndarray]]] = {
    "tanh": (_tanh, _tanh_slope),
    "sigmoid": (_sigmoid, lambda value: value * (1.0 - value)),
    "softplus": (_softplus, lambda value: -np.expm1(-value)),
}
"""Each gives φ(z), which may take the place of z, and φ' from the value of φ."""


@dataclass(frozen=True)
class Pass:
    """Intermediate results of a network's forward pass, for its derivatives; names as in the paper.

    Attributes:
        inputs: o⁽¹⁾, (B, in).
        hidden: o⁽²⁾ = φ(i⁽¹⁾), (B, hidden).
        output: y, (B, out).
    """

    inputs: np.ndarray
    hidden: np.ndarray
    output: np.ndarray


@dataclass(frozen=True)
class Deltas:
    """δ of one network for a cotangent of its outputs; linear in that cotangent.

    Attributes:
        hidden: δ⁽¹⁾, (B, hidden).
        output: δ⁽²⁾, (B, out).
    """

    hidden: np.ndarray
    output: np.ndarray

    def __add__(self, other: Deltas) -> Deltas:
        return Deltas(self.hidden + other.hidden, self.output + other.output)

    def __rmul__(self, factor: float) -> Deltas:
        return Deltas(factor * self.hidden, factor * self.output)


@dataclass(frozen=True)
class Network:
    """One hidden layer: y = ψ(W₂ φ(W₁ x + b₁) + b₂), with ψ(z) = bound · tanh(z / bound).

    Attributes:
        hidden_weights, hidden_bias: W₁ (hidden, in), b₁ (hidden,).
        output_weights, output_bias: W₂ (out, hidden), b₂ (out,).
        activation: φ, one of `ACTIVATIONS`.
        bound: where outputs bend.
    """

    hidden_weights: np.ndarray
    hidden_bias: np.ndarray
    output_weights: np.ndarray
    output_bias: np.ndarray
    activation: str = "tanh"
    bound: float = OUTPUT_BOUND

    @classmethod
    def random(
        cls, inputs: int, hidden: int, outputs: int, rng: np.random.Generator, activation: str = "tanh"
    ) -> Network:
        """A network to start training from: inputs of size one excite the hidden layer, outputs are small.

        Raises:
            UsageError: the activation is not known.
        """
        if activation not in ACTIVATIONS:
            raise UsageError(f"No activation {activation!r}.", f"There are {listed(ACTIVATIONS)}.")
        return cls(
            rng.normal(size=(hidden, inputs)) / np.sqrt(inputs),
            rng.uniform(-1.0, 1.0, hidden),
            0.1 * rng.normal(size=(outputs, hidden)) / np.sqrt(hidden),
            np.zeros(outputs),
            activation,
        )

    def run(self, x: np.ndarray) -> Pass:
        """Forward pass for inputs (B, in)."""
        hidden = x @ self.hidden_weights.T
        hidden += self.hidden_bias
        hidden = ACTIVATIONS[self.activation][0](hidden)
        output = hidden @ self.output_weights.T
        output += self.output_bias
        output /= self.bound
        return Pass(x, hidden, self.bound * np.tanh(output, out=output))

    def deltas(self, done: Pass, cotangent: np.ndarray) -> Deltas:
        """δ⁽²⁾ = cotangent ⊙ ψ' and δ⁽¹⁾ = W₂ᵀ δ⁽²⁾ ⊙ φ', for a cotangent of the outputs (B, out)."""
        output = cotangent * self._output_slope(done)
        hidden = output @ self.output_weights
        hidden *= self._hidden_slope(done)
        return Deltas(hidden, output)

    def pull_inputs(self, deltas: Deltas) -> np.ndarray:
        """Cotangent of the inputs, (B, in)."""
        return deltas.hidden @ self.hidden_weights

    def weight_gradient(self, done: Pass, deltas: Deltas) -> list[np.ndarray]:
        """δ⁽¹⁾ o⁽¹⁾ᵀ and δ⁽²⁾ o⁽²⁾ᵀ summed over the batch, as `arrays`: (12) and (13), or (14) and (15)."""
        out, hidden = deltas.output, deltas.hidden
        ones = np.ones(len(out), out.dtype)
        return [hidden.T @ done.inputs, ones @ hidden, out.T @ done.hidden, ones @ out]

    def input_jacobian(self, done: Pass) -> np.ndarray:
        """∂y/∂x, (B, out, in)."""
        hidden = self.output_weights * self._hidden_slope(done)[:, None, :]
        return self._output_slope(done)[:, :, None] * (hidden @ self.hidden_weights)

    def _hidden_slope(self, done: Pass) -> np.ndarray:
        return ACTIVATIONS[self.activation][1](done.hidden)

    def _output_slope(self, done: Pass) -> np.ndarray:
        bent = done.output / self.bound
        return 1.0 - bent * bent

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """The weights: W₁, b₁, W₂, b₂."""
        return self.hidden_weights, self.hidden_bias, self.output_weights, self.output_bias

    def vector(self) -> np.ndarray:
        """All weights in one new vector."""
        return np.concatenate([part.ravel() for part in self.arrays])

    def with_vector(self, vector: np.ndarray) -> Network:
        """The network whose weights are views of a vector: to change it in place changes the network."""
        parts: list[np.ndarray] = []
        start = 0
        for part in self.arrays:
            parts.append(vector[start : start + part.size].reshape(part.shape))
            start += part.size
        return Network(parts[0], parts[1], parts[2], parts[3], self.activation, self.bound)

    def astype(self, dtype: Any) -> Network:
        """The same network in another precision."""
        names = [f.name for f in fields(self)[:4]]
        return replace(self, **{name: getattr(self, name).astype(dtype) for name in names})


# -- P: vector -> symmetric positive-definite matrix ---------------------------------------------------------


def vector_size(n: int) -> int:
    """Entries of the vector that P maps to an n × n matrix."""
    return n * (n + 1) // 2


@lru_cache(maxsize=32)
def lower_indices(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the lower triangle, in the order of P's vector."""
    return np.tril_indices(n)


@lru_cache(maxsize=32)
def _flat_lower(n: int) -> np.ndarray:
    rows, columns = lower_indices(n)
    return rows * n + columns


def spd_factor(vector: np.ndarray, n: int) -> np.ndarray:
    """L = 1 + tril(v), (B, n, n), of vectors (B, n(n+1)/2); v = 0 gives the unit matrix."""
    factor = np.zeros((*vector.shape[:-1], n, n), vector.dtype)
    rows, columns = lower_indices(n)
    factor[..., rows, columns] = vector
    factor[..., np.arange(n), np.arange(n)] += 1.0
    return factor


def spd_shift(factor: np.ndarray) -> np.ndarray:
    """What P adds to the diagonal of L Lᵀ, (B,)."""
    return factor.dtype.type(SPD_FLOOR) * (1.0 + np.einsum("...ij,...ij->...", factor, factor))


def spd_matrix(factor: np.ndarray) -> np.ndarray:
    """P = L Lᵀ + ε (1 + |L|²) 1, (B, n, n): positive-definite whatever L is, in float32 too."""
    unit = np.eye(factor.shape[-1], dtype=factor.dtype)
    return factor @ np.swapaxes(factor, -1, -2) + spd_shift(factor)[..., None, None] * unit


def spd_apply(factor: np.ndarray, shift: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """P y without forming P, and Lᵀ y on the way; (B, n) each."""
    inner = (y[..., None, :] @ factor)[..., 0, :]
    return (factor @ inner[..., None])[..., 0] + shift[..., None] * y, inner


def spd_pull(
    factor: np.ndarray, left: np.ndarray, left_inner: np.ndarray, right: np.ndarray, right_inner: np.ndarray
) -> np.ndarray:
    """P⁻¹ of the paper: the cotangent of v, (B, n(n+1)/2), for the cotangent left · rightᵀ of P.

    Args:
        left_inner, right_inner: Lᵀ left and Lᵀ right, (B, n), which `spd_apply` has at hand.
    """
    full = left[..., :, None] * right_inner[..., None, :]
    full += right[..., :, None] * left_inner[..., None, :]
    shift = 2.0 * factor.dtype.type(SPD_FLOOR) * np.einsum("...i,...i->...", left, right)
    full += shift[..., None, None] * factor
    return full.reshape(*full.shape[:-2], -1)[..., _flat_lower(factor.shape[-1])]


def spd_derivative(factor: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Change of P, (B, n, n), for a change of v, (B, n(n+1)/2)."""
    n = factor.shape[-1]
    step = spd_factor(change, n) - np.eye(n, dtype=factor.dtype)
    half = step @ np.swapaxes(factor, -1, -2)
    trace = 2.0 * factor.dtype.type(SPD_FLOOR) * np.einsum("...ij,...ij->...", step, factor)
    return half + np.swapaxes(half, -1, -2) + trace[..., None, None] * np.eye(n, dtype=factor.dtype)
