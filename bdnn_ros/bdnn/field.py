"""The seed form f(x, u) = [q̇, H(q) (u − R(q, q̇))] with H and R networks, and its derivatives by hand.

H(q) = F P(h(q)) F and R(q, q̇) = U r(q, q̇), with networks h and r of one hidden layer and diagonal scales
F = √(acceleration / effort) and U = effort, so that weights of size one suit any robot. Equation numbers are
those of the paper's appendix A. A state is x = [q, q̇], (B, 2n); everything is batched over B.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bdnn_ros.bdnn.networks import (
    Deltas,
    Network,
    Pass,
    spd_apply,
    spd_derivative,
    spd_factor,
    spd_matrix,
    spd_pull,
    spd_shift,
    vector_size,
)


@dataclass(frozen=True)
class Scales:
    """Typical sizes of what a robot does; each (n,).

    Attributes:
        velocity: [rad/s].
        acceleration: [rad/s²].
        effort: [N·m].
        slow: speed below which dry friction changes over, [rad/s].
    """

    velocity: np.ndarray
    acceleration: np.ndarray
    effort: np.ndarray
    slow: np.ndarray

    def astype(self, dtype: Any) -> Scales:
        """The same scales in another precision."""
        return Scales(*(np.asarray(getattr(self, f), dtype) for f in self.__dataclass_fields__))


@dataclass(frozen=True)
class FieldPass:
    """Intermediate results of an evaluation of f, for its derivatives.

    Attributes:
        state: x, (B, 2n).
        h, r: passes of the two networks.
        factor, shift: of P.
        drive, inner: F (u − R) and Lᵀ of it, (B, n) each.
        acceleration: q̈, (B, n).
    """

    state: np.ndarray
    h: Pass
    r: Pass
    factor: np.ndarray
    shift: np.ndarray
    drive: np.ndarray
    inner: np.ndarray
    acceleration: np.ndarray


@dataclass(frozen=True)
class EffortPass:
    """Intermediate results of an evaluation of the inverse dynamics, for its derivative.

    Attributes:
        h, r: passes of the two networks.
        factor: of P.
        inverse: P⁻¹, (B, n, n).
        inertial: P⁻¹ F⁻¹ q̈, (B, n).
        effort: u, (B, n) [N·m].
    """

    h: Pass
    r: Pass
    factor: np.ndarray
    inverse: np.ndarray
    inertial: np.ndarray
    effort: np.ndarray


@dataclass(frozen=True)
class FieldDeltas:
    """δ of both networks, linear in the adjoint they are for."""

    h: Deltas
    r: Deltas

    def __add__(self, other: FieldDeltas) -> FieldDeltas:
        return FieldDeltas(self.h + other.h, self.r + other.r)

    def __rmul__(self, factor: float) -> FieldDeltas:
        return FieldDeltas(factor * self.h, factor * self.r)


@dataclass(frozen=True)
class Field:
    """f(x, u) by networks h and r.

    Attributes:
        h: [sin q, cos q] -> vector of P.
        r: [sin q, cos q, q̇ / velocity, tanh(q̇ / slow)] -> R / effort.
        scales: typical sizes.
    """

    h: Network
    r: Network
    scales: Scales

    @classmethod
    def random(cls, scales: Scales, hidden: int, rng: np.random.Generator, activation: str = "tanh") -> Field:
        """Untrained networks with `hidden` units each; H starts at the diagonal of the scales."""
        n = len(scales.effort)
        h = Network.random(2 * n, hidden, vector_size(n), rng, activation)
        return cls(h, Network.random(4 * n, hidden, n, rng, activation), scales)

    @property
    def width(self) -> int:
        """Number of joints n."""
        return len(self.scales.effort)

    @property
    def gain(self) -> np.ndarray:
        """F, the diagonal that scales H, (n,)."""
        return np.sqrt(self.scales.acceleration / self.scales.effort)

    def vector(self) -> np.ndarray:
        """All weights, θ then ε, in one new vector."""
        return np.concatenate([self.h.vector(), self.r.vector()])

    @property
    def arrays(self) -> tuple[np.ndarray, ...]:
        """The weights of h, then of r."""
        return self.h.arrays + self.r.arrays

    def with_vector(self, vector: np.ndarray) -> Field:
        """The field whose weights are views of a vector."""
        edge = self.h.vector().size
        return replace(self, h=self.h.with_vector(vector[:edge]), r=self.r.with_vector(vector[edge:]))

    def astype(self, dtype: Any) -> Field:
        """The same field in another precision."""
        return Field(self.h.astype(dtype), self.r.astype(dtype), self.scales.astype(dtype))

    # -- evaluation ------------------------------------------------------------------------------------------

    def bias_inputs(self, state: np.ndarray, direction: np.ndarray | None = None) -> np.ndarray:
        """Inputs of r, (B, 4n); the first 2n are those of h.

        Args:
            direction: of the motion, as soft as the effort it goes with, (B, n); None is tanh(q̇ / slow).
        """
        n = self.width
        q, v = state[:, :n], state[:, n:]
        direction = np.tanh(v / self.scales.slow) if direction is None else direction
        return np.concatenate([np.sin(q), np.cos(q), v / self.scales.velocity, direction], axis=1)

    def acceleration(self, state: np.ndarray, effort: np.ndarray) -> FieldPass:
        """q̈ = H (u − R), equation (2), with all that its derivatives need; effort (B, n) [N·m]."""
        x = self.bias_inputs(state)
        h, r = self.h.run(x[:, : 2 * self.width]), self.r.run(x)
        factor = spd_factor(h.output, self.width)
        shift = spd_shift(factor)
        drive = self.gain * (effort - self.scales.effort * r.output)
        product, inner = spd_apply(factor, shift, drive)
        return FieldPass(state, h, r, factor, shift, drive, inner, self.gain * product)

    def effort(
        self, state: np.ndarray, acceleration: np.ndarray, direction: np.ndarray | None = None
    ) -> EffortPass:
        """u = H⁻¹ q̈ + R, (B, n) [N·m]: the other direction of the same networks."""
        x = self.bias_inputs(state, direction)
        h, r = self.h.run(x[:, : 2 * self.width]), self.r.run(x)
        factor = spd_factor(h.output, self.width)
        inverse = np.linalg.inv(spd_matrix(factor))
        inertial = (inverse @ (acceleration / self.gain)[..., None])[..., 0]
        return EffortPass(
            h, r, factor, inverse, inertial, inertial / self.gain + self.scales.effort * r.output
        )

    def effort_gradient(self, done: EffortPass, cotangent: np.ndarray) -> list[np.ndarray]:
        """Gradient by all weights for a cotangent of u (B, n), as `arrays`.

        With y = P⁻¹ F⁻¹ q̈ it is dy = −P⁻¹ dP y: the cotangent of P is −(P⁻¹ F⁻¹ ū) yᵀ.
        """
        left = -(done.inverse @ (cotangent / self.gain)[..., None])[..., 0]
        turned = np.swapaxes(done.factor, -1, -2)
        inner = [(turned @ side[..., None])[..., 0] for side in (left, done.inertial)]
        on_h = self.h.deltas(done.h, spd_pull(done.factor, left, inner[0], done.inertial, inner[1]))
        on_r = self.r.deltas(done.r, cotangent * self.scales.effort)
        return self.h.weight_gradient(done.h, on_h) + self.r.weight_gradient(done.r, on_r)

    def bias(self, state: np.ndarray) -> np.ndarray:
        """R(q, q̇), (B, n) [N·m]."""
        return self.scales.effort * self.r.run(self.bias_inputs(state)).output

    def inverse_inertia(self, position: np.ndarray) -> np.ndarray:
        """H(q), (B, n, n) [1/(kg·m²)]."""
        x = np.concatenate([np.sin(position), np.cos(position)], axis=1)
        return np.outer(self.gain, self.gain) * spd_matrix(spd_factor(self.h.run(x).output, self.width))

    def inverse_inertia_derivative(self, position: np.ndarray) -> np.ndarray:
        """∂H/∂q_k at [..., k], (B, n, n, n)."""
        n = self.width
        sine, cosine = np.sin(position), np.cos(position)
        done = self.h.run(np.concatenate([sine, cosine], axis=1))
        jacobian = self.h.input_jacobian(done)
        slope = jacobian[:, :, :n] * cosine[:, None, :] - jacobian[:, :, n:] * sine[:, None, :]
        factor = spd_factor(done.output, n)
        steps = [spd_derivative(factor, slope[:, :, k]) for k in range(n)]
        return np.outer(self.gain, self.gain)[:, :, None] * np.stack(steps, axis=-1)

    # -- derivatives -----------------------------------------------------------------------------------------

    def pull(self, done: FieldPass, adjoint: np.ndarray) -> tuple[np.ndarray, FieldDeltas]:
        """αᵀ ∂f/∂x, (B, 2n), and the networks' δ, for adjoints α (B, 2n): equation (11).

        The velocity half α_s meets [∂H/∂q (u − R)  0] − H ∂R/∂x, the position half meets q̇. The cotangents of
        the networks' outputs are P⁻¹(α_s (u − R)ᵀ) as in (12) and −H α_s as in (14).
        """
        n, x = self.width, done.r.inputs
        scaled = self.gain * adjoint[:, n:]
        on_drive, inner = spd_apply(done.factor, done.shift, scaled)
        on_h = self.h.deltas(done.h, spd_pull(done.factor, scaled, inner, done.drive, done.inner))
        on_r = self.r.deltas(done.r, on_drive * -(self.scales.effort * self.gain))
        from_r = self.r.pull_inputs(on_r)
        from_r[:, : 2 * n] += self.h.pull_inputs(on_h)
        result = np.empty_like(adjoint)
        result[:, :n] = from_r[:, :n] * x[:, n : 2 * n] - from_r[:, n : 2 * n] * x[:, :n]
        rate = (1.0 - x[:, 3 * n :] ** 2) / self.scales.slow
        result[:, n:] = from_r[:, 2 * n : 3 * n] / self.scales.velocity + from_r[:, 3 * n :] * rate
        result[:, n:] += adjoint[:, :n]
        return result, FieldDeltas(on_h, on_r)

    def weight_gradient(self, done: FieldPass, deltas: FieldDeltas) -> list[np.ndarray]:
        """αᵀ ∂f/∂w summed over the batch, θ then ε: equations (12) to (15); as `arrays`."""
        return self.h.weight_gradient(done.h, deltas.h) + self.r.weight_gradient(done.r, deltas.r)
