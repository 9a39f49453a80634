"""extended.mjcf.xml: an extended model as a MuJoCo model that stands alone.

MuJoCo's joints know armature, damping, frictionloss and springs, its actuators a gain and a bias, so it
carries more of the effects than a URDF can. Links fixed to one another are one body; shapes are capsules that
touch nothing.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from bdnn_ros.effects.registry import Installed
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.urdf import IN_URDF, Joints, joints_of, named, upright
from bdnn_ros.physical.consistency import feasible
from bdnn_ros.robot import Robot
from bdnn_ros.robot.bodies import thickened
from bdnn_ros.robot.urdf import UNLIMITED, inertia_of
from bdnn_ros.written import numbers

IN_MJCF = frozenset({"armature", "joint_spring", "effort_scale", "effort_offset"})
"""Effects that a MuJoCo model carries beside those of the URDF."""
WORLD = "world"
SPECK = np.array([1e-9, 0.0, 0.0, 0.0, 1e-12, 0.0, 1e-12, 0.0, 0.0, 1e-12])
"""Stands for a body without mass, which MuJoCo refuses: m, m·c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz [kg, kg·m, kg·m²]."""
THICKENED = " No body can have the inertia that the robot has here; thickened, so that MuJoCo takes it. "
TIMESTEP = 0.001
"""[s]"""
THICKNESS = 0.12
"""Radius of the drawn capsules, as a share of their length."""


def beside_mjcf(effects: list[Installed]) -> list[Installed]:
    """Those of the effects beside the URDF that the MuJoCo model carries as well."""
    return [effect for effect in effects if effect.effect.name in IN_MJCF]


def extended_mjcf(model: ExtendedModel, left_out: Sequence[str] = ()) -> str:
    """The model in MuJoCo's format.

    Args:
        left_out: what neither it nor effects.yaml carries, in words.
    """
    robot = model.robot
    root = ElementTree.Element("mujoco", model=_name(model.robot.urdf))
    root.append(ElementTree.Comment(_preamble(model, left_out)))
    ElementTree.SubElement(root, "compiler", angle="radian", inertiafromgeom="false", autolimits="true")
    ElementTree.SubElement(root, "option", timestep=numbers(TIMESTEP), integrator="implicitfast")
    names = _body_names(robot)
    world = ElementTree.SubElement(root, "worldbody")
    ElementTree.SubElement(world, "light", pos="0 0 3", dir="0 0 -1", directional="true")
    # gravity stays vertical; a tilted base is turned instead
    base = ElementTree.SubElement(world, "body", name=names[0], quat=_quaternion(upright(robot)))
    _add_bodies(base, model, names[1:])
    _add_motors(root, model)
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _body_names(robot: Robot) -> list[str]:
    """Names of the base and of the joints' moving links: MuJoCo's own body is called world, and no two are called alike."""
    names = list[str]()
    for name in (WORLD, *map(robot.moving_link, robot.joints), "base"):
        while name in names:
            name += "_"
        names.append(name)
    return [names[-1], *names[1:-1]]


def _add_bodies(base: ElementTree.Element, model: ExtendedModel, names: Sequence[str]) -> None:
    robot, joints = model.robot, joints_of(model)
    tree, order = robot.pinocchio_model()
    bodies = {0: base}
    for index in range(1, tree.njoints):  # parents come before their children
        joint = int(np.flatnonzero(order == tree.idx_vs[index])[0])
        placement = tree.jointPlacements[index]
        body = ElementTree.SubElement(
            bodies[tree.parents[index]],
            "body",
            name=names[joint],
            pos=numbers(*placement.translation),
            quat=_quaternion(placement.rotation),
        )
        bodies[index] = body
        known = robot.inertials[joint]
        loadable = _loadable(known)
        if known.any() and loadable is not known:
            body.append(ElementTree.Comment(THICKENED))
        body.append(_inertial(loadable))
        body.append(_joint(model, joints, joint, *_axis(tree, index)))
        _draw(bodies[tree.parents[index]], placement.translation)


def _inertial(parameters: np.ndarray) -> ElementTree.Element:
    inertia = inertia_of(parameters)
    matrix = inertia.inertia
    about_centre = (matrix[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    return ElementTree.Element(
        "inertial",
        pos=numbers(*inertia.lever),
        mass=numbers(inertia.mass),
        fullinertia=numbers(*about_centre),
    )


def _loadable(parameters: np.ndarray) -> np.ndarray:
    """A body (PER_LINK,) that MuJoCo takes: itself where it can exist."""
    if not parameters.any():
        return SPECK
    if feasible(parameters[None]):
        return parameters
    return thickened(parameters)


def _axis(tree: pin.Model, index: int) -> tuple[str, np.ndarray]:
    """Kind and axis (3,) of a joint, in its own frame."""
    data = tree.joints[index].createData()
    tree.joints[index].calc(data, np.zeros(tree.nq))
    motion = np.asarray(data.S, float).ravel()
    return ("slide", motion[:3]) if np.abs(motion[:3]).max() > 0.5 else ("hinge", motion[3:])


def _joint(
    model: ExtendedModel, joints: Joints, joint: int, kind: str, axis: np.ndarray
) -> ElementTree.Element:
    limits, name = model.robot.limits, model.joints[joint]
    element = ElementTree.Element("joint", name=name, type=kind, axis=numbers(*axis))
    ends = np.array([limits.lower[joint], limits.upper[joint]])
    if np.isfinite(ends).any():  # MuJoCo knows no range with one end
        element.set("range", numbers(*np.clip(ends, -UNLIMITED, UNLIMITED)))
    values = {
        "armature": joints.armature[joint],
        "damping": joints.viscous[joint],
        "frictionloss": joints.coulomb[joint],
    }
    springs = [e.values for e in named(model, "joint_spring") if e.target == joint]
    stiffness = sum(spring["stiffness"] for spring in springs)
    if stiffness > 0.0:  # springs on one joint pull like one of their weighted mean rest
        values["stiffness"] = stiffness
        rest = sum(s["stiffness"] * s["rest"] for s in springs) / stiffness
        values["springref"] = rest - model.plant.position_offset[joint]  # told as the joint reports it
    for key, value in values.items():
        if value:
            element.set(key, numbers(value))
    return element


def _add_motors(root: ElementTree.Element, model: ExtendedModel) -> None:
    """A motor on every joint, commanded with the measured effort: force = scale · command + offset."""
    actuators = ElementTree.SubElement(root, "actuator")
    for joint, name in enumerate(model.joints):
        scale, offset, limit = (
            model.plant.scale[joint],
            model.plant.offset[joint],
            model.robot.limits.effort[joint],
        )
        plain = scale == 1.0 and offset == 0.0
        motor = ElementTree.SubElement(
            actuators, "motor" if plain else "general", name=f"{name}_motor", joint=name
        )
        if not plain:
            motor.set("gainprm", numbers(scale))
            motor.set("biastype", "affine")
            motor.set("biasprm", numbers(offset, 0.0, 0.0))
        if np.isfinite(limit):
            motor.set("ctrlrange", numbers(-limit, limit))


def _draw(parent: ElementTree.Element, end: np.ndarray) -> None:
    """A capsule from a body's origin to the next joint, for the eye only."""
    length = float(np.linalg.norm(end))
    if length > 1e-6:
        ElementTree.SubElement(
            parent,
            "geom",
            type="capsule",
            fromto=numbers(0.0, 0.0, 0.0, *end),
            size=numbers(THICKNESS * length),
            contype="0",
            conaffinity="0",
            mass="0",
        )


def _preamble(model: ExtendedModel, left_out: Sequence[str]) -> str:
    names = dict.fromkeys(effect.effect.name for effect in model.effects)
    rest = [name for name in names if name not in IN_URDF | IN_MJCF]
    missing = f" It leaves out {', '.join(rest)}: see effects.yaml." if rest else ""
    if left_out:
        missing += f" {'Nor has it' if rest else 'It leaves out'} {', '.join(left_out)}: only model.bdnn has."
    return f" Stands alone, without the URDF.{missing} "


def _name(urdf: str) -> str:
    return ElementTree.fromstring(urdf).get("name") or "robot"


def _quaternion(rotation: np.ndarray) -> str:
    x, y, z, w = pin.Quaternion(np.asarray(rotation)).coeffs()
    return numbers(w, x, y, z)
