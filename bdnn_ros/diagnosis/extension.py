"""The extended model: the simulation's robot with its links corrected and the effects that were found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bdnn_ros.diagnosis.effects_file import entry, from_entry
from bdnn_ros.effects.base import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.errors import BdnnError, ModelFileError
from bdnn_ros.physical.consistency import consistent
from bdnn_ros.physical.model import robot_from_state
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals

if TYPE_CHECKING:
    from bdnn_ros.diagnosis.diagnose import Examination

IN_BODIES = frozenset({"payload", "link_inertia", "base_tilt"})
"""Effects that are other inertial parameters or another gravity: installing them changes the rigid robot."""
IN_PLANT = IN_BODIES | {
    "armature",
    "viscous_friction",
    "position_offset",
    "effort_scale",
    "effort_offset",
    "effort_delay",
    "velocity_filter",
}
"""Effects that a plant carries as numbers; the others are efforts, one column or more each."""
WITH_MEMORY = frozenset(
    {
        "hysteresis",
        "effort_delay",
        "external_wrench",
        "drift",
        "velocity_filter",
        "joint_elasticity",
        "backlash",
    }
)
"""Effects that need the motion's past or its clock."""
LOAD_ROUNDS = 100
"""Most rounds of the fixed point between load and the friction that depends on it."""
LOAD_TOLERANCE = 1e-10
LOOSE_ROUNDS = 6
"""The same where a gear is loose: its sides are found in two or three rounds, and may flicker afterwards."""


@dataclass(frozen=True)
class ExtendedModel:
    """A robot with named effects.

    Along a motion, `predict` counts every effect. The pointwise answers (`inverse_dynamics` and the rest)
    know neither past nor clock: hysteresis, backlash, elasticity, delays, filters, drifts and external
    wrenches count only in `predict`. M, C and g are those of the efforts that act; `inverse_dynamics`
    returns, and `forward_dynamics` takes, the effort that is measured, where
    effort that acts = scale · measured + offset.

    Attributes:
        robot: the simulation's robot, its links corrected; its armature, friction and gravity stay.
        effects: what was found, with place and values.
        noise: standard deviation of the low-passed effort around `predict`, (n,) [N·m].
        stds: standard deviations of each effect's values, in the order of `effects`; empty if unknown.
        lead: how far the effort's stamps lead the motion's [s]: a property of the recording that only
            `predict` counts.
    """

    kind: ClassVar[str] = "extended"

    robot: Robot
    effects: tuple[Installed, ...]
    noise: np.ndarray
    stds: tuple[Mapping[str, float], ...] = ()
    lead: float = 0.0

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names, the order of every array."""
        return self.robot.joints

    @cached_property
    def plant(self) -> Plant:
        """The robot with every effect installed that needs neither past nor clock."""
        return _plant(self.robot, [e for e in self.effects if e.effect.name not in WITH_MEMORY])

    @property
    def rigid_robot(self) -> Robot:
        """The robot with the effects on its bodies and on its joints' armature and viscous friction."""
        return self.plant.robot

    # -- pointwise -------------------------------------------------------------------------------------------

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Measured effort [N·m], (..., n)."""
        plant = self.plant
        rest = plant.robot.inverse_dynamics(position - plant.position_offset, velocity, acceleration)
        acting = rest
        for _ in range(LOAD_ROUNDS):
            previous, acting = acting, rest + self._resistance(position, velocity, acting)
            if np.abs(acting - previous).max(initial=0.0) < LOAD_TOLERANCE:
                break
        return np.asarray((acting - plant.offset) / plant.scale)

    def forward_dynamics(self, position: np.ndarray, velocity: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """Acceleration [rad/s²] under a measured effort, (..., n)."""
        plant = self.plant
        acting = plant.scale * effort + plant.offset
        drive = acting - self._resistance(position, velocity, acting)
        return plant.robot.forward_dynamics(position - plant.position_offset, velocity, drive)

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """M(q) [kg·m²], (..., n, n), symmetric positive-definite."""
        return self.plant.robot.mass_matrix(position - self.plant.position_offset)

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

    def _resistance(self, position: np.ndarray, velocity: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Effort of springs, ripples, drag and dry friction under a load, (..., n) [N·m]."""
        width = self.robot.width
        q, v, u = (np.reshape(values, (-1, width)).tolist() for values in (position, velocity, load))
        result = np.zeros((len(q), width))
        for joint, effort in self.plant.efforts:
            for k in range(len(q)):
                result[k, joint] += effort(0.0, q[k][joint], v[k][joint], u[k][joint])
        for joint, dry in self.plant.dry:
            for k in range(len(q)):
                if v[k][joint]:
                    sign = 1.0 if v[k][joint] > 0.0 else -1.0
                    result[k, joint] += sign * dry(0.0, abs(v[k][joint]), u[k][joint], sign)
        return result.reshape(np.shape(position))

    # -- along a motion --------------------------------------------------------------------------------------

    def predict(self, signals: Signals) -> np.ndarray:
        """Measured effort along a motion, (N, n) [N·m], not low-passed; every effect counts."""
        plant = _plant(self.robot, [e for e in self.effects if e.effect.name in IN_PLANT])
        motion, acting = self._acting(plant, signals)
        measured = np.empty_like(acting)
        leads = plant.delay + self.lead
        for lead in np.unique(leads):
            later = motion.advanced(acting, float(lead)) if lead else acting
            measured[:, leads == lead] = later[:, leads == lead]
        return np.asarray((measured - plant.offset) / plant.scale)

    def _acting(self, plant: Plant, signals: Signals) -> tuple[Motion, np.ndarray]:
        """A motion with the effort that really acts along it, and that effort, (N, n) [N·m].

        What a load decides (friction in proportion to it, the side on which a loose gear lies) is decided by
        the model's own load, never by the measured effort.
        """
        robot = plant.robot
        rigid = robot.rigid_effort(
            signals.position - plant.position_offset, signals.velocity, signals.acceleration
        )
        drive = robot.armature * signals.acceleration + robot.viscous * signals.velocity
        drive = drive + robot.coulomb * signals.sign
        own = replace(signals, effort=None)
        motion = Motion(own, robot, rigid + drive)
        others = [e for e in self.effects if e.effect.name not in IN_PLANT]
        loaded = [e for e in others if e.effect.of_load or e.effect.name == "backlash"]
        for effect in others:
            if effect not in loaded:
                part = contribution(effect, motion)
                rigid, drive = (rigid, drive + part) if effect.effect.in_drive else (rigid + part, drive)
        loose = any(effect.effect.name == "backlash" for effect in loaded)
        fixed = acting = rigid + drive
        for _ in range(0 if not loaded else LOOSE_ROUNDS if loose else LOAD_ROUNDS):
            motion = motion.with_load(acting, drive)
            if loose:
                motion = replace(motion, signals=replace(own, effort=acting))
            previous, acting = acting, fixed + sum(contribution(effect, motion) for effect in loaded)
            if np.abs(acting - previous).max(initial=0.0) < LOAD_TOLERANCE:
                break
        return motion, np.asarray(acting)

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
            "noise": self.noise,
        }
        info = {
            "urdf": robot.urdf,
            "joints": list(robot.joints),
            "effects": [entry(effect, robot) for effect in self.effects],
            "stds": [dict(std) for std in self.stds],
            "lead": self.lead,
        }
        return arrays, info

    @classmethod
    def from_state(cls, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> ExtendedModel:
        """The model of `to_state`.

        Raises:
            ModelFileError: something is missing or does not fit.
        """
        try:
            robot = robot_from_state(arrays, info)
            return cls(
                robot=robot,
                effects=tuple(from_entry(one, robot) for one in info["effects"]),
                noise=np.asarray(arrays["noise"], float),
                stds=tuple({str(k): float(v) for k, v in std.items()} for std in info["stds"]),
                lead=float(info["lead"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError, BdnnError) as error:
            raise ModelFileError(
                f"The extended model is incomplete ({error!r}).", "Diagnose again."
            ) from None


def extend(examination: Examination) -> ExtendedModel:
    """The extended model of a diagnosis: links corrected, every finding installed.

    The links' errors are those of the fit, moved as little as its information allows to bodies that can
    exist together with the effects on them, so that M(q) is positive-definite.
    """
    robot, equations, fit = examination.robot, examination.equations, examination.fit
    found = [
        Installed(e.term.effect, e.term.target, e.term.link, dict(e.values)) for e in examination.estimates
    ]
    stds = [{name: q.std for name, q in e.quantities().items()} for e in examination.estimates]
    for finding in examination.diagnosis.findings:
        effect = get(finding.effect)
        if effect.kinematic:
            values = {name: q.value for name, q in finding.parameters.items()}
            found.append(Installed(effect, robot.joints.index(str(finding.joint)), finding.link, values))
            stds.append({name: q.std for name, q in finding.parameters.items()})
    links = equations.rigid.shape[2]
    corrected = corrected_links(
        robot, found, equations.relative, fit.coefficients[:links], fit.covariance[:links, :links]
    )
    rows = equations.usable & examination.test[:, None]
    error = np.where(rows, examination.extended, 0.0)
    noise = np.sqrt(np.sum(error**2, axis=0) / np.maximum(rows.sum(axis=0), 1))
    lead = float(fit.coefficients[links]) if len(fit.coefficients) > links else 0.0
    return ExtendedModel(corrected, tuple(_scaled_offsets(found)), noise, tuple(stds), lead)


def corrected_links(
    robot: Robot,
    effects: Sequence[Installed],
    relative: np.ndarray,
    errors: np.ndarray,
    covariance: np.ndarray,
) -> Robot:
    """A robot with its links' errors added, feasible together with the effects on its bodies.

    Args:
        relative: from relative errors to inertial parameters, (P, P), P = n · PER_LINK.
        errors, covariance: belief in the relative errors, (P,) and (P, P).
    """
    bodies = _plant(robot, [e for e in effects if e.effect.name in IN_BODIES]).robot.inertials
    added = (bodies - robot.inertials).ravel()
    mean = robot.inertials.ravel() + relative @ errors + added
    back = np.linalg.inv(relative)
    information = back.T @ np.linalg.solve(covariance, back)
    total = consistent(mean, 0.5 * (information + information.T), robot.width, np.array([], dtype=int))
    return robot.with_inertials((total - added).reshape(-1, PER_LINK))


def contribution(effect: Installed, motion: Motion) -> np.ndarray:
    """What an effect adds to the measured effort along a motion, (N, n) [N·m]."""
    coefficients, shape = effect.effect.coefficients(effect.values)
    columns = effect.effect.columns(motion, effect.target, shape, effect.link)
    return np.asarray(columns @ coefficients)


def _plant(robot: Robot, effects: Sequence[Installed]) -> Plant:
    plant = Plant(robot)
    for effect in effects:
        effect.install(plant)
    return plant


def _scaled_offsets(effects: Sequence[Installed]) -> list[Installed]:
    """Offsets in the contract's convention beside a scale on the same joint.

    The regression adds the effects up, measured = acting / scale - column; the contract has
    measured = (acting - offset) / scale.
    """
    scales = {e.target: e.values["scale"] for e in effects if e.effect.name == "effort_scale"}
    result = []
    for e in effects:
        if e.effect.name == "effort_offset" and e.target in scales:
            e = replace(e, values={"offset": e.values["offset"] * scales[e.target]})
        result.append(e)
    return result
