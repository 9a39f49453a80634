"""Refining a push by Gauss-Newton: its times between rows, and its point if it has one of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve

from bdnn_ros.diagnosis.pushes.contact import distance
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.environment import EDGES, POINT, ExternalWrench, Push, edge_rates, window
from bdnn_ros.robot import Robot

STEPS = 5
"""Most Gauss-Newton steps."""
AT_POINT = 2e-4
"""Step of the point that ends the refinement [m]."""
LARGEST_TIME_STEP = 0.1
"""Largest step of the times [s]."""
EXACT = 1e-3
"""Step of the times that ends the refinement [s]."""


def between_rows(pool: Pool, fit: Fit, term: Term, robot: Robot) -> tuple[float, Term]:
    """Log evidence that a push adds to a fit with its times and its own point refined, and the push.

    Terms of the fit that are at a bound may leave it.
    """
    fit = unbound(pool, fit)
    here = _Here.of(pool, fit, term)
    for _ in range(STEPS):
        steps = here.steps(pool, fit, robot)
        shape = dict(here.term.shape)
        for name, by in steps.items():
            shape[name] += by
        if not term.effect.shape_allowed(shape):
            break
        there = _Here.of(pool, fit, term.shaped(shape))
        if there.gain <= here.gain:
            break
        here = there
        if all(abs(by) < (EXACT if name in EDGES else AT_POINT) for name, by in steps.items()):
            break
    return here.gain, here.term


def unbound(pool: Pool, fit: Fit) -> Fit:
    """A fit without bounds: without a push among the terms, bounds hold friction that would have to act like it."""
    moment = pool.total[1][pool.columns_of(fit.terms)]
    return replace(fit, coefficients=cho_solve((fit.factor, True), moment))


@dataclass(frozen=True)
class _Here:
    """A push at one point of the refinement.

    Attributes:
        acting: its window, (N,).
        columns: its columns as rows, (R, n, k).
        gain: log evidence that it adds to a fit [nats].
        coefficients: of its columns, (k,).
    """

    term: Term
    effect: Push
    acting: np.ndarray
    columns: np.ndarray
    gain: float
    coefficients: np.ndarray

    @classmethod
    def of(cls, pool: Pool, fit: Fit, term: Term) -> _Here:
        """The push beside a fit."""
        effect, shape = term.effect, dict(term.shape)
        assert isinstance(effect, Push)
        acting = window(pool.equations.motion, shape)
        columns = pool.equations.columns.pushed(term, acting, effect.mixing(shape))
        return cls(term, effect, acting, columns, *pool.gain_of(fit, term, columns))

    def steps(self, pool: Pool, fit: Fit, robot: Robot) -> dict[str, float]:
        """Gauss-Newton step of its times [s], and of its point [m] if that is none of the usual ones."""
        equations, shape, own = pool.equations, dict(self.term.shape), self.columns
        whole, names = self.effect.mixing(shape) @ self.coefficients[:, None], list(EDGES)
        columns = [
            equations.columns.pushed(self.term, rate, whole) for rate in edge_rates(equations.motion, shape).T
        ]
        if isinstance(self.effect, ExternalWrench) and distance(self.term, robot) > 0.0:
            arms = equations.columns.pushed(
                self.term, self.acting, self.effect.displaced(self.coefficients[:3])
            )
            columns, own, names = [*columns, arms], own[..., :3], [*EDGES, *POINT]
        found = pool.gain_of(fit, self.term, np.concatenate([*columns, own], axis=2))[1]
        found[: len(EDGES)] = np.clip(found[: len(EDGES)], -LARGEST_TIME_STEP, LARGEST_TIME_STEP)
        return dict(zip(names, found.tolist(), strict=False))
