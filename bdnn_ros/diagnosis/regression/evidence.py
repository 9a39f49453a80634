"""Bayesian evidence of sets of effects, with the links' errors marginalised.

Inertial errors of the URDF are part of every fit under a Gaussian prior, so that a slightly wrong description is not named
friction, payload or armature.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from bdnn_ros.diagnosis.regression.bounded import (
    EXACT,
    by_block,
    explained,
    factored,
    gains_of,
    held,
    held_out_losses,
    mean_evidence,
    outside,
    pieces,
)
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.nuisances import BLURS
from bdnn_ros.diagnosis.regression.term import Term, kinds_of


class Pool:
    """Candidate terms with their Gram matrices at one noise model, by held-out block.

    Args:
        equations: the regression.
        noise: its noise model.
        terms: the candidates, each with a shape.
        link_error: prior standard deviation of the links' relative errors; see `Errors.spread`.
    """

    def __init__(self, equations: Equations, noise: Noise, terms: Sequence[Term], link_error: float) -> None:
        self.equations, self.noise, self.terms = equations, noise, list(terms)
        self.link_error = link_error
        columns = [equations.columns.of(term) for term in self.terms]
        nuisance = equations.nuisances.along(equations.motion)
        self.base = equations.rigid.shape[2] + nuisance.shape[2]
        sizes = [c.shape[2] for c in columns]
        starts = self.base + np.cumsum([0, *sizes])
        self.slots = [np.arange(a, b) for a, b in zip(starts[:-1], starts[1:], strict=True)]
        spread = [
            equations.errors.spread(link_error),
            equations.nuisances.spread(equations.rows.effort_scale),
        ]
        spread += [equations.spread(t, c) for t, c in zip(self.terms, columns, strict=True)]
        self.precision = 1.0 / np.concatenate(spread) ** 2
        free = np.tile([-np.inf, np.inf], (self.base, 1))
        self.lower, self.upper = np.vstack([free, *(t.effect.coefficient_bounds for t in self.terms)]).T
        self.kinds, self.kinds_of_each = kinds_of(self.terms, self.base)
        self.white = equations.whitening.of(
            np.concatenate([equations.rigid, nuisance, *columns], axis=2), noise
        )
        self.white_target = equations.whitening.of(equations.rows.target, noise)
        self.gram, self.moment, self.power = by_block(self.white, self.white_target, equations.rows.block)
        for term, slot in zip(self.terms, self.slots, strict=True):
            self.moment[:, slot] -= equations.noise_gain(term, len(slot))
        self._fits: dict[tuple[int, ...], Fit] = {}
        self._held_out: dict[tuple[int, ...], np.ndarray] = {}
        self._tall: tuple[tuple[object, ...], tuple[np.ndarray, np.ndarray]] | None = None
        self._scale = equations.whitening.log_scale(noise)

    def changed(self, **parts: object) -> Pool:
        """The pool with some of its parts changed, and nothing cached of the old ones."""
        other = copy(self)
        other.__dict__.update(parts, _fits={}, _held_out={}, _tall=None)
        other.__dict__.pop("total", None)
        return other

    def with_link_error(self, link_error: float) -> Pool:
        """The pool with another prior standard deviation of the links' errors."""
        spread = self.equations.errors.spread(link_error)
        precision = np.concatenate([spread**-2.0, self.precision[len(spread) :]])
        return self.changed(link_error=link_error, precision=precision)

    def still(self) -> Pool:
        """The pool whose fits are zero: as if the reference had predicted all that was measured."""
        return self.changed(moment=np.zeros_like(self.moment))

    def replacing(self, found: Mapping[int, Term], columns: np.ndarray | None = None) -> Pool:
        """The pool with new shapes of some terms; for a single term, optionally with given columns, rows (R, n, k)."""
        if not found:
            return self
        kept = {name: getattr(self, name).copy() for name in ("precision", "white", "gram", "moment")}
        other = self.changed(terms=list(self.terms), **kept)
        for one, term in found.items():
            made, own = self.equations.columns.of(term) if columns is None else columns, self.slots[one]
            other.terms[one] = term
            other.precision[own] = self.equations.spread(term, made) ** -2.0
            other.white[:, :, own] = self.equations.whitening.of(made, self.noise)
        slot = np.concatenate([self.slots[one] for one in found])
        for b, rows in enumerate(pieces(self.equations.rows.block)):
            new = other.white[rows][:, :, slot].reshape(-1, len(slot))
            cross = other.white[rows].reshape(-1, other.white.shape[2]).T @ new
            other.gram[b][:, slot], other.gram[b][slot] = cross, cross.T
            other.moment[b][slot] = new.T @ self.white_target[rows].ravel()
        for one, term in found.items():
            other.moment[:, self.slots[one]] -= self.equations.noise_gain(term, len(self.slots[one]))
        return other

    @cached_property
    def total(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Gram matrix, moments and power summed over all blocks."""
        return self.gram.sum(0), self.moment.sum(0), float(self.power.sum())

    @property
    def sure(self) -> np.ndarray:
        """Usable rows in which possible sticking adds less than the other noise, (R, n) bool."""
        return self.equations.usable & self.noise.sure(self.equations.rows.sticking_doubt)

    @property
    def whole(self) -> Fit:
        """Posterior of all terms of the pool together."""
        return self.fit(range(len(self.terms)))

    def residual_of_all(self) -> np.ndarray:
        """Residual of all terms, rows (R, n) [N·m]; the blurs, which only weigh down noise, are not subtracted."""
        return self.residual(self.whole, blur=False)

    def fit(self, chosen: Sequence[int]) -> Fit:
        """Posterior of a set of terms, with coefficients within their bounds."""
        key = tuple(chosen)
        if key not in self._fits:
            index = self.columns_of(key)
            kinds = self.kinds[:, index]
            kinds = kinds[:1] if (kinds == kinds[0]).all() else np.unique(kinds, axis=0)
            believed, ends = self.precision[index], (self.lower[index], self.upper[index])
            each = [self._fit(key, index, believed * kind, *ends) for kind in kinds]
            evidence = float(mean_evidence(np.array([fit.evidence for fit in each])))
            self._fits[key] = replace(max(each, key=lambda fit: fit.evidence), evidence=evidence)
        return self._fits[key]

    def without(self, fit: Fit, left_out: Collection[int]) -> Fit:
        """Posterior with some terms of a fit left out; only the bounds that are active in the fit stay enforced.

        Otherwise a remaining term that takes over for a missing one would stop at its bound (friction for a rotor, say), and a
        shape sought beside it would be wrong.
        """
        kept = tuple(c for c in fit.terms if c not in left_out)
        index = self.columns_of(kept)
        rows = np.isin(self.columns_of(fit.terms), index)
        best, low, high = fit.coefficients[rows], self.lower[index], self.upper[index]
        free = (best > low + EXACT) & (best < high - EXACT)
        low, high = np.where(free, -np.inf, low), np.where(free, np.inf, high)
        return self._fit(kept, index, fit.precision[rows], low, high)

    def _fit(
        self, chosen: tuple[int, ...], index: np.ndarray, precision: np.ndarray, *ends: np.ndarray
    ) -> Fit:
        gram, moment, power = self.total
        a = gram[np.ix_(index, index)] + np.diag(precision)
        factor = factored(a)
        best = cho_solve((factor, True), moment[index])
        if outside(best, *ends):
            best = held(factor, moment[index], *ends)
        loss = 0.5 * (power - 2.0 * best @ moment[index] + best @ a @ best)
        volume = 0.5 * np.sum(np.log(precision)) - np.sum(np.log(np.diag(factor)))
        return Fit(chosen, best, precision, factor, float(volume - loss - self._scale), float(loss))

    def evidence_bound(self, candidates: Sequence[int]) -> float:
        """Upper bound of the evidence of any subset of some terms, with these shapes: all at once, at no prior cost.

        Infinite where they are too collinear for that to be computed.
        """
        gram, moment, power = self.total
        index = self.columns_of(candidates)
        least = self.precision[index] * self.kinds[:, index].min(axis=0)
        return explained(gram[np.ix_(index, index)], moment[index], least, power) - self._scale

    def columns_of(self, chosen: Sequence[int]) -> np.ndarray:
        """Column indices of links, nuisances and some terms."""
        return np.concatenate([np.arange(self.base), *(self.slots[c] for c in chosen)]).astype(int)

    def gains(self, fit: Fit, candidates: Sequence[int]) -> np.ndarray:
        """Log evidence that each candidate would add to a fit by itself, (len(candidates),)."""
        gram, moment, _ = self.total
        index = self.columns_of(fit.terms)
        left = moment - gram[:, index] @ fit.coefficients
        wanted = np.concatenate([self.slots[c] for c in candidates])
        half = np.zeros((len(index), gram.shape[0]))
        half[:, wanted] = solve_triangular(fit.factor, gram[np.ix_(index, wanted)], lower=True)
        result = np.empty(len(candidates))
        sizes = [(len(self.slots[c]), self.kinds_of_each[c]) for c in candidates]
        for size, few in sorted(set(sizes)):
            same = [i for i, one in enumerate(sizes) if one == (size, few)]
            slots = np.array([self.slots[candidates[i]] for i in same])
            inner = gram[slots[:, :, None], slots[:, None, :]]
            seen = half[:, slots].transpose(1, 2, 0)
            schur = inner - seen @ seen.transpose(0, 2, 1)
            schur[:, np.arange(size), np.arange(size)] += self.precision[slots]
            ends, kinds = (self.lower[slots], self.upper[slots]), self.kinds[:few, slots[0]]
            result[same], _ = gains_of(schur, left[slots], self.precision[slots], *ends, kinds)
        return result

    def gain_of(self, fit: Fit, term: Term, columns: np.ndarray | None = None) -> tuple[float, np.ndarray]:
        """Log evidence that a term outside the pool would add to a fit, and its coefficients (k,).

        Args:
            columns: rows (R, n, k) in place of the term's own, unbounded if k differs; None makes its own, not cached.
        """
        columns = self.equations.columns.fresh(term) if columns is None else columns
        gains, best = self._each(fit, [term], columns[:, :, None])
        return float(gains[0]), best[0]

    def gains_of_shapes(self, fit: Fit, tried: Sequence[Term]) -> np.ndarray:
        """Log evidence that each of c shapes of a term outside the pool would add to a fit, (c,)."""
        return self._each(fit, tried, np.stack([self.equations.columns.of(one) for one in tried], axis=2))[0]

    def _each(self, fit: Fit, terms: Sequence[Term], columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """As `gain_of` for c terms of one effect with columns (R, n, c, k): log evidence (c,) and coefficients (c, k)."""
        bounds, kinds, size = np.array(terms[0].effect.coefficient_bounds), terms[0].kinds, columns.shape[3]
        if size != len(bounds):
            bounds, kinds = np.tile([-np.inf, np.inf], (size, 1)), kinds[:0]
        inner, left = self.beside(fit, columns)
        left -= np.array([self.equations.noise_gain(term, size).sum(axis=0) for term in terms])
        each = zip(terms, np.moveaxis(columns, 2, 0), strict=True)
        prior = np.array([self.equations.spread(term, own) for term, own in each]) ** -2.0
        schur = inner + prior[:, :, None] * np.eye(size)
        return gains_of(schur, left, prior, bounds[None, :, 0], bounds[None, :, 1], kinds)

    def beside(self, fit: Fit, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Information (c, k, k) and moments (c, k) of columns (R, n, c, k) once a fit's terms are projected out."""
        acting = np.any(columns, axis=(2, 3))
        joints, when = np.flatnonzero(acting.any(axis=0)), np.flatnonzero(acting.any(axis=1))
        rows = slice(when[0], when[-1] + 1 + self.noise.order) if len(when) else slice(0)
        white = self.equations.whitening.of(columns[rows][:, joints], self.noise, joints, rows)
        each = columns.shape[2:]
        known, beyond = (of_fit[rows] for of_fit in self.known(fit, joints))
        tall = white.reshape(-1, each[0] * each[1])
        left = tall.T @ beyond.ravel()
        cross = known.reshape(-1, len(fit.coefficients)).T @ tall
        seen = solve_triangular(fit.factor, cross, lower=True)
        told, own = (values.reshape(-1, *each).transpose(1, 2, 0) for values in (seen, tall))
        return own @ own.transpose(0, 2, 1) - told @ told.transpose(0, 2, 1), left.reshape(each)

    def known(self, fit: Fit, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whitened columns of a fit for some joints, (R, joints, P), and its residual; cached for the next call."""
        key = (fit.terms, fit.coefficients.tobytes(), tuple(joints.tolist()))
        if self._tall is None or self._tall[0] != key:
            white = self.white[:, joints[:, None], self.columns_of(fit.terms)]
            of_fit = white.reshape(-1, white.shape[2]) @ fit.coefficients
            self._tall = key, (white, self.white_target[:, joints] - of_fit.reshape(white.shape[:2]))
        return self._tall[1]

    def held_out(self, chosen: Sequence[int]) -> np.ndarray:
        """Half the squared whitened error on each block, predicted by a fit to all other blocks, (B,)."""
        key = tuple(chosen)
        if key not in self._held_out:
            index = self.columns_of(chosen)
            blocks = self.gram[:, index[:, None], index], self.moment[:, index], self.power
            ends = self.lower[index], self.upper[index]
            self._held_out[key] = held_out_losses(*blocks, self.precision[index], *ends)
        return self._held_out[key]

    def disbelief(self, chosen: Sequence[int]) -> float:
        """Half the squared distance of a fit's link errors and nuisances from their prior, in standard deviations."""
        known = self.fit(chosen).coefficients[: self.base]
        return float(0.5 * self.precision[: self.base] @ known**2)

    def residual(self, fit: Fit, blur: bool = True) -> np.ndarray:
        """Residual of a fit, not whitened, rows (R, n) [N·m]; `blur` as of `contribution`."""
        return self.equations.rows.target - self.contribution(fit, blur)

    def white_residual(self, fit: Fit) -> np.ndarray:
        """Whitened residual of a fit, rows (R, n)."""
        return np.asarray(self.white_target - self.white[:, :, self.columns_of(fit.terms)] @ fit.coefficients)

    def nuisances(self, fit: Fit) -> np.ndarray:
        """Coefficients of the nuisances in a fit, (K,)."""
        return np.asarray(fit.coefficients[self.equations.rigid.shape[2] : self.base])

    def contribution(self, fit: Fit, blur: bool = True) -> np.ndarray:
        """Effort that link errors, nuisances and terms of a fit add, rows (R, n) [N·m].

        Args:
            blur: include the blurs, which only weigh down noise that no model could predict.
        """
        equations = self.equations
        nuisances = self.nuisances(fit).copy()
        nuisances[BLURS] *= blur
        total = equations.rigid @ fit.coefficients[: equations.rigid.shape[2]]
        total += equations.nuisances.along(equations.motion) @ nuisances
        for chosen, coefficients in zip(fit.terms, self.each(fit), strict=True):
            total += equations.columns.of(self.terms[chosen]) @ coefficients
        return np.asarray(total)

    def part(self, fit: Fit, chosen: int) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (k,) and their covariance (k, k) of one term of a fit."""
        rows = self.rows(fit, chosen)
        return fit.coefficients[rows], fit.covariance[rows, rows]

    def coefficients(self, fit: Fit, chosen: int) -> np.ndarray:
        """Coefficients (k,) of one term of a fit."""
        return fit.coefficients[self.rows(fit, chosen)]

    def each(self, fit: Fit) -> list[np.ndarray]:
        """Coefficients (k,) of every term of a fit."""
        ends = np.cumsum([self.base, *(len(self.slots[c]) for c in fit.terms)]).tolist()
        return [fit.coefficients[a:b] for a, b in pairwise(ends)]

    def rows(self, fit: Fit, chosen: int) -> slice:
        """Indices of one term's coefficients within a fit; KeyError if it is not in it."""
        if chosen not in fit.terms:
            raise KeyError(chosen)
        at = self.base + sum(len(self.slots[other]) for other in fit.terms[: fit.terms.index(chosen)])
        return slice(at, at + len(self.slots[chosen]))
