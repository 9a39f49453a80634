"""How near a learned model is to the robot that made the data: effort, its parts, and the motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from _motion import Data

from bdnn_ros.robot import Dynamics
from bdnn_ros.scores import rollout_error, score_model
from bdnn_ros.signals import Signals

HORIZONS = {"rollout_0.1": 0.1, "rollout_1": 1.0}
POSES_EVERY = 25
"""Held-out samples between two poses whose parts are compared."""
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
    """
    q = np.concatenate([s.position[s.interior][::POSES_EVERY] for s in data.test])
    v = np.concatenate([s.velocity[s.interior][::POSES_EVERY] for s in data.test])
    with np.errstate(all="ignore"):  # what a bad model answers is judged, not mended
        return {
            "nmse": float(score_model(model, data.test).nmse.mean()),
            "mass": relative(model.mass_matrix(q), data.truth.mass_matrix(q)),
            "gravity": relative(model.gravity(q), data.truth.gravity(q)),
            "coriolis": relative(model.coriolis(q, v), data.truth.coriolis(q, v)),
            **{name: rollout(model, data.test, horizon) for name, horizon in HORIZONS.items()},
        }


def relative(value: np.ndarray, true: np.ndarray) -> float:
    """|value − true| / |true|, at most `WORST`."""
    error = float(np.linalg.norm(value - true) / np.linalg.norm(true))
    return min(error, WORST) if np.isfinite(error) else WORST


def rollout(model: Dynamics, parts: Sequence[Signals], horizon: float) -> float | None:
    """Root mean square error of all joints' positions after a horizon [s], in [rad]."""
    errors = np.concatenate([rollout_error(model, signals, horizon).position for signals in parts])
    size = float(np.sqrt(np.mean(errors**2)))
    return size if np.isfinite(size) else None
