"""Reads a URDF for Pinocchio."""

from __future__ import annotations

import os
import re
import tempfile
import threading
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import IO

import numpy as np
import pinocchio as pin

from bdnn_ros.errors import RobotError, listed
from bdnn_ros.robot.arrays import ReadOnlyArrays
from bdnn_ros.robot.mimics import mimicking

OPEN_VELOCITY = 2.0
"""Usual velocity of a joint without a velocity limit [rad/s] ([m/s])."""
UNLIMITED = 1e9
"""Magnitude (SI units) from which a limit counts as none; given to Pinocchio as position limit of continuous joints."""
FREE = {"planar", "floating"}
"""Joint types with more than one degree of freedom."""
Held = Mapping[str, float]
"""Positions of joints that do not move [rad] ([m]), by name."""
NONE_HELD: Held = MappingProxyType({})
WHERE = re.compile(rb" +at line \d+ in ")
"""What the URDF parser appends to a complaint."""
_STDERR = threading.Lock()
"""Held while the process's stderr is redirected."""


@dataclass(frozen=True)
class Limits(ReadOnlyArrays):
    """Limits of each joint by the URDF, (n,) each, infinite where it gives none; read-only."""

    READ_ONLY = ("lower", "upper", "velocity", "effort")

    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray

    @property
    def usual_velocity(self) -> np.ndarray:
        """Velocity limits, or `OPEN_VELOCITY` where there is none, (n,) [rad/s] ([m/s])."""
        return np.where(np.isfinite(self.velocity), self.velocity, OPEN_VELOCITY)

    @property
    def usual_range(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions that joints usually reach, (n,) each [rad] ([m]): the limits, but at most half a turn each way from zero.

        If the limits exclude zero: at most a turn about their middle, or from the only limit there is.
        """
        lower, upper = np.maximum(self.lower, -np.pi), np.minimum(self.upper, np.pi)
        for joint in np.flatnonzero((self.lower > 0.0) | (self.upper < 0.0)):
            low, high = self.lower[joint], self.upper[joint]
            least = high - 2.0 * np.pi if np.isinf(low) else low
            most = least + 2.0 * np.pi if np.isinf(high) else high
            middle, half = 0.5 * (least + most), min(0.5 * (most - least), np.pi)
            lower[joint], upper[joint] = middle - half, middle + half
        return lower, upper


def limits_of(model: pin.Model, order: np.ndarray) -> Limits:
    """The limits of a model's joints.

    Args:
        order: velocity index of each joint, (n,).
    """
    lower, upper = model.lowerPositionLimit[order], model.upperPositionLimit[order]
    velocity, effort = model.velocityLimit[order], model.effortLimit[order]
    return Limits(
        lower=np.where(lower > -UNLIMITED, lower, -np.inf),
        upper=np.where(upper < UNLIMITED, upper, np.inf),
        velocity=np.where((velocity > 0.0) & (velocity < UNLIMITED), velocity, np.inf),
        effort=np.where((effort > 0.0) & (effort < UNLIMITED), effort, np.inf),
    )


def model_of(urdf: str, joints: tuple[str, ...], held: Held) -> tuple[pin.Model, tuple[str, ...]]:
    """Pinocchio's model of a URDF, and the names of its joints.

    Args:
        urdf: the XML text.
        joints: movable joints of one degree of freedom to keep; empty keeps all but those that mimic another.
        held: where others are held [rad] ([m]); the rest is at zero, or at the nearest limit.

    Raises:
        RobotError: the text is not a usable URDF, lacks a joint, or that has more than one degree of freedom.
    """
    if not urdf.strip():
        raise RobotError("The robot description is empty.", "Check who writes it.")
    full = _parsed(urdf).copy()
    free = free_joints(urdf)
    movable = tuple(name for name in full.names[1:] if name not in free)
    if {*free} & {*joints} or (free and not movable):
        refuse_free(urdf)
    mimics = mimicking(urdf)
    names = joints or tuple(name for name in movable if name not in mimics) or movable
    missing = [name for name in names if name not in movable]
    if not movable:
        raise RobotError("The URDF has no movable joint.", "Use the URDF of this robot.")
    if missing or not names:
        raise RobotError(
            f"The URDF has no movable joint {listed(missing)}; it has {listed(movable, 20)}.",
            "Use the URDF of this robot, or joints that it has.",
        )
    lock = [full.getJointId(name) for name in full.names[1:] if name not in names]
    if lock:
        rest = np.clip(pin.neutral(full), full.lowerPositionLimit, full.upperPositionLimit)
        for name in set(held) & set(movable):
            rest[full.idx_qs[full.getJointId(name)]] = held[name]
        full = _without(full, lock, rest)
    return full, tuple(names)


@lru_cache(maxsize=4)
def _parsed(urdf: str) -> pin.Model:
    """Pinocchio's model with all joints, only to be copied: robots of other parameters are of the same description.

    Raises:
        RobotError: the text is not a usable URDF.
    """
    said: list[str] = []
    try:
        with _overheard(said):
            return pin.buildModelFromXML(_bounded(urdf))
    except (ValueError, RuntimeError, ElementTree.ParseError) as error:
        reasons = [*said, *str(error).strip().splitlines(), "no reason given"]
        raise RobotError(
            f"The robot description is not a usable URDF ({reasons[0].rstrip('.')}).",
            "Check it with check_urdf.",
        ) from None
    except OSError as error:
        raise RobotError(
            f"The robot description cannot be read ({error.strerror or error}).",
            "Have other programs leave it files and memory.",
        ) from None


def free_joints(urdf: str) -> list[str]:
    """Joints of more than one degree of freedom; they are held in their described pose."""
    return [str(joint.get("name")) for joint in _read(urdf).findall("joint") if joint.get("type") in FREE]


def refuse_free(urdf: str) -> None:
    """Refuses a URDF with joints of more than one degree of freedom, for callers that do not name the joints they mean.

    Raises:
        RobotError: there is one.
    """
    free = free_joints(urdf)
    if free:
        raise RobotError(
            f"The URDF has joints of more than one degree of freedom ({listed(free)}), and only where others are named "
            "(--joints) are they held still.",
            "Name those of a fixed-base arm with --joints (the node: parameter joints).",
        )


def _without(model: pin.Model, lock: list[int], rest: np.ndarray) -> pin.Model:
    """The model with some joints locked where they rest.

    Pinocchio asks for the frame of a joint by its name alone, and refuses where a link has the same one: such links
    have another name meanwhile.
    """
    tail = "_" * max(len(frame.name) for frame in model.frames)
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.name in model.names:
            frame.name += tail
    reduced = pin.buildReducedModel(model, lock, rest)
    for frame in reduced.frames:
        frame.name = frame.name.removesuffix(tail)
    return reduced


def _unnamed() -> IO[bytes]:
    """An anonymous file: in memory, as the disk may be full or read-only; on disk where the system has no memory files.

    Raises:
        OSError: no file is available.
    """
    if hasattr(os, "memfd_create"):
        return open(os.memfd_create("bdnn_complaints"), "w+b")
    return tempfile.TemporaryFile()


@contextmanager
def _overheard(said: list[str]) -> Iterator[None]:
    """Collects the URDF parser's complaints, which it writes to the process's stderr instead of raising.

    What others write to stderr meanwhile is passed on afterwards.
    """
    with _STDERR, _unnamed() as heard:
        stderr = os.dup(2)
        os.dup2(heard.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            heard.seek(0)
            lines = heard.readlines()
            mine = [line for line in lines if line.startswith(b"Error:")]
            said += [line.decode(errors="replace").removeprefix("Error:").strip() for line in mine]
            others = b"".join(line for line in lines if line not in mine and not WHERE.match(line))
            with suppress(OSError):  # stderr may be closed
                os.write(2, others)


def _bounded(urdf: str) -> str:
    """The URDF with continuous joints turned into revolute ones without limits, so each has one angle."""
    root = ElementTree.fromstring(urdf)
    if root.tag != "robot":
        raise ValueError(f"the root element is <{root.tag}>, not <robot>")
    for joint in root.iter("joint"):
        if joint.get("type") != "continuous":
            continue
        joint.set("type", "revolute")
        limit = joint.find("limit")
        if limit is None:
            limit = ElementTree.SubElement(joint, "limit", effort="0", velocity="0")
        limit.set("lower", str(-UNLIMITED))
        limit.set("upper", str(UNLIMITED))
    return ElementTree.tostring(root, encoding="unicode")


def inertia_of(parameters: np.ndarray) -> pin.Inertia:
    """The inertia of a body by its parameters (10,): m, m·c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz at the origin."""
    mass, (xx, xy, yy, xz, yz, zz) = parameters[0], parameters[4:]
    if mass != 0.0:
        return pin.Inertia.FromDynamicParameters(np.asarray(parameters, float))
    # without mass there is no centre of mass to divide out
    return pin.Inertia(0.0, np.zeros(3), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))


def link_inertia(urdf: str, link: str) -> pin.Inertia:
    """The <inertial> of a link, in its frame; zero where it has none."""
    body = _named(urdf, "link", link)
    element = None if body is None else body.find("inertial")
    if element is None:
        return pin.Inertia.Zero()

    def numbers(tag: str, key: str, default: str) -> np.ndarray:
        found = element.find(tag)
        return np.array([float(x) for x in (default if found is None else found.get(key, default)).split()])

    ixx, ixy, ixz, iyy, iyz, izz = (
        numbers("inertia", key, "0")[0] for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    rotation = pin.rpy.rpyToMatrix(numbers("origin", "rpy", "0 0 0"))
    centre = numbers("origin", "xyz", "0 0 0")
    # the constructor refuses estimates with a moment just below zero, which URDFs of real robots hold
    inertia = pin.Inertia.Zero()
    inertia.mass, inertia.lever = float(numbers("mass", "value", "0")[0]), centre
    inertia.inertia = rotation @ tensor @ rotation.T
    return inertia


def child_link(urdf: str, joint: str) -> str | None:
    """The link that a joint moves; None where there is no such joint."""
    element = _named(urdf, "joint", joint)
    child = None if element is None else element.find("child")
    return None if child is None else child.get("link")


def _named(urdf: str, tag: str, name: str) -> ElementTree.Element | None:
    """A child of the robot element by tag and name, whatever characters the name contains."""
    elements = _read(urdf).findall(tag)
    return next((element for element in elements if element.get("name") == name), None)


@lru_cache(maxsize=4)
def _read(urdf: str) -> ElementTree.Element:
    """The parsed robot element, cached and not to be modified."""
    return ElementTree.fromstring(urdf)


def joint_tags(urdf: str, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Damping [N·m·s/rad] and friction [N·m] of some joints by their <dynamics> tags, (n,) each; zero without one."""
    tags = {str(joint.get("name")): joint.find("dynamics") for joint in _read(urdf).findall("joint")}

    def number(joint: str, key: str) -> float:
        dynamics = tags.get(joint)
        return 0.0 if dynamics is None else float(dynamics.get(key, "0"))

    damping, friction = (
        np.array([number(joint, key) for joint in joints]) for key in ("damping", "friction")
    )
    return damping, friction
