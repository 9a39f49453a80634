"""Training a black box: a chain found, its bodies made real, and networks for what it leaves out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from bdnn_ros.bdnn import chain as chains
from bdnn_ros.bdnn.chain import Chain, Search
from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.bdnn.kinematics import Kinematics
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.local_training import fit_local
from bdnn_ros.bdnn.samples import Samples, joined, samples_of, scales_of
from bdnn_ros.errors import DataError
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals

SEARCH_SHARE = 0.5
"""Share of the budget after which no new start is made."""
POLISH_SAMPLES = 1500
POLISH_STEPS = 30
REFINE_SAMPLES = 4000
FIRMNESS = (1e3, 1e3, 1e2, 1e2, 10.0, 10.0, 1.0, 1.0, 1.0, 1.0)
"""How firmly the generic body is held, step by step: on the edge of what can exist axes hardly move."""
CLEAR = 1e-3
"""A start that leaves less than this of the effort's variance needs no rival."""
PATIENCE = 0.3
"""Share of the budget after which two starts that agree end the search, clear or not."""
LAST_SHARE = 0.85
"""Share of the budget kept free for the last fits: they cost little."""


class ChainTraining:
    """One black box in the making, a short piece of work at a time.

    The stages are: search random axes until two starts agree; polish the best on more samples; make their
    bodies real and refine them; keep the one that does best on what was held out; fit its bodies and its
    local networks to all.
    """

    def __init__(
        self, train: Sequence[Signals], validation: Sequence[Signals], rng: np.random.Generator
    ) -> None:
        self._train, self._validation = list(train), list(validation)
        self._joints = train[0].joints
        self._samples, self._judge = samples_of(train), samples_of(validation)
        self._rng = rng
        self._search = Search(self._samples, rng)
        self._polish = self._samples.some(POLISH_SAMPLES, rng)
        self._refine = self._samples.some(REFINE_SAMPLES, rng)
        self._belief = chains.generic(self._samples)
        self._waiting: list[Chain] = []
        self._done: list[Chain] = []
        self._steps = len(FIRMNESS)
        self.stage = "search"
        self._model: BDNN | None = None

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do."""
        return self.stage == "finished"

    def advance(self, used: Callable[[], float]) -> None:
        """One piece of work; `used` tells the share of the budget that is spent."""
        if self.stage == "search":
            self._search_once(used)
        elif self.stage == "refine":
            self._refine_once(used)
        elif self.stage == "fit":
            self._model = self._fitted()
            self.stage = "finished"

    def model(self) -> BDNN:
        """The best black box so far.

        Raises:
            DataError: there was no time to find one.
        """
        if self._model is None:
            if not self._done and not self._found():
                raise DataError(
                    "The budget is too short to find a model.", "Give more seconds with --budget."
                )
            self._model = self._fitted()
        return self._model

    @property
    def told(self) -> str:
        """What is being done, for a progress line."""
        if self.stage == "search":
            best = f", best error {100.0 * self._search.found[0].cost:.3g} %" if self._search.found else ""
            return f"searching axes: start {self._search.starts}{best}"
        best = f", held-out error {100.0 * self._score(self._done[0]):.3g} %" if self._done else ""
        return f"refining bodies{best}"

    # -- stages ----------------------------------------------------------------------------------------------

    def _search_once(self, used: Callable[[], float]) -> None:
        self._search.try_once(lambda: bool(self._search.found) and used() > SEARCH_SHARE)
        agreed = self._search.settled and (self._search.found[0].cost < CLEAR or used() > PATIENCE)
        if agreed or used() > SEARCH_SHARE:
            self.stage, self._waiting = "refine", self._found()

    def _found(self) -> list[Chain]:
        """What the search found, without what the best makes idle."""
        found = self._search.found
        if found and found[0].cost < CLEAR:
            return found[:1]
        return [chain for chain in found if chain.cost < 2.0 * found[0].cost]

    def _refine_once(self, used: Callable[[], float]) -> None:
        """Polish a waiting chain and make it real, or refine the one in hand by a step."""
        hurried = used() > LAST_SHARE
        if self._steps == len(FIRMNESS) and self._waiting and not (hurried and self._done):
            chain = self._waiting.pop(0)
            if not hurried:
                start, samples = chain.kinematics, self._polish
                chain = chains.descend(samples, start, POLISH_STEPS, lambda: used() > LAST_SHARE)
            firmness = 1.0 if hurried else FIRMNESS[0]
            self._done.append(chains.feasible(self._refine, chain, self._belief.stronger(firmness)))
            self._steps = 0
        elif self._steps < len(FIRMNESS) and not hurried:
            belief = self._belief.stronger(FIRMNESS[self._steps])
            self._done[-1] = chains.refine(self._refine, self._done[-1], belief) or self._done[-1]
            self._steps += 1
        else:
            self.stage = "fit"

    def _score(self, chain: Chain) -> float:
        return float(chain.error(self._judge).mean())

    def _fitted(self) -> BDNN:
        """The black box of the chain that does best on what was held out, fitted to all."""
        done = self._done or [chains.feasible(self._refine, self._found()[0], self._belief)]
        best = min(done, key=self._score)
        learned = chains.refit(self._samples, best, self._belief)
        core = core_of(learned, self._joints, self._samples)
        networks = fit_local(core, self._train, self._validation)
        # what was held out has chosen; now it may teach as well
        full = chains.refit(joined(self._samples, self._judge), learned, self._belief)
        return BDNN(with_networks(core_of(full, self._joints, self._samples), networks))

    # -- files -----------------------------------------------------------------------------------------------

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest from which the training goes on."""
        arrays: dict[str, np.ndarray] = {}
        for name, group in (("found", self._search.found), ("waiting", self._waiting), ("done", self._done)):
            for k, chain in enumerate(group):
                arrays[f"{name}.{k}.rotations"] = chain.kinematics.rotations
                arrays[f"{name}.{k}.translations"] = chain.kinematics.translations
                arrays[f"{name}.{k}.parameters"] = chain.parameters
                arrays[f"{name}.{k}.cost"] = np.array(chain.cost)
        info = {
            "stage": self.stage,
            "starts": self._search.starts,
            "steps": self._steps,
            "rng": self._rng.bit_generator.state,
        }
        return arrays, info

    def restore(self, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> None:
        """Go on from a state of the same data."""
        groups: dict[str, list[Chain]] = {}
        for name in ("found", "waiting", "done"):
            count = sum(key.startswith(f"{name}.") and key.endswith(".cost") for key in arrays)
            groups[name] = [_chain(arrays, f"{name}.{k}") for k in range(count)]
        self._search.found, self._waiting, self._done = groups["found"], groups["waiting"], groups["done"]
        self._search.starts, self._steps = int(info["starts"]), int(info["steps"])
        self.stage = "fit" if info["stage"] == "finished" else str(info["stage"])
        self._rng.bit_generator.state = info["rng"]


def core_of(chain: Chain, joints: Sequence[str], samples: Samples) -> PriorCore:
    """A chain as the core of a black box: a robot, and silent networks with its effort offset."""
    n, scales = samples.width, scales_of(samples)
    inertials = chain.parameters[: PER_LINK * n].reshape(n, PER_LINK)
    armature, viscous, coulomb, offset = chain.parameters[PER_LINK * n :].reshape(4, n)
    robot = Robot.from_urdf(chain.kinematics.urdf(joints, inertials), joints)
    robot = robot.with_inertials(inertials).with_joint_parameters(armature, viscous, coulomb)
    load = np.maximum(np.std(robot.gravity(samples.position), axis=0), 1e-3 * scales.effort)
    networks = LocalNetworks.silent(scales.velocity, load).with_offset(offset)
    return PriorCore(robot, networks, None, scales.slow)


def with_networks(core: PriorCore, networks: LocalNetworks) -> PriorCore:
    """The core with other networks beside its offset."""
    return replace(core, local=networks.with_offset(core.local.output_weights[:, 0]))


def _chain(arrays: dict[str, np.ndarray], prefix: str) -> Chain:
    kinematics = Kinematics(arrays[f"{prefix}.rotations"], arrays[f"{prefix}.translations"])
    return Chain(kinematics, arrays[f"{prefix}.parameters"], float(arrays[f"{prefix}.cost"]))
