"""Where something touched: the point of a link at which a force alone explains most.

A force F at the point p of a link that has turned by R has the torque (R p) x F about the link's origin, which is not constant
while the link turns. For a given point the columns are linear in F, and they are linear in the point as well, so that the gain
at any point follows from one small matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from bdnn_ros.diagnosis.regression.bounded import gains_of
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.environment import POINT, ExternalWrench, window
from bdnn_ros.robot import Robot

FARTHEST = 1.0
"""Largest distance of a contact from its link's origin [m]."""
REACH = 0.3
"""Prior spread of the contact about the points tried first [m]; it decides only where the evidence cannot."""
STEP = 1.5e-8
"""Step of finite differences [m]."""
GRID = np.linspace(-0.4, 0.4, 9)
"""Offsets from a point tried first, along each axis of the link [m]."""


def point_of(push: Term) -> np.ndarray:
    """Where on its link a wrench acts, (3,) [m]."""
    shape = dict(push.shape)
    return np.array([shape[axis] for axis in POINT])


def distance(push: Term, robot: Robot) -> float:
    """Distance of a push from the nearest point of its link that is tried first [m]; zero for a torque about a joint."""
    if push.link is None:
        return 0.0
    usual = push.effect.points(robot, push.link)
    return min(float(np.linalg.norm(point_of(push) - [point[axis] for axis in POINT])) for point in usual)


def contact(pool: Pool, fit: Fit, term: Term) -> Term | None:
    """The wrench at the point where a force alone explains most beside a fit; None if that is out of reach."""
    effect = term.effect
    if not isinstance(effect, ExternalWrench):
        return None
    usual = point_of(term)
    pull = _Pull.of(pool, fit, term, effect)
    around = np.stack(np.meshgrid(GRID, GRID, GRID, indexing="ij"), axis=-1).reshape(-1, 3) + usual

    def against(points: np.ndarray) -> np.ndarray:
        return 0.5 * np.sum(((points - usual) / REACH) ** 2, axis=-1) - pull.gains(points)

    def with_slope(point: np.ndarray) -> tuple[float, np.ndarray]:
        here, *there = against(point + np.vstack([np.zeros(3), STEP * np.eye(3)]))
        return float(here), (np.array(there) - here) / STEP

    start = around[np.argmin(against(around))]
    found = minimize(with_slope, start, jac=True, method="BFGS")
    if not np.isfinite(found.fun) or np.linalg.norm(found.x) > FARTHEST:
        return None
    return term.shaped({**dict(term.shape), **dict(zip(POINT, found.x.tolist(), strict=True))})


@dataclass(frozen=True)
class _Pull:
    """Gain of a force at any point of a link: its columns are affine in the point.

    Attributes:
        schur: information of the columns at the origin and per metre along each axis, for each force, (4, 3, 4, 3).
        left: their moments with the fit's residual, (4, 3).
        prior: precision of the force, (3,) [1/N²].
    """

    schur: np.ndarray
    left: np.ndarray
    prior: np.ndarray

    @classmethod
    def of(cls, pool: Pool, fit: Fit, term: Term, effect: ExternalWrench) -> _Pull:
        equations, shape = pool.equations, dict(term.shape)
        origin = effect.mixing(dict.fromkeys(POINT, 0.0))[:, :3]
        arms = np.stack([effect.displaced(force) for force in np.eye(3)], axis=2)
        mixing = np.concatenate([origin[:, None], arms], axis=1)
        acting = window(equations.motion, shape)
        columns = equations.columns.pushed(term, acting, mixing.reshape(len(mixing), 12))
        (schur,), (left,) = pool.beside(fit, columns[:, :, None])
        own = equations.columns.pushed(term, acting, effect.mixing(shape))
        prior = 1.0 / equations.spread(term, own)[:3] ** 2
        return cls(schur.reshape(4, 3, 4, 3), left.reshape(4, 3), prior)

    def gains(self, points: np.ndarray) -> np.ndarray:
        """Log evidence that a force adds at each of some points (P, 3) [m], (P,)."""
        at = np.concatenate([np.ones((len(points), 1)), points], axis=1)
        schur = np.einsum("pa,pb,akbl->pkl", at, at, self.schur) + np.diag(self.prior)
        ends, prior = np.full(3, np.inf), np.broadcast_to(self.prior, (len(points), 3))
        return gains_of(schur, at @ self.left, prior, -ends, ends)[0]
