"""Detects a change of the robot while it moves: a payload, an external push, or friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bdnn_ros.online.changed.drift import Drift
from bdnn_ros.online.changed.hypotheses import Explanation, explain
from bdnn_ros.online.changed.scene import BLOCK_SECONDS, Block, Scene, base_parameters, blocks, inverse
from bdnn_ros.online.changed.usual import CORRELATION, Usual
from bdnn_ros.online.changed.wording import finding
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import Prior
from bdnn_ros.physical.presliding import directions
from bdnn_ros.physical.weighing import certainty
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mounting import STANDARD_GRAVITY
from bdnn_ros.signals import Signals

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
LEAST_PUSHING = 0.7
"""And when it lasts so long [s]: friction that is not learned yet gives jolts that are shorter."""
KNOWN = 3.0
"""A payload is named when its mass is so many standard deviations from zero."""
PATIENT, HOPE = 3, 2.0
"""After so many chunks, suspicion is given up if all log odds are under this."""
LONGEST = 8
"""Chunks that are looked at together."""
OTHERWISE = 0.01
"""A robot stands otherwise where its base or a joint's zero is turned by more than this [rad] ([m])."""


@dataclass(frozen=True)
class Change:
    """A named change.

    Attributes:
        explanation: the hypothesis that won.
        rivals: others within `APART` of it.
        finding: as in the contract's diagnosis.json, with the time [s] on the stream's clock.
        belief: what is known of the robot after it.
        seen: end of the motion that told it, on the stream's clock [s].
    """

    explanation: Explanation
    rivals: tuple[Explanation, ...]
    finding: dict[str, Any]
    belief: Prior
    seen: float


class Monitor:
    """Monitors the residual of the model in service, chunk by chunk.

    Args:
        robot: its description.
    """

    def __init__(self, robot: Robot) -> None:
        self.scene = Scene(robot)
        self._information = self.scene.information.copy()
        self._usual = Usual(self.scene.scale)
        self._reference: PhysicalModel | None = None
        self._before: tuple[Signals, np.ndarray] | None = None
        self._suspects: list[tuple[Signals, np.ndarray]] = []
        self._calm = 0
        self._evidence = 0.0
        self._drift = Drift(self.scene)

    def look(self, signals: Signals, rows: np.ndarray, model: PhysicalModel | None) -> tuple[Change, ...]:
        """Process the next chunk; returns the changes found. Several at once are drifts of several joints.

        Args:
            signals, rows: its motion and the samples that count.
            model: that serves, None before the first.
        """
        if model is None:
            return ()
        self._see(model.robot)
        suspicious = bool(self._suspects)
        reference = self._reference if suspicious and self._reference is not None else model
        residual = _residual(reference, signals, rows)
        ratio = float(np.max(np.mean(residual**2, axis=0) / self._usual.level))
        if not suspicious and ratio <= ODD:
            return self._pass(signals, rows, residual, model)
        self._suspects.append((signals, rows))
        self._calm = self._calm + 1 if ratio < CALM else 0
        change = self._judge()
        if change is not None:
            self._start_over(change.belief)
            return (change,)
        groundless = len(self._suspects) >= PATIENT and self._evidence < HOPE
        if self._calm >= 2 or groundless or len(self._suspects) >= LONGEST:
            return self._let_pass(model)
        return ()

    def _see(self, robot: Robot) -> None:
        """Take over base tilt and joint zeros as identified by now; what was learned with another set-up is dropped."""
        stands = self.scene.robot
        turned = np.abs(robot.gravity_vector - stands.gravity_vector).max() > OTHERWISE * np.linalg.norm(
            STANDARD_GRAVITY
        )
        if turned or np.abs(robot.zeros - stands.zeros).max() > OTHERWISE:
            self.scene = Scene(stands.set_up_as(robot))
            self._information = self.scene.information.copy()
            self._drift = Drift(self.scene)

    def _let_pass(self, model: PhysicalModel) -> tuple[Change, ...]:
        """Treat the suspicious chunks as usual from now on: nothing explains them. They may be part of a slow drift."""
        suspects, self._suspects, self._calm = self._suspects, [], 0
        for signals, rows in suspects:
            changes = self._pass(signals, rows, _residual(model, signals, rows), model)
            if changes:
                return changes
        return ()

    def _pass(
        self, signals: Signals, rows: np.ndarray, residual: np.ndarray, model: PhysicalModel
    ) -> tuple[Change, ...]:
        """Process a chunk without a sudden change."""
        known, noise = self._usual.known, self._usual.noise
        self._usual.take(residual, signals.at_rest[rows])
        now = self._usual.noise
        self._reference, self._before = model, (signals, rows)
        columns = self.scene.columns(signals, rows)
        certain = _certainty(signals, rows, model, now)
        phi = columns * (np.sqrt(certain) / now)[:, :, None]
        self._information += np.tensordot(phi, phi, axes=((0, 1), (0, 1)))
        if (self._usual.known != known).any():
            self._drift.clear()  # it starts over with those of which something is usual by now
        return self._drifts(signals, rows, columns, model, noise if known.any() else None, certain)

    def _drifts(
        self,
        signals: Signals,
        rows: np.ndarray,
        columns: np.ndarray,
        model: PhysicalModel,
        noise: np.ndarray | None,
        certain: np.ndarray,
    ) -> tuple[Change, ...]:
        """Joints whose friction has drifted over the last minutes."""
        told = self._drift.look(signals, rows, columns, model, noise, certain)
        if told is None:
            return ()
        found, belief = told
        before = self._drift.reference + found[0].mean
        self._start_over(belief)
        seen = float(signals.time[rows[-1]])
        return tuple(Change(each, (), finding(self.scene, each, (), before), belief, seen) for each in found)

    def _start_over(self, belief: Prior) -> None:
        """Restart from the changed robot: nothing is known yet of its usual residual."""
        self._information = inverse(belief.covariance)[0]
        self._drift.clear()
        self._usual.clear()
        self._suspects, self._calm = [], 0
        self._reference = self._before = None

    # -- judging ---------------------------------------------------------------------------------

    def _judge(self) -> Change | None:
        """The change that explains the suspicious chunks, if the motion so far is conclusive."""
        window = [*([self._before] if self._before else []), *self._suspects]
        if self._reference is None:
            return None
        data: list[Block] = []
        loud = self._usual.loud
        for signals, rows in window:
            residual = _residual(self._reference, signals, rows)
            certain = _certainty(signals, rows, self._reference, loud)
            data += blocks(self.scene, signals, rows, residual, loud, certain=certain)
        found = explain(self.scene, data, self._information)
        self._evidence = max(e.evidence - e.edge for e in found)
        best = found[0]
        seen = data[-1].end - best.start
        if best.evidence - best.edge < SURE or best.share < EXPLAINED or seen < LEAST:
            return None
        if best.kind == "push" and not self._is_push(best, data[-1].end):
            return None
        if best.kind == "payload" and abs(best.value[0]) < KNOWN * np.sqrt(best.covariance[0, 0]):
            return None
        mean = base_parameters(self._reference.robot, self._reference.offset)
        if best.kind != "push":
            index, _ = self.scene.changed(best.kind, best.target)
            if best.below_nothing((mean + best.mean)[index]):
                return None
        rivals = tuple(e for e in found[1:] if best.evidence - e.evidence < APART and e.kind != best.kind)
        if rivals and len(self._suspects) < LONGEST - 1:
            return None
        spread = 0.5 * (best.spread + best.spread.T)
        belief = Prior(mean + best.mean, spread, self.scene.scale)
        signals, rows = window[-1]
        seen = float(signals.time[rows[-1]])
        return Change(best, rivals, finding(self.scene, best, rivals, mean), belief, seen)

    def _is_push(self, found: Explanation, now: float) -> bool:
        """Whether it is too strong and too long for a jolt of the robot itself, and has ended: a payload stays."""
        over = now - found.end > 0.5 * BLOCK_SECONDS or len(self._suspects) >= LONGEST - 1
        strong = float(np.linalg.norm(found.value[:3])) >= LEAST_PUSH * self.scene.weight
        return over and strong and found.end - found.start >= LEAST_PUSHING


def _residual(model: PhysicalModel, signals: Signals, rows: np.ndarray) -> np.ndarray:
    """Measured minus predicted effort, low-passed, (R, n) [N·m]."""
    assert signals.effort is not None
    return np.asarray(signals.smooth(signals.effort - model.predict(signals))[rows])


def _certainty(signals: Signals, rows: np.ndarray, model: PhysicalModel, noise: np.ndarray) -> np.ndarray:
    """Weight of each row, from 0 to 1, (R, n): low where dry friction may hold a joint in either direction.

    The rows of one stop share the same error, so together they count as one. A push that exceeds noise and friction still shows.

    Args:
        noise: standard deviation of one row, (n,) [N·m].
    """
    slow = np.full((len(rows), signals.width), np.finfo(float).tiny)
    position = signals.position[rows]
    dry = 0.5 * np.abs(model.friction(position, slow) - model.friction(position, -slow)).max(axis=0)
    doubt = np.sqrt(CORRELATION[1]) * np.hypot(dry, model.std.coulomb)
    return certainty(signals, rows, directions(signals), doubt, noise)
