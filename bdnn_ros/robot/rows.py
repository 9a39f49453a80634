"""Inverse dynamics of many rows at once, in Pinocchio's own loop."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pinocchio as pin

MANY = 200
"""From so many rows on that loop is worth a thread of its own.

It sets how many threads OpenMP may have in whichever thread calls it, and torch asks the same OpenMP.
"""
HAS_LOOP = hasattr(pin, "rneaInParallel")
"""Bindings that were built without OpenMP, as those of a Linux distribution may be, come without that loop."""


def rnea(model: pin.Model, data: pin.Data, rows: Sequence[np.ndarray]) -> np.ndarray:
    """Efforts (N, nv) [N·m] of positions, velocities and accelerations in Pinocchio's order, (N, nv) each."""
    if len(rows[0]) < MANY or not HAS_LOOP:
        efforts = [pin.rnea(model, data, *row) for row in zip(*rows, strict=True)]
        return np.array(efforts).reshape(len(rows[0]), model.nv)
    with ThreadPoolExecutor(1) as aside:
        done = aside.submit(pin.rneaInParallel, 1, pin.ModelPool(model, 1), *(row.T for row in rows))
    return np.asarray(done.result().reshape(model.nv, -1).T)
