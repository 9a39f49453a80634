"""Effort of rigid bodies and identified joints in operations that `symbols` turns into ONNX graphs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bdnn_ros.physical.dictionary import curve, features
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

Array = Any
"""A `Symbol` with the batch first; an ndarray would do."""
CROSS = (np.array([1, 2, 0]), np.array([2, 0, 1]))


def robot_effort(robot: Robot, q: Array, v: Array, a: Array, way: Array | None = None) -> Array:
    """As `Robot.inverse_dynamics`.

    Args:
        way: how much of its dry friction each joint has, (N, n), from -1 to 1; None for all of it.
    """
    friction = robot.viscous * v + robot.coulomb * (np.sign(v) if way is None else way)
    return rigid_effort(robot, q, v, a) + robot.armature * a + friction


def rigid_effort(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """As `Robot.rigid_effort`: recursive Newton-Euler (Luh, Walker, Paul, JDSMC 102(2), 1980)."""
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
        turn[index] = (
            _turned(rotation, turn[parent], back=True) + change * angular + _cross(omega, rate * angular)
        )
        rise[index] = (
            _turned(rotation, rise[parent] + arc, back=True)
            + change * linear
            + 2.0 * _cross(omega, rate * linear)
        )
        force[index], moment[index] = _newton_euler(
            robot.inertials[joint], spin[index], turn[index], rise[index]
        )
        steps[index] = (parent, rotation, lever, linear, angular)
    efforts: dict[int, Array] = {}
    for index in range(tree.njoints - 1, 0, -1):
        parent, rotation, lever, linear, angular = steps[index]
        joint = int(np.flatnonzero(order == tree.idx_vs[index])[0])
        efforts[joint] = (force[index] * linear + moment[index] * angular).sum(axis=1)
        if parent:
            pushed = _turned(rotation, force[index])
            force[parent] = force[parent] + pushed
            moment[parent] = moment[parent] + _turned(rotation, moment[index]) + _cross(lever, pushed)
    return np.stack([efforts[joint] for joint in range(robot.width)], axis=1)


def _axes(tree: Any, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular motion per unit of a joint, (3,) each."""
    data = tree.joints[index].createData()
    tree.joints[index].calc(data, np.zeros(tree.joints[index].nq))
    motion = np.asarray(data.S, float).ravel()
    return motion[:3], motion[3:]


def _rotation(base: np.ndarray, axis: np.ndarray, angle: Array) -> Any:
    """base · exp(axis × angle), (N, 3, 3), by Rodrigues; the constant base where nothing turns."""
    if not axis.any():
        return base
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    along = np.outer(axis, axis)
    turned = angle[:, :, None]
    return base @ along + np.cos(turned) * (base @ (np.eye(3) - along)) + np.sin(turned) * (base @ skew)


def _turned(rotation: Any, vector: Array, back: bool = False) -> Array:
    """R v, or Rᵀ v, of vectors (N, 3)."""
    if isinstance(rotation, np.ndarray):
        return vector @ (rotation if back else rotation.T)
    row = vector[:, None, :]
    return (row @ (rotation if back else np.swapaxes(rotation, 1, 2)))[:, 0, :]


def _cross(left: Any, right: Any) -> Any:
    first, second = CROSS
    return left[:, first] * right[:, second] - left[:, second] * right[:, first]


def _newton_euler(parameters: np.ndarray, spin: Array, turn: Array, rise: Array) -> tuple[Array, Array]:
    """Force and moment about its frame's origin that a body takes, (N, 3) each."""
    mass, first = parameters[0], spin * 0.0 + parameters[1:4]
    tensor = parameters[[4, 5, 7, 5, 6, 8, 7, 8, 9]].reshape(3, 3)
    force = mass * rise + _cross(turn, first) + _cross(spin, _cross(spin, first))
    moment = turn @ tensor + _cross(spin, spin @ tensor) + _cross(first, rise)
    return force, moment


def physical_effort(model: PhysicalModel, q: Array, v: Array, a: Array) -> Array:
    """As `PhysicalModel.inverse_dynamics`."""
    load = rigid_effort(model.robot, q, v, a)
    robot = model.robot
    own = robot.armature * a + robot.viscous * v + robot.coulomb * np.sign(v) + model.offset
    return load + own + effort_beyond(model, q, v, a, load)


def effort_beyond(model: PhysicalModel, q: Array, v: Array, a: Array, load: Array) -> Array:
    """Effort of coupled motors and learned friction of an identified robot, under a load."""
    motors, effort = model.motors, 0.0 * q
    if motors.couplings:
        ways = motors.on_joints(np.eye(len(motors.couplings)), len(model.joints))
        speed, rate = v @ ways.T, a @ ways.T
        inertia, viscous, coulomb = motors.parameters.T
        own = inertia * rate + viscous * speed + coulomb * np.sign(speed)
        shape = curve(speed / motors.limit, np.sign(speed))
        own = own + sum(weight * phi for weight, phi in zip(motors.weights.T, shape, strict=True))
        effort = effort + own @ ways
    if model.learned is not None and model.learned.active:
        phi = features(q, v, np.sign(v), load, model.learned.scales)
        viscous, coulomb, offset = model.learned.straight.T
        learned = np.einsum("tjk,jk->tj", phi, model.learned.weights)
        effort = effort + learned - (viscous * v + coulomb * np.sign(v) + offset)
    return effort


def inertial_effort(model: Robot | PhysicalModel, q: Array, a: Array) -> Array:
    """M(q) q̈, (N, n), of a robot or an identified one."""
    robot = model if isinstance(model, Robot) else model.robot
    weightless = replace(robot, gravity_vector=np.zeros(3))
    effort = rigid_effort(weightless, q, 0.0 * q, a) + robot.armature * a
    if isinstance(model, PhysicalModel) and model.motors.couplings:
        effort = effort + a @ model.motors.mass_matrix(robot.width)
    return effort
