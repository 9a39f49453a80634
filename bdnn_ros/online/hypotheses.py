"""What may have changed on a robot that moves, and how well each explains the residual since.

Everything is linear and Gaussian, so each hypothesis has its evidence in closed form (MacKay, "Information
theory, inference and learning algorithms", ch. 28): a payload changes the ten inertial parameters of one body
from some moment on, a change of friction three parameters of one joint, a push adds a wrench that is another
one in every `BLOCK_SECONDS`. All of them share what was not known of the robot before: motion the model
has not met is not taken for a change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from bdnn_ros.physical.parameters import Parameters, of_robot, prior
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals

BLOCK_SECONDS = 0.25
OWN = 4
"""A joint's own parameters: armature, viscous, coulomb, offset."""
LEVER = 0.15
"""Typical distance of a payload's centre from its link's origin [m]."""
GYRATION = 0.17
"""Typical distance for its second moments [m]."""
FRICTION = 0.3
"""Typical change of friction, as a share of the joint's effort scale."""
LEAST_CORRELATION = 3.0
"""Rows that say as much as one independent row under the low-pass alone."""
ALIKE = 0.03
"""Pushes or payloads on two links explain alike when they differ by less than this share."""
OFF_TIP = -3.0
"""Log odds of a payload or a push on another link than the last."""

Kind = Literal["payload", "friction", "push"]


@dataclass(frozen=True)
class Block:
    """Statistics of a short stretch of residuals, weighted by their noise.

    Attributes:
        start, end: [s].
        gram, moment: of the robot's P base parameters, (P, P) and (P,).
        pull_gram: of the wrenches on each body, (n, 6, 6).
        pull_moment: (n, 6).
        cross: wrench against parameters, (n, 6, P).
        energy: Σ w r².
        count: rows of all joints.
    """

    start: float
    end: float
    gram: np.ndarray
    moment: np.ndarray
    pull_gram: np.ndarray
    pull_moment: np.ndarray
    cross: np.ndarray
    energy: float
    count: int


@dataclass(frozen=True)
class Explanation:
    """A hypothesis after the data.

    Attributes:
        kind, target: what changed, on which body or joint.
        start, end: since when, and until when [s].
        evidence: log odds against no change.
        share: part of the residual's weighted square since `start` that it removes.
        misfit: what is left, as a multiple of the noise, at least 1.
        value, covariance: 10 inertial parameters, or (viscous, coulomb, offset), or the mean wrench.
        mean, spread: all base parameters relative to before, and their covariance, (P,) and (P, P).
    """

    kind: Kind
    target: int
    start: float
    end: float
    evidence: float
    share: float
    misfit: float
    value: np.ndarray
    covariance: np.ndarray
    mean: np.ndarray
    spread: np.ndarray


class Scene:
    """Columns and typical sizes of one robot.

    Args:
        robot: its description.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.width = robot.width
        belief = prior(robot)
        self.scale = belief.effort_scale
        ridge = 1e-12 * np.diag(np.diagonal(belief.covariance))
        self.information = _inverse(belief.covariance + ridge)[0]
        self.links = [robot.moving_link(joint) for joint in robot.joints]
        self.load = float(np.mean(np.maximum(robot.inertials[:, 0], 1e-3)))
        velocity = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, 2.0)
        self._friction = FRICTION * np.stack([self.scale / velocity, self.scale, self.scale / 3.0])

    def columns(self, signals: Signals, rows: np.ndarray) -> np.ndarray:
        """Low-passed columns of the base parameters, (R, n, P)."""
        robot, n = self.robot, self.width
        own = np.zeros((len(signals), n, OWN, n))
        each = np.arange(n)
        terms = (signals.acceleration, signals.velocity, signals.sign, np.ones_like(signals.position))
        for k, values in enumerate(terms):
            own[:, each, k, each] = values
        regressor = robot.regressor(signals.position, signals.velocity, signals.acceleration)
        columns = np.concatenate([regressor, own.reshape(len(signals), n, OWN * n)], axis=2)
        weights = signals.smooth(np.eye(len(signals)))[rows]
        return np.asarray(np.tensordot(weights, columns, axes=1))

    def pulls(self, signals: Signals, rows: np.ndarray) -> np.ndarray:
        """Columns of the wrenches on each body, (R, n, n, 6): they hardly change within a low-pass."""
        jacobians = [self.robot.link_jacobian(signals.position[rows], link) for link in self.links]
        return np.asarray(-np.stack(jacobians, axis=1).transpose(0, 3, 1, 2))

    def changed(self, kind: Kind, target: int) -> tuple[np.ndarray, np.ndarray]:
        """Which base parameters a payload or friction changes, and the prior covariance of the change."""
        n = self.width
        if kind == "payload":
            moments = [1.0, *[LEVER] * 3, *[GYRATION**2] * 6]
            return target * PER_LINK + np.arange(PER_LINK), np.diag((self.load * np.array(moments)) ** 2)
        index = n * PER_LINK + np.array([1, 2, 3]) * n + target
        return index, np.diag(self._friction[:, target] ** 2)

    @property
    def wrench(self) -> np.ndarray:
        """Prior covariance of a push, (6, 6)."""
        force = 9.81 * self.load
        return np.diag([force**2] * 3 + [(LEVER * force) ** 2] * 3)


def blocks(
    scene: Scene,
    signals: Signals,
    rows: np.ndarray,
    residual: np.ndarray,
    noise: np.ndarray,
    pushes: bool = True,
) -> list[Block]:
    """Statistics of residuals (R, n) [N·m] at the chosen samples, in blocks of time.

    Args:
        noise: standard deviation of one row, widened for the rows' correlation, (n,) [N·m].
        pushes: whether wrenches will be asked about.
    """
    columns = scene.columns(signals, rows)
    pull = scene.pulls(signals, rows) if pushes else np.zeros((len(rows), scene.width, scene.width, 6))
    time = signals.time[rows]
    number = np.floor((time - time[0]) / BLOCK_SECONDS + 1e-9).astype(int)
    result = []
    for k in np.unique(number):
        inside = number == k
        phi = (columns[inside] / noise[:, None]).reshape(-1, columns.shape[2])
        r = (residual[inside] / noise).ravel()
        w = (pull[inside] / noise[:, None, None]).reshape(-1, scene.width, 6).transpose(1, 0, 2)
        result.append(
            Block(
                float(time[inside][0]),
                float(time[inside][-1]),
                phi.T @ phi,
                phi.T @ r,
                np.swapaxes(w, 1, 2) @ w,
                np.swapaxes(w, 1, 2) @ r,
                np.swapaxes(w, 1, 2) @ phi,
                float(r @ r),
                len(r),
            )
        )
    return result


def explain(scene: Scene, data: Sequence[Block], information: np.ndarray) -> list[Explanation]:
    """Every hypothesis at its best moment, the best first.

    Args:
        data: blocks in order of time.
        information: inverse covariance of the base parameters before, (P, P).
    """
    known = _Known.of(data, information)
    tip = scene.width - 1
    found: list[Explanation] = []
    for target in range(scene.width):
        found += [_step(scene, data, known, kind, target) for kind in ("payload", "friction")]
        push = _push(scene, data, known, target)
        if push is not None:
            found.append(push)
    # a name that fits but for its edges raises the noise for all: rivals are apart by what that noise allows
    misfit = max(found, key=lambda e: e.evidence).misfit
    found = [replace(e, evidence=e.evidence / misfit, covariance=e.covariance * e.misfit) for e in found]
    odds = [e.evidence + (OFF_TIP if e.kind != "friction" and e.target != tip else 0.0) for e in found]
    return _outermost_first([found[k] for k in np.argsort(odds)[::-1]])


def _outermost_first(ranked: list[Explanation]) -> list[Explanation]:
    """With the outermost of the links that explain alike in front: neighbours share most of their motion."""
    best = ranked[0]
    if best.kind == "push":
        alike = [e for e in ranked if e.kind == "push" and e.share > best.share - ALIKE]
    elif best.kind == "payload":
        alike = [e for e in ranked if e.kind == "payload" and e.evidence > (1.0 - ALIKE) * best.evidence]
    else:
        return ranked
    chosen = max(alike, key=lambda e: e.target)
    return [chosen, *(e for e in ranked if e is not chosen)]


@dataclass(frozen=True)
class _Known:
    """The base parameters if nothing changed: prior information, and mean and covariance after the data."""

    information: np.ndarray
    gram: np.ndarray
    moment: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(cls, data: Sequence[Block], information: np.ndarray) -> _Known:
        gram = np.sum([block.gram for block in data], axis=0)
        moment = np.sum([block.moment for block in data], axis=0)
        covariance = _inverse(information + gram)[0]
        return cls(information, gram, moment, covariance @ moment, covariance)


def _step(scene: Scene, data: Sequence[Block], known: _Known, kind: Kind, target: int) -> Explanation:
    """Parameters that are others from some block on, by Schur complements of what is known without."""
    index, size = scene.changed(kind, target)
    inverse_size, log_size = _inverse(size)
    gram, moment = np.zeros_like(known.gram), np.zeros_like(known.moment)
    best = (-np.inf, 0, np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)))
    for first in range(len(data) - 1, -1, -1):
        gram = gram + data[first].gram
        moment = moment + data[first].moment
        cross = gram[index]
        inner = gram[np.ix_(index, index)] - cross @ known.covariance @ cross.T + inverse_size
        score = moment[index] - cross @ known.mean
        spread, log_inner = _inverse(inner)
        change = spread @ score
        gain = 0.5 * (float(score @ change) - log_size - log_inner)
        if gain > best[0]:
            best = (gain, first, change, spread, cross)
    gain, first, change, spread, cross = best
    # the change moves what is known of the other parameters, too
    pull = np.zeros((len(known.mean), len(index)))
    pull[index, np.arange(len(index))] = 1.0
    pull -= known.covariance @ cross.T
    before = known.mean - known.covariance @ cross.T @ change
    part = np.zeros(len(known.mean))
    part[index] = change
    return Explanation(
        kind,
        target,
        data[first].start,
        data[-1].end,
        gain,
        _share(data[first:], before, part),
        _misfit(data[first:], sum(_energy(block, before + part) for block in data[first:])),
        change,
        spread,
        before + part,
        known.covariance + pull @ spread @ pull.T,
    )


def _push(scene: Scene, data: Sequence[Block], known: _Known, target: int) -> Explanation | None:
    """A wrench on one body over some blocks, another one in each."""
    inverse_size, log_size = _inverse(scene.wrench)
    spreads, gains = [], []
    for block in data:
        spread, log_inner = _inverse(block.pull_gram[target] + inverse_size)
        score = block.pull_moment[target]
        spreads.append(spread)
        gains.append(0.5 * (float(score @ spread @ score) - log_size - log_inner))
    low, high = _best_run(gains)
    if high == low:
        return None
    gram, moment = known.gram.copy(), known.moment.copy()
    for block, spread in zip(data[low:high], spreads[low:high], strict=True):
        cross = block.cross[target]
        gram -= cross.T @ spread @ cross
        moment -= cross.T @ (spread @ block.pull_moment[target])
    covariance, log_with = _inverse(known.information + gram)
    mean = covariance @ moment
    log_without = -np.linalg.slogdet(known.covariance)[1]
    without = 0.5 * (float(known.moment @ known.mean) - log_without)
    evidence = sum(gains[low:high]) + 0.5 * (float(moment @ mean) - log_with) - without
    wrenches, removed, energy = [], 0.0, 0.0
    for block, spread in zip(data[low:high], spreads[low:high], strict=True):
        score = block.pull_moment[target] - block.cross[target] @ mean
        wrench = spread @ score
        wrenches.append(wrench)
        removed += 2.0 * float(wrench @ score) - float(wrench @ block.pull_gram[target] @ wrench)
        energy += _energy(block, mean)
    return Explanation(
        "push",
        target,
        data[low].start,
        data[high - 1].end,
        evidence,
        removed / max(energy, 1e-300),
        _misfit(data[low:high], energy - removed),
        np.mean(wrenches, axis=0),
        np.mean(spreads[low:high], axis=0) / (high - low),
        mean,
        covariance,
    )


def _inverse(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse of a positive-definite matrix, and the logarithm of its determinant."""
    size = np.sqrt(np.diagonal(matrix))
    factor, lower = cho_factor(matrix / np.outer(size, size), lower=True, check_finite=False)
    inverse = cho_solve((factor, lower), np.eye(len(size)), check_finite=False) / np.outer(size, size)
    log_determinant = 2.0 * float(np.log(np.diagonal(factor)).sum() + np.log(size).sum())
    return 0.5 * (inverse + inverse.T), log_determinant


def inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a positive-definite matrix."""
    return _inverse(matrix)[0]


def _energy(block: Block, mean: np.ndarray) -> float:
    """Weighted square of the residual under base parameters `mean`."""
    return max(block.energy - 2.0 * float(mean @ block.moment) + float(mean @ block.gram @ mean), 1e-300)


def _misfit(data: Sequence[Block], left: float) -> float:
    """How many times the noise is left of the weighted square, at least 1 (Birge 1932)."""
    return max(LEAST_CORRELATION * left / sum(block.count for block in data), 1.0)


def _share(data: Sequence[Block], before: np.ndarray, change: np.ndarray) -> float:
    """Part of the weighted square since the change that the change removes."""
    old = sum(_energy(block, before) for block in data)
    new = sum(_energy(block, before + change) for block in data)
    return 1.0 - new / max(old, 1e-300)


def _best_run(gains: Sequence[float]) -> tuple[int, int]:
    """The consecutive items with the largest sum, as a half-open range (Bentley 1984, Kadane's algorithm)."""
    best, result, total, start = 0.0, (0, 0), 0.0, 0
    for k, gain in enumerate(gains):
        if total <= 0.0:
            total, start = 0.0, k
        total += gain
        if total > best:
            best, result = total, (start, k + 1)
    return result


def base_parameters(robot: Robot, offset: np.ndarray) -> np.ndarray:
    """The P base parameters of an identified robot, (P,)."""
    own = of_robot(robot)
    return Parameters(own.inertials, own.armature, own.viscous, own.coulomb, offset).vector()
