"""Time integration of a plant: rigid bodies, sticking friction, drives, motors behind elastic or loose gears.

Position Verlet: half a step of position, one step of velocity with the forces in the middle, half a step of
position. It is of second order, conserves energy, and applies the held command exactly over its interval. Dry
friction is solved for the velocity at the end of the step: a joint that it can hold stops and sticks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from bdnn_ros.effects.plant import Plant
from bdnn_ros.simulation.motors import Motors

LONGEST_STEP = 1e-3
"""Longest step of integration [s]."""
NONE = np.zeros(0, int)


@dataclass
class State:
    """State of a plant: position [rad], velocity and acceleration of the links, (n,) each."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


class Integrator:
    """Steps a plant from one command to the next.

    Args:
        plant: the robot with its effects.
        position: where it rests at the start, (n,) [rad].
        load: effort that holds it there, (n,) [N·m].
        period: time between commands [s].
    """

    def __init__(self, plant: Plant, position: np.ndarray, load: np.ndarray, period: float) -> None:
        robot, n = plant.robot, plant.robot.width
        self.plant, self.motors = plant, Motors.of(plant, position, load)
        self.model, self.order = robot.pinocchio_model()
        self.data = self.model.createData()
        self.back = np.argsort(self.order)
        self.plain = bool((self.order == np.arange(n)).all())
        self.steps = max(int(np.ceil(period / min(LONGEST_STEP, self.motors.longest_step()))), 1)
        self.step = period / self.steps
        rigid = np.ones(n)
        rigid[self.motors.joints] = 0.0
        self.coulomb, self.viscous = robot.coulomb * rigid, robot.viscous * rigid
        mobility = np.diag(np.linalg.inv(robot.mass_matrix(position)))
        implicit = _implicit_share(self.step * self.viscous * mobility)
        armature = robot.armature * rigid + implicit * self.step * self.viscous
        self.model.armature[:] = armature[self.back]
        elastic = set(self.motors.joints)
        self.efforts = [*(pair for pair in plant.efforts if pair[0] not in elastic), *plant.across]
        self.reported = plant.position_offset
        self.dry = [pair for pair in plant.dry if pair[0] not in elastic]
        self.has_dry = bool(self.dry) or bool(self.coulomb.any())
        self.stuck = NONE
        self.state = State(position.astype(float).copy(), np.zeros(n), np.zeros(n))

    def advance(self, time: float, acting: list[np.ndarray]) -> None:
        """Steps over one period; `acting` holds the effort that acts in each of its steps, (n,) [N·m]."""
        state, h = self.state, self.step
        for k in range(self.steps):
            load = acting[k]
            state.position += 0.5 * h * state.velocity
            middle = time + (k + 0.5) * h
            drive = self._drive(middle, load)
            self.stuck = NONE
            state.acceleration = self._acceleration(middle, drive, load)
            state.velocity = state.velocity + h * state.acceleration
            state.velocity[self.stuck] = 0.0
            state.position += 0.5 * h * state.velocity

    def _drive(self, time: float, load: np.ndarray) -> np.ndarray:
        """Effort on the links from drives, smooth effects and the environment, (n,)."""
        state = self.state
        drive = load - self.viscous * state.velocity
        for joint, resist in self.efforts:
            reported = float(state.position[joint] + self.reported[joint])
            drive[joint] -= resist(time, reported, float(state.velocity[joint]), float(load[joint]))
        for link, point, wrench in self.plant.wrenches:
            push = wrench(time)
            if push.any():
                drive += self.plant.robot.link_jacobian(state.position[None], link, point)[0].T @ push
        if self.motors.joints:
            self.motors.advance(time, self.step, load, state.position, state.velocity, drive)
        return drive

    def _acceleration(self, time: float, drive: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Mean acceleration over the step, dry friction included, (n,)."""
        state, h = self.state, self.step
        if not self.has_dry:
            return self._bodies(drive)
        velocity = state.velocity
        direction = np.sign(velocity)
        friction = self._dry(time, np.abs(velocity), load, direction)
        acceleration = self._bodies(drive - direction * friction)
        crossing = (velocity * (velocity + h * acceleration) <= 0.0) & (self.coulomb > 0.0)
        for joint, _ in self.dry:
            crossing[joint] = velocity[joint] * (velocity[joint] + h * acceleration[joint]) <= 0.0
        if not crossing.any():
            return acceleration
        return self._stopped(time, load, acceleration, direction * friction, np.flatnonzero(crossing))

    def _dry(self, time: float, speed: np.ndarray, load: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Magnitude of dry friction, (n,)."""
        magnitude = self.coulomb.copy()
        for joint, resist in self.dry:
            magnitude[joint] += resist(time, float(speed[joint]), float(load[joint]), float(direction[joint]))
        return magnitude

    def _stopped(
        self,
        time: float,
        load: np.ndarray,
        acceleration: np.ndarray,
        applied: np.ndarray,
        stopping: np.ndarray,
    ) -> np.ndarray:
        """Acceleration where joints stop, stick or reverse: friction takes what is needed to hold them, within its limits."""
        velocity = self.state.velocity[stopping]
        lower, upper = self._holding(time, load, stopping)
        inverse = self._inverse_mass()[:, stopping]
        free = acceleration + inverse @ applied[stopping]
        friction, held = held_friction(inverse[stopping], free[stopping] + velocity / self.step, lower, upper)
        self.stuck = stopping[held]
        return free - inverse @ friction

    def _holding(self, time: float, load: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the dry friction that holds joints at rest, (k,) each [N·m]."""
        if not self.dry:
            limit = self.coulomb[joints]
            return -limit, limit
        rest, ahead = np.zeros(len(load)), np.ones(len(load))
        back, forth = self._dry(time, rest, load, -ahead), self._dry(time, rest, load, ahead)
        return -back[joints], forth[joints]

    def _bodies(self, drive: np.ndarray) -> np.ndarray:
        """Acceleration of the bodies under an effort, (n,)."""
        state = self.state
        velocity = state.velocity + 0.5 * self.step * state.acceleration
        if self.plain:
            return np.array(pin.aba(self.model, self.data, state.position, velocity, drive))
        back = self.back
        return pin.aba(self.model, self.data, state.position[back], velocity[back], drive[back])[self.order]

    def _inverse_mass(self) -> np.ndarray:
        """Inverse of the mass matrix with armature and the implicit share of viscous friction, (n, n)."""
        if self.plain:
            return np.array(pin.computeMinverse(self.model, self.data, self.state.position))
        inverse = pin.computeMinverse(self.model, self.data, self.state.position[self.back])
        return np.asarray(inverse[self.order][:, self.order])


def _implicit_share(decay: np.ndarray) -> np.ndarray:
    """Share of viscous friction that acts on the velocity at the end of a step, (n,): about a half, or 1 if it decays within it.

    Exact for a single joint (exponential integration), so a strongly damped joint approaches its speed without ringing.

    Args:
        decay: step times decay rate, (n,).
    """
    decay = np.maximum(decay, 1e-6)
    return np.asarray(np.where(decay < 1e-3, 0.5 + decay / 12.0, -1.0 / np.expm1(-decay) - 1.0 / decay))


def held_friction(
    coupling: np.ndarray, wanted: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Friction of joints that may stick: what stops them, unless that exceeds its limits.

    Solves the linear complementarity problem `rate = wanted - coupling · friction`, where rate = 0 inside the
    limits, rate >= 0 at the upper and <= 0 at the lower one, by changing the state of the most wrong joint until none
    is wrong.

    Args:
        coupling: inverse mass matrix of these joints, (k, k).
        wanted: rate of change over the step from rest without their friction, (k,) [rad/s²].
        lower, upper: limits of the friction, (k,) [N·m].

    Returns:
        Friction (k,) [N·m], and which joints stick, (k,) bool.
    """
    sliding = np.zeros(len(wanted), int)
    friction = np.linalg.solve(coupling, wanted) if len(wanted) > 1 else wanted / coupling[0]
    if ((friction >= lower) & (friction <= upper)).all():
        return friction, sliding == 0
    for _ in range(8 * len(wanted)):
        friction = np.where(sliding > 0, upper, lower) * (sliding != 0)
        stick = np.flatnonzero(sliding == 0)
        if len(stick):
            rest = wanted[stick] - coupling[stick] @ friction
            friction[stick] = np.linalg.solve(coupling[np.ix_(stick, stick)], rest)
        rate = wanted - coupling @ friction
        wrong_way = -sliding * rate / np.diag(coupling)
        excess = np.maximum(friction - upper, lower - friction)
        error = np.where(sliding == 0, excess, wrong_way)
        worst = int(np.argmax(error))
        if error[worst] <= 1e-12 * (1.0 + abs(friction[worst])):
            break
        sliding[worst] = 0 if sliding[worst] else (1 if friction[worst] > upper[worst] else -1)
    return friction, sliding == 0
