"""Refuses a URDF whose moving links and joints have values that are not numbers or not physically possible.

URDF parsers ignore an <inertial> that they cannot read, and unexpanded xacro: links would silently have no mass, or be
missing.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from xml.parsers import expat

import numpy as np

from bdnn_ros.errors import RobotError

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
"""Numbers as URDF parsers accept them."""
NEGATIVE = 0.1
"""Published (estimated) inertias have principal moments down to minus this share of the largest,"""
NEGATIVE_SPREAD = 1e-6
"""or down to minus this per mass, where all of them are tiny [m²]."""
MOST = 1e9
"""Largest mass, inertia, coordinate or friction in SI units; a limit beyond counts as none."""
XACRO = re.compile(r"\{[^}]*xacro[^}]*\}")
"""Namespace prefix of xacro elements."""
UNDECLARED = re.compile(r"<xacro:([\w.-]+)")
"""A xacro element whose namespace is not declared."""
RUN_XACRO = "Run xacro first, and give what it writes."
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def refuse_impossible(urdf: str) -> None:
    """Checks masses, inertias and poses of moving links, and axes, limits and friction of all joints.

    Raises:
        RobotError: a value is missing, not a finite number, too large for a robot, or impossible; or xacro
            has not been run.
    """
    try:
        root = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        left = UNDECLARED.search(urdf)
        if left and expat.ErrorString(error.code) == expat.errors.XML_ERROR_UNBOUND_PREFIX:
            raise _unexpanded(left[1]) from None
        return  # reported when the model is built
    for element in root.iter():
        if XACRO.match(element.tag):
            raise _unexpanded(XACRO.sub("", element.tag))
    moved = _moved(root)
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None and link.get("name") in moved:
            _check_inertial(inertial, f"link {link.get('name')}")
    for joint in root.findall("joint"):
        _check_joint(joint, f"joint {joint.get('name')}")


def _unexpanded(name: str) -> RobotError:
    return RobotError(f"The robot description holds <xacro:{name}>, which xacro has not expanded.", RUN_XACRO)


def _moved(root: ElementTree.Element) -> set[str | None]:
    """Links that a joint moves, and those that are fixed to them."""
    joints = [(joint.get("type"), *_ends(joint)) for joint in root.findall("joint")]
    moved: set[str | None] = set()
    while True:
        found = {child for kind, parent, child in joints if kind != "fixed" or parent in moved}
        if found <= moved:
            return moved
        moved |= found


def _ends(joint: ElementTree.Element) -> tuple[str | None, str | None]:
    """Names of the links that a joint connects."""
    parent, child = (joint.find(tag) for tag in ("parent", "child"))
    return (None if parent is None else parent.get("link"), None if child is None else child.get("link"))


def _check_inertial(inertial: ElementTree.Element, owner: str) -> None:
    _check_origin(inertial, owner)
    mass = _needed(inertial, "mass", ("value",), owner)[0]
    if mass < 0.0:
        raise RobotError(f"The mass of {owner} is negative (value={mass:g} kg).", "Correct the URDF.")
    ixx, ixy, ixz, iyy, iyz, izz = _needed(inertial, "inertia", MOMENTS, owner)
    moments = np.linalg.eigvalsh([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    if moments[0] < -(NEGATIVE * max(moments[-1], 0.0) + NEGATIVE_SPREAD * mass):
        diagonal = {"ixx": ixx, "iyy": iyy, "izz": izz}
        named = [f"{key}={value:g}" for key, value in diagonal.items() if value < 0.0]
        raise RobotError(
            f"The <inertia> of {owner} ({', '.join(named) or 'ixx to izz'}) has a negative principal moment, "
            f"{moments[0]:.3g} kg*m^2, as no body can.",
            "Correct the URDF.",
        )


def _check_joint(joint: ElementTree.Element, owner: str) -> None:
    _check_origin(joint, owner)
    if joint.get("type") == "fixed":
        return
    axis = joint.find("axis")
    if axis is not None and axis.get("xyz") is not None and not any(_numbers(axis, "xyz", owner, 3)):
        raise RobotError(
            f'The <axis> of {owner} has xyz="{axis.get("xyz")}", which is no direction.',
            "Name the axis that it turns about or slides along, for example 0 0 1.",
        )
    # a continuous joint's range is not read
    bounds = () if joint.get("type") == "continuous" else ("lower", "upper")
    for tag, keys in (("limit", (*bounds, "effort", "velocity")), ("dynamics", ("damping", "friction"))):
        element = joint.find(tag)
        for key in keys:
            if element is not None and element.get(key) is not None:
                _numbers(element, key, owner, most=math.inf if tag == "limit" else MOST)


def _check_origin(element: ElementTree.Element, owner: str) -> None:
    origin = element.find("origin")
    for key in ("xyz", "rpy"):
        if origin is not None and origin.get(key) is not None:
            _numbers(origin, key, owner, 3)


def _needed(inertial: ElementTree.Element, tag: str, keys: tuple[str, ...], owner: str) -> list[float]:
    """Attributes of a part of an <inertial>, one number each."""
    element = inertial.find(tag)
    missing = [key for key in keys if element is None or element.get(key) is None]
    if element is None or missing:
        raise RobotError(
            f"The <{tag}> of {owner} lacks {', '.join(missing)}: the link would count as massless.",
            "Complete its <inertial>, or take it away.",
        )
    return [_numbers(element, key, owner)[0] for key in keys]


def _numbers(
    element: ElementTree.Element, key: str, owner: str, count: int = 1, most: float = MOST
) -> list[float]:
    """The numbers of an attribute: one, which parsers read behind spaces but not before them, or some with spaces between."""
    text = element.get(key, "")
    parts = [text.lstrip()] if count == 1 else text.split()
    if len(parts) == count and all(NUMBER.fullmatch(part) for part in parts):
        values = [float(part) for part in parts]
        if all(map(math.isfinite, values)):
            _refuse_beyond(element, key, owner, values, most)
            return values
    wanted = "a finite number" if count == 1 else f"{count} finite numbers"
    raise RobotError(f'The <{element.tag}> of {owner} has {key}="{text}", not {wanted}.', _remedy(text))


def _refuse_beyond(
    element: ElementTree.Element, key: str, owner: str, values: list[float], most: float
) -> None:
    if max(map(abs, values)) > most:
        raise RobotError(
            f'The <{element.tag}> of {owner} has {key}="{element.get(key)}", as no robot has.',
            "Correct the URDF; its units are kg, m, rad and s.",
        )


def _remedy(text: str) -> str:
    """What to do about a text that is not a number."""
    if "$" in text:
        return RUN_XACRO
    return "Write a point, not a comma." if "," in text else "Correct the URDF."
