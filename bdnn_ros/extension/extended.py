"""The extended model: a robot with corrected links and the effects found in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from bdnn_ros.bdnn.rest import RestNetwork, effort_of
from bdnn_ros.diagnosis.recorded.compared import Compared
from bdnn_ros.diagnosis.regression.unsure import Unsure
from bdnn_ros.effects.actuation import JointSpring
from bdnn_ros.effects.drawing import contribution
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed
from bdnn_ros.extension import earlier
from bdnn_ros.extension.holding import IN_PLANT, IN_ROBOT, WITH_MEMORY, plant_of
from bdnn_ros.extension.recorded import Recorded
from bdnn_ros.extension.state import parts_of, state_of
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import Signals

LOAD_ROUNDS = 300
"""Most rounds of the fixed point between load and the friction that depends on it along a motion: the largest ratio takes 220."""
LOAD_TOLERANCE = 1e-10
"""The rounds are over where the load changes by less than this share of itself, or less than so much [N·m]."""
GEAR_ROUNDS = {"joint_elasticity": 1, "backlash": 2}
"""The same for effects of the load that a gear passes on: more rounds feed the deflection's curvature back."""


@dataclass(frozen=True)
class ExtendedModel:
    """A robot with named effects.

    Along a motion, `predict` includes every effect, at its times in the recordings it was found in; `along` adapts the times
    to other recordings. The pointwise functions (`inverse_dynamics` and the rest) know neither history nor clock: hysteresis,
    backlash, elasticity, delays, filters, drifts and external wrenches count only in `predict`. M, C and g refer to the
    effort that acts; `inverse_dynamics` returns, and `forward_dynamics` takes, the measured effort, where effort that acts =
    scale · measured + offset.

    Attributes:
        bare: the robot without the effects: the simulation's with its links corrected.
        effects: what was found, with place and values.
        noise: standard deviation of the low-passed effort around `predict`, (n,) [N·m].
        stds: standard deviations of each effect's values, in the order of `effects`; empty if unknown.
        lead: how far the effort's stamps lead the motion's [s]: a property of the recording that only `predict` counts.
        lag: time constant of a low-pass of first order that the measured effort has passed [s]; another such property.
        sticking: each joint's dry friction times how far it turns round before the joint does [N·m·s], (n,); empty
            for none. A joint that sticks leaves slowly; only `predict` counts it.
        creep: velocities under which each joint's dry friction comes on little by little, ahead and back [rad/s], and
            how early it does [s], which only `predict` counts, n triples; empty for at once.
        beyond: an identified model whose joints add to its robot what no effect says (motors that turn with
            two joints, learned friction), or None; its offset is not counted.
        recorded: the recordings that it was diagnosed from, whose one clock is that of its effects; empty where nobody
            knows, or nothing has a time.
        unsure: what is not known of what acts at its joints, or None where nobody knows.
        networks: what learned of some joints what neither links nor effects say.
    """

    kind: ClassVar[str] = "extended"

    bare: Robot
    effects: tuple[Installed, ...]
    noise: np.ndarray
    stds: tuple[Mapping[str, float], ...] = ()
    lead: float = 0.0
    lag: float = 0.0
    beyond: PhysicalModel | None = None
    sticking: tuple[float, ...] = ()
    creep: tuple[tuple[float, ...], ...] = ()
    recorded: tuple[Recorded, ...] = ()
    unsure: Unsure | None = None
    networks: tuple[RestNetwork, ...] = ()

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names, the order of every array."""
        return self.bare.joints

    @property
    def leads(self) -> np.ndarray:
        """How far each joint's measured effort is ahead of the motion, (n,) [s]."""
        return np.asarray(self._planted.delay + self.lead)

    @cached_property
    def _planted(self) -> Plant:
        """The robot with the effects that act throughout a motion."""
        return plant_of(self.bare, [e for e in self.effects if e.effect.name in IN_PLANT])

    @cached_property
    def plant(self) -> Plant:
        """The robot with every effect that needs neither history nor clock."""
        return plant_of(self.bare, [e for e in self.effects if e.effect.name not in WITH_MEMORY])

    @property
    def robot(self) -> Robot:
        """The robot with the effects that a `Robot` can hold: bodies, gravity, armature, viscous friction."""
        return self.plant.robot

    def along(self, recording: Recording) -> tuple[ExtendedModel, str]:
        """The model on the clock of a recording, and a sentence on what is left out (empty if nothing is)."""
        return earlier.along(self, recording)

    def afterwards(self) -> ExtendedModel:
        """The model after its recordings: pushes are over, drifts stay at their end value."""
        return earlier.afterwards(self)

    def compared(self) -> Compared:
        """The model in the form in which new recordings are compared with it."""
        return earlier.compared(self)

    @property
    def beside_robot(self) -> tuple[Installed, ...]:
        """The effects that a `Robot` cannot hold."""
        return tuple(effect for effect in self.effects if effect.effect.name not in IN_ROBOT)

    # -- pointwise -------------------------------------------------------------------------------------------

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Measured effort [N·m], (..., n)."""
        plant = self.plant
        rest = plant.robot.inverse_dynamics(position - plant.position_offset, velocity, acceleration)
        rest = (
            rest
            - self._yet_to_come(velocity)
            + self._friction_beyond(position, velocity)
            + acceleration @ self._inertia_beyond
        )
        plain = self._resistance(position, velocity, np.zeros_like(rest))
        free = rest + plain
        # friction grows with a load's size, by less than the load: what acts has the sign of what would without it
        grown = self._resistance(position, velocity, free) - plain
        share = np.divide(grown, free, out=np.zeros_like(free), where=free != 0.0)
        acting = free / (1.0 - share)
        return np.asarray((acting - plant.offset) / plant.scale)

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Acceleration [rad/s²] under a measured effort, (..., n)."""
        plant = self.plant
        acting = plant.scale * effort + plant.offset
        drive = acting - self._resistance(position, velocity, acting)
        drive = drive + self._yet_to_come(velocity) - self._friction_beyond(position, velocity)
        still = np.zeros_like(position)
        drive = drive - plant.robot.inverse_dynamics(position - plant.position_offset, velocity, still)
        return np.linalg.solve(self.mass_matrix(position), drive[..., None])[..., 0]

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q) [kg·m²], (..., n, n), symmetric positive-definite."""
        return self.plant.robot.mass_matrix(position - self.plant.position_offset) + self._inertia_beyond

    def coriolis(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """C(q, q̇) q̇ [N·m], (..., n)."""
        return self.plant.robot.coriolis(position - self.plant.position_offset, velocity)

    def gravity(self, position: np.ndarray) -> np.ndarray:
        """g(q) [N·m], (..., n)."""
        return self.plant.robot.gravity(position - self.plant.position_offset)

    def friction(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Measured effort at zero acceleration that is neither Coriolis nor gravity, (..., n) [N·m]."""
        still = self.inverse_dynamics(position, velocity, np.zeros_like(position))
        return still - self.coriolis(position, velocity) - self.gravity(position)

    def learned_effort(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """The part of `friction` that networks learned, (..., n) [N·m], in measured units."""
        return self._learned(position, velocity, self._way(velocity)) / self.plant.scale

    @cached_property
    def _inertia_beyond(self) -> np.ndarray:
        """Contribution of the identified model's coupled motors to M, (n, n)."""
        width = self.bare.width
        return np.zeros((width, width)) if self.beyond is None else self.beyond.motors.mass_matrix(width)

    def _friction_beyond(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Friction beside the robot's own: networks and learned joint terms, (..., n) [N·m]."""
        learned = self._learned(position, velocity, self._way(velocity))
        if self.beyond is None:
            return learned
        own = self.beyond.robot.friction(position, velocity) + self.beyond.offset
        return learned + self.beyond.friction(position, velocity) - own

    def _learned(self, position: np.ndarray, velocity: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """What networks learned, (..., n) [N·m]."""
        if not self.networks:
            return np.zeros_like(position)
        return effort_of(self.networks, position, velocity, direction, self.bare.gravity(position))

    def _way(self, velocity: np.ndarray) -> np.ndarray:
        """Fraction of dry friction that acts at each joint, (..., n), from -1 to 1; it may build up gradually with velocity."""
        sign, speed = np.sign(velocity), np.abs(velocity)
        if not self.creep:
            return np.asarray(sign)
        ahead, back, _ = np.array(self.creep).T
        whole = np.maximum(np.where(sign < 0.0, back, ahead), speed)
        return np.divide(velocity, whole, out=np.zeros_like(whole), where=whole > 0.0)

    def _yet_to_come(self, velocity: np.ndarray) -> np.ndarray:
        """Dry friction that the robot counts in full although it has not built up yet, (..., n) [N·m]."""
        return self.robot.coulomb * (np.sign(velocity) - self._way(velocity))

    def _resistance(self, position: np.ndarray, velocity: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Effort of springs, ripples, drag and dry friction under a load, (..., n) [N·m]."""
        width = self.robot.width
        ways = self._way(velocity)
        q, v, u, way = (np.reshape(each, (-1, width)).tolist() for each in (position, velocity, load, ways))
        result = np.zeros((len(q), width))
        for joint, effort in (*self.plant.efforts, *self.plant.across):
            for k in range(len(q)):
                result[k, joint] += effort(0.0, q[k][joint], v[k][joint], u[k][joint])
        for joint, dry in self.plant.dry:
            for k in range(len(q)):
                if v[k][joint]:
                    sign = math.copysign(1.0, v[k][joint])
                    result[k, joint] += way[k][joint] * dry(0.0, abs(v[k][joint]), u[k][joint], sign)
        return result.reshape(np.shape(position))

    # -- along a motion --------------------------------------------------------------------------------------

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is; every effect counts."""
        plant, leads = self._planted, self.leads
        creep = np.array(self.creep) if self.creep else None
        motion, acting = self._acting(plant, replace(signals, creep=creep))
        measured = np.empty_like(acting)
        for lead in np.unique(leads):
            later = motion.advanced(acting, float(lead)) if lead else acting
            measured[:, leads == lead] = later[:, leads == lead]
        return np.asarray((signals.lagging(measured, self.lag) - plant.offset) / plant.scale)

    def _acting(self, plant: Plant, signals: Signals) -> tuple[Motion, np.ndarray]:
        """The motion with the effort that acts along it, and that effort, (N, n) [N·m].

        Effects that depend on the load (load-dependent friction, the side of a gear's backlash) use the model's own load,
        never the measured effort.
        """
        robot = plant.robot
        rigid = robot.rigid_effort(
            signals.position - plant.position_offset, signals.velocity, signals.acceleration
        )
        drive = robot.drive_effort(signals.velocity, signals.acceleration, signals.sign)
        if self.beyond is not None:
            known = self.beyond.robot
            plain = described_effort(known, signals) + self.beyond.offset
            drive = drive + self.beyond.predict(signals) - plain
        drive = drive + self._learned(signals.position, signals.velocity, signals.sign)
        own = replace(signals, effort=None)
        motion = Motion(own, robot, rigid + drive, springs=self._springs())
        if any(self.sticking):
            drive = drive + np.array(self.sticking) * motion.derivative(signals.sign)
        others = [e for e in self.effects if e.effect.name not in IN_PLANT]
        loaded = [e for e in others if e.effect.of_load or e.effect.name in GEAR_ROUNDS]
        for effect in others:
            if effect not in loaded:
                part = contribution(effect, motion)
                rigid, drive = (rigid, drive + part) if effect.effect.in_drive else (rigid + part, drive)
        geared = max((GEAR_ROUNDS.get(effect.effect.name, 0) for effect in loaded), default=0)
        fixed = acting = rigid + drive
        for _ in range(geared or (LOAD_ROUNDS if loaded else 0)):
            motion = motion.with_load(acting, drive)
            if geared:
                motion = replace(motion, signals=replace(own, effort=acting))
            previous, acting = acting, fixed + sum(contribution(effect, motion) for effect in loaded)
            if _settled(acting, previous):
                break
        return motion, np.asarray(acting)

    def _springs(self) -> np.ndarray:
        """Stiffness of the springs across the joints, (n,) [N·m/rad]."""
        stiffness = np.zeros(self.robot.width)
        for one in self.effects:
            if one.effect.name == JointSpring.name:
                stiffness[one.target] += one.values["stiffness"]
        return stiffness

    # -- files -----------------------------------------------------------------------------------------------

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest that make the model again."""
        return state_of(self)

    @classmethod
    def from_state(cls, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> ExtendedModel:
        """The model of `to_state`.

        Raises:
            ModelFileError: something is missing or does not fit.
        """
        return cls(**parts_of(arrays, info))


def _settled(load: np.ndarray, before: np.ndarray) -> bool:
    """Whether a fixed-point iteration no longer changes the load beyond rounding."""
    most = LOAD_TOLERANCE * (1.0 + np.abs(load).max(initial=0.0))
    return bool(np.abs(load - before).max(initial=0.0) <= most)
