"""A robot whose parameters were identified, with their uncertainty: the physical model handed over."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from bdnn_ros.errors import ModelFileError
from bdnn_ros.physical.parameters import Parameters, parameter_names
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals


@dataclass(frozen=True)
class PhysicalModel:
    """An identified robot: rigid bodies, armature, friction, offset.

    Attributes:
        robot: bodies, armature and friction as identified; feasible, so M is positive-definite everywhere.
        offset: effort offset of each joint, (n,) [N·m].
        covariance: of all parameters in the order of `parameter_names`, (P, P), before feasibility was asked
            for.
        noise: standard deviation of the low-passed residual effort, (n,) [N·m].
        version: counts the updates of a live model.
    """

    kind: ClassVar[str] = "physical"

    robot: Robot
    offset: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    version: int = 0

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names, the order of every array."""
        return self.robot.joints

    @property
    def parameters(self) -> Parameters:
        """What was identified, by kind."""
        robot = self.robot
        return Parameters(robot.inertials, robot.armature, robot.viscous, robot.coulomb, self.offset)

    @property
    def std(self) -> Parameters:
        """Standard deviations of the parameters."""
        return Parameters.from_vector(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))

    def table(self) -> list[tuple[str, float, float]]:
        """Name, value and standard deviation of every parameter."""
        names, values = parameter_names(self.joints), self.parameters.vector()
        return list(zip(names, values.tolist(), self.std.vector().tolist(), strict=True))

    # -- dynamics --------------------------------------------------------------------------------------------

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Effort [N·m], (..., n)."""
        return self.robot.inverse_dynamics(position, velocity, acceleration) + self.offset

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Acceleration [rad/s²], (..., n)."""
        return self.robot.forward_dynamics(position, velocity, effort - self.offset)

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q) [kg·m²], (..., n, n), symmetric positive-definite."""
        return self.robot.mass_matrix(position)

    def coriolis(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """C(q, q̇) q̇ [N·m], (..., n)."""
        return self.robot.coriolis(position, velocity)

    def gravity(self, position: np.ndarray) -> np.ndarray:
        """g(q) [N·m], (..., n)."""
        return self.robot.gravity(position)

    def friction(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Friction and offset [N·m], (..., n)."""
        return self.robot.friction(position, velocity) + self.offset

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], not low-passed."""
        robot = self.robot
        rigid = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
        friction = robot.viscous * signals.velocity + robot.coulomb * signals.sign + self.offset
        return rigid + robot.armature * signals.acceleration + friction

    # -- files -----------------------------------------------------------------------------------------------

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest that make the model again."""
        robot = self.robot
        arrays = {
            "inertials": robot.inertials,
            "armature": robot.armature,
            "viscous": robot.viscous,
            "coulomb": robot.coulomb,
            "gravity_vector": robot.gravity_vector,
            "offset": self.offset,
            "covariance": self.covariance,
            "noise": self.noise,
        }
        return arrays, {"urdf": robot.urdf, "joints": list(robot.joints), "version": self.version}

    @classmethod
    def from_state(cls, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> PhysicalModel:
        """The model of `to_state`.

        Raises:
            ModelFileError: something is missing or does not fit.
        """
        try:
            return cls(
                robot=robot_from_state(arrays, info),
                offset=arrays["offset"],
                covariance=arrays["covariance"],
                noise=arrays["noise"],
                version=int(info["version"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise ModelFileError(
                f"The physical model is incomplete ({error!r}).", "Identify it again."
            ) from None


def robot_from_state(arrays: dict[str, np.ndarray], info: dict[str, Any]) -> Robot:
    """The robot of a model's state: its URDF with the identified parameters."""
    robot = Robot.from_urdf(str(info["urdf"]), [str(joint) for joint in info["joints"]])
    robot = robot.with_inertials(arrays["inertials"])
    robot = robot.with_joint_parameters(arrays["armature"], arrays["viscous"], arrays["coulomb"])
    return replace(robot, gravity_vector=np.asarray(arrays["gravity_vector"], float))
