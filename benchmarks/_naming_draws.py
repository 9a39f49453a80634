"""Blind draws: what is hidden in which recording, and what a diagnosis that cannot see it says."""

from __future__ import annotations

import tempfile
import time
import traceback
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _naming_judging import judge
from _naming_odds import evidence
from _naming_robots import robot_of
from _naming_tables import NOT_DRAWN

from bdnn_ros import bags
from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.effects.drawing import contribution
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import EFFECTS
from bdnn_ros.errors import BdnnError
from bdnn_ros.extension.holding import IN_ROBOT
from bdnn_ros.robot import Robot
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import flattened, prepare
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.simulate import Simulated

HIDDEN = {0: 0.15, 1: 0.6, 2: 0.15, 3: 0.1}
WRONG = {0.0: 0.2, 0.05: 0.5, 0.1: 0.3}
DURATIONS = {15.0: 0.15, 30.0: 0.7, 60.0: 0.15}
WORN, COLOURED, POOR = 0.4, 0.5, 0.15
"""What is drawn how often, where the command line does not fix it."""


@dataclass(frozen=True)
class Draw:
    """One recording to be made; everything random in it follows from the seed.

    Attributes:
        robot: a bundled robot, or the path of a URDF file.
        hidden: number of effects.
        effects: names to draw them from; empty for all.
        wrong: the real links are off by about this share.
    """

    seed: int
    robot: str
    hidden: int
    effects: tuple[str, ...]
    wrong: float
    worn: bool
    coloured: bool
    duration: float
    poor: bool

    @property
    def key(self) -> str:
        """What tells it from other draws."""
        return repr(tuple(asdict(self).values()))


@dataclass(frozen=True)
class Choices:
    """What the command line fixes; None leaves it to the seed."""

    robots: tuple[str, ...] = ("arm2", "arm6", "arm7")
    effects: tuple[str, ...] = tuple(EFFECTS)
    hidden: int | None = None
    wrong: float | None = None
    worn: bool | None = None
    coloured: bool | None = None
    duration: float | None = None
    poor: bool | None = None

    def draw(self, seed: int) -> Draw:
        """The draw of a seed; single effects take turns, so that each is met as often."""
        rng = np.random.default_rng([seed, *b"naming"])
        robot = str(rng.choice(self.robots))
        hidden, wrong = int(_drawn(rng, HIDDEN)), _drawn(rng, WRONG)
        duration = _drawn(rng, DURATIONS)
        worn, coloured, poor = (bool(rng.random() < share) for share in (WORN, COLOURED, POOR))
        hidden = hidden if self.hidden is None else self.hidden
        turn = (self.effects[seed % len(self.effects)],)
        return Draw(
            seed=seed,
            robot=robot,
            hidden=hidden,
            effects=turn if hidden == 1 else self.effects if hidden else (),
            wrong=wrong if self.wrong is None else self.wrong,
            worn=worn if self.worn is None else self.worn,
            coloured=coloured if self.coloured is None else self.coloured,
            duration=duration if self.duration is None else self.duration,
            poor=poor if self.poor is None else self.poor,
        )


def done(draw: Draw) -> dict[str, Any]:
    """The record of a draw: simulated, written as a bag, diagnosed from the bag, and only then compared."""
    record: dict[str, Any] = {"key": draw.key, "draw": asdict(draw)}
    try:
        simulated, truth = scenario(draw).run()
    except BdnnError as error:
        return {**record, "status": NOT_DRAWN, "why": str(error)}
    start = time.process_time()
    with tempfile.TemporaryDirectory(prefix="naming") as folder:
        bag = bags.write(simulated.recording, Path(folder) / "bag")
        try:
            examination = diagnosed(bag)
        except BdnnError as error:
            return {**record, "status": "refused", "why": str(error), "truth": truth["effects"]}
        except Exception:
            return {**record, "status": "crashed", "why": traceback.format_exc(), "truth": truth["effects"]}
    seconds = time.process_time() - start
    report, robot = examination.diagnosis.as_json(), robot_of(draw.robot)
    outcome = judge(truth, report["findings"], robot)
    after = np.array(report["effort_rmse"]["extended"])
    ratio = after / np.maximum(noise_floor(simulated, examination), 1e-12)
    telling = evidence(truth, simulated.effects, examination)
    for one in outcome["hidden"]:
        one["evidence"] = telling.get((one["effect"], one["target"]))
    return {
        **record,
        "status": "diagnosed",
        "truth": truth["effects"],
        "found": [_short(finding) for finding in report["findings"]],
        "verdict": report["verdict"],
        "gain": report["gain"],
        "over_floor": float(np.sqrt(np.mean(ratio**2))),
        "over_floor_worst": float(ratio.max()),
        "cpu_seconds": round(seconds, 2),
        "outcome": outcome,
    }


def diagnosed(bag: Path) -> Examination:
    """A diagnosis that knows the bag alone."""
    recording = bags.read(bag)
    assert recording.urdf is not None
    return examine([recording], Robot.from_urdf(recording.urdf, recording.joints))


def noise_floor(simulated: Simulated, examination: Examination) -> np.ndarray:
    """What the sensors' noise alone leaves of a perfect model on the held-out rows, (n,) [N·m].

    The noise of the effort, and that of the position as it passes through the inverse dynamics, friction and effects.
    """
    noisy, equations, real = simulated.recording, examination.equations, simulated.real
    offset = np.mean(noisy.position - simulated.motor_position, axis=0)
    clean = replace(noisy, position=simulated.motor_position + offset, effort=simulated.effort)
    lower = equations.motion.signals.cutoff
    left = []
    for recording in (noisy, clean):
        signals = flattened(prepare(recording), lower)
        assert signals.effort is not None
        effort = described_effort(real, signals)
        motion = Motion(signals, real, effort)
        beside = IN_ROBOT | {one.effect.name for one in simulated.effects if one.effect.kinematic}
        effects = [one for one in simulated.effects if one.effect.name not in beside]
        added = sum((contribution(one, motion) for one in effects), np.zeros_like(effort))
        left.append(signals.smooth(signals.effort - effort - added))
    if left[0].shape != left[1].shape or len(left[0]) <= equations.rows.samples.max():
        return np.full(len(noisy.joints), np.nan)
    error = (left[0] - left[1])[equations.rows.samples]
    held = equations.usable & examination.test[:, None]
    return np.sqrt(np.sum(np.where(held, error, 0.0) ** 2, axis=0) / np.maximum(held.sum(axis=0), 1))


def scenario(draw: Draw) -> Scenario:
    """What `bdnn simulate` would be asked for."""
    return Scenario(
        robot_of(draw.robot),
        hide=draw.hidden,
        hidden_names=draw.effects,
        seed=draw.seed,
        duration=draw.duration,
        coloured=draw.coloured,
        wrong=draw.wrong,
        worn=draw.worn,
        poor=draw.poor,
        name=draw.robot,
    )


def _short(finding: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in finding.items() if key != "sentence"}


def _drawn(rng: np.random.Generator, shares: dict[Any, float]) -> Any:
    return list(shares)[int(rng.choice(len(shares), p=list(shares.values())))]
