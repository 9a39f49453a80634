"""What recordings are compared with where a model identified earlier takes the simulation's place: its sensors aside.

What that model says of sensors is taken out of the recordings before anything is looked for: a cause then has its real
size, and is no cause where the sensor is as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from bdnn_ros.bdnn.rest import RestNetwork
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
"""Share of a joint's motion that is left out and told."""
UNSHOWN = (
    "The motion goes beyond what the earlier model's networks learned from, {joints}: that is not compared. "
    "Diagnose a recording that covers it to learn it."
)


@runtime_checkable
class KnowsSensors(Predictor, Protocol):
    """A model that says of sensors what they do."""

    def compared(self) -> Compared:
        """Itself as recordings of another time are compared with it."""


@runtime_checkable
class Identified(Predictor, Protocol):
    """A model whose parameters were identified, each with what is known of it."""

    offset: np.ndarray
    """What it adds to the measured efforts, (n,) [N·m]."""
    left_open: LeftOpen
    """What is not known of all its parameters and of what its joints may add beside them."""
    learned: LocalResiduals | None
    """What its joints add that was learned."""
    lead: float
    """How far the measured effort is ahead of the motion [s]."""
    lag: float
    """Time constant of the low-pass that it has passed [s]."""

    @property
    def velocity_cutoff(self) -> np.ndarray:
        """Of the low-passes on reported velocities, (n,) [Hz], infinite for none."""


@dataclass(frozen=True)
class Compared:
    """A model of efforts when and in the units in which they act, and what its sensors do beside.

    Attributes:
        model: predicts `scale` times what is measured, when it acts; None where the simulation is compared with.
        robot: what it believes, at the positions that the joints report.
        scale: effort that acts, but for an offset, per measured effort, (n,).
        delay: by which efforts act after their stamps, (n,) [s].
        velocity_cutoff: of the low-passes on reported velocities, (n,) [Hz], infinite for none.
        held: effects that the model has beside its robot, of which there may be less by now, and loads on it.
        left_open: what is not known of an identified model, else None.
        lead: how far the recorded effort is known to be ahead of the motion [s].
        creep: how dry friction is known to come on, as `Signals.creep`, else None.
        unloaded: the robot without the loads that the model found on it: its links are off by shares of their own; None for none.
        learned: what joints add that was learned, some of it perhaps with the load, else None.
        unsure: what is not known of what an earlier diagnosis found at joints, else None.
        networks: what learned of some joints what no effect says, by the motion of that time.
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
        """A model with its robot; the robot is its own where it says of sensors what they do."""
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
    def since(self) -> Compared | None:
        """Itself where a model takes the simulation's place, else None."""
        return None if self.model is None else self

    @property
    def dry(self) -> np.ndarray:
        """What dry friction may hold of each joint while it rests, (n,) [N·m]."""
        dry = self.robot.coulomb.copy()
        for one in self.held:
            if isinstance(one.effect, DryFriction):
                dry[one.target] += max(one.values[p.name] for p in one.effect.parameters if p.unit == "N*m")
        return dry

    @property
    def by_load(self) -> LoadFriction:
        """What the model has of friction that grows with the load."""
        ratios = np.zeros(self.robot.width)
        for one in self.held:
            if one.effect.name == LoadDependentFriction.name:
                ratios[one.target] += one.values["ratio"]
        return LoadFriction(ratios, self.learned)

    def shown(self, signals: Signals) -> tuple[Signals, list[str]]:
        """A motion without the efforts of joints where networks do not know what to say, and notes on these.

        Nobody knows what acts there, on either day: it is neither a change nor none.
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
        """Recordings with efforts when and in the units in which they act, and a note where those are others."""
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
    """Effort offsets of joints to whose measured efforts a model adds so much, (n,) [N·m]: the contract's count the other way."""
    offset = get(EffortOffset.name)
    return tuple(
        Installed(offset, joint, None, {"offset": -float(value)})
        for joint, value in enumerate(added)
        if value
    )


def _later(recording: Recording, delay: np.ndarray) -> Recording:
    """A recording with each joint's effort by so much later, (n,) [s], without the moments of which none is known then."""
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
