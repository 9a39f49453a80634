"""Geometry of an unknown serial chain, and the derivative of its effort with respect to the axes."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from bdnn_ros.robot import PER_LINK, STANDARD_GRAVITY
from bdnn_ros.written import numbers

REACH = 0.3
"""Typical distance between axes of a chain to start from [m]."""


@dataclass(frozen=True)
class Kinematics:
    """Pose of each joint's frame in that of the joint before, at zero angle; every axis is z.

    Attributes:
        rotations: (n, 3, 3).
        translations: (n, 3) [m].
    """

    rotations: np.ndarray
    translations: np.ndarray

    @classmethod
    def random(cls, n: int, rng: np.random.Generator) -> Kinematics:
        """Axes in random directions."""
        quaternions = rng.normal(size=(n, 4))
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        rotations = np.array([pin.Quaternion(*row).toRotationMatrix() for row in quaternions])
        return cls(rotations, REACH * rng.normal(size=(n, 3)))

    def __len__(self) -> int:
        return len(self.rotations)

    def moved(self, twists: np.ndarray) -> Kinematics:
        """Every joint's frame moved by a twist in its own frame, (6n,), linear over angular parts."""
        placements = [
            pin.SE3(rotation, translation) * pin.exp6(twist)
            for rotation, translation, twist in zip(
                self.rotations, self.translations, twists.reshape(-1, 6), strict=True
            )
        ]
        return Kinematics(
            np.array([m.rotation for m in placements]), np.array([m.translation for m in placements])
        )

    def regressor(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Y with the bodies' effort = Y · inertials, (N, n, n · PER_LINK), for motions (N, n)."""
        model = self._model(None, loose=False)
        data = model.createData()
        result = np.empty((*position.shape, PER_LINK * len(self)))
        for k, row in enumerate(zip(position, velocity, acceleration, strict=True)):
            result[k] = pin.computeJointTorqueRegressor(model, data, *row)
        return result

    def jacobian(
        self, inertials: np.ndarray, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Derivative of the bodies' effort by the twists of `moved`, (N, n, 6n).

        A joint of six degrees of freedom before each real one, held at rest, makes a twist a coordinate: then
        it is the derivative of the inverse dynamics by position.

        Args:
            inertials: (n, PER_LINK); masses may be negative while a fit goes on.
        """
        least = min(float(np.cumsum(inertials[::-1, 0]).min()), float(inertials[:, 0].min()))
        if least >= 1e-3:
            return self._jacobian(inertials, position, velocity, acceleration)
        # Pinocchio divides by sums of masses; the effort is linear in them: add bodies, then take them off
        added = np.zeros_like(inertials)
        added[:, 0] = 1.0 - least
        added[:, [4, 6, 9]] = 1e-3
        total = self._jacobian(inertials + added, position, velocity, acceleration)
        return total - self._jacobian(added, position, velocity, acceleration)

    def _jacobian(
        self, inertials: np.ndarray, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        model = self._model(inertials, loose=True)
        data = model.createData()
        n = len(self)
        real = 7 * np.arange(n) + 6
        loose = (7 * np.arange(n)[:, None] + np.arange(6)).ravel()
        q = np.tile(pin.neutral(model), (len(position), 1))
        v, a = np.zeros((len(position), model.nv)), np.zeros((len(position), model.nv))
        q[:, 8 * np.arange(n) + 7], v[:, real], a[:, real] = position, velocity, acceleration
        result = np.empty((len(position), n, 6 * n))
        for k in range(len(position)):
            pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
            result[k] = data.dtau_dq[real][:, loose]
        return result

    def _model(self, inertials: np.ndarray | None, loose: bool) -> pin.Model:
        model = pin.Model()
        model.gravity.linear = np.array(STANDARD_GRAVITY)
        parent = 0
        for i, (rotation, translation) in enumerate(zip(self.rotations, self.translations, strict=True)):
            placement = pin.SE3(rotation, translation)
            if loose:
                parent = model.addJoint(parent, pin.JointModelFreeFlyer(), placement, f"loose{i}")
                placement = pin.SE3.Identity()
            parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"joint{i}")
            if inertials is not None:
                body = pin.Inertia.FromDynamicParameters(inertials[i])
                model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        return model

    def urdf(self, joints: Sequence[str], inertials: np.ndarray) -> str:
        """A URDF of the chain with feasible inertials (n, PER_LINK); links are named after their joints."""
        robot = ElementTree.Element("robot", name="learned_chain")
        ElementTree.SubElement(robot, "link", name="base_of_" + joints[0])
        for i, joint in enumerate(joints):
            link = ElementTree.SubElement(robot, "link", name="link_of_" + joint)
            _write_inertial(link, inertials[i])
            element = ElementTree.SubElement(robot, "joint", name=joint, type="continuous")
            parent = f"link_of_{joints[i - 1]}" if i else "base_of_" + joint
            ElementTree.SubElement(element, "parent", link=parent)
            ElementTree.SubElement(element, "child", link="link_of_" + joint)
            rpy = pin.rpy.matrixToRpy(self.rotations[i])
            ElementTree.SubElement(element, "origin", xyz=numbers(*self.translations[i]), rpy=numbers(*rpy))
            ElementTree.SubElement(element, "axis", xyz="0 0 1")
        ElementTree.indent(robot)
        return ElementTree.tostring(robot, encoding="unicode")


def _write_inertial(link: ElementTree.Element, parameters: np.ndarray) -> None:
    inertia = pin.Inertia.FromDynamicParameters(parameters)
    tensor = np.array(inertia.inertia)
    element = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(element, "origin", xyz=numbers(*np.array(inertia.lever)), rpy="0 0 0")
    ElementTree.SubElement(element, "mass", value=numbers(inertia.mass))
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    values = {name: numbers(tensor[place]) for name, place in entries.items()}
    ElementTree.SubElement(element, "inertia", values)
