"""Parameters of the chosen effects with their uncertainty, that of shapes included."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bdnn_ros.diagnosis.judging.widening import mirrored, widened
from bdnn_ros.diagnosis.pushes.contact import distance
from bdnn_ros.diagnosis.pushes.pushes import edges, unseen
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.odds import COST
from bdnn_ros.diagnosis.regression.term import COMMON, Term
from bdnn_ros.diagnosis.result import Quantity
from bdnn_ros.diagnosis.search.candidates import acting_per_measured
from bdnn_ros.diagnosis.search.leads import lead_and_delays
from bdnn_ros.effects.base import SHOWN
from bdnn_ros.effects.environment import EDGES, POINT

RELATIVE_STEP = 1e-3
GIVEN = 1e-9
"""Standard deviation of a shape parameter that is given, such as a link's mass by the description."""
ABOUT = 0.1
"""Prior spread of a push's point along what the motion does not show [m]."""
CLEAR = 3.0
"""Distance from zero that a name needs, in standard deviations: true causes lie beyond, mistaken ones often do not."""
PAID = math.sqrt(2.0 * COST)
"""The same for kinds neither common nor of bodies: half its square is the prior cost, to be paid in these rows, too."""
MORE = 0.01
"""Least excess of a law over the one it settles into, relative to its coefficients; with less it is that one."""
LINK_SPREAD_FACTOR = 2.0
"""Factor on the links' prior spread under which a body's mass must still be significant."""


@dataclass(frozen=True)
class Estimate:
    """A term with its coefficients and three covariances of coefficients and shape.

    Attributes:
        covariance: by the noise model.
        robust: by the scatter of blocks of time (sandwich, clustered by block; White, Econometrica 48(4), 1980).
        doubting: by the noise model, for a body with the links' prior spread doubled, since that was estimated from the same
            motion. For other terms the same as `covariance`.
        acting: effort that acts per coefficient; see `acting_per_measured`.
        mirrored: variance of each coefficient by its mirror image, (k,), see `widening.mirrored`; None for none.
        largest_effort: the largest effort measured at its joint [N·m].
    """

    term: Term
    coefficients: np.ndarray
    covariance: np.ndarray
    robust: np.ndarray
    doubting: np.ndarray
    acting: float = 1.0
    mirrored: np.ndarray | None = None
    largest_effort: float = math.inf

    @property
    def values(self) -> dict[str, float]:
        """Parameters as in the contract."""
        return self.term.effect.values(self.acting * self.coefficients, dict(self.term.shape))

    @property
    def there(self) -> bool:
        """Whether the effect surely exists: physically possible, significant, and more than what it settles into."""
        return self.possible and self.clear and self.more

    @property
    def shown(self) -> bool:
        """Whether it is known well enough for a name: that it exists, and its parameters."""
        stds = zip(self.term.effect.parameters, self._stds(self.covariance, self.robust), strict=True)
        known = {p.name: float(std) for p, std in stds}
        return self.there and self.term.effect.shown(self.values, known, self.acting * self.largest_effort)

    @property
    def more(self) -> bool:
        """Whether its excess over the law that it settles into is more than negligible."""
        weights = self.term.effect.excess
        return weights is None or abs(float(weights @ self.coefficients)) > MORE * float(
            np.abs(self.coefficients).max()
        )

    @property
    def possible(self) -> bool:
        """Whether such an effect is physically possible within the uncertainty of its coefficients."""
        return self.term.effect.believable(self.coefficients, np.sqrt(np.diag(self.covariance)))

    @property
    def clear(self) -> bool:
        """Whether its coefficients together differ significantly from zero by every covariance.

        With the links' errors doubled `SHOWN` is enough: a link off by `CLEAR` of those could never be named otherwise.
        """
        effect = self.term.effect
        known = min(self._distance(self.covariance), self._distance(self.robust))
        enough = CLEAR if effect.on_body or effect.name in COMMON else PAID
        return known > enough and self._distance(self.doubting) > SHOWN

    def _distance(self, covariance: np.ndarray) -> float:
        """Mahalanobis distance of the coefficients from zero."""
        rows = slice(len(self.coefficients))
        squared = self.coefficients @ np.linalg.pinv(covariance[rows, rows]) @ self.coefficients
        return math.sqrt(max(squared, 0.0))

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """Parameters with standard deviations by linear propagation, each the largest over all covariances."""
        known = (self.covariance, self.robust, self.doubting)
        if self.mirrored is not None:
            sides = np.diag(np.pad(self.mirrored, (0, len(self.covariance) - len(self.mirrored))))
            known = (self.covariance + sides, self.robust + sides, self.doubting + sides)
        values, stds = self.values, self._stds(*known)
        kept = self.term.effect.kept or {}
        return {
            p.name: Quantity(values[p.name], 0.0 if p.name in kept else float(std), p.unit)
            for p, std in zip(self.term.effect.parameters, stds, strict=True)
        }

    def _stds(self, *covariances: np.ndarray) -> np.ndarray:
        """Standard deviations of the parameters, each the largest over some covariances of coefficients and shape."""
        names = [name for name, _ in self.term.shape]
        shape = np.array([value for _, value in self.term.shape])
        possible, _ = self.term.effect.coefficients(self.values)
        point = np.concatenate([possible, shape])
        count = len(possible)

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
        linear = np.arange(len(point)) < count
        inexact = linear | np.array(
            [False] * count + [name in self.term.effect.idealised_shapes for name in names]
        )
        ideal = np.diag((self.term.effect.idealised * np.where(inexact, point, 0.0)) ** 2)
        acting = np.where(linear, self.acting, 1.0)
        variances = [
            np.einsum("ij,jk,ik->i", jacobian, np.outer(acting, acting) * one + ideal, jacobian)
            for one in covariances
        ]
        return np.asarray(np.sqrt(np.maximum(np.max(variances, axis=0), 0.0)))


def estimates(pool: Pool, fit: Fit) -> list[Estimate]:
    """Every chosen term with the joint uncertainty of coefficients and shapes.

    The effort is linearised in the shape parameters at the fit and their columns join the regression, so that a coefficient's
    spread includes the uncertainty of its shape.
    """
    white, precision, spans = _linearised(pool, fit)
    tall = white.reshape(-1, white.shape[2])
    gram = tall.T @ tall
    covariance = np.linalg.inv(gram + np.diag(precision))
    robust = _clustered(pool, fit, white, covariance)
    precision[: pool.base] = pool.with_link_error(LINK_SPREAD_FACTOR * pool.link_error).precision[: pool.base]
    doubting = np.linalg.inv(gram + np.diag(precision))
    _, moved = lead_and_delays(pool, fit)
    result, start = [], pool.base
    for chosen, span in zip(fit.terms, spans, strict=True):
        term, coefficients = pool.terms[chosen], pool.coefficients(fit, chosen)
        rows = np.concatenate([np.arange(start, start + len(pool.slots[chosen])), span]).astype(int)
        start += len(pool.slots[chosen])
        pick = np.eye(len(covariance))[rows]
        if chosen in moved:
            coefficients = coefficients + moved[chosen]
            pick[0, pool.equations.rigid.shape[2]] = 1.0
        beyond = widened(pool, chosen, coefficients, len(span))
        third = doubting if term.effect.on_body else covariance
        own, scattered, doubted = (pick @ one @ pick.T + beyond for one in (covariance, robust, third))
        result.append(
            Estimate(
                term,
                coefficients,
                own,
                scattered,
                doubted,
                acting_per_measured(pool, fit, chosen),
                mirrored(pool, fit, term, coefficients),
                _most(pool, term),
            )
        )
    return result


def _most(pool: Pool, term: Term) -> float:
    """Largest effort measured at a term's joint [N·m]; infinite without one."""
    effort = pool.equations.motion.signals.effort
    return math.inf if effort is None or term.target < 0 else float(np.abs(effort[:, term.target]).max())


def _linearised(pool: Pool, fit: Fit) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Whitened columns of all unknowns (R, n, P), shapes last; their prior precisions (P,); and each term's shape columns."""
    tangents, spans = list[np.ndarray](), []
    at = pool.base + sum(len(pool.slots[c]) for c in fit.terms)
    for chosen in fit.terms:
        term, coefficients = pool.terms[chosen], pool.coefficients(fit, chosen)
        columns = [_tangent(pool, term, coefficients, name) for name, _ in term.shape]
        tangents += columns
        spans.append(np.arange(at, at + len(columns)))
        at += len(columns)
    index = pool.columns_of(fit.terms)
    white = pool.white[:, :, index]
    # an incidental coefficient keeps its usual prior here, even if the likeliest kind sets it to zero
    precision = np.minimum(fit.precision, pool.precision[index])
    if tangents:
        extra = np.stack(tangents, axis=2)
        white = np.concatenate([white, pool.equations.whitening.of(extra, pool.noise)], axis=2)
        ranges = [span for c in fit.terms for span in _ranges(pool, pool.terms[c])]
        precision = np.concatenate([precision, 1.0 / np.array(ranges) ** 2])
    return white, precision, spans


def excesses(pool: Pool) -> list[float]:
    """Standard deviations by which each law of a pool exceeds the one it settles into; infinite without such.

    The smaller number by noise model and scatter of blocks. Shapes are held fixed: they mean nothing at zero excess.
    """
    fit = pool.whole
    if all(term.effect.excess is None for term in pool.terms):
        return [math.inf] * len(pool.terms)
    index = pool.columns_of(fit.terms)
    white = pool.white[:, :, index]
    tall = white.reshape(-1, white.shape[2])
    covariance = np.linalg.inv(tall.T @ tall + np.diag(pool.precision[index]))
    robust = _clustered(pool, fit, white, covariance)
    result, start = [], pool.base
    for chosen in fit.terms:
        rows = slice(start, start + len(pool.slots[chosen]))
        start, weights = rows.stop, pool.terms[chosen].effect.excess
        if weights is None:
            result.append(math.inf)
            continue
        beyond = float(np.dot(weights, pool.coefficients(fit, chosen)))
        variance = max(float(weights @ one[rows, rows] @ weights) for one in (covariance, robust))
        result.append(abs(beyond) / math.sqrt(variance))
    return result


def _ranges(pool: Pool, term: Term) -> list[float]:
    """Prior spread of each shape parameter; given ones are known.

    Times of a push: as long as no row is usable there, or else about its own length.
    """
    free = term.effect.shape_bounds if term.effect.kept is None else {}
    usual = {name: abs(value) + 1e-6 for name, value in term.shape}
    if term.effect.timed:
        start, end = edges(term)
        usual |= {name: gap or end - start for name, gap in unseen(pool, term).items()}
        if distance(term, pool.equations.motion.robot) > 0.0:
            usual |= dict.fromkeys(POINT, ABOUT)
    return [usual[name] if name in free else GIVEN for name, _ in term.shape]


def _clustered(pool: Pool, fit: Fit, white: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance of all unknowns (P, P) by the scatter of the blocks' gradients; whitened columns are (R, n, P)."""
    pulls = np.einsum("rjp,rj->rp", white, pool.white_residual(fit))
    block, blocks = pool.equations.rows.block, pool.equations.rows.blocks
    by_block = np.zeros((blocks, pulls.shape[1]))
    np.add.at(by_block, block, pulls)
    by_block -= by_block.mean(axis=0)
    moved = by_block @ covariance
    return np.asarray(moved.T @ moved * blocks / max(blocks - 1, 1))


def _tangent(pool: Pool, term: Term, coefficients: np.ndarray, name: str) -> np.ndarray:
    """Derivative of the effort with respect to one shape parameter, rows (R, n)."""
    shape = dict(term.shape)
    motion = pool.equations.motion
    timed = term.effect.timed and name in EDGES
    step = 1.0 / motion.signals.rate if timed else 1e-2 * max(abs(shape[name]), 1e-3)

    def effort(side: float) -> np.ndarray:
        moved = {**shape, name: shape[name] + side * step}
        return term.effect.columns(motion, term.target, moved, term.link) @ coefficients

    change = (effort(1.0) - effort(-1.0)) / (2.0 * step)
    return pool.equations.decimation.as_rows(change, borne=not term.effect.at_sensor)
