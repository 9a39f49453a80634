"""Dynamics of many rows in Pinocchio's order, by Pinocchio's own loop where it has one."""

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


def regressors(model: pin.Model, data: pin.Data, rows: Sequence[np.ndarray]) -> np.ndarray:
    """Regressors of the efforts by the ten inertial parameters of each body, (N, nv, nv, 10), for the same rows."""
    result = np.empty((len(rows[0]), 10 * model.nv, model.nv))  # as Pinocchio has it: efforts last
    for k, row in enumerate(zip(*rows, strict=True)):
        found = pin.computeJointTorqueRegressor(model, data, *row)
        result[k] = found.reshape(model.nv, -1).T  # of one joint it is a vector
    return result.reshape(len(result), model.nv, 10, model.nv).transpose(0, 3, 1, 2)


def rnea_derivatives(
    model: pin.Model, data: pin.Data, rows: Sequence[np.ndarray], *names: str
) -> tuple[np.ndarray, ...]:
    """Intermediate results of Pinocchio's effort derivatives, by its own names, for each of the same rows."""
    # views of what each row is written to; of one joint they are vectors
    found = [getattr(data, name).reshape(-1, model.nv) for name in names]
    result = tuple(np.empty((len(rows[0]), *values.shape)) for values in found)
    pairs = list(zip(result, found, strict=True))
    for k, row in enumerate(zip(*rows, strict=True)):
        pin.computeRNEADerivatives(model, data, *row)
        for kept, values in pairs:
            kept[k] = values
    return result
