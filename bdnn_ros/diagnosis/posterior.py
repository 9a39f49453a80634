"""Parameters of the chosen effects with their uncertainty, shapes included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.equations import Term
from bdnn_ros.diagnosis.evidence import Fit, Pool
from bdnn_ros.diagnosis.result import Quantity

RELATIVE_STEP = 1e-3


@dataclass(frozen=True)
class Estimate:
    """A term with its coefficients and the covariance of coefficients and shape."""

    term: Term
    coefficients: np.ndarray
    covariance: np.ndarray

    @property
    def values(self) -> dict[str, float]:
        """Parameters of the contract."""
        return self.term.effect.values(self.coefficients, dict(self.term.shape))

    def quantities(self) -> dict[str, Quantity]:
        """Parameters with standard deviations, by linear propagation."""
        names = [name for name, _ in self.term.shape]
        shape = np.array([value for _, value in self.term.shape])
        point = np.concatenate([self.coefficients, shape])
        count = len(self.coefficients)

        def values(x: np.ndarray) -> np.ndarray:
            found = self.term.effect.values(x[:count], dict(zip(names, x[count:].tolist(), strict=True)))
            return np.array([found[p.name] for p in self.term.effect.parameters])

        centre = values(point)
        jacobian = np.empty((len(centre), len(point)))
        for i in range(len(point)):
            step = RELATIVE_STEP * max(abs(point[i]), np.sqrt(self.covariance[i, i]), 1e-9)
            moved = point.copy()
            moved[i] += step
            jacobian[:, i] = (values(moved) - centre) / step
        std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian), 0.0))
        return {
            p.name: Quantity(float(v), float(s), p.unit)
            for p, v, s in zip(self.term.effect.parameters, centre, std, strict=True)
        }


def estimates(pool: Pool, fit: Fit) -> list[Estimate]:
    """Every chosen term with the joint uncertainty of coefficients and shapes.

    The effort is linearised in the shape parameters at the fit: their columns join the regression, so that a coefficient's
    spread includes what is not known of its shape.
    """
    equations = pool.equations
    parts, tangents, spans = [], [], []
    at = pool.base + sum(len(pool.slots[c]) for c in fit.terms)
    for chosen in fit.terms:
        term = pool.terms[chosen]
        coefficients, _ = pool.part(fit, chosen)
        columns = [_tangent(pool, term, coefficients, name) for name, _ in term.shape]
        parts.append((term, chosen, coefficients))
        tangents += columns
        spans.append(np.arange(at, at + len(columns)))
        at += len(columns)
    index = pool.columns_of(fit.terms)
    white = pool.white[:, :, index]
    precision = pool.precision[index]
    if tangents:
        extra = np.stack(tangents, axis=2)
        white = np.concatenate([white, equations.whiten(extra, pool.noise)], axis=2)
        ranges = [abs(value) + 1e-6 for c in fit.terms for _, value in pool.terms[c].shape]
        precision = np.concatenate([precision, 1.0 / np.array(ranges) ** 2])
    tall = white.reshape(-1, white.shape[2])
    covariance = np.linalg.inv(tall.T @ tall + np.diag(precision))
    result, start = [], pool.base
    for (term, chosen, coefficients), span in zip(parts, spans, strict=True):
        rows = np.concatenate([np.arange(start, start + len(pool.slots[chosen])), span]).astype(int)
        result.append(Estimate(term, coefficients, covariance[np.ix_(rows, rows)]))
        start += len(pool.slots[chosen])
    return result


def _tangent(pool: Pool, term: Term, coefficients: np.ndarray, name: str) -> np.ndarray:
    """Change of the effort per unit of one shape parameter, rows (R, n)."""
    shape = dict(term.shape)
    step = 1e-2 * max(abs(shape[name]), 1e-3)
    motion = pool.equations.motion

    def effort(side: float) -> np.ndarray:
        moved = {**shape, name: shape[name] + side * step}
        return term.effect.columns(motion, term.target, moved, term.link) @ coefficients

    return pool.equations.reduced((effort(1.0) - effort(-1.0)) / (2.0 * step))
