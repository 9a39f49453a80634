"""Training on a prior: the bodies of a robot are identified, then networks learn the rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from bdnn_ros.bdnn import correction
from bdnn_ros.bdnn.bodies import PER_JOINT, Belief, columns, fit, quadratic
from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.dynamics import BDNNOnPrior
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.local_training import fit_local
from bdnn_ros.bdnn.restoring import fingerprint, prior_core, prior_core_state
from bdnn_ros.bdnn.samples import (
    Samples,
    joined,
    mean_square,
    most_samples,
    most_working_samples,
    samples_of,
    scales_of,
    shortened,
)
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import ModelFileError
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.bodies import heaviness, thickened
from bdnn_ros.signals import Signals

WRONG_BY = 0.3
"""How far a URDF's bodies are off, as a relative standard deviation."""
JOINT_STRENGTH = 0.1
"""How firmly generic rotors and friction are believed in [nats]."""
ROUNDS = 3
"""Fits of the bodies, each with the noise that the one before left."""
NOISE_FLOOR = 1e-3
CORRECTION_SHARE = 0.8
"""Share of the budget after which the correction of M stops."""
STAGES = ("bodies", "networks", "correction", "finished")


class PriorTraining:
    """The training of a BDNN on a prior, in steps: bodies, networks, correction of M."""

    def __init__(
        self,
        train: Sequence[Signals],
        validation: Sequence[Signals],
        prior: Dynamics,
        rng: np.random.Generator,
        budget: float = np.inf,
    ) -> None:
        self._train, self._validation = list(train), list(validation)
        self._samples, self._judge = samples_of(train), samples_of(validation)
        self._given, self._rng, self._budget = prior, rng, budget
        scales = scales_of(self._samples)
        load = np.maximum(np.std(prior.gravity(self._samples.position), axis=0), 1e-3 * scales.effort)
        self._core = PriorCore(prior, LocalNetworks.silent(scales.velocity, load), None, scales.slow)
        self.stage = "bodies" if isinstance(prior, Robot) else "networks"

    @property
    def finished(self) -> bool:
        """Whether the training is complete."""
        return self.stage == "finished"

    @property
    def told(self) -> str:
        """The present stage, for a progress line."""
        return {"bodies": "identifying bodies and friction", "networks": "fitting the joints' networks"}.get(
            self.stage, "correcting the mass matrix"
        )

    def model(self) -> BDNNOnPrior:
        """The best model so far; the prior itself at first."""
        return BDNNOnPrior(self._core)

    def advance(self, used: Callable[[], float]) -> None:
        """Do one step; `used` returns the share of the budget that is spent."""
        if self.stage == "bodies":
            self._identify_bodies()
            self.stage = "networks"
        elif self.stage == "networks":
            parts = shortened([*self._train, *self._validation], most_working_samples(self._budget))
            self._core = replace(self._core, local=fit_local(self._core, parts))
            self.stage = "correction"
        elif self.stage == "correction":
            give_up = lambda: used() > CORRECTION_SHARE  # noqa: E731
            self._core = correction.corrected(self._core, self._train, self._validation, self._rng, give_up)
            self.stage = "finished"

    def _identify_bodies(self) -> None:
        prior = self._core.prior
        assert isinstance(prior, Robot)
        most = most_samples(self._budget) // 2
        belief = belief_of(prior, self._samples)
        theta = identified(prior, belief, self._samples.some(most, self._rng), None)
        every = joined(self._samples, self._judge).some(most, self._rng)
        if _error(prior, theta, self._judge) < _error(prior, belief.reference, self._judge):
            theta = identified(prior, belief, every, theta)
            robot, offset = robot_of(prior, theta)
            self._core = replace(self._core, prior=robot, local=self._core.local.with_offset(offset))

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able information to resume the training; a prior other than a robot is not part of it."""
        arrays, info = prior_core_state(self._core, with_prior=isinstance(self._core.prior, Robot))
        info |= {"given": fingerprint(self._given), "stage": self.stage}
        return arrays, {**info, "rng": self._rng.bit_generator.state}

    def restore(self, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> None:
        """Resume from a state of the same data and prior.

        Raises:
            ModelFileError: the prior was another one.
        """
        given = self._given
        core = prior_core(arrays, info, lambda kind, held, told: given)
        of_another = isinstance(core.prior, Robot) != isinstance(given, Robot)
        if of_another or core.prior.joints != given.joints or info["stage"] not in STAGES:
            raise ValueError("state")
        if info["given"] != fingerprint(given):
            raise ModelFileError(
                "The training state is that of another prior: its robot description or model is not the same.",
                "Give another file, or remove it to begin anew.",
            )
        self._core, self.stage = core, str(info["stage"])
        self._rng.bit_generator.state = info["rng"]


def belief_of(robot: Robot, samples: Samples) -> Belief:
    """The prior from a URDF: its bodies approximately, rotors and friction of any usual size."""
    scales = scales_of(samples)
    usual = np.array([scales.effort / scales.acceleration, scales.effort / scales.velocity, scales.effort])
    told = np.array([robot.armature, robot.viscous, robot.coulomb])
    heavy = heaviness(robot.inertials)
    bodies = np.array([thickened(values, heavy) for values in robot.inertials])
    joints = np.maximum(told, 0.05 * usual)
    return Belief(bodies, joints, scales.effort, 1.0 / WRONG_BY**2, JOINT_STRENGTH)


def identified(robot: Robot, belief: Belief, samples: Samples, start: np.ndarray | None) -> np.ndarray:
    """The most probable θ of a robot, as in `bodies`; the noise is the residual of the fit before."""
    design = columns(robot.regressor(samples.position, samples.velocity, samples.acceleration), samples)
    theta = belief.reference if start is None else start
    least = NOISE_FLOOR * scales_of(samples).effort
    for _ in range(ROUNDS):
        left = np.sqrt(mean_square(design @ theta - samples.effort, samples.seen))
        noise = np.maximum(left, least)
        theta = fit(quadratic(design, samples.effort, noise), belief)
    return theta


def robot_of(robot: Robot, theta: np.ndarray) -> tuple[Robot, np.ndarray]:
    """The robot with parameters θ, and its effort offset (n,)."""
    n = robot.width
    armature, viscous, coulomb, offset = theta[PER_LINK * n :].reshape(PER_JOINT, n)
    changed = robot.with_inertials(theta[: PER_LINK * n]).with_joint_parameters(armature, viscous, coulomb)
    return changed, offset


def _error(robot: Robot, theta: np.ndarray, samples: Samples) -> float:
    design = columns(robot.regressor(samples.position, samples.velocity, samples.acceleration), samples)
    errors = (design @ theta - samples.effort) / scales_of(samples).effort
    return float(np.sum(errors**2) / np.count_nonzero(samples.seen))
