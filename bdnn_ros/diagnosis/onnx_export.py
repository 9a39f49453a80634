"""Inverse dynamics of models as ONNX graphs: position, velocity, acceleration (N, n) -> effort (N, n), in double.

A graph is handed out only after it was run and has agreed with the model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import onnx
from onnx.reference import ReferenceEvaluator

from bdnn_ros.diagnosis.extended import IN_PLANT, WITH_MEMORY, ExtendedModel
from bdnn_ros.diagnosis.symbols import Graph, Symbol
from bdnn_ros.errors import DataError
from bdnn_ros.robot import Dynamics, Robot

INPUTS = ("position", "velocity", "acceleration")
OUTPUT = "effort"
AGREEMENT = 1e-6
"""Largest difference from the model, relative to its largest effort."""
SAMPLES = 6
CROSS = (np.array([1, 2, 0]), np.array([2, 0, 1]))

Formula = Callable[[Symbol, Symbol, Symbol], Symbol]


def inverse_dynamics_graph(model: Dynamics) -> onnx.ModelProto:
    """The graph of a model's inverse dynamics.

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
    got = ReferenceEvaluator(made).run(None, dict(zip(INPUTS, examples, strict=True)))[0]
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
    raise DataError(f"No ONNX graph is known for a {type(model).__name__}.", "")


# -- rigid bodies --------------------------------------------------------------------------------------------


def robot_effort(robot: Robot, q: Symbol, v: Symbol, a: Symbol) -> Symbol:
    """As `Robot.inverse_dynamics`."""
    friction = robot.viscous * v + robot.coulomb * np.sign(v)
    return rigid_effort(robot, q, v, a) + robot.armature * a + friction


def rigid_effort(robot: Robot, q: Symbol, v: Symbol, a: Symbol) -> Symbol:
    """As `Robot.rigid_effort`: recursive Newton-Euler (Luh, Walker, Paul, JDSMC 102(2), 1980), vectors as (N, 3)."""
    tree, order = robot.pinocchio_model()
    zero = q[:, :1] * 0.0 + np.zeros(3)
    spin, turn, rise = {0: zero}, {0: zero}, {0: zero - np.asarray(robot.gravity_vector)}
    steps: dict[int, tuple[int, Any, Any, np.ndarray, np.ndarray]] = {}
    force, moment = {}, {}
    for index in range(1, tree.njoints):
        joint, parent = int(np.flatnonzero(order == tree.idx_vs[index])[0]), int(tree.parents[index])
        linear, angular = _axes(tree, index)
        at, rate, change = q[:, [joint]], v[:, [joint]], a[:, [joint]]
        base = tree.jointPlacements[index]
        rotation = _rotation(base.rotation, angular, at)
        lever = at * (base.rotation @ linear) + base.translation
        omega = _turned(rotation, spin[parent], back=True)
        arc = np.add(_cross(turn[parent], lever), _cross(spin[parent], _cross(spin[parent], lever)))
        spin[index] = omega + rate * angular
        turn[index] = _turned(rotation, turn[parent], back=True) + change * angular + _cross(omega, rate * angular)
        rise[index] = (
            _turned(rotation, rise[parent] + arc, back=True)
            + change * linear
            + 2.0 * _cross(omega, rate * linear)
        )
        force[index], moment[index] = _newton_euler(robot.inertials[joint], spin[index], turn[index], rise[index])
        steps[index] = (parent, rotation, lever, linear, angular)
    efforts: dict[int, Symbol] = {}
    for index in range(tree.njoints - 1, 0, -1):
        parent, rotation, lever, linear, angular = steps[index]
        joint = int(np.flatnonzero(order == tree.idx_vs[index])[0])
        efforts[joint] = (force[index] * linear + moment[index] * angular).sum(axis=1)
        if parent:
            pushed = _turned(rotation, force[index])
            force[parent] = force[parent] + pushed
            moment[parent] = moment[parent] + _turned(rotation, moment[index]) + _cross(lever, pushed)
    return np.stack([efforts[joint] for joint in range(robot.width)], axis=1)  # type: ignore[call-overload, no-any-return]


def _axes(tree: Any, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular motion per unit of a joint, (3,) each."""
    data = tree.joints[index].createData()
    tree.joints[index].calc(data, np.zeros(tree.joints[index].nq))
    motion = np.asarray(data.S, float).ravel()
    return motion[:3], motion[3:]


def _rotation(base: np.ndarray, axis: np.ndarray, angle: Symbol) -> Any:
    """base · exp(axis × angle), (N, 3, 3), by Rodrigues; the constant base where nothing turns."""
    if not axis.any():
        return base
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    along = np.outer(axis, axis)
    turned = angle[:, :, None]
    return base @ along + np.cos(turned) * (base @ (np.eye(3) - along)) + np.sin(turned) * (base @ skew)


def _turned(rotation: Any, vector: Symbol, back: bool = False) -> Symbol:
    """R v, or Rᵀ v, of vectors (N, 3)."""
    if isinstance(rotation, np.ndarray):
        return vector @ (rotation if back else rotation.T)
    row = vector[:, None, :]
    return (row @ (rotation if back else np.swapaxes(rotation, 1, 2)))[:, 0, :]


def _cross(left: Any, right: Any) -> Any:
    first, second = CROSS
    return left[:, first] * right[:, second] - left[:, second] * right[:, first]


def _newton_euler(parameters: np.ndarray, spin: Symbol, turn: Symbol, rise: Symbol) -> tuple[Symbol, Symbol]:
    """Force and moment about its frame's origin that a body takes, (N, 3) each."""
    mass, first = parameters[0], spin * 0.0 + parameters[1:4]
    tensor = parameters[[4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(3, 3)
    force = mass * rise + _cross(turn, first) + _cross(spin, _cross(spin, first))
    moment = turn @ tensor + _cross(spin, spin @ tensor) + _cross(first, rise)
    return force, moment


# -- effects -------------------------------------------------------------------------------------------------


def extended_effort(model: ExtendedModel, q: Symbol, v: Symbol, a: Symbol) -> Symbol:
    """As `ExtendedModel.inverse_dynamics`."""
    plant, width = model.plant, len(model.joints)
    sign = np.sign(v)
    acting = robot_effort(plant.robot, q - plant.position_offset, v, a)
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
        at, speed, side = q[:, [effect.target]], v[:, [effect.target]], sign[:, [effect.target]]
        acting = acting + RESISTANCE[name](at, speed, side, values) * np.eye(width)[effect.target]
    if ratio.any():  # u = x + r |u| s has the sign of x, because r < 1
        acting = acting / (1.0 - ratio * sign * np.sign(acting))
    return (acting - plant.offset) / plant.scale  # type: ignore[no-any-return]


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
"""Effort of an effect from its joint's position, velocity and direction, (N, 1) each."""
