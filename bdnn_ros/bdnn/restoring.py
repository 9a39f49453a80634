"""Serialization of a prior with its networks."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from typing import Any

import numpy as np

from bdnn_ros.bdnn.cores import PriorCore, get_network, put_network
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.networks import vector_size
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import ModelFileError
from bdnn_ros.robot import Robot
from bdnn_ros.robot.entries import require_robot, require_shapes
from bdnn_ros.robot.state import robot_from_state, robot_state

Build = Callable[[str, dict[str, np.ndarray], dict[str, Any]], Dynamics]
"""Makes a prior of another kind from its kind, arrays and info."""


def prior_core_state(
    core: PriorCore, with_prior: bool = True
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and JSON-able rest of a core.

    Args:
        with_prior: not where who restores it has the prior, to be given by `build`.

    Raises:
        ModelFileError: the prior cannot be saved.
    """
    arrays, info = core.local.to_state()
    arrays["slow"] = core.slow
    if core.h is not None:
        put_network("h", core.h, arrays, info)
    kind, held, told = _prior_state(core.prior) if with_prior else ("given", {}, {})
    arrays |= {f"prior.{key}": value for key, value in held.items()}
    return arrays, {**info, "prior": {"kind": kind, "info": told}}


def prior_core(arrays: dict[str, np.ndarray], info: dict[str, Any], build: Build | None = None) -> PriorCore:
    """The core of `prior_core_state`.

    Args:
        build: makes a prior that is not a `Robot`.

    Raises:
        ModelFileError: the prior is of a kind that `build` is needed for.
        KeyError, TypeError, ValueError: something is missing or does not fit.
    """
    held = {key[len("prior.") :]: value for key, value in arrays.items() if key.startswith("prior.")}
    kind, told = info["prior"]["kind"], info["prior"]["info"]
    if kind == "robot":
        require_robot(arrays, len(told["joints"]), "prior.")
        prior: Dynamics = robot_from_state(held, told)
    elif build is None:
        raise ModelFileError(
            f"The prior of the BDNN is a model of kind {kind!r}.", "Load it by `load_model`."
        )
    else:
        prior = build(kind, held, told)
    n = len(prior.joints)
    h = get_network("h", arrays, info, 2 * n, vector_size(n)) if "h" in info else None
    require_shapes(arrays, {"slow": (n,)})
    return PriorCore(prior, LocalNetworks.from_state(arrays, info, n), h, arrays["slow"])


def fingerprint(prior: Dynamics) -> str:
    """A hash that identifies a prior; for priors that cannot be saved, of type and joints only."""
    try:
        kind, arrays, info = _prior_state(prior)
    except ModelFileError:
        kind, arrays, info = type(prior).__name__, {}, {}
    digest = hashlib.sha256(json.dumps([kind, list(prior.joints), info], sort_keys=True).encode())
    for name, values in sorted(arrays.items()):
        digest.update(f"{name} {values.dtype.str} {values.shape}".encode() + values.tobytes())
    return digest.hexdigest()


def _prior_state(prior: Dynamics) -> tuple[str, dict[str, np.ndarray], dict[str, Any]]:
    if isinstance(prior, Robot):
        return "robot", *robot_state(prior)
    kind, state = getattr(prior, "kind", None), getattr(prior, "to_state", None)
    if kind is None or state is None:
        raise ModelFileError(
            f"A prior of type {type(prior).__name__} cannot be saved.", "Use a Robot or an identified model."
        )
    arrays, info = state()
    return kind, arrays, info
