"""Hypotheses on what has changed on a moving robot, and how well each explains the residual since.

Everything is linear and Gaussian, so each hypothesis has its evidence in closed form (MacKay, "Information theory, inference and
learning algorithms", ch. 28). A payload changes the ten inertial parameters of one body from some moment on. A change of friction
changes three parameters of one joint. A push adds a wrench that may differ in every `BLOCK_SECONDS`. All share the prior
uncertainty of the robot, so that motion the model has not met yet is not mistaken for a change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from bdnn_ros.online.changed.scene import Block, Kind, Scene, inverse
from bdnn_ros.online.changed.usual import CORRELATION

ALIKE = 0.03
"""Pushes or payloads on two links explain alike when they differ by less than this share."""
NEGATIVE = 2.0
"""Standard deviations by which what cannot be negative is less than nothing."""
POSITIVE: Mapping[Kind, int] = MappingProxyType({"payload": 1, "friction": 2, "push": 0})
"""How many of what a change changes, from the first, cannot be negative."""
OFF_TIP = -3.0
"""Log odds of a payload or a push on another link than the last."""


@dataclass(frozen=True)
class Explanation:
    """A hypothesis evaluated on the data.

    Attributes:
        kind, target: what changed, on which body or joint.
        start, end: since when, and until when [s].
        evidence: log odds against no change.
        edge: the part of it that is a wrench in the block in which the change began.
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
    edge: float = 0.0

    def below_nothing(self, after: np.ndarray) -> bool:
        """Whether a quantity that cannot be negative certainly is: a body's mass, viscous or Coulomb friction.

        Args:
            after: the parameters that it changes, as it leaves them, in the order of `value`.
        """
        spread = np.sqrt(np.diagonal(self.covariance))
        return bool((after < -NEGATIVE * spread)[: POSITIVE[self.kind]].any())


def explain(scene: Scene, data: Sequence[Block], information: np.ndarray) -> list[Explanation]:
    """Every hypothesis at its most likely moment, the best first.

    Args:
        data: blocks in order of time.
        information: inverse covariance of the base parameters before, (P, P).
    """
    known = Known.of(data, information)
    tip = scene.width - 1
    found: list[Explanation] = []
    for target in range(scene.width):
        jolts = [jolt(scene, block, target) for block in data]
        # a change hardly ever falls on the edge of a block: the one before it may have a wrench of its own
        begun = [
            known.beside([(block, each)], target) if each.evidence > 0.0 else None
            for block, each in zip(data, jolts, strict=True)
        ]
        found += [step(scene, data, known, kind, target, begun) for kind in ("payload", "friction")]
        push = _push(data, known, target, jolts)
        if push is not None:
            found.append(push)
    # a name that fits but for its edges raises the noise for all: rivals are apart by what that noise allows
    noise = max(found, key=lambda e: e.evidence).misfit
    found = [
        replace(e, evidence=e.evidence / noise, edge=e.edge / noise, covariance=e.covariance * e.misfit)
        for e in found
    ]
    odds = [e.evidence + (OFF_TIP if e.kind != "friction" and e.target != tip else 0.0) for e in found]
    return _outermost_first([found[k] for k in np.argsort(odds)[::-1]])


def _outermost_first(ranked: list[Explanation]) -> list[Explanation]:
    """The ranking with the outermost of equally good links first: neighbouring links share most of their motion."""
    best = ranked[0]
    if best.kind == "push":
        alike = [e for e in ranked if e.kind == "push" and e.share > best.share - ALIKE]
    elif best.kind == "payload":
        least = best.evidence - ALIKE * abs(best.evidence)
        alike = [e for e in ranked if e.kind == "payload" and e.evidence >= least]
    else:
        return ranked
    chosen = max(alike, key=lambda e: e.target)
    return [chosen, *(e for e in ranked if e is not chosen)]


@dataclass(frozen=True)
class Jolt:
    """A wrench on one body during one block: its evidence, mean and covariance."""

    evidence: float
    wrench: np.ndarray
    spread: np.ndarray

    def beside(self, block: Block, target: int, mean: np.ndarray) -> tuple[np.ndarray, float]:
        """The wrench if the base parameters are off by `mean`, and the weighted square that it removes then."""
        gram, score = block.pull_gram[target], block.pull_moment[target] - block.cross[target] @ mean
        wrench = self.spread @ score
        return wrench, 2.0 * float(wrench @ score) - float(wrench @ gram @ wrench)


def jolt(scene: Scene, block: Block, target: int) -> Jolt:
    """The wrench that best explains a block if the base parameters are right."""
    inverse_size, log_size = inverse(scene.wrench)
    score = block.pull_moment[target]
    spread, log_inner = inverse(block.pull_gram[target] + inverse_size)
    wrench = spread @ score
    return Jolt(0.5 * (float(score @ wrench) - log_size - log_inner), wrench, spread)


@dataclass(frozen=True)
class Known:
    """The base parameters if nothing changed: prior information, posterior mean and covariance.

    Attributes:
        evidence: log evidence of the data up to a constant of the prior.
    """

    information: np.ndarray
    gram: np.ndarray
    moment: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray
    evidence: float

    @classmethod
    def of(cls, data: Sequence[Block], information: np.ndarray) -> Known:
        gram = np.sum([block.gram for block in data], axis=0)
        return cls.from_sums(information, gram, np.sum([block.moment for block in data], axis=0))

    @classmethod
    def from_sums(cls, information: np.ndarray, gram: np.ndarray, moment: np.ndarray) -> Known:
        """The same from sums over the data."""
        covariance, volume = inverse(information + gram)
        mean = covariance @ moment
        evidence = 0.5 * (float(moment @ mean) - volume)
        return cls(information, gram, moment, mean, covariance, evidence)

    def beside(self, wrenches: Sequence[tuple[Block, Jolt]], target: int) -> Known:
        """The posterior if some blocks have an arbitrary wrench of their own on a body."""
        gram, moment = self.gram.copy(), self.moment.copy()
        for block, each in wrenches:
            cross = block.cross[target]
            gram -= cross.T @ each.spread @ cross
            moment -= cross.T @ each.wrench
        found = Known.from_sums(self.information, gram, moment)
        return replace(found, evidence=found.evidence + sum(each.evidence for _, each in wrenches))


def step(
    scene: Scene,
    data: Sequence[Block],
    known: Known,
    kind: Kind,
    target: int,
    begun: Sequence[Known | None] = (),
) -> Explanation:
    """Parameters that change at some block, by Schur complements of the posterior without the change.

    Args:
        begun: what is known where the change begins inside each block, if it may.
    """
    index, size = scene.changed(kind, target)
    inverse_size, log_size = inverse(size)
    gram, moment = np.zeros_like(known.gram), np.zeros_like(known.moment)
    best, chosen = _Step(-np.inf, np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))), (known, 0, 0.0)
    for first in range(len(data) - 1, -1, -1):
        gram = gram + data[first].gram
        moment = moment + data[first].moment
        for without in (known, begun[first - 1] if begun and first else None):
            if without is not None:
                edge = without.evidence - known.evidence
                tried = _step(without, gram[index], moment[index], index, inverse_size, log_size)
                if tried.gain + edge > best.gain + chosen[2]:
                    best, chosen = tried, (without, first, edge)
    without, first, edge = chosen
    # the change moves what is known of the other parameters, too
    pull = np.zeros((len(known.mean), len(index)))
    pull[index, np.arange(len(index))] = 1.0
    pull -= without.covariance @ best.cross.T
    before = without.mean - without.covariance @ best.cross.T @ best.change
    part = np.zeros(len(known.mean))
    part[index] = best.change
    old = sum(energy(block, before) for block in data[first:])
    new = sum(energy(block, before + part) for block in data[first:])
    return Explanation(
        kind,
        target,
        data[first if without is known else first - 1].start,
        data[-1].end,
        best.gain + edge,
        1.0 - new / max(old, 1e-300),
        misfit(data[first:], new),
        best.change,
        best.spread,
        before + part,
        without.covariance + pull @ best.spread @ pull.T,
        edge,
    )


@dataclass(frozen=True)
class _Step:
    """A change of parameters: log odds, mean, covariance, and the information that it shares with all parameters."""

    gain: float
    change: np.ndarray
    spread: np.ndarray
    cross: np.ndarray


def _step(
    known: Known,
    cross: np.ndarray,
    moment: np.ndarray,
    index: np.ndarray,
    inverse_size: np.ndarray,
    log_size: float,
) -> _Step:
    inner = cross[:, index] - cross @ known.covariance @ cross.T + inverse_size
    score = moment - cross @ known.mean
    spread, log_inner = inverse(inner)
    change = spread @ score
    return _Step(0.5 * (float(score @ change) - log_size - log_inner), change, spread, cross)


def _push(data: Sequence[Block], known: Known, target: int, jolts: Sequence[Jolt]) -> Explanation | None:
    """A wrench on one body during several blocks, a different one in each."""
    low, high = _best_run([each.evidence for each in jolts])
    if high == low:
        return None
    pushed = known.beside(list(zip(data[low:high], jolts[low:high], strict=True)), target)
    mean = pushed.mean
    settled = [
        each.beside(block, target, mean) for block, each in zip(data[low:high], jolts[low:high], strict=True)
    ]
    whole = sum(energy(block, mean) for block in data[low:high])
    removed = sum(less for _, less in settled)
    return Explanation(
        "push",
        target,
        data[low].start,
        data[high - 1].end,
        pushed.evidence - known.evidence,
        removed / max(whole, 1e-300),
        misfit(data[low:high], whole - removed),
        np.mean([wrench for wrench, _ in settled], axis=0),
        np.mean([each.spread for each in jolts[low:high]], axis=0) / (high - low),
        mean,
        pushed.covariance,
    )


def energy(block: Block, mean: np.ndarray) -> float:
    """Weighted square of the residual under base parameters `mean`."""
    return max(block.energy - 2.0 * float(mean @ block.moment) + float(mean @ block.gram @ mean), 1e-300)


def misfit(data: Sequence[Block], left: float) -> float:
    """Ratio of the residual to the noise, at least 1 (Birge 1932)."""
    return max(CORRELATION[0] * left / sum(block.count for block in data), 1.0)


def _best_run(gains: Sequence[float]) -> tuple[int, int]:
    """The run of consecutive items with the largest sum, as a half-open range (Bentley 1984, Kadane's algorithm)."""
    best, result, total, start = 0.0, (0, 0), 0.0, 0
    for k, gain in enumerate(gains):
        if total <= 0.0:
            total, start = 0.0, k
        total += gain
        if total > best:
            best, result = total, (start, k + 1)
    return result
