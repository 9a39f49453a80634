"""Scenarios: everything a simulated recording is made of, and the truth that a blind test opens
afterwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.effects import drawing
from bdnn_ros.effects.registry import Installed, parse_spec
from bdnn_ros.errors import UsageError
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory, fourier, poor
from bdnn_ros.simulation.perturbation import worn_robot, wrong_robot
from bdnn_ros.simulation.possible import never_acting, refuse_impossible
from bdnn_ros.simulation.sensors import Noise, VelocitySource
from bdnn_ros.simulation.simulate import Progress, Simulated, check, simulate

FORMAT, VERSION = "bdnn_ros/truth", 1
DRAWING_RATE = 100.0
"""Samples per second of the motion on which hidden effects are sized [Hz]."""


@dataclass(frozen=True)
class Scenario:
    """What to simulate; everything random in it follows from the seed.

    Attributes:
        robot: the description.
        effects: specifications, as on the command line.
        hide: number of random effects to add.
        hidden_names: effects to draw them from; empty for all.
        least, most: size of the hidden ones, as a share of the effort.
        seed: of separate random streams for motion, noise, reality and hidden effects.
        duration, rate: [s], [Hz].
        noise: effort noise as a share of the range of each joint's effort, the position's in proportion.
        coloured: effort noise with a correlation time instead of white.
        resolution: step of the encoders [rad], 0 for none.
        velocity: from a separate sensor, the difference of the reported positions, or none.
        wrong: relative error of the description's links, about.
        worn: Coulomb and viscous friction and rotor inertia on every joint.
        poor: only one joint moves, slowly over a small range, instead of all joints over theirs.
        installed: effects as objects, such as those of an effects.yaml.
        known: whether the controller compensates these, as that of a robot with an identified model does.
        plan: the motion, with its own duration and rate; None draws one.
        name: of the robot, for the truth.
    """

    robot: Robot
    effects: Sequence[str] = ()
    hide: int = 0
    hidden_names: Sequence[str] = ()
    least: float = 0.05
    most: float = 0.4
    seed: int = 0
    duration: float = 30.0
    rate: float = 500.0
    noise: float = Noise.effort
    coloured: bool = False
    resolution: float = 0.0
    velocity: VelocitySource = "sensor"
    wrong: float = 0.0
    worn: bool = False
    poor: bool = False
    name: str = "robot"
    installed: Sequence[Installed] = ()
    known: bool = False
    plan: Trajectory | None = None

    def run(self, progress: Progress | None = None) -> tuple[Simulated, dict[str, object]]:
        """The simulated recording, and its truth as truth.yaml holds it.

        Raises:
            UsageError: an option or specification makes no sense.
            DataError: no hidden effect fits, or the effects throw the robot off its path.
        """
        if not 0.0 <= self.wrong <= 0.3:
            raise UsageError(f"Links cannot be off by {self.wrong:g}.", "Use a share from 0 to 0.3.")
        if not 0 <= self.hide <= 8:
            raise UsageError(f"{self.hide} effects cannot be hidden.", "Hide 0 to 8.")
        if not 0.0 <= self.resolution < 0.1:
            raise UsageError(
                f"An encoder step of {self.resolution:g} rad makes no sense.", "Use up to 0.1 rad."
            )
        asked = [parse_spec(spec, self.robot) for spec in self.effects]
        effects = [*self.installed, *asked]
        plan = self._planned()
        reality = self._reality(plan)
        refuse_impossible(effects, self.robot)
        for sentence in never_acting(asked, self.robot, self.seconds):
            raise UsageError(sentence, "Change its start and end, or simulate longer with --duration.")
        effects += self._hidden(reality, plan, effects)
        simulated = simulate(
            self.robot,
            effects,
            seed=self.seed,
            noise=replace(
                Noise.of(self.noise, self.coloured), resolution=self.resolution, velocity_source=self.velocity
            ),
            reality=reality,
            plan=plan,
            known=self.installed if self.known else (),
            progress=progress,
        )
        return simulated, self._truth(simulated, reality)

    def _planned(self) -> Trajectory:
        if self.plan is not None and self.poor:
            raise UsageError("A given motion cannot be a poor one too.", "Leave one of them out.")
        check(self.seconds, self.rate)
        if self.plan is not None:
            return self.plan
        time = np.arange(round(self.duration * self.rate)) / self.rate
        return (poor if self.poor else fourier)(self.robot, time, self._stream("motion"))

    @property
    def seconds(self) -> float:
        """How long it lasts [s]."""
        return self.duration if self.plan is None else float(self.plan.time[-1])

    def _stream(self, purpose: str) -> np.random.Generator:
        return np.random.default_rng([self.seed, *purpose.encode()])

    def _reality(self, plan: Trajectory) -> Robot:
        reality = wrong_robot(self.robot, self.wrong, self._stream("links"))
        if not self.worn:
            return reality
        effort = self.robot.rigid_effort(plan.position, plan.velocity, plan.acceleration)
        return worn_robot(reality, np.std(effort, axis=0), self._stream("joints"))

    def _hidden(self, reality: Robot, plan: Trajectory, beside: Sequence[Installed]) -> list[Installed]:
        """Random effects, sized on the planned motion."""
        if not self.hide:
            return []
        rng, every = self._stream("effects"), max(round(self.rate / DRAWING_RATE), 1)
        rows = slice(None, None, every)
        motion = (plan.position[rows], plan.velocity[rows], plan.acceleration[rows])
        planned = drawing.planned(reality, plan.time[rows], motion)
        found: list[Installed] = []
        for _ in range(self.hide):
            one = drawing.draw(rng, planned, self.hidden_names, self.least, self.most, [*beside, *found])
            found.append(one)
        return found

    def _truth(self, simulated: Simulated, reality: Robot) -> dict[str, object]:
        joints = self.robot.joints
        changed = [
            name
            for name, a, b in zip(joints, reality.inertials, self.robot.inertials, strict=True)
            if (a != b).any()
        ]
        worn = {
            name: {
                "coulomb": float(reality.coulomb[j]),
                "viscous": float(reality.viscous[j]),
                "armature": float(reality.armature[j]),
            }
            for j, name in enumerate(joints)
        }
        return {
            "format": FORMAT,
            "version": VERSION,
            "robot": self.name,
            "joints": list(joints),
            "effects": [one.as_truth(self.robot) for one in simulated.effects],
            "hidden": self.hide,
            "worn": worn if self.worn else None,
            "wrong": self.wrong,
            "links": {
                name: {
                    "described": self.robot.inertials[joints.index(name)].tolist(),
                    "real": reality.inertials[joints.index(name)].tolist(),
                }
                for name in changed
            },
            "excitation": "given" if self.plan else "poor" if self.poor else "fourier",
            "seed": self.seed,
            "duration": self.seconds,
            "rate": self.rate,
            "noise": {"effort": self.noise, "coloured": self.coloured, "resolution": self.resolution},
        }
