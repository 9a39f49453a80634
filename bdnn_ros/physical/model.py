"""The physical model: a robot with identified parameters and their uncertainty."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from bdnn_ros.errors import ModelFileError, RobotError
from bdnn_ros.physical.couplings import CoupledMotors
from bdnn_ros.physical.dictionary import FEATURES
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.physical.parameters import PER_JOINT, Parameters, parameter_names
from bdnn_ros.physical.plausible import require_covariance, require_plausible
from bdnn_ros.physical.presliding import BREAKAWAYS, USUAL, directions
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.arrays import ReadOnlyArrays, fitting
from bdnn_ros.robot.entries import reading, require_robot, require_shapes
from bdnn_ros.robot.mounting import tilt_of
from bdnn_ros.robot.state import robot_from_state, robot_state
from bdnn_ros.robot.units import along
from bdnn_ros.signals import Signals

LOAD_ITERATIONS = 50
LOAD_TOLERANCE = 1e-10
"""Friction by load depends on the acceleration it lets through: iterated, to this share of the load."""


@dataclass(frozen=True)
class PhysicalModel(ReadOnlyArrays):
    """An identified robot: rigid bodies, armature, friction, offset and learned joint terms; arrays are read-only.

    Attributes:
        robot: bodies, armature and friction as identified; feasible, so M is positive-definite everywhere.
        offset: effort offset of each joint, (n,) [N·m].
        covariance: of all parameters in the order of `parameter_names`, (P, P), before feasibility was asked
            for.
        noise: standard deviation of the low-passed residual effort, (n,) [N·m].
        version: counts the updates of a live model.
        breakaway: index into `BREAKAWAYS` of each joint: the travel in which dry friction turns round.
        motors: motors that turn with two joints.
        learned: what the joints' networks add, or None.
        lead: how far the measured effort is ahead of the motion [s]; a command held for a period is by half of it.
        lead_std: its standard deviation [s].
        lag: time constant of a low-pass of first order that the measured effort has passed [s].
        tilt_std: standard deviations of the roll and pitch at which `robot` stands [rad]; zero where they were taken
            as known.
        zeros_std: standard deviations of the robot's zeros, n of them [rad] ([m]), zero of those taken as known; or none.
        velocity_lags: time constants of the low-passes that the reported velocities had passed, n of them [s]; or none.
        open: what the motion left open of all it may add to the rigid bodies, or None where nobody knows.
    """

    kind: ClassVar[str] = "physical"
    READ_ONLY = ("offset", "covariance", "noise")

    robot: Robot
    offset: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    version: int = 0
    breakaway: tuple[int, ...] = ()
    motors: CoupledMotors = field(default_factory=CoupledMotors)
    learned: LocalResiduals | None = None
    lead: float = 0.0
    lead_std: float = 0.0
    lag: float = 0.0
    tilt_std: tuple[float, float] = (0.0, 0.0)
    zeros_std: tuple[float, ...] = ()
    open: LeftOpen | None = None
    velocity_lags: tuple[float, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names, the order of every array."""
        return self.robot.joints

    @property
    def leads(self) -> np.ndarray:
        """How far each joint's measured effort is ahead of the motion, (n,) [s]."""
        return np.full(self.robot.width, self.lead)

    @property
    def parameters(self) -> Parameters:
        """The identified parameters by kind."""
        robot = self.robot
        return Parameters(robot.inertials, robot.armature, robot.viscous, robot.coulomb, self.offset)

    @property
    def tilt(self) -> tuple[float, float]:
        """Roll and pitch [rad] at which the base stands."""
        return tilt_of(self.robot.gravity_vector)

    @property
    def leans(self) -> bool:
        """Whether the motion showed that the base is tilted differently from the description."""
        return any(self.tilt_std)

    @property
    def zeros(self) -> list[tuple[int, float, float]]:
        """Joints with an identified zero: index, the position reported at zero, its standard deviation [rad] ([m])."""
        return [(k, float(self.robot.zeros[k]), std) for k, std in enumerate(self.zeros_std) if std]

    def position_unit(self, joint: int) -> str:
        """Unit of a joint's position, rad or m."""
        return along("rad", bool(self.robot.slides[joint]))

    @property
    def left_open(self) -> LeftOpen:
        """What the motion left open; from the covariance alone if nothing else is known."""
        return LeftOpen.plain(self.covariance) if self.open is None else self.open

    @property
    def velocity_cutoff(self) -> np.ndarray:
        """Cut-off of the low-passes on the reported velocities, (n,) [Hz], infinite for none."""
        lags = np.array(self.velocity_lags or (0.0,) * self.robot.width)
        return np.divide(0.5 / np.pi, lags, out=np.full(len(lags), np.inf), where=lags > 0.0)

    @cached_property
    def std(self) -> Parameters:
        """Standard deviations of the parameters."""
        return Parameters.from_vector(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))

    def table(self) -> list[tuple[str, float, float]]:
        """Name, value and standard deviation of every parameter."""
        names, values = parameter_names(self.joints), self.parameters.vector()
        return list(zip(names, values.tolist(), self.std.vector().tolist(), strict=True))

    # -- dynamics --------------------------------------------------------------------------------

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Effort [N·m], (..., n)."""
        q, v, a = fitting(self.robot.width, position, velocity, acceleration)
        load = self.robot.rigid_effort(q, v, a)
        return load + self.robot.armature * a + self.motors.inertial(a) + self._friction(q, v, load)

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Acceleration [rad/s²], (..., n).

        Where learned friction depends on the load, the load is iterated together with the acceleration. The iteration
        converges if friction grows more slowly than the load; otherwise the result is that of the last of `LOAD_ITERATIONS`
        rounds, and does not invert `inverse_dynamics`.
        """
        q, v, u = fitting(self.robot.width, position, velocity, effort)
        M = self.mass_matrix(q)
        load = bias = self.robot.rigid_effort(q, v, np.zeros_like(q))
        for _ in range(LOAD_ITERATIONS):
            drive = u - bias - self._friction(q, v, load)
            acceleration = np.linalg.solve(M, drive[..., None])[..., 0]
            if self.learned is None or not self.learned.by_load:
                break
            before, load = load, self.robot.rigid_effort(q, v, acceleration)
            if np.abs(load - before).max(initial=0.0) <= LOAD_TOLERANCE * (
                1.0 + np.abs(load).max(initial=0.0)
            ):
                break
        return np.asarray(acceleration)

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q) [kg·m²], (..., n, n), symmetric positive-definite."""
        return self.robot.mass_matrix(position) + self.motors.mass_matrix(self.robot.width)

    def coriolis(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """C(q, q̇) q̇ [N·m], (..., n)."""
        return self.robot.coriolis(position, velocity)

    def gravity(self, position: np.ndarray) -> np.ndarray:
        """g(q) [N·m], (..., n)."""
        return self.robot.gravity(position)

    def friction(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Friction, offset and learned terms at zero acceleration [N·m], (..., n)."""
        q, v = fitting(self.robot.width, position, velocity)
        return self._friction(q, v, self.robot.rigid_effort(q, v, np.zeros_like(q)))

    def _friction(self, position: np.ndarray, velocity: np.ndarray, load: np.ndarray) -> np.ndarray:
        way = np.sign(velocity)
        result = self.robot.friction(position, velocity) + self.offset
        result = result + self.motors.friction(velocity, np.sign(self.motors.speeds(velocity)))
        if self.learned is not None:
            result = result + self.learned.effort(position, velocity, way, load)
        return np.asarray(result)

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is.

        Unlike `inverse_dynamics` it knows the history of the motion: dry friction needs some travel to reverse.
        """
        robot, q, v, a = self.robot, signals.position, signals.velocity, signals.acceleration
        state = directions(signals)
        chosen = self.breakaway or (USUAL,) * robot.width
        load = robot.rigid_effort(q, v, a)
        dry = np.take_along_axis(state.joints, np.array(chosen)[None, :, None], axis=2)[..., 0]
        sharp = robot.coulomb * dry + self.motors.dry(v, self.motors.of_pairs(state.pairs))
        if self.learned is not None:
            sharp = sharp + self.learned.effort(q, v, state.joints[:, :, USUAL], load, dry)
        linear = robot.armature * a + robot.viscous * v + self.offset
        linear = linear + self.motors.inertial(a) + self.motors.viscous(v)
        return self._shifted(load + linear + signals.soften(sharp), signals)

    def _shifted(self, effort: np.ndarray, signals: Signals) -> np.ndarray:
        """The effort as the sensor reports it: with its lead and its low-pass."""
        effort = signals.lagging(effort, self.lag)
        if self.lead == 0.0:
            return effort
        result = np.empty_like(effort)
        for rows in signals.segments:
            time = signals.time[rows]
            for joint, column in enumerate(effort[rows].T):
                result[rows, joint] = np.interp(time + self.lead, time, column)
        return result

    def effort_std(self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        """Standard deviation of the effort from parameters and residual, (N, n) [N·m]; arguments (N, n)."""
        n = self.robot.width
        q, v, a = fitting(n, position, velocity, acceleration)
        terms = np.stack([a, v, np.sign(v), np.ones_like(q)], axis=-1)
        own = np.einsum("tjk,jl->tjkl", terms, np.eye(n)).reshape(len(q), n, -1)
        columns = np.concatenate([self.robot.regressor(q, v, a), own], axis=-1)
        variance = ((columns @ self.covariance) * columns).sum(axis=-1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) + self.noise**2))

    # -- files -----------------------------------------------------------------------------------

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest that make the model again."""
        arrays, info = robot_state(self.robot)
        arrays |= {"offset": self.offset, "covariance": self.covariance, "noise": self.noise}
        motors, pairs = self.motors.to_state()
        arrays |= {f"motors.{key}": value for key, value in motors.items()}
        info |= {
            "version": self.version,
            "breakaway": list(self.breakaway),
            "lead": self.lead,
            "lead_std": self.lead_std,
            "lag": self.lag,
            "tilt_std": list(self.tilt_std),
            "zeros_std": list(self.zeros_std),
            "velocity_lags": list(self.velocity_lags),
            "motors": pairs,
        }
        if self.learned is not None:
            learned, info["learned"] = self.learned.to_state()
            arrays |= {f"learned.{key}": value for key, value in learned.items()}
        if self.open is not None:
            arrays |= {f"left_open.{key}": value for key, value in self.open.to_state().items()}
        return arrays, info

    @classmethod
    def from_state(cls, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> PhysicalModel:
        """The model of `to_state`.

        Raises:
            ModelFileError: something is missing, does not fit or cannot be.
        """
        with reading("The physical model", "Identify it again.", arrays, info) as (arrays, info):
            motors, learned, left = (_under(arrays, name) for name in ("motors.", "learned.", "left_open."))
            width = len(info["joints"])
            require_robot(arrays, width)
            require_shapes(arrays, _shapes(width, bool(learned)))
            breakaway = tuple(int(index) for index in info["breakaway"])
            if len(breakaway) not in (0, width):
                raise ValueError("breakaway")
            if breakaway and not 0 <= min(breakaway) <= max(breakaway) < len(BREAKAWAYS):
                raise ValueError("breakaway")
            roll, pitch = map(float, info.get("tilt_std", (0.0, 0.0)))
            zeros_std = tuple(map(float, info.get("zeros_std", ())))
            if len(zeros_std) not in (0, width):
                raise ValueError("zeros_std")
            lags = tuple(map(float, info.get("velocity_lags", ())))
            if len(lags) not in (0, width):
                raise ValueError("velocity_lags")
            try:
                robot = robot_from_state(arrays, info)
                require_plausible(robot)
                require_covariance(arrays["covariance"])
            except RobotError as error:
                raise ModelFileError(
                    f"The physical model is damaged: {error.problem}", "Identify it again."
                ) from None
            return cls(
                robot=robot,
                offset=arrays["offset"],
                covariance=arrays["covariance"],
                noise=arrays["noise"],
                version=int(info["version"]),
                breakaway=breakaway,
                lead=float(info["lead"]),
                lead_std=float(info.get("lead_std", 0.0)),
                lag=float(info.get("lag", 0.0)),
                tilt_std=(roll, pitch),
                zeros_std=zeros_std,
                motors=CoupledMotors.from_state(motors, info["motors"]),
                learned=LocalResiduals.from_state(learned, info["learned"]) if learned else None,
                open=LeftOpen.from_state(left, width) if left else None,
                velocity_lags=lags,
            )


def _shapes(width: int, learned: bool) -> dict[str, tuple[int, ...]]:
    """Shapes of the arrays of a model of n = `width` joints, except those of its robot."""
    count = width * (PER_LINK + PER_JOINT)
    shapes: dict[str, tuple[int, ...]] = {"offset": (width,), "covariance": (count, count), "noise": (width,)}
    if learned:
        shapes |= {"learned.weights": (width, FEATURES), "learned.straight": (width, 3)}
        shapes |= {"learned.scale_effort": (width,), "learned.scale_velocity": (width,)}
    return shapes


def _under(arrays: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {key[len(prefix) :]: value for key, value in arrays.items() if key.startswith(prefix)}
