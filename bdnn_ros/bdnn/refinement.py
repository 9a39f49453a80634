"""Refinement of a chain, from axes that explain the effort to physically possible bodies, step by step."""

from __future__ import annotations

from typing import Any

import numpy as np

from bdnn_ros.bdnn import chain as chains
from bdnn_ros.bdnn.bodies import Belief
from bdnn_ros.bdnn.chain import Chain
from bdnn_ros.bdnn.kinematics import Kinematics
from bdnn_ros.bdnn.samples import Samples

ATTEMPTS = (
    (1e3, 1e3, 1e2, 1e2, 10.0, 10.0, 1.0, 1.0, 1.0, 1.0),
    (1.0,) * 10,
    (1e2, 1e2, 30.0, 30.0, 10.0, 10.0, 3.0, 3.0, 1.0, 1.0),
    (10.0, 10.0, 10.0, 3.0, 3.0, 3.0, 1.0, 1.0, 1.0, 1.0),
)
"""How firmly the generic body is held, step by step; on the edge of what can exist axes hardly move."""
ENOUGH = 1.6
"""An attempt that ends within this factor of the error without limits on the bodies needs no other."""


class Refinement:
    """The refinement of one chain: several attempts from the same axes.

    Attributes:
        origin: the chain to start from, its bodies unlimited.
        reached: the end of each attempt so far; the last may still be on its way.
    """

    def __init__(self, origin: Chain) -> None:
        self.origin = origin
        self.reached: list[Chain] = []
        self._step = 0

    @property
    def best(self) -> Chain | None:
        """The chain with the least error so far."""
        return min(self.reached, key=lambda chain: chain.cost, default=None)

    @property
    def finished(self) -> bool:
        """Whether another step would hardly help."""
        if not self.reached or self._step < len(ATTEMPTS[len(self.reached) - 1]):
            return False
        return len(self.reached) == len(ATTEMPTS) or self.reached[-1].cost < ENOUGH * self.origin.cost

    def advance(self, samples: Samples, belief: Belief) -> None:
        """One step, or the start of the next attempt."""
        if not self.reached or self._step == len(ATTEMPTS[len(self.reached) - 1]):
            firmness = ATTEMPTS[len(self.reached)][0]
            self.reached.append(chains.feasible(samples, self.origin, belief.stronger(firmness)))
            self._step = 0
            return
        firmness = ATTEMPTS[len(self.reached) - 1][self._step]
        better = chains.refine(samples, self.reached[-1], belief.stronger(firmness))
        if better is not None:
            self.reached[-1] = better
        self._step += 1

    def to_state(self, prefix: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
        """Add the arrays of a state under a prefix; returns the JSON-able rest."""
        put_chain(f"{prefix}.origin", self.origin, arrays)
        for k, chain in enumerate(self.reached):
            put_chain(f"{prefix}.reached{k}", chain, arrays)
        return {"reached": len(self.reached), "step": self._step}

    @classmethod
    def from_state(cls, prefix: str, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> Refinement:
        """The refinement of `to_state`."""
        result = cls(get_chain(f"{prefix}.origin", arrays))
        result.reached = [get_chain(f"{prefix}.reached{k}", arrays) for k in range(int(info["reached"]))]
        result._step = int(info["step"])
        return result


def put_chain(name: str, chain: Chain, arrays: dict[str, np.ndarray]) -> None:
    """Add a chain to a state's arrays."""
    arrays[f"{name}.rotations"] = chain.kinematics.rotations
    arrays[f"{name}.translations"] = chain.kinematics.translations
    arrays[f"{name}.parameters"] = chain.parameters
    arrays[f"{name}.cost"] = np.array(chain.cost)


def get_chain(name: str, arrays: dict[str, np.ndarray]) -> Chain:
    """The chain of `put_chain`."""
    kinematics = Kinematics(arrays[f"{name}.rotations"], arrays[f"{name}.translations"])
    return Chain(kinematics, arrays[f"{name}.parameters"], float(arrays[f"{name}.cost"].item()))
