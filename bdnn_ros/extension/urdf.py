"""extended.urdf: the changes of an extended model written into its URDF, whose other text stays unchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from bdnn_ros.effects.environment import COMPONENTS
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.effects.rigid import POINT, payload_parameters
from bdnn_ros.errors import UsageError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.urdf_text import Element, UrdfText, tag
from bdnn_ros.physical.consistency import feasible
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mounting import tilt_of
from bdnn_ros.robot.urdf import inertia_of, link_inertia

IN_URDF = frozenset({"payload", "link_inertia", "base_tilt", "coulomb_friction", "viscous_friction"})
"""Effects that a URDF can carry."""
WORLD = "world"
"""A root link of this name simulators hold in place; one above it would let it fall."""
SAME = 1e-12
"""Inertial parameters that differ by less than this share of the body's are not written again."""


@dataclass(frozen=True)
class Joints:
    """Joint parameters of a model, (n,) each; units as in `Robot`."""

    armature: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray


def joints_of(model: ExtendedModel) -> Joints:
    """Armature, viscous and Coulomb friction including the effects of these names."""
    robot = model.robot
    coulomb = robot.coulomb.copy()
    for effect in named(model, "coulomb_friction"):
        coulomb[effect.target] += effect.values["coulomb"]
    return Joints(robot.armature, robot.viscous, coulomb)


def named(model: ExtendedModel, name: str) -> list[Installed]:
    """The model's effects of one name."""
    return [effect for effect in model.effects if effect.effect.name == name]


def upright(robot: Robot) -> np.ndarray:
    """Rotation of the base (3, 3) that makes the robot's gravity vertical."""
    roll, pitch = tilt_of(robot.gravity_vector)
    return np.asarray(pin.rpy.rpyToMatrix(roll, pitch, 0.0))


def beside_urdf(model: ExtendedModel) -> list[Installed]:
    """The effects that an extended URDF cannot express; the robot's own armature becomes one of them."""
    armature = joints_of(model).armature
    rotors = [
        Installed(get("armature"), joint, None, {"armature": float(value)})
        for joint, value in enumerate(armature)
        if value
    ]
    rest = [e for e in model.effects if e.effect.name not in IN_URDF and e.effect.name != "armature"]
    return [*rotors, *(_from_level(effect, model.robot) for effect in rest)]


def _from_level(effect: Installed, robot: Robot) -> Installed:
    """An effect for a robot described from a level base: pushes on links are along that base's axes."""
    if COMPONENTS[0] not in effect.values:
        return effect
    wrench = np.reshape([effect.values[c] for c in COMPONENTS], (2, 3)) @ upright(robot).T
    return replace(
        effect, values={**effect.values, **dict(zip(COMPONENTS, wrench.ravel().tolist(), strict=True))}
    )


def extended_urdf(model: ExtendedModel) -> str:
    """The model's URDF with corrected inertials, payloads, friction tags, zeros and the base's tilt."""
    document = UrdfText(model.robot.urdf)
    _write_bodies(document, model)
    _write_friction(document, model)
    _write_origins(document, model.robot)
    _write_tilt(document, model.robot.gravity_vector)
    return document.text()


def _write_bodies(document: UrdfText, model: ExtendedModel) -> None:
    robot = model.robot
    nominal = Robot.from_urdf(model.robot.urdf, model.joints, dict(model.robot.held))
    wanted = links_of(model)
    members: dict[int, dict[str, np.ndarray]] = {i: {} for i in range(robot.width)}
    for link in robot.links:
        try:
            body, rotation, translation = nominal.body_of(link)
        except UsageError:
            continue  # it does not move
        inertia = link_inertia(model.robot.urdf, link)
        members[body][link] = np.array(pin.SE3(rotation, translation).act(inertia).toDynamicParameters())
    for body, joint in enumerate(model.joints):
        _write_body(document, model, robot.moving_link(joint), members[body], wanted[body])
    for effect in _carried(model):
        _write_payload(document, effect)


def _write_body(
    document: UrdfText, model: ExtendedModel, own: str, links: dict[str, np.ndarray], wanted: np.ndarray
) -> None:
    """Inertials of the links of one body, so that they add up to the wanted parameters (PER_LINK,).

    Scaled links are scaled, and the moving link takes the rest of the change. If its inertia would become impossible, it
    takes the whole body's, and the links fixed to it lose theirs.
    """
    scales = {str(e.link): e.values["scale"] for e in named(model, "link_inertia") if e.link in links}
    others = {link: scales.get(link, 1.0) * values for link, values in links.items() if link != own}
    new = wanted - sum(others.values(), np.zeros_like(wanted))
    if np.abs(new - links[own]).max() <= SAME * np.abs(wanted).max():
        new = links[own]
    elif any(values.any() for values in others.values()) and not feasible(new[None]):
        new, scales = wanted, {link: 0.0 for link, values in others.items() if values.any()}
    if new is not links[own]:
        _write_inertial(document, own, pin.Inertia.FromDynamicParameters(new))
    for link, scale in scales.items():
        if link != own:
            old = link_inertia(model.robot.urdf, link)
            _write_inertial(document, link, inertia_of(scale * old.toDynamicParameters()))


def _write_inertial(document: UrdfText, link: str, inertia: pin.Inertia) -> None:
    """Write the link's <inertial>, or remove it if nothing is left."""
    text = _inertial(inertia) if inertia.mass > 0.0 else ""
    document.put(document.named("link", link), "inertial", text)


def _inertial(inertia: pin.Inertia) -> str:
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = inertia.inertia
    return tag(
        "inertial",
        tag("origin", xyz=inertia.lever.tolist(), rpy="0 0 0"),
        tag("mass", value=inertia.mass),
        tag("inertia", ixx=ixx, ixy=ixy, ixz=ixz, iyy=iyy, iyz=iyz, izz=izz),
    )


def _carried(model: ExtendedModel) -> list[Installed]:
    """The payloads; mass that an earlier model had and that is gone is taken from the links themselves."""
    return [effect for effect in named(model, "payload") if effect.values["mass"] > 0.0]


def links_of(model: ExtendedModel) -> np.ndarray:
    """Inertial parameters of the moving links in the URDF, where payloads are links of their own, (n, PER_LINK)."""
    links = model.robot.inertials.copy()
    for effect in _carried(model):
        coefficients, shape = effect.effect.coefficients(effect.values)
        body, parameters = payload_parameters(model.robot.body_of(str(effect.link)), shape)
        links[body] -= parameters @ coefficients[:POINT]
    return links


def _write_payload(document: UrdfText, effect: Installed) -> None:
    """Add a point mass as a link of its own, fixed at its centre of mass."""
    mass, centre = effect.values["mass"], [effect.values[f"com_{axis}"] for axis in "xyz"]
    link = document.free_name("link", f"{effect.link}_payload")
    point = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    document.append(document.robot, tag("link", _inertial(point), name=link))
    _write_fixed_joint(document, f"{link}_joint", str(effect.link), link, centre, [0.0, 0.0, 0.0])


def _write_fixed_joint(
    document: UrdfText, name: str, parent: str, child: str, xyz: Sequence[float], rpy: Sequence[float]
) -> None:
    joint = tag(
        "joint",
        tag("parent", link=parent),
        tag("child", link=child),
        tag("origin", xyz=list(xyz), rpy=list(rpy)),
        name=document.free_name("joint", name),
        type="fixed",
    )
    document.append(document.robot, joint)


def _write_friction(document: UrdfText, model: ExtendedModel) -> None:
    nominal, joints = (
        Robot.from_urdf(model.robot.urdf, model.joints, dict(model.robot.held)),
        joints_of(model),
    )
    for k, name in enumerate(model.joints):
        same = joints.viscous[k] == nominal.viscous[k] and joints.coulomb[k] == nominal.coulomb[k]
        if same:
            continue
        joint = document.named("joint", name)
        old = joint.child("dynamics")
        attributes: dict[str, object] = dict(old.attributes) if old else {}
        attributes |= {"damping": joints.viscous[k], "friction": joints.coulomb[k]}
        document.put(joint, "dynamics", tag("dynamics", **attributes))


def _write_origins(document: UrdfText, robot: Robot) -> None:
    """Move the origins of joints with corrected zeros, and of bodies that stand on a tilted world."""
    zeros = dict(
        zip(robot.joints, zip(robot.zeros.tolist(), robot.slides.tolist(), strict=True), strict=True)
    )
    turn = upright(robot) if document.root_link() == WORLD else np.eye(3)
    for joint in document.elements("joint"):
        zero, slides = zeros.get(joint.name, (0.0, False))
        turned = _parent(joint) == WORLD and not np.array_equal(turn, np.eye(3))
        if zero == 0.0 and not turned:
            continue
        rotation, xyz = _origin(joint)
        if zero:  # a fixed joint may have an axis of nothing
            axis = _vector(joint.child("axis"), "xyz", "1 0 0")
            back = -zero * axis / np.linalg.norm(axis)
            xyz, rotation = (xyz + rotation @ back, rotation) if slides else (xyz, rotation @ pin.exp3(back))
        if turned:
            rotation, xyz = turn @ rotation, turn @ xyz
        rpy = pin.rpy.matrixToRpy(rotation).tolist()
        document.put(joint, "origin", tag("origin", xyz=xyz.tolist(), rpy=rpy))


def _origin(joint: Element) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and translation (3,) [m] of a joint in its parent's frame."""
    origin = joint.child("origin")
    rotation = pin.rpy.rpyToMatrix(*_vector(origin, "rpy", "0 0 0"))
    return rotation, _vector(origin, "xyz", "0 0 0")


def _vector(element: Element | None, key: str, default: str) -> np.ndarray:
    return np.array((element.attributes.get(key, default) if element else default).split(), float)


def _parent(joint: Element) -> str | None:
    parent = joint.child("parent")
    return None if parent is None else parent.attributes.get("link")


def _write_tilt(document: UrdfText, gravity_vector: np.ndarray) -> None:
    """Add a level link under the base, which is turned by Ry(pitch)·Rx(roll); a link `world` itself stays level."""
    roll, pitch = tilt_of(gravity_vector)
    root = document.root_link()
    if root == WORLD or (roll == 0.0 and pitch == 0.0):
        return
    level = document.free_name("link", "level")
    document.append(document.robot, tag("link", name=level))
    _write_fixed_joint(document, f"{level}_to_base", level, root, [0.0, 0.0, 0.0], [roll, pitch, 0.0])
