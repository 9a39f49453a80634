"""Networks that learn what named causes leave, as far as motion predicts it; their gain is measured apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.bdnn.local_training import Sums, chosen_weights
from bdnn_ros.bdnn.rest import POSITION, QUANTITIES, Input, RestNetwork
from bdnn_ros.diagnosis.pushes.pushes import pushing
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.gains import held_out_gain
from bdnn_ros.diagnosis.result import Diagnosis
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.unexplained import describe
from bdnn_ros.errors import listed

BLOCKS = 10
"""Blocks of time over which a network's ridge is cross-validated."""
MOST_INPUTS = 5
"""Most inputs of a joint's network: hardly any motion covers all combinations of more."""
SURELY = 0.02
"""Least relative reduction of the held-out error, at the lower end of its interval, of networks that are kept."""


@dataclass(frozen=True)
class Rest:
    """Networks for what is unexplained, with their gain.

    Attributes:
        networks: fitted to all rows.
        inputs: inputs of each joint's network, as "joint.quantity".
        gain: 1 - RMSE(with networks) / RMSE(extended model) of these joints on blocks held out of the fit.
        interval: its bounds at 95 %.
    """

    networks: tuple[RestNetwork, ...]
    inputs: Mapping[str, tuple[str, ...]]
    gain: float
    interval: tuple[float, float]

    @property
    def sentence(self) -> str:
        """The sentence that reports them."""
        low, high = (100.0 * end for end in self.interval)
        inputs = dict.fromkeys(key for keys in self.inputs.values() for key in keys)
        return (
            f"Networks learn it at {listed(self.inputs)} from {listed(inputs)}: with them the extended model's held-out error "
            f"there falls by {100.0 * self.gain:.1f} % more (95 % interval {low:.1f} to {high:.1f} %)."
        )


def with_rest(
    diagnosis: Diagnosis, case: Case, left: np.ndarray
) -> tuple[Diagnosis, tuple[RestNetwork, ...]]:
    """A diagnosis extended by networks for what it leaves, and these; arguments as of `learned`."""
    rest = learned(case, left, diagnosis.above or diagnosis.slight)
    if rest is None:
        return diagnosis, ()
    said = f"{diagnosis.unexplained_sentence} {rest.sentence}"
    return replace(diagnosis, unexplained_sentence=said, learned=(rest.gain, *rest.interval)), rest.networks


def learned(case: Case, left: np.ndarray, joints: Sequence[str]) -> Rest | None:
    """Networks for what is left at some joints; None if they surely gain nothing.

    Inputs and weights are chosen without the held-out rows, which measure the gain only.

    Args:
        left: residual of all terms, fitted to all rows, (R, n) [N·m].
        joints: those where it exceeds the noise.
    """
    equations, apart = case.equations, case.attempt.extended
    if not any(_known(case.remainder.inputs.get(joint, {})) for joint in joints):
        return None
    names, counted = equations.motion.signals.joints, equations.usable
    equations.use_rows(counted & ~case.attempt.test[:, None])
    told = describe(equations, apart).inputs
    wanted = {names.index(joint): _known(told.get(joint, {}))[:MOST_INPUTS] for joint in joints}
    made = _made(equations, wanted)
    tried = _taught(equations, apart, made)
    equations.use_rows(counted)
    after, pushed = apart.copy(), pushing(case.attempt.fitted.terms, equations.rows.time)
    for one in tried:
        after[:, one.joint] -= made[one.joint][1] @ one.output_weights

    def gain(joints: Sequence[int]) -> tuple[float, tuple[float, float]]:
        there = np.isin(np.arange(equations.rows.width), joints)
        return held_out_gain(equations, after, case.held & there, pushed, apart)

    helps = [one.joint for one in tried if gain([one.joint])[1][0] >= SURELY]
    networks = _taught(equations, left, {joint: made[joint] for joint in helps})
    if not networks:
        return None
    inputs = {names[one.joint]: tuple(wanted[one.joint]) for one in networks}
    return Rest(networks, inputs, *gain([one.joint for one in networks]))


def _known(inputs: Mapping[str, float]) -> list[str]:
    """Those of some inputs that a network may use, strongest first."""
    seen = (key for key in inputs if key.rpartition(".")[2] in QUANTITIES)
    return sorted(seen, key=lambda key: -inputs[key])


Made = Mapping[int, tuple[RestNetwork, np.ndarray]]
"""A network with zero weights for each of some joints, with its features as rows, (R, F)."""


def _made(equations: Equations, wanted: Mapping[int, Sequence[str]]) -> Made:
    """Networks with zero weights for joints with wanted inputs, and their features."""
    motion = equations.motion
    given = motion.position, motion.velocity, motion.robot.gravity(motion.position)
    found = {}
    for joint, keys in wanted.items():
        if keys:
            network = RestNetwork.silent(joint, [_input(equations, given, key) for key in keys])
            features = network.features(given[0], given[1], motion.signals.sign, given[2])
            found[joint] = network, equations.decimation.as_rows(features, borne=False)
    return found


def _taught(equations: Equations, left: np.ndarray, made: Made) -> tuple[RestNetwork, ...]:
    """Networks fitted to a residual (R, n) in usable rows; none for joints where they would not help."""
    found = []
    for joint, (network, features) in made.items():
        rows = np.flatnonzero(equations.usable[:, joint])
        if not len(rows):
            continue
        parts = np.split(rows, np.flatnonzero(np.diff(equations.rows.block[rows])) + 1)
        pieces = np.array_split(np.arange(len(parts)), min(BLOCKS, len(parts)))
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


def _input(equations: Equations, given: Sequence[np.ndarray], key: str) -> Input:
    """An input of a network, with its range and scale along this motion.

    Args:
        given: `QUANTITIES` along the motion, (N, n) each.
    """
    motion = equations.motion
    name, _, quantity = key.rpartition(".")
    joint = motion.signals.joints.index(name)
    values = given[QUANTITIES.index(quantity)][:, joint]
    low, high = float(values.min()), float(values.max())
    scale = max(float(np.std(values)), 1e-9)
    if quantity == POSITION:
        scale = np.pi / max(high - low, 1e-9) if motion.robot.slides[joint] else 1.0
    return Input(joint, quantity, low, high, float(scale))
