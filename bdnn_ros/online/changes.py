"""Notices that a robot has changed while it moves, and says what: a payload, a push, or friction."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from bdnn_ros.online.hypotheses import Explanation, explain
from bdnn_ros.online.scene import Block, Scene, base_parameters, blocks, inverse
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Prior
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals

QUIET_CHUNKS = 5
"""Chunks without suspicion before a change can be told from learning."""
REMEMBERED = 20
"""Chunks whose residual says what is usual."""
ODD = 3.0
"""A chunk is suspicious when a joint's squared residual is so many times the usual."""
CALM = 1.5
"""And it is over when it is less than so many times the usual."""
SURE = 15.0
"""Log odds against no change from which a change is named."""
APART = 4.0
"""Log odds by which it must lead its rivals, unless `LONGEST` has passed."""
EXPLAINED = 0.6
"""Part of the residual since the change that its name must explain."""
LEAST = 1.5
"""Motion after a change that lasts before it is named [s]."""
LEAST_PUSH = 0.2
"""A push is named from this share of a mean link's weight on: stiction and gears give less."""
KNOWN = 3.0
"""A payload is named when its mass is so many standard deviations from zero."""
LONGEST = 8
"""Chunks that are looked at together."""
CORRELATION = (3.0, 30.0)
"""Rows that say as much as one independent row: least (the low-pass alone) and most."""


@dataclass(frozen=True)
class Change:
    """A change that was named.

    Attributes:
        explanation: the hypothesis that won.
        rivals: others within `APART` of it.
        finding: as in the contract's diagnosis.json, with the time [s] on the stream's clock.
        belief: what is known of the robot after it.
    """

    explanation: Explanation
    rivals: tuple[Explanation, ...]
    finding: dict[str, Any]
    belief: Prior


class Monitor:
    """Watches the residual of the model that serves, one chunk of motion after the other.

    Args:
        robot: its description.
    """

    def __init__(self, robot: Robot) -> None:
        self.scene = Scene(robot)
        self._information = self.scene.information.copy()
        self._usual: deque[np.ndarray] = deque(maxlen=REMEMBERED)
        self._correlation: deque[np.ndarray] = deque(maxlen=REMEMBERED)
        self._reference: PhysicalModel | None = None
        self._before: tuple[Signals, np.ndarray] | None = None
        self._suspects: list[tuple[Signals, np.ndarray]] = []
        self._calm = 0

    def look(self, signals: Signals, rows: np.ndarray, model: PhysicalModel | None) -> Change | None:
        """Look at the next chunk.

        Args:
            signals, rows: its motion and the samples that count.
            model: that serves, None before the first.
        """
        if model is None:
            return None
        suspicious = bool(self._suspects)
        reference = self._reference if suspicious and self._reference is not None else model
        residual = _residual(reference, signals, rows)
        squared = np.mean(residual**2, axis=0)
        ready = len(self._usual) >= QUIET_CHUNKS
        ratio = float(np.max(squared / self._level)) if ready else 0.0
        if not suspicious and not (ready and ratio > ODD):
            self._learn(signals, rows, residual, squared)
            self._reference, self._before = model, (signals, rows)
            return None
        self._suspects.append((signals, rows))
        self._calm = self._calm + 1 if ratio < CALM else 0
        change = self._judge()
        if change is not None:
            self._start_over(change.belief)
        elif self._calm >= 2 or len(self._suspects) >= LONGEST:
            self._dismiss(model)
        return change

    # -- what is usual ---------------------------------------------------------------------------

    @property
    def _level(self) -> np.ndarray:
        """Usual squared residual of each joint, (n,)."""
        level = np.median(self._usual, axis=0)
        return np.asarray(np.maximum(level, (1e-4 * self.scene.scale) ** 2))

    @property
    def _noise(self) -> np.ndarray:
        """Standard deviation of one row as if rows were independent, (n,)."""
        return np.asarray(np.sqrt(self._level * np.median(self._correlation, axis=0)))

    def _learn(self, signals: Signals, rows: np.ndarray, residual: np.ndarray, squared: np.ndarray) -> None:
        self._usual.append(squared)
        self._correlation.append(_correlation(residual))
        phi = self.scene.columns(signals, rows) / self._noise[:, None]
        self._information += np.tensordot(phi, phi, axes=((0, 1), (0, 1)))

    def _start_over(self, belief: Prior) -> None:
        self._information = inverse(belief.covariance)[0]
        self._dismiss(None)

    def _dismiss(self, model: PhysicalModel | None) -> None:
        """Forget what was usual: whatever it was, from now on it is so."""
        self._usual.clear()
        self._correlation.clear()
        self._suspects, self._calm = [], 0
        self._reference, self._before = model, None

    # -- judging ---------------------------------------------------------------------------------

    def _judge(self) -> Change | None:
        """Name the change, if the motion so far says enough."""
        window = [*([self._before] if self._before else []), *self._suspects]
        if self._reference is None:
            return None
        data: list[Block] = []
        for signals, rows in window:
            residual = _residual(self._reference, signals, rows)
            data += blocks(self.scene, signals, rows, residual, self._noise)
        found = explain(self.scene, data, self._information)
        best = found[0]
        seen = data[-1].end - best.start
        if max(e.evidence for e in found) < SURE or best.share < EXPLAINED or seen < LEAST:
            return None
        if best.kind == "push" and np.linalg.norm(best.value[:3]) < LEAST_PUSH * 9.81 * self.scene.load:
            return None
        if best.kind == "payload" and abs(best.value[0]) < KNOWN * np.sqrt(best.covariance[0, 0]):
            return None
        rivals = tuple(e for e in found[1:] if best.evidence - e.evidence < APART and e.kind != best.kind)
        if rivals and len(self._suspects) < LONGEST - 1:
            return None
        mean = base_parameters(self._reference.robot, self._reference.offset)
        spread = 0.5 * (best.spread + best.spread.T)
        belief = Prior(mean + best.mean, spread, self.scene.scale)
        return Change(best, rivals, _finding(self.scene, best, rivals, mean), belief)


def _residual(model: PhysicalModel, signals: Signals, rows: np.ndarray) -> np.ndarray:
    """What the model leaves of the effort, low-passed, (R, n) [N·m]."""
    assert signals.effort is not None
    return np.asarray(signals.smooth(signals.effort - model.predict(signals))[rows])


def _correlation(residual: np.ndarray) -> np.ndarray:
    """Rows that say as much as one independent row, from the autocorrelation of one chunk, (n,)."""
    r = residual - residual.mean(axis=0)
    power = np.maximum((r**2).sum(axis=0), 1e-300)
    result = np.ones(r.shape[1])
    growing = np.ones(r.shape[1], bool)
    for lag in range(1, len(r) // 2):
        rho = (r[lag:] * r[:-lag]).sum(axis=0) / power
        growing &= rho > 0.05
        if not growing.any():
            break
        result += np.where(growing, 2.0 * rho, 0.0)
    return np.asarray(np.clip(result, *CORRELATION))


# -- words ---------------------------------------------------------------------------------------


def _finding(
    scene: Scene, best: Explanation, rivals: tuple[Explanation, ...], before: np.ndarray
) -> dict[str, Any]:
    """The change as a finding of the contract."""
    describe = {"payload": _payload, "friction": _friction, "push": _push}[best.kind]
    entry = describe(scene, best, before)
    odds = np.exp([e.evidence - best.evidence for e in (best, *rivals)])
    probability = odds / odds.sum()
    entry |= {
        "share": float(np.clip(best.share, 0.0, 1.0)),
        "probability": float(probability[0]),
        "rivals": [
            {**_where(scene, rival), "probability": float(p)}
            for rival, p in zip(rivals, probability[1:], strict=True)
        ],
    }
    return entry


def _where(scene: Scene, found: Explanation) -> dict[str, Any]:
    effect = {"payload": "payload", "friction": "drift", "push": "external_wrench"}[found.kind]
    joint = scene.robot.joints[found.target] if found.kind == "friction" else None
    return {"effect": effect, "joint": joint, "link": None if joint else scene.links[found.target]}


def _quantity(value: float, std: float, unit: str) -> dict[str, Any]:
    return {"value": float(f"{value:.6g}"), "std": float(f"{std:.3g}"), "unit": unit}


def _payload(scene: Scene, found: Explanation, before: np.ndarray) -> dict[str, Any]:
    """Something gripped (mass added) or released (mass taken away)."""
    mass = float(found.value[0])
    released = mass < 0
    centre = found.value[1:4] / mass
    std = np.sqrt(np.diagonal(found.covariance))
    time = "end" if released else "start"
    parameters = {
        "mass": _quantity(abs(mass), std[0], "kg"),
        **{f"com_{axis}": _quantity(centre[k], std[1 + k] / abs(mass), "m") for k, axis in enumerate("xyz")},
        time: _quantity(found.start, 0.25, "s"),
    }
    link = scene.links[found.target]
    verb = "released" if released else "gripped"
    sentence = f"{link} {verb} {abs(mass):.2f} kg (± {std[0]:.2f}) at {found.start:.1f} s."
    return {**_where(scene, found), "parameters": parameters, "sentence": sentence}


def _friction(scene: Scene, found: Explanation, before: np.ndarray) -> dict[str, Any]:
    """Friction of a joint that is another than before: the part that changed most."""
    n = scene.width
    index = n * PER_LINK + np.array([1, 2, 3]) * n + found.target
    std = np.sqrt(np.diagonal(found.covariance))
    which = int(np.argmax(np.abs(found.value) / scene.changed("friction", found.target)[1].diagonal() ** 0.5))
    name = ("viscous friction", "Coulomb friction", "effort offset")[which]
    unit = ("N*m*s/rad", "N*m", "N*m")[which]
    old, new = before[index[which]], before[index[which]] + found.value[which]
    parameters = {
        "start_value": _quantity(old, std[which], unit),
        "end_value": _quantity(new, std[which], unit),
        "start": _quantity(found.start, 0.5, "s"),
    }
    joint = scene.robot.joints[found.target]
    text = unit.replace("*", "·")
    sentence = (
        f"{joint} drifts: its {name} went from {old:.3g} to {new:.3g} {text} since {found.start:.1f} s."
    )
    return {**_where(scene, found), "parameters": parameters, "sentence": sentence}


def _push(scene: Scene, found: Explanation, before: np.ndarray) -> dict[str, Any]:
    """A wrench of the environment, for a while."""
    std = np.sqrt(np.diagonal(found.covariance))
    names = [f"{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz"]
    units = ["N"] * 3 + ["N*m"] * 3
    parameters = {
        "start": _quantity(found.start, 0.25, "s"),
        "end": _quantity(found.end, 0.25, "s"),
        **{
            name: _quantity(value, spread, unit)
            for name, value, spread, unit in zip(names, found.value, std, units, strict=True)
        },
    }
    force = ", ".join(f"{value:.1f}" for value in found.value[:3])
    link = scene.links[found.target]
    sentence = f"Something pushed {link} from {found.start:.1f} s to {found.end:.1f} s with ({force}) N."
    return {**_where(scene, found), "parameters": parameters, "sentence": sentence}
