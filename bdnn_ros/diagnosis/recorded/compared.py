"""Comparing recordings with an earlier model in the simulation's place, sensor errors aside.

Sensor errors that the model knows are removed from the recordings before anything is looked for: a cause then has its real
size, and an unchanged sensor is no cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from bdnn_ros.bdnn.rest import RestNetwork
from bdnn_ros.diagnosis.regression.known import Known
from bdnn_ros.diagnosis.regression.load_friction import LoadFriction
from bdnn_ros.diagnosis.regression.unsure import Unsure
from bdnn_ros.effects.actuation import EffortOffset
from bdnn_ros.effects.friction import DryFriction, LoadDependentFriction
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.errors import listed
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import Predictor
from bdnn_ros.signals import Signals

TOLD = 0.01
"""Share of a joint's motion that, if left out, is reported in a note."""
UNSHOWN = (
    "The motion goes beyond what the earlier model's networks learned from, {joints}: that is not compared. "
    "Diagnose a recording that covers it to learn it."
)


@runtime_checkable
class KnowsSensors(Predictor, Protocol):
    """A model that knows errors of sensors."""

    def compared(self) -> Compared:
        """The model as later recordings are compared with it."""


@runtime_checkable
class Identified(Predictor, Protocol):
    """A model with identified parameters and their uncertainty."""

    offset: np.ndarray
    """Added to the measured efforts, (n,) [N·m]."""
    left_open: LeftOpen
    """Uncertainty of all its parameters and of what its joints may add beside them."""
    learned: LocalResiduals | None
    """Learned joint residuals."""
    lead: float
    """Lead of the measured effort over the motion [s]."""
    lag: float
    """Time constant of the low-pass that the measured effort has passed [s]."""

    @property
    def velocity_cutoff(self) -> np.ndarray:
        """Cut-offs of low-passes on reported velocities, (n,) [Hz], infinite for none."""


@dataclass(frozen=True)
class Compared:
    """A model of acting efforts, and the sensor errors that it knows.

    Attributes:
        model: predicts acting effort, `scale` times what is measured; None against the simulation.
        robot: the model's robot, with joint zeros as the sensors report them.
        scale: acting effort, an offset aside, per measured effort, (n,).
        delay: by which efforts act after their stamps, (n,) [s].
        velocity_cutoff: low-passes on reported velocities, (n,) [Hz], infinite for none.
        held: effects that the model has beside its robot, which may have become less, and loads on it.
        left_open: uncertainty of an identified model, else None.
        lead: known lead of the recorded effort over the motion [s].
        creep: known onset of dry friction, as `Signals.creep`, else None.
        unloaded: the robot without loads that the model found on it, to which link errors are relative; None for none.
        learned: learned joint residuals, some of which may grow with the load, else None.
        unsure: uncertainty of joint effects that an earlier diagnosis found, else None.
        networks: those that learned what no effect explains at some joints.
    """

    model: Predictor | None
    robot: Robot
    scale: np.ndarray
    delay: np.ndarray
    velocity_cutoff: np.ndarray
    held: tuple[Installed, ...] = ()
    left_open: LeftOpen | None = None
    lead: float = 0.0
    creep: np.ndarray | None = None
    unloaded: Robot | None = None
    learned: LocalResiduals | None = None
    unsure: Unsure | None = None
    networks: tuple[RestNetwork, ...] = ()

    @classmethod
    def of(cls, model: Predictor | None, robot: Robot) -> Compared:
        """A model with its robot: its own robot if it knows sensor errors, else the given one."""
        if isinstance(model, KnowsSensors):
            return model.compared()
        same = np.ones(robot.width)
        plain = cls(model, robot, same, 0.0 * same, np.inf * same)
        if not isinstance(model, Identified):
            return plain
        held, lead = offsets_of(model.offset), model.lead - model.lag
        known = replace(plain, held=held, left_open=model.left_open, lead=lead, learned=model.learned)
        return replace(known, velocity_cutoff=model.velocity_cutoff)

    @property
    def earlier(self) -> Compared | None:
        """Itself if a model takes the simulation's place, else None."""
        return None if self.model is None else self

    @property
    def dry(self) -> np.ndarray:
        """Largest dry friction of each joint, which may hold it at rest, (n,) [N·m]."""
        dry = self.robot.coulomb.copy()
        for one in self.held:
            if isinstance(one.effect, DryFriction):
                dry[one.target] += max(one.values[p.name] for p in one.effect.parameters if p.unit == "N*m")
        return dry

    @property
    def of_model(self) -> Known:
        """What a regression takes from the model beside its robot and its effort."""
        return Known(self.left_open, self._by_load, self.unloaded, self.unsure, self.lead)

    @property
    def _by_load(self) -> LoadFriction:
        """Load-dependent friction of the model."""
        ratios = np.zeros(self.robot.width)
        for one in self.held:
            if one.effect.name == LoadDependentFriction.name:
                ratios[one.target] += one.values["ratio"]
        return LoadFriction(ratios, self.learned)

    def shown(self, signals: Signals) -> tuple[Signals, list[str]]:
        """A motion without efforts of joints where networks would extrapolate, and notes on these.

        Networks say nothing reliable there, so that neither a change nor its absence can be told.
        """
        beyond = np.zeros(signals.position.shape, bool)
        gravity = self.robot.gravity(signals.position) if self.networks else signals.position
        for one in self.networks:
            beyond[:, one.joint] |= one.beyond(signals.position, signals.velocity, gravity)
        if not beyond.any():
            return signals, []
        share = beyond.mean(axis=0)
        told = [
            f"{100.0 * share[j]:.0f} % of it at {signals.joints[j]}" for j in np.flatnonzero(share > TOLD)
        ]
        unmeasured = beyond if signals.unmeasured is None else beyond | signals.unmeasured
        return replace(signals, unmeasured=unmeasured), [UNSHOWN.format(joints=listed(told))] * bool(told)

    def acting(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings with efforts at the times and in the units in which they act, and a note where these changed."""
        joints = list(zip(self.robot.joints, self.scale.tolist(), self.delay.tolist(), strict=True))
        changes = [f"times {scale:.3g} at {joint}" for joint, scale, _ in joints if scale != 1.0]
        if len({*self.delay.tolist()}) == 1:
            changes += [f"{1e3 * self.delay[0]:.3g} ms later"] * bool(self.delay[0])
        else:
            changes += [f"{1e3 * delay:.3g} ms later at {joint}" for joint, _, delay in joints if delay]
        if not changes:
            return list(recordings)
        said = f"efforts are looked at as they act by the earlier model, {listed(changes, 20)}."
        scaled = (replace(one, effort=one.require_effort() * self.scale) for one in recordings)
        return [replace(_later(one, self.delay), notes=(*one.notes, f"{one.name}: {said}")) for one in scaled]


def offsets_of(added: np.ndarray) -> tuple[Installed, ...]:
    """Effort offsets equivalent to what a model adds to measured efforts, (n,) [N·m]; the contract's sign is the opposite."""
    offset = get(EffortOffset.name)
    return tuple(
        Installed(offset, joint, None, {"offset": -float(value)})
        for joint, value in enumerate(added)
        if value
    )


def _later(recording: Recording, delay: np.ndarray) -> Recording:
    """A recording with each joint's effort delayed by (n,) [s], without the samples for which none is known then."""
    if not delay.any():
        return recording
    effort = recording.require_effort().copy()
    known = np.zeros(len(recording), bool)
    for rows in recording.segments():
        time = recording.time[rows]
        known[rows] = time >= time[0] + delay.max()
        for joint in np.flatnonzero(delay):
            effort[rows, joint] = np.interp(time - delay[joint], time, effort[rows, joint])
    return replace(recording, effort=effort).part(known)
