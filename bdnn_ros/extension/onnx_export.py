"""Inverse dynamics of models as ONNX graphs, in double precision.

Inputs are position, velocity and acceleration, (N, n) each, the output is the effort (N, n). A graph is
handed out only after it was run and has agreed with the model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import onnx
from onnx.reference import ReferenceEvaluator

from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import DataError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.holding import IN_PLANT, WITH_MEMORY
from bdnn_ros.extension.onnx_bodies import Array, effort_beyond, physical_effort, rigid_effort, robot_effort
from bdnn_ros.extension.onnx_networks import bdnn_effort
from bdnn_ros.extension.symbols import Graph
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

INPUTS = ("position", "velocity", "acceleration")
OUTPUT = "effort"
AGREEMENT = 1e-6
"""Largest difference from the model, relative to its largest effort."""
SAMPLES = 6

Formula = Callable[[Array, Array, Array], Array]


def inverse_dynamics_graph(model: Dynamics) -> onnx.ModelProto:
    """The ONNX graph of a model's inverse dynamics.

    Raises:
        DataError: the model is of a kind that no graph is known for, or the graph did not agree with it.
    """
    formula = _formula(model)
    examples = _states(len(model.joints))
    graph = Graph()
    symbols = [graph.input(name, value) for name, value in zip(INPUTS, examples, strict=True)]
    made = graph.model(formula(*symbols), OUTPUT)
    made.doc_string = "Inverse dynamics; joints: " + ", ".join(model.joints)
    wanted = model.inverse_dynamics(*examples)
    got = np.asarray(ReferenceEvaluator(made).run([OUTPUT], dict(zip(INPUTS, examples, strict=True)))[0])  # type: ignore[index]
    error = float(np.abs(got - wanted).max() / max(np.abs(wanted).max(), 1e-12))
    if not error < AGREEMENT:
        raise DataError(f"The graph differs from the model by {error:.1e} of its effort.", "Report this.")
    return made


def _states(width: int) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.uniform(-2.0, 2.0, (SAMPLES, width)) for _ in INPUTS]


def _formula(model: Dynamics) -> Formula:
    if isinstance(model, Robot):
        return lambda q, v, a: robot_effort(model, q, v, a)
    if isinstance(model, ExtendedModel):
        return lambda q, v, a: extended_effort(model, q, v, a)
    if isinstance(model, PhysicalModel):
        return lambda q, v, a: physical_effort(model, q, v, a)
    if isinstance(model, BDNN):
        return lambda q, v, a: bdnn_effort(model, q, v, a)
    raise DataError(f"No ONNX graph is known for a {type(model).__name__}.", "")


# -- effects -------------------------------------------------------------------------------------------------


def extended_effort(model: ExtendedModel, q: Array, v: Array, a: Array) -> Array:
    """As `ExtendedModel.inverse_dynamics`."""
    plant, width = model.plant, len(model.joints)
    way = _way(model, v)
    acting = robot_effort(plant.robot, q - plant.position_offset, v, a, way)
    if model.beyond is not None and (model.beyond.motors.couplings or model.beyond.learned):
        load = rigid_effort(model.beyond.robot, q, v, 0.0 * v)
        acting = acting + effort_beyond(model.beyond, q, v, a, load)
    if model.networks:
        carried = rigid_effort(model.bare, q, 0.0 * v, 0.0 * v)
        for network in model.networks:
            acting = acting + network.effort(q, v, way, carried)[:, None] * np.eye(width)[network.joint]
    ratio = np.zeros(width)
    for effect in model.effects:
        name, values = effect.effect.name, effect.values
        if name in IN_PLANT | WITH_MEMORY:
            continue
        if name == "load_dependent_friction":
            ratio[effect.target] += values["ratio"]
            continue
        if name not in RESISTANCE:
            raise DataError(f"No ONNX graph is known for {name}.", "")
        at, speed, side = q[:, [effect.target]], v[:, [effect.target]], way[:, [effect.target]]
        acting = acting + RESISTANCE[name](at, speed, side, values) * np.eye(width)[effect.target]
    if ratio.any():  # u = x + r |u| s has the sign of x, because r < 1
        acting = acting / (1.0 - ratio * way * np.sign(acting))
    return (acting - plant.offset) / plant.scale


def _way(model: ExtendedModel, v: Array) -> Array:
    """Fraction of dry friction that acts at each joint, from -1 to 1."""
    if not model.creep:
        return np.sign(v)
    ahead, back, _ = np.array(model.creep).T
    forth, hither = _share(v, ahead), -_share(-v, back)
    return forth + hither


def _share(speed: Array, whole: np.ndarray) -> Array:
    """Fraction of dry friction built up at a speed in one direction, from 0 to 1; 1 at once where `whole` is zero."""
    soft = whole > 0.0
    return soft * np.minimum(np.maximum(speed / np.where(soft, whole, 1.0), 0.0), 1.0) + ~soft * np.maximum(
        np.sign(speed), 0.0
    )


def _stribeck(q: Any, v: Any, sign: Any, p: dict[str, float]) -> Any:
    return sign * (p["coulomb"] + (p["static"] - p["coulomb"]) * np.exp(-((v / p["velocity"]) ** 2)))


RESISTANCE: dict[str, Callable[[Any, Any, Any, dict[str, float]], Any]] = {
    "coulomb_friction": lambda q, v, s, p: p["coulomb"] * s,
    "stribeck_friction": _stribeck,
    "asymmetric_friction": lambda q, v, s, p: (
        p["positive"] * np.maximum(s, 0.0) + p["negative"] * np.minimum(s, 0.0)
    ),
    "quadratic_drag": lambda q, v, s, p: p["drag"] * np.abs(v) * v,
    "joint_spring": lambda q, v, s, p: p["stiffness"] * (q - p["rest"]),
    "cogging": lambda q, v, s, p: p["amplitude"] * np.sin(p["periods_per_rev"] * q + p["phase"]),
}
"""Effort of an effect from its joint's position, velocity and share of dry friction, (N, 1) each."""
