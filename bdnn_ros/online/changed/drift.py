"""Detects friction that changes too slowly to be seen from one second to the next.

The model in service follows such a change and hides it. Here one model stays the reference for minutes. Its residual is explained
by constant parameter errors and, joint by joint, by friction that grows or shrinks linearly since some moment (a ramp).
Everything is linear and Gaussian, as in `hypotheses`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.online.changed.hypotheses import Explanation, Known, energy, misfit, step
from bdnn_ros.online.changed.scene import Block, Scene, base_parameters, inverse
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Prior
from bdnn_ros.signals import Signals

CHUNKS = 4
"""Chunks of motion that are summed up together."""
MOST = 60
"""So many of these are remembered."""
LEAST = 4
"""A ramp lasts at least so many."""
SURE = 25.0
"""Log odds against no change from which a drift is named."""
APART = 8.0
"""Log odds by which it must lead a payload."""
SHARE = 0.1
"""Least change that is named, as a share of the joint's friction."""
OF_EFFORT = 0.01
"""And as a share of its effort scale."""
KNOWN = 5.0
"""And in standard deviations."""


@dataclass(frozen=True)
class Ramp:
    """Friction of one joint that changes linearly from the start of block `first` on."""

    joint: int
    first: int
    gain: float


class Drift:
    """Searches the motion of the last minutes for slow changes of friction.

    Args:
        scene: of the robot.

    Attributes:
        reference: what was known at the start of these minutes, as base parameters, (P,).
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.clear()

    def clear(self) -> None:
        """Forget the past minutes, because the robot has changed."""
        self._model: PhysicalModel | None = None
        self._noise = np.zeros(0)
        self._blocks: list[Block] = []
        self._parts: list[Block] = []

    @property
    def reference(self) -> np.ndarray:
        """What the changes are counted from."""
        assert self._model is not None
        return base_parameters(self._model.robot, self._model.offset)

    def look(
        self,
        signals: Signals,
        rows: np.ndarray,
        columns: np.ndarray,
        model: PhysicalModel,
        noise: np.ndarray | None,
        certain: np.ndarray,
    ) -> tuple[list[Explanation], Prior] | None:
        """Process the next chunk; returns the drifts found and the belief about the robot now, or None.

        Args:
            signals, rows: its motion and the samples that count.
            columns: of the base parameters there, low-passed, (R, n, P).
            model: that serves.
            noise: standard deviation of one row as if rows were independent, (n,) [N·m]; None if not known.
            certain: what each row counts for each joint, from 0 to 1, (R, n).
        """
        if self._model is None or _terms(self._model) != _terms(model):
            self.clear()
            if noise is None:
                return None
            self._model, self._noise = model, noise
        assert signals.effort is not None
        residual = signals.smooth(signals.effort - self._model.predict(signals))[rows]
        self._parts.append(_block(signals.time[rows], columns, residual, np.sqrt(certain) / self._noise))
        if len(self._parts) < CHUNKS:
            return None
        self._blocks = [*self._blocks, _joined(self._parts)][-MOST:]
        self._parts = []
        return self._judge() if len(self._blocks) > LEAST else None

    def _judge(self) -> tuple[list[Explanation], Prior] | None:
        scene, data, information = self._scene, self._blocks, self._scene.information
        ramps: list[Ramp] = []
        while len(ramps) < scene.width:
            known = Known.of(data, information)
            found = [
                _steepest(scene, data, known, joint)
                for joint in range(scene.width)
                if joint not in [ramp.joint for ramp in ramps]
            ]
            best = max(found, key=lambda ramp: ramp.gain)
            left = sum(energy(block, known.mean) for block in data) - 2.0 * best.gain
            if best.gain / misfit(data, max(left, 0.0)) < SURE or self._is_payload(known, best):
                break
            ramps.append(best)
            data, information = _with_ramp(scene, data, information, best)
        if not ramps:
            return None
        known = Known.of(data, information)
        noise = misfit(data, sum(energy(block, known.mean) for block in data))
        found_all = [self._explanation(known, ramps, k, noise) for k in range(len(ramps))]
        found_all = [e for e in found_all if self._matters(e, known.mean)]
        return (found_all, self._belief(known, ramps)) if found_all else None

    def _is_payload(self, known: Known, best: Ramp) -> bool:
        """Whether a payload gripped or released explains about as much."""
        data = [_plain(block, len(self._scene.information)) for block in self._blocks]
        if len(known.mean) > len(self._scene.information):
            return False  # it was asked before the first ramp
        payloads = [step(self._scene, data, known, "payload", k).evidence for k in range(self._scene.width)]
        return max(payloads) > best.gain - APART

    def _explanation(self, known: Known, ramps: Sequence[Ramp], which: int, noise: float) -> Explanation:
        size, ramp = len(self._scene.information), ramps[which]
        own = slice(size + 3 * which, size + 3 * which + 3)
        data = self._blocks
        without = known.mean.copy()
        without[own] = 0.0
        augmented = data
        information = self._scene.information
        for each in ramps:
            augmented, information = _with_ramp(self._scene, augmented, information, each)
        before = sum(energy(block, without) for block in augmented[ramp.first :])
        after = sum(energy(block, known.mean) for block in augmented[ramp.first :])
        return Explanation(
            "friction",
            ramp.joint,
            data[ramp.first].start,
            data[-1].end,
            ramp.gain / noise,
            1.0 - after / max(before, 1e-300),
            noise,
            known.mean[own],
            noise * known.covariance[own, own],
            known.mean[:size],
            known.covariance[:size, :size],
        )

    def _matters(self, found: Explanation, mean: np.ndarray) -> bool:
        """Whether the change is large enough to report, at the usual speed of the joint."""
        index, _ = self._scene.changed("friction", found.target)
        gram = sum(block.gram[np.ix_(index, index)] for block in self._blocks)
        speed = float(np.sqrt(gram[0, 0] / max(gram[1, 1], 1e-300)))
        way = np.array([speed, 1.0, 0.0])
        before = (self.reference + mean[: len(self.reference)])[index]
        if found.below_nothing(before + found.value):
            return False
        level = float(way @ before)
        change = max(abs(float(way @ found.value)), abs(float(found.value[2])))
        spread = float(np.sqrt(max(way @ found.covariance @ way, found.covariance[2, 2])))
        least = max(SHARE * level, OF_EFFORT * self._scene.scale[found.target], KNOWN * spread)
        return change > least

    def _belief(self, known: Known, ramps: Sequence[Ramp]) -> Prior:
        """The belief about the robot at the end, wide enough for friction that drifts on."""
        size = len(self._scene.information)
        now = np.eye(size, len(known.mean))
        more = np.zeros((size, size))
        for k, ramp in enumerate(ramps):
            index, spread = self._scene.changed("friction", ramp.joint)
            now[index, size + 3 * k + np.arange(3)] = 1.0
            more[np.ix_(index, index)] += spread
        covariance = now @ known.covariance @ now.T + more
        return Prior(self.reference + now @ known.mean, 0.5 * (covariance + covariance.T), self._scene.scale)


def _terms(model: PhysicalModel) -> tuple[object, ...]:
    """The terms of a model; the reference must have the same ones as the model in service."""
    groups = model.learned.groups if model.learned is not None else ()
    return model.breakaway, model.motors.couplings, groups


def _block(time: np.ndarray, columns: np.ndarray, residual: np.ndarray, weight: np.ndarray) -> Block:
    phi = (columns * weight[:, :, None]).reshape(-1, columns.shape[2])
    r = (residual * weight).ravel()
    none = np.zeros(0)
    return Block(
        float(time[0]), float(time[-1]), phi.T @ phi, phi.T @ r, none, none, none, float(r @ r), len(r)
    )


def _joined(parts: Sequence[Block]) -> Block:
    return replace(
        parts[0],
        end=parts[-1].end,
        gram=np.sum([part.gram for part in parts], axis=0),
        moment=np.sum([part.moment for part in parts], axis=0),
        energy=sum(part.energy for part in parts),
        count=sum(part.count for part in parts),
    )


def _plain(block: Block, size: int) -> Block:
    return replace(block, gram=block.gram[:size, :size], moment=block.moment[:size])


def _heights(data: Sequence[Block], first: int) -> np.ndarray:
    """Height of a ramp from block `first` on at each block; one at the end."""
    middle = np.array([0.5 * (block.start + block.end) for block in data])
    start, end = data[first].start, data[-1].end
    return np.clip((middle - start) / (end - start), 0.0, 1.0)


def _steepest(scene: Scene, data: Sequence[Block], known: Known, joint: int) -> Ramp:
    """The start of a ramp of one joint's friction that explains most, by Schur complements."""
    index, size = scene.changed("friction", joint)
    inverse_size, log_size = inverse(size)
    cross_parts = np.array([block.gram[index] for block in data])
    inner_parts = cross_parts[:, :, index]
    moment_parts = np.array([block.moment[index] for block in data])
    best = Ramp(joint, 0, -np.inf)
    for first in range(len(data) - LEAST + 1):
        height = _heights(data, first)
        cross = np.tensordot(height, cross_parts, 1)
        inner = np.tensordot(height**2, inner_parts, 1) - cross @ known.covariance @ cross.T + inverse_size
        score = height @ moment_parts - cross @ known.mean
        spread, log_inner = inverse(inner)
        gain = 0.5 * (float(score @ spread @ score) - log_size - log_inner)
        if gain > best.gain:
            best = Ramp(joint, first, gain)
    return best


def _with_ramp(
    scene: Scene, data: Sequence[Block], information: np.ndarray, ramp: Ramp
) -> tuple[list[Block], np.ndarray]:
    """The statistics with the three parameters of the ramp appended."""
    index, size = scene.changed("friction", ramp.joint)
    count = len(information)
    result = []
    for block, height in zip(data, _heights(data, ramp.first), strict=True):
        way = np.eye(count + len(index), count)
        way[count:, :] = 0.0
        way[count + np.arange(len(index)), index] = height
        result.append(replace(block, gram=way @ block.gram @ way.T, moment=way @ block.moment))
    wider = np.zeros((count + len(index),) * 2)
    wider[:count, :count] = information
    wider[count:, count:] = inverse(size)[0]
    return result, wider
