"""How near a learned model is to the robot that made the data: effort, its parts, and the motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from _motion import Data

from bdnn_ros.bdnn import mechanics
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.scores import rollout_error, score_model
from bdnn_ros.signals import Signals

HORIZONS = {"rollout_0.1": 0.1, "rollout_1": 1.0}
POSES_EVERY = 25
"""Held-out samples between two poses whose parts are compared."""
MOVING = 0.15
"""Friction is compared where a joint is faster than this share of its typical velocity: at a reversal it is a
step, which some models round.
"""
WORST = 99.0
"""Relative errors are cut here: a model that is so wrong need not be told from a worse one."""


class Judged(Dynamics, Protocol):
    """What is judged: any dynamics that predict the effort along a motion."""

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort, (N, n) [N·m]."""


def judge(model: Judged, data: Data) -> dict[str, float | None]:
    """Errors on the held-out motions; None where a rollout ran away.

    Returns:
        nmse: squared error of the effort over its variance, mean of the joints, both sides low-passed.
        mass, gravity, coriolis: relative Frobenius errors against the true robot, over all poses.
        rollout_0.1, rollout_1: root mean square error of the position [rad].
        friction, kinetic, potential: relative errors of the friction and of the energies.
        least_eigenvalue: smallest eigenvalue of M within the held-out range, over the true robot's.
        passive: share of random motions in that range in which friction takes energy out.
        gravity_curl: how far gravity is from having a potential, see `mechanics.Consistency`.
    """
    q = np.concatenate([s.position[s.interior][::POSES_EVERY] for s in data.test])
    v = np.concatenate([s.velocity[s.interior][::POSES_EVERY] for s in data.test])
    low, high, fastest = q.min(axis=0), q.max(axis=0), np.abs(v).max(axis=0)
    middle = 0.5 * (low + high)
    moving = np.abs(v) > MOVING * np.std(v, axis=0)
    with np.errstate(all="ignore"):  # what a bad model answers is judged, not mended
        found, true = (mechanics.consistency(m, low, high, fastest, poses=200) for m in (model, data.truth))
        return {
            "nmse": float(score_model(model, data.test).nmse.mean()),
            "mass": relative(model.mass_matrix(q), data.truth.mass_matrix(q)),
            "gravity": relative(model.gravity(q), data.truth.gravity(q)),
            "coriolis": relative(model.coriolis(q, v), data.truth.coriolis(q, v)),
            **{name: rollout(model, data.test, horizon) for name, horizon in HORIZONS.items()},
            "friction": relative(moving * model.friction(q, v), moving * data.truth.friction(q, v)),
            "kinetic": relative(*(mechanics.kinetic_energy(m, q, v) for m in (model, data.truth))),
            "potential": relative(
                *(mechanics.potential_energy(_Rows(m), q, middle) for m in (model, data.truth))
            ),
            "least_eigenvalue": found.smallest_eigenvalue / true.smallest_eigenvalue,
            "passive": found.passive,
            "gravity_curl": found.gravity_curl,
        }


class _Rows:
    """Dynamics whose gravity answers poses of any leading shape (..., n)."""

    def __init__(self, model: Dynamics) -> None:
        self._model = model

    def __getattr__(self, name: str) -> Any:
        return getattr(self._model, name)

    def gravity(self, position: np.ndarray) -> np.ndarray:
        rows = position.reshape(-1, position.shape[-1])
        return self._model.gravity(rows).reshape(position.shape)


def relative(value: np.ndarray, true: np.ndarray) -> float:
    """|value − true| / |true|, at most `WORST`."""
    error = float(np.linalg.norm(value - true) / np.linalg.norm(true))
    return min(error, WORST) if np.isfinite(error) else WORST


def rollout(model: Dynamics, parts: Sequence[Signals], horizon: float) -> float | None:
    """Root mean square error of all joints' positions after a horizon [s], in [rad]."""
    errors = np.concatenate([rollout_error(model, signals, horizon).position for signals in parts])
    size = float(np.sqrt(np.mean(errors**2)))
    return size if np.isfinite(size) else None
