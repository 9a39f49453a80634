"""The rigid-body robot of a URDF: inverse dynamics, mass matrix, regressor, limits (by Pinocchio)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from pathlib import Path
from threading import get_ident

import numpy as np
import pinocchio as pin

from bdnn_ros.errors import UsageError, listed
from bdnn_ros.robot.arrays import ReadOnlyArrays, fitting
from bdnn_ros.robot.mounting import STANDARD_GRAVITY, gravity_of, turned_back, zeros_of
from bdnn_ros.robot.rows import regressors, rnea, rnea_derivatives
from bdnn_ros.robot.urdf import (
    NONE_HELD,
    Held,
    Limits,
    child_link,
    inertia_of,
    joint_tags,
    limits_of,
    model_of,
)
from bdnn_ros.robot.urdf_file import bundled_text, text_of
from bdnn_ros.robot.urdf_values import refuse_impossible

PER_LINK = 10
"""Inertial parameters of a link: m, m·c (3), then Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the frame's origin."""


@dataclass(frozen=True)
class Robot(ReadOnlyArrays):
    """A fixed-base robot with n joints of one degree of freedom each; its arrays are read-only, any threads may share it.

    Attributes:
        urdf: the description's text.
        joints: n joint names, the order of every array.
        inertials: inertial parameters of the n moving bodies, (n, PER_LINK); a body is a link with everything
            fixed to it; body i moves with joint i.
        armature, viscous, coulomb: per joint, (n,) [kg·m²], [N·m·s/rad], [N·m]; URDFs give the last two only.
        zeros: reported position of each joint at its true zero, (n,) [rad] ([m]).
        gravity_vector: acceleration of gravity in the base frame, (3,) [m/s²].
        held: positions of other joints of the URDF [rad] ([m]); the rest are at zero, or at the nearest limit.
    """

    READ_ONLY = ("inertials", "armature", "viscous", "coulomb", "zeros", "gravity_vector")

    urdf: str
    joints: tuple[str, ...]
    inertials: np.ndarray
    armature: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    limits: Limits
    zeros: np.ndarray
    gravity_vector: np.ndarray = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    held: tuple[tuple[str, float], ...] = ()

    @classmethod
    def from_urdf(cls, urdf: str, joints: Sequence[str] = (), held: Held = NONE_HELD) -> Robot:
        """A robot from a URDF's text.

        Args:
            urdf: the XML text.
            joints: joints to keep, in this order; empty: all but those that mimic another, in the tree's order.
            held: positions of the others [rad] ([m]).

        Raises:
            RobotError: the text is not a usable URDF, lacks a joint, or holds what no robot can have.
        """
        refuse_impossible(urdf)
        model, names = model_of(urdf, tuple(joints), held)
        order = np.array([model.idx_vs[model.getJointId(name)] for name in names])
        inertials = np.array([model.inertias[model.getJointId(name)].toDynamicParameters() for name in names])
        none, tags, limits = np.zeros(len(names)), joint_tags(urdf, names), limits_of(model, order)
        return cls(urdf, names, inertials, none, *tags, limits, none, held=tuple(held.items()))

    @classmethod
    def from_file(cls, path: str | Path, joints: Sequence[str] = ()) -> Robot:
        """A robot from a URDF file; see `from_urdf`."""
        return cls.from_urdf(text_of(path), joints)

    @classmethod
    def bundled(cls, name: str, joints: Sequence[str] = ()) -> Robot:
        """One of the robots bundled with the package, by name.

        Raises:
            UsageError: there is none of that name.
        """
        return cls.from_urdf(bundled_text(name), joints)

    @property
    def width(self) -> int:
        """Number of joints n."""
        return len(self.joints)

    @cached_property
    def _model(self) -> pin.Model:
        model, _ = model_of(self.urdf, self.joints, dict(self.held))
        for name, values, zero in zip(self.joints, self.inertials, self.zeros, strict=True):
            joint = model.getJointId(name)
            model.inertias[joint] = inertia_of(values)
            model.jointPlacements[joint] = turned_back(model, joint, zero)
        model.armature[:] = 0.0
        model.gravity.linear = np.asarray(self.gravity_vector)
        return model

    @property
    def _data(self) -> pin.Data:
        return self._memory[get_ident()]

    @cached_property
    def _memory(self) -> dict[int, pin.Data]:
        """Pinocchio's working memory, one per thread, so that no thread reads another's results."""
        return defaultdict(self._model.createData)

    @cached_property
    def _order(self) -> np.ndarray:
        """Pinocchio's velocity index of each joint, (n,): the joint's number in Pinocchio minus one."""
        return np.array([self._model.idx_vs[self._model.getJointId(name)] for name in self.joints])

    @cached_property
    def _from_pinocchio(self) -> np.ndarray:
        """Our index of each of Pinocchio's velocity entries, (n,)."""
        return np.argsort(self._order)

    def _in_order(self, values: np.ndarray, *axes: int) -> np.ndarray:
        """Values with Pinocchio's joint order along some axes, in our order; not copied if they agree."""
        alike = (np.diff(self._order) == 1).all()
        return values if alike else reduce(lambda v, axis: np.take(v, self._order, axis), axes, values)

    def pinocchio_model(self) -> tuple[pin.Model, np.ndarray]:
        """A copy of Pinocchio's model of the bodies, and its velocity index of each joint, (n,)."""
        return self._model.copy(), self._order.copy()

    def __getstate__(self) -> dict[str, object]:
        return {key: value for key, value in self.__dict__.items() if not key.startswith("_")}

    def rigid_effort(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """M q̈ + C q̇ + g of the bodies, without armature or friction, (..., n) [N·m]."""
        rows, shape = self._rows(position, velocity, acceleration)
        return rnea(self._model, self._data, rows)[:, self._order].reshape(shape)

    def drive_effort(
        self, velocity: np.ndarray, acceleration: np.ndarray, direction: np.ndarray
    ) -> np.ndarray:
        """Effort for rotor inertia and friction, before the gear, (..., n) [N·m].

        Args:
            direction: of each joint, -1 to 1; values in between during a reversal.
        """
        v, a, way = fitting(self.width, velocity, acceleration, direction)
        return self.armature * a + self.viscous * v + self.coulomb * way

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Effort of bodies, armature and friction, (..., n) [N·m]."""
        drive = self.drive_effort(velocity, acceleration, np.sign(velocity))
        return self.rigid_effort(position, velocity, acceleration) + drive

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Acceleration under an effort, (..., n) [rad/s²]."""
        q, v, u = fitting(self.width, position, velocity, effort)
        drive = u - self.rigid_effort(q, v, np.zeros_like(q)) - self.friction(q, v)
        return np.linalg.solve(self.mass_matrix(q), drive[..., None])[..., 0]

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q) with armature on its diagonal, (..., n, n) [kg·m²]."""
        ((q,), shape), model, data = self._rows(position), self._model, self._data
        upper = np.array([pin.crba(model, data, row) for row in q]).reshape(-1, self.width, self.width)
        full = np.triu(upper) + np.swapaxes(np.triu(upper, 1), -1, -2)
        full = self._in_order(full, 1, 2) + np.diag(self.armature)
        return full.reshape(*shape, self.width)

    def gravity(self, position: np.ndarray) -> np.ndarray:
        """g(q), (..., n) [N·m]."""
        rest = np.zeros_like(position)
        return self.rigid_effort(position, rest, rest)

    def coriolis(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """C(q, q̇) q̇, (..., n) [N·m]."""
        return self.rigid_effort(position, velocity, np.zeros_like(position)) - self.gravity(position)

    def friction(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Viscous and Coulomb friction, (..., n) [N·m]."""
        _, v = fitting(self.width, position, velocity)
        return self.viscous * v + self.coulomb * np.sign(v)

    def regressor(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Y with rigid_effort = Y · inertials.ravel(), (N, n, n * PER_LINK), for (N, n) arrays."""
        rows, _ = self._rows(position, velocity, acceleration)
        blocks = self._in_order(regressors(self._model, self._data, rows), 1, 2)
        return blocks.reshape(*blocks.shape[:2], self.width * PER_LINK)

    def effort_derivatives(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of `rigid_effort` by position, velocity and acceleration, (N, n, n) each, for (N, n) arrays."""
        rows, _ = self._rows(position, velocity, acceleration)
        dq, dv, da = rnea_derivatives(self._model, self._data, rows, "dtau_dq", "dtau_dv", "M")
        da = np.triu(da) + np.swapaxes(np.triu(da, 1), 1, 2)
        return self._in_order(dq, 1, 2), self._in_order(dv, 1, 2), self._in_order(da, 1, 2)

    def setup_derivatives(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of `rigid_effort` by position (N, n, n) and by `gravity_vector` (N, n, 3), for (N, n) arrays."""
        rows, _ = self._rows(position, velocity, acceleration)
        dq, force = rnea_derivatives(self._model, self._data, rows, "dtau_dq", "dFda")
        return self._in_order(dq, 1, 2), -self._in_order(force[:, :3].swapaxes(1, 2), 1)  # M is symmetric

    @cached_property
    def slides(self) -> np.ndarray:
        """Whether each joint is prismatic, (n,) bool."""
        kinds = (self._model.joints[int(body) + 1].shortname() for body in self._order)
        return np.array([kind.startswith("JointModelP") for kind in kinds])

    @cached_property
    def carries(self) -> np.ndarray:
        """Which joints (columns) each joint (rows) moves, including itself, (n, n) bool."""
        bodies = self._order + 1
        return np.array([np.isin(bodies, list(self._model.subtrees[int(body)])) for body in bodies])

    @cached_property
    def carried(self) -> np.ndarray:
        """How many of the other joints each joint carries, (n,) int."""
        return np.asarray(self.carries.sum(axis=1) - 1)

    def link_jacobian(self, position: np.ndarray, link: str, point: np.ndarray | None = None) -> np.ndarray:
        """Jacobian of a point of a link, world-aligned, linear over angular rows, (N, 6, n).

        Args:
            point: in the link's frame, (3,) [m]; None for its origin.

        Raises:
            UsageError: the URDF has no such link.
        """
        jacobian, rotation = self.link_motion(position, link)
        if point is not None:
            jacobian[:, :3] += np.cross(jacobian[:, 3:], (rotation @ point)[:, :, None], axis=1)
        return jacobian

    def link_motion(self, position: np.ndarray, link: str) -> tuple[np.ndarray, np.ndarray]:
        """Jacobian of a link's origin, as in `link_jacobian`, and rotation from its frame to the base's, (N, 3, 3)."""
        frame, aligned = self._frame(link), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        ((rows,), _), model, data = self._rows(position), self._model, self._data
        jacobian, rotation = np.empty((len(rows), 6, self.width)), np.empty((len(rows), 3, 3))
        for k, row in enumerate(rows):
            # of one joint pinocchio gives a vector
            jacobian[k] = pin.computeFrameJacobian(model, data, row, frame, aligned).reshape(6, -1)
            rotation[k] = data.oMf[frame].rotation  # computed along with the Jacobian
        return self._in_order(jacobian, 2), rotation

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of all links of the URDF."""
        return tuple(frame.name for frame in self._model.frames if frame.type == pin.FrameType.BODY)

    def moving_link(self, joint: str) -> str:
        """The child link of a joint: the frame of the body that moves with it."""
        if (link := child_link(self.urdf, joint)) is not None:
            return link
        raise UsageError(f"The URDF has no joint {joint!r}.", f"It has {listed(self.joints, 20)}.")

    def body_of(self, link: str) -> tuple[int, np.ndarray, np.ndarray]:
        """Which body carries a link, and where: (joint index, rotation (3, 3), translation (3,) [m]).

        A point p of the link frame is R p + t in the body's frame.

        Raises:
            UsageError: there is no such link, or it is fixed to the base.
        """
        frame = self._model.frames[self._frame(link)]
        name = self._model.names[frame.parentJoint]
        if frame.parentJoint == 0 or name not in self.joints:
            moving = [self.moving_link(joint) for joint in self.joints]
            raise UsageError(f"Link {link!r} does not move.", f"Moving links are {listed(moving, 20)}.")
        return self.joints.index(name), frame.placement.rotation.copy(), frame.placement.translation.copy()

    def _frame(self, link: str) -> int:
        if link not in self.links:
            raise UsageError(f"The URDF has no link {link!r}.", f"It has {listed(self.links, 20)}.")
        return int(self._model.getFrameId(link, pin.FrameType.BODY))

    def with_inertials(self, inertials: np.ndarray) -> Robot:
        """The same robot with other inertial parameters, (n, PER_LINK) or flat."""
        return replace(self, inertials=np.array(inertials, float).reshape(self.width, PER_LINK))

    def with_joint_parameters(
        self,
        armature: np.ndarray | None = None,
        viscous: np.ndarray | None = None,
        coulomb: np.ndarray | None = None,
    ) -> Robot:
        """The same robot with other per-joint parameters, (n,) each; None keeps."""
        given = {"armature": armature, "viscous": viscous, "coulomb": coulomb}
        return replace(self, **{k: np.asarray(v, float).copy() for k, v in given.items() if v is not None})

    def tilted(self, roll: float, pitch: float) -> Robot:
        """The same robot on a base turned by Ry(pitch)·Rx(roll) from level [rad]."""
        return replace(self, gravity_vector=gravity_of(roll, pitch))

    def set_up_as(self, other: Robot) -> Robot:
        """The same robot with another's zeros, by joint name, and on the other's base."""
        zeros = zeros_of(self.joints, dict(zip(other.joints, other.zeros, strict=True)))
        return replace(self, zeros=zeros, gravity_vector=other.gravity_vector)

    def _rows(self, *values: np.ndarray) -> tuple[list[np.ndarray], tuple[int, ...]]:
        """Values (..., n) as contiguous rows in Pinocchio's order, (N, n) each, and their common shape."""
        arrays, order = fitting(self.width, *values), self._from_pinocchio
        rows = [np.ascontiguousarray(array.reshape(-1, self.width)[:, order]) for array in arrays]
        return rows, arrays[0].shape
