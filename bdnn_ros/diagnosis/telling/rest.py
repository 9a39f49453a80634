"""What named causes leave and motion predicts: learned by networks, its gain measured apart from theirs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.bdnn.local_training import Sums, chosen_weights
from bdnn_ros.bdnn.rest import POSITION, QUANTITIES, Input, RestNetwork
from bdnn_ros.diagnosis.pushes.pushes import pushing
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.gains import gain_of
from bdnn_ros.diagnosis.result import Diagnosis
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.unexplained import describe
from bdnn_ros.errors import listed

BLOCKS = 10
"""Blocks of time by which the strength of a network's ridge is chosen."""
MOST_INPUTS = 5
"""The strongest inputs that a joint's network sees: of more, hardly any motion shows all that they do together."""
SURELY = 0.02
"""Networks are kept that take this share at least off the error on held-out data, by the lower end of its interval."""


@dataclass(frozen=True)
class Rest:
    """What networks learned.

    Attributes:
        networks: fitted to all rows.
        inputs: what each joint's depends on, as "joint.quantity".
        gain: 1 - RMSE(with networks) / RMSE(extended model) of these joints on held-out blocks that had no say in them.
        interval: its bounds at 95 %.
    """

    networks: tuple[RestNetwork, ...]
    inputs: Mapping[str, tuple[str, ...]]
    gain: float
    interval: tuple[float, float]

    @property
    def sentence(self) -> str:
        """What is said of them."""
        low, high = (100.0 * end for end in self.interval)
        inputs = dict.fromkeys(key for keys in self.inputs.values() for key in keys)
        return (
            f"Networks learn it at {listed(self.inputs)} from {listed(inputs)}: with them the extended model's held-out error "
            f"there falls by {100.0 * self.gain:.1f} % more (95 % interval {low:.1f} to {high:.1f} %)."
        )


def with_rest(
    diagnosis: Diagnosis, case: Case, left: np.ndarray
) -> tuple[Diagnosis, tuple[RestNetwork, ...]]:
    """A diagnosis with what is said of networks that learned what it leaves, and these; arguments as of `learned`."""
    rest = learned(case, left, diagnosis.above or diagnosis.slight)
    if rest is None:
        return diagnosis, ()
    said = f"{diagnosis.unexplained_sentence} {rest.sentence}"
    return replace(diagnosis, unexplained_sentence=said, learned=(rest.gain, *rest.interval)), rest.networks


def learned(case: Case, left: np.ndarray, joints: Sequence[str]) -> Rest | None:
    """Networks for what is left at some joints; None where nothing is surely learned.

    Which inputs they see, and by how much they gain, is asked of rows apart: those that were held out say only the latter.

    Args:
        left: what all findings leave in all rows, (R, n) [N·m].
        joints: where that is more than noise.
    """
    equations, apart = case.equations, case.attempt.extended
    if not any(_known(case.remainder.inputs.get(joint, {})) for joint in joints):
        return None
    counted = equations.usable
    equations.count(counted & ~case.attempt.test[:, None])
    told = describe(equations, apart).inputs
    wanted = {joint: _known(told.get(joint, {}))[:MOST_INPUTS] for joint in joints}
    tried = _fitted(equations, apart, wanted)
    equations.count(counted)
    helps = [one.joint for one in tried if _gain(case, tried, [one.joint])[1][0] >= SURELY]
    names = equations.motion.signals.joints
    networks = _fitted(equations, left, {names[joint]: wanted[names[joint]] for joint in helps})
    if not networks:
        return None
    inputs = {names[one.joint]: tuple(wanted[names[one.joint]]) for one in networks}
    return Rest(networks, inputs, *_gain(case, tried, [one.joint for one in networks]))


def _gain(
    case: Case, networks: Sequence[RestNetwork], joints: Sequence[int]
) -> tuple[float, tuple[float, float]]:
    """By how much networks lower the extended model's held-out error at some joints, with its interval."""
    equations, apart = case.equations, case.attempt.extended
    there = np.isin(np.arange(equations.width), joints)
    pushed = pushing(case.attempt.fitted.terms, equations.motion.time[equations.rows])
    return gain_of(equations, apart - _effort(equations, networks), case.held & there, pushed, apart)


def _known(inputs: Mapping[str, float]) -> list[str]:
    """Those of some inputs that a network may see, strongest first."""
    seen = (key for key in inputs if key.rpartition(".")[2] in QUANTITIES)
    return sorted(seen, key=lambda key: -inputs[key])


def _fitted(
    equations: Equations, left: np.ndarray, wanted: Mapping[str, Sequence[str]]
) -> tuple[RestNetwork, ...]:
    """Networks by the rows that count of what is left, (R, n); none for joints where they would not help."""
    names, found = equations.motion.signals.joints, []
    for name, keys in wanted.items():
        joint = names.index(name)
        rows = np.flatnonzero(equations.usable[:, joint])
        if not keys or not len(rows):
            continue
        network = RestNetwork.silent(joint, [_input(equations, key) for key in keys])
        features = _features(equations, network)
        edges = np.flatnonzero(np.diff(equations.block[rows])) + 1
        pieces = np.array_split(np.arange(len(edges) + 1), min(BLOCKS, len(edges) + 1))
        parts = np.split(rows, edges)
        blocks = [
            _sums(features, left[:, joint], np.concatenate([parts[k] for k in some])) for some in pieces
        ]
        weights = chosen_weights(blocks, network.penalties)
        if weights[1:].any():
            found.append(network.with_weights(weights))
    return tuple(found)


def _sums(features: np.ndarray, left: np.ndarray, rows: np.ndarray) -> Sums:
    x, y = features[rows], left[rows]
    return Sums(x.T @ x, x.T @ y, float(y @ y), len(rows))


def _input(equations: Equations, key: str) -> Input:
    """What a network sees, as this motion shows it."""
    motion = equations.motion
    name, _, quantity = key.rpartition(".")
    joint = motion.signals.joints.index(name)
    values = _given(equations)[QUANTITIES.index(quantity)][:, joint]
    low, high = float(values.min()), float(values.max())
    scale = max(float(np.std(values)), 1e-9)
    if quantity == POSITION:
        scale = np.pi / max(high - low, 1e-9) if motion.robot.slides[joint] else 1.0
    return Input(joint, quantity, low, high, float(scale))


def _given(equations: Equations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and gravity's effort at the working rate, (N, n) each."""
    motion = equations.motion
    return motion.position, motion.velocity, motion.robot.gravity(motion.position)


def _features(equations: Equations, network: RestNetwork) -> np.ndarray:
    """A network's features as rows, (R, F)."""
    position, velocity, load = _given(equations)
    made = network.features(position, velocity, equations.motion.signals.sign, load)
    return equations.reduced(made, borne=False)


def _effort(equations: Equations, networks: Sequence[RestNetwork]) -> np.ndarray:
    """What networks add, as rows (R, n) [N·m]."""
    result = np.zeros_like(equations.target)
    for network in networks:
        result[:, network.joint] += _features(equations, network) @ network.output_weights
    return result
