"""Training without a prior: find a chain, make its bodies physically possible, learn the rest by networks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from bdnn_ros.bdnn import chain as chains
from bdnn_ros.bdnn.bodies import PER_JOINT
from bdnn_ros.bdnn.chain import Chain, Search
from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.local_training import fit_local
from bdnn_ros.bdnn.refinement import Refinement, get_chain, put_chain
from bdnn_ros.bdnn.samples import (
    Samples,
    most_samples,
    most_working_samples,
    samples_of,
    scales_of,
    shortened,
)
from bdnn_ros.errors import DataError
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals

SEARCH_SHARE = 0.5
"""Share of the budget after which no new start is made."""
LAST_SHARE = 0.85
"""Share of the budget after which only the last fits are made: they cost little."""
CLEAR = 1e-3
"""A start that leaves less than this of the effort's variance, and was found twice, needs no rival."""
HOPELESS = 2.0
"""A start that leaves this much more than the best is not refined."""
POLISH_SAMPLES, POLISH_STEPS = 1500, 30
REFINE_SAMPLES = 4000
"""At most; short budgets take fewer."""
LOAD_SAMPLES = 2000


class ChainTraining:
    """The training of a black-box model, in short steps.

    Stages: search random axes until two starts agree; polish the best on more samples, make their bodies possible and refine
    them; keep the one with the least error, and fit its bodies and local networks to all samples. All chains have equally
    many weights, few compared with the samples, so none are held out for the choice; the local networks are cross-validated
    on blocks of time.
    """

    def __init__(
        self,
        train: Sequence[Signals],
        validation: Sequence[Signals],
        rng: np.random.Generator,
        budget: float = np.inf,
    ) -> None:
        self._parts = [*train, *validation]
        self._budget = budget
        self._joints = train[0].joints
        self._samples = samples_of(self._parts)
        self._rng = rng
        self._search = Search(self._samples, rng)
        self._polish = self._samples.some(min(POLISH_SAMPLES, most_samples(budget)), rng)
        self._refine = self._samples.some(min(REFINE_SAMPLES, most_samples(budget)), rng)
        self._belief = chains.generic(self._samples)
        self._waiting: list[Chain] = []
        self._refinements: list[Refinement] = []
        self.stage = "search"
        self._model: BDNN | None = None

    @property
    def finished(self) -> bool:
        """Whether the training is complete."""
        return self.stage == "finished"

    @property
    def told(self) -> str:
        """The present stage, for a progress line."""
        if self.stage == "search":
            best = f", best error {100.0 * self._search.found[0].cost:.3g} %" if self._search.found else ""
            return f"searching axes: start {self._search.starts}{best}"
        done = self._done()
        return "refining bodies" + (f", error {100.0 * done[0].cost:.3g} %" if done else "")

    def advance(self, used: Callable[[], float]) -> None:
        """Do one step; `used` returns the share of the budget that is spent."""
        if self.stage == "search":
            self._search.try_once(lambda: bool(self._search.found) and used() > SEARCH_SHARE)
            agreed = self._search.settled and self._search.found[0].cost < CLEAR
            if agreed or used() > SEARCH_SHARE:
                self.stage, self._waiting = "refine", self._promising()
        elif self.stage == "refine":
            self._refine_once(used)
        elif self.stage == "fit":
            self._model = self._fitted()
            self.stage = "finished"

    def model(self) -> BDNN:
        """The best model so far.

        Raises:
            DataError: there was no time to find one, or no start found any.
        """
        if self._model is None:
            self._model = self._fitted()
        return self._model

    # -- stages ----------------------------------------------------------------------------------------------

    def _promising(self) -> list[Chain]:
        """What the search found, without what the best makes idle."""
        found = self._search.found
        if found and found[0].cost < CLEAR:
            return found[:1]
        return [chain for chain in found if chain.cost < HOPELESS * found[0].cost]

    def _refine_once(self, used: Callable[[], float]) -> None:
        """A step of the refinement in hand, or the next one begun."""
        hurried = used() > LAST_SHARE
        if hurried and self._done():
            self.stage = "fit"
        elif self._refinements and not self._refinements[-1].finished:
            self._refinements[-1].advance(self._refine, self._belief)
        elif self._waiting:
            chain = self._waiting.pop(0)
            if not hurried:
                give_up = lambda: used() > LAST_SHARE  # noqa: E731
                with suppress(np.linalg.LinAlgError):  # unpolished it is still what the search found
                    chain = chains.descend(self._polish, chain.kinematics, POLISH_STEPS, give_up)
            self._refinements.append(Refinement(chain))
        else:
            self.stage = "fit"

    def _done(self) -> list[Chain]:
        """The best chain of each refinement, best first."""
        ends = [refinement.best for refinement in self._refinements]
        return sorted((chain for chain in ends if chain is not None), key=lambda chain: chain.cost)

    def _fitted(self) -> BDNN:
        """The black box of the chain with the least error, fitted to all."""
        if not self._search.found:
            raise self._nothing_found()
        done = self._done()
        best = done[0] if done else chains.feasible(self._refine, self._promising()[0], self._belief)
        samples = self._samples.some(most_samples(self._budget), self._rng)
        core = core_of(chains.refit(samples, best, self._belief), self._joints, self._samples)
        parts = shortened(self._parts, most_working_samples(self._budget))
        return BDNN(replace(core, local=fit_local(core, parts)))

    def _nothing_found(self) -> DataError:
        if not self._search.starts:
            return DataError("The budget is too short to find a model.", "Give more seconds with --budget.")
        return DataError(
            f"No chain of joints can be fitted to these numbers: all of {self._search.starts} starts broke down.",
            "Check the recording with bdnn info, or use a robot description and --prior urdf.",
        )

    # -- files -----------------------------------------------------------------------------------------------

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able information to resume the training."""
        arrays: dict[str, np.ndarray] = {}
        for name, group in (("found", self._search.found), ("waiting", self._waiting)):
            for k, chain in enumerate(group):
                put_chain(f"{name}{k}", chain, arrays)
        refined = [one.to_state(f"refinement{k}", arrays) for k, one in enumerate(self._refinements)]
        counts = {"found": len(self._search.found), "waiting": len(self._waiting), "refinements": refined}
        rng = self._rng.bit_generator.state
        return arrays, {"stage": self.stage, "starts": self._search.starts, "rng": rng, **counts}

    def restore(self, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> None:
        """Resume from a state of the same data."""
        found, self._waiting = (
            [get_chain(f"{name}{k}", arrays) for k in range(int(info[name]))] for name in ("found", "waiting")
        )
        self._search.found, self._search.starts = found, int(info["starts"])
        self._refinements = [
            Refinement.from_state(f"refinement{k}", arrays, told)
            for k, told in enumerate(info["refinements"])
        ]
        self.stage = "fit" if info["stage"] == "finished" else str(info["stage"])
        self._rng.bit_generator.state = info["rng"]


def core_of(chain: Chain, joints: Sequence[str], samples: Samples) -> PriorCore:
    """A chain as the core of a black box: a robot, and silent networks with its effort offset."""
    n, scales = samples.width, scales_of(samples)
    inertials = chain.parameters[: PER_LINK * n].reshape(n, PER_LINK)
    armature, viscous, coulomb, offset = chain.parameters[PER_LINK * n :].reshape(PER_JOINT, n)
    robot = Robot.from_urdf(chain.kinematics.urdf(joints, inertials), joints)
    robot = robot.with_inertials(inertials).with_joint_parameters(armature, viscous, coulomb)
    some = samples.position[:: max(len(samples) // LOAD_SAMPLES, 1)]
    load = np.maximum(np.std(robot.gravity(some), axis=0), 1e-3 * scales.effort)
    networks = LocalNetworks.silent(scales.velocity, load).with_offset(offset)
    return PriorCore(robot, networks, None, scales.slow)
