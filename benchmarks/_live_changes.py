"""Draws of robots that change while they move, through the online code: what is named, when, and how rightly."""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "test"))

from live_support import motion, real_robot

from bdnn_ros.online.learning import Learning
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ROBOTS = ("arm2", "arm6", "arm7")
KINDS = ("gripped", "released", "push", "drift", "nothing")
EFFECTS = {"gripped": "payload", "released": "payload", "push": "external_wrench", "drift": "drift"}
RATE = 100.0
NOISE = 0.003
IN_TIME = 5.0
"""A payload or a push is named within so long of rich motion [s]."""
SIX = ([0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2])


@dataclass(frozen=True)
class Draw:
    """What happened and what was named.

    Attributes:
        kind, robot, seed: what was drawn.
        onset: when [s]; 0 for nothing.
        truth: mass [kg], force [N], or growth of friction at the usual speed [N·m/s].
        named: whether the right thing was, as the first.
        delay: from the onset to the name [s].
        error: of mass or force, as a share; NaN where there is none to compare.
        others: other names that were given.
    """

    kind: str
    robot: str
    seed: int
    onset: float
    truth: float
    named: bool
    delay: float
    error: float
    others: tuple[str, ...]


def carrying(robot: Robot, mass: float, centre: np.ndarray) -> Robot:
    """The robot with a point mass on its last link."""
    inertia = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    inertials = robot.inertials.copy()
    inertials[-1] += [mass, *(mass * centre), *inertia[SIX]]
    return robot.with_inertials(inertials)


def draw(kind: str, name: str, seed: int) -> Draw:
    """One robot, one change."""
    g = np.random.default_rng([seed, KINDS.index(kind), ROBOTS.index(name)])
    arm = Robot.bundled(name)
    real = real_robot(arm, seed=seed, error=float(g.uniform(0.05, 0.2)))
    onset = float(g.uniform(18.0, 35.0))
    length = float(g.uniform(60.0, 120.0)) if kind == "drift" else 0.0
    duration = {"drift": onset + length, "nothing": 90.0}.get(kind, onset + 12.0)
    load = float(np.mean(arm.inertials[:, 0]))
    rich = {"seed": seed + 1000, "noise": NOISE}
    plain = motion(real, duration, RATE, **rich)
    after = (plain.time >= onset)[:, None]
    assert plain.effort is not None
    joint, truth, effort = "", 0.0, plain.effort
    if kind in ("gripped", "released"):
        truth = load * float(np.exp(g.uniform(np.log(0.1), np.log(0.6))))
        loaded = carrying(real, truth, g.uniform(-0.1, 0.1, 3) + np.array([0.0, 0.0, 0.05]))
        other = motion(loaded, duration, RATE, **rich).effort
        effort = np.where(after == (kind == "gripped"), other, effort)
    elif kind == "push":
        way = g.normal(size=3)
        truth = 9.81 * load * float(g.uniform(0.5, 1.5))
        wrench = np.concatenate([truth * way / np.linalg.norm(way), np.zeros(3)])
        jacobian = arm.link_jacobian(plain.position, arm.moving_link(arm.joints[-1]))
        during = after[:, 0] & (plain.time < onset + g.uniform(0.8, 3.0))
        effort = effort - during[:, None] * np.einsum("tij,i->tj", jacobian, wrench)
    elif kind == "drift":
        j = int(g.integers(arm.width))
        joint, growth = arm.joints[j], float(g.uniform(0.6, 2.0))
        speed = plain.velocity[:, j]
        way = growth * np.array([real.viscous[j] * g.integers(2), real.coulomb[j]])
        truth = float(way @ [np.sqrt(np.mean(speed**2)), 1.0]) / length
        ramp = np.clip((plain.time - onset) / length, 0.0, 1.0)
        effort = effort.copy()
        effort[:, j] += ramp * (way[0] * speed + way[1] * np.sign(speed))
    told = _told(arm, replace(plain, effort=effort))
    right = [k for k, (when, f) in enumerate(told) if when > onset and _is_right(kind, joint, arm, f)]
    others = tuple(
        f"{f['effect']}@{f['joint'] or f['link']}" for k, (_, f) in enumerate(told) if k not in right
    )
    named = bool(right) and right[0] == 0
    delay = told[right[0]][0] - onset if right else float("nan")
    sees = kind != "push" or arm.width >= 6  # two joints do not feel every force
    error = _error(kind, truth, told[right[0]][1]) if right and sees else float("nan")
    return Draw(kind, name, seed, onset, truth, named, delay, error, others)


def _told(arm: Robot, recording: Recording) -> list[tuple[float, dict[str, Any]]]:
    """When what was named."""
    learning, told, step = Learning(arm), [], round(0.2 * RATE)
    for start in range(0, len(recording), step):
        rows = slice(start, start + step)
        assert recording.effort is not None
        for _ in learning.take(recording.time[rows], recording.position[rows], recording.effort[rows]):
            pass
        told += [(float(recording.time[rows][-1]), change.finding) for change in learning.changes]
        learning.changes.clear()
    return told


def _is_right(kind: str, joint: str, arm: Robot, finding: dict[str, Any]) -> bool:
    if finding["effect"] != EFFECTS.get(kind):
        return False
    if kind == "drift":
        return bool(finding["joint"] == joint)
    at_tip = finding["link"] == arm.moving_link(arm.joints[-1])
    return at_tip and (kind == "push" or kind in finding["sentence"])


def _error(kind: str, truth: float, finding: dict[str, Any]) -> float:
    values = {name: entry["value"] for name, entry in finding["parameters"].items()}
    if kind == "push":
        force = np.linalg.norm([values[f"force_{axis}"] for axis in "xyz"])
        return float(abs(force / truth - 1.0))
    return float(abs(values["mass"] / truth - 1.0)) if kind in ("gripped", "released") else float("nan")


def measure(counts: dict[str, int], first_seed: int = 0) -> list[Draw]:
    """All draws, on two processes."""
    tasks = [
        (kind, ROBOTS[number % len(ROBOTS)], first_seed + number)
        for kind, count in counts.items()
        for number in range(count)
    ]
    with ProcessPoolExecutor(2) as pool:
        return list(pool.map(draw, *zip(*tasks, strict=True)))


def table(draws: list[Draw]) -> str:
    """One line a kind."""
    head = f"{'change':10}{'draws':>6}{'named':>7}{'in 5 s':>8}{'median s':>10}{'slowest':>9}{'error':>8}{'other names':>13}"
    lines = [head]
    for kind in KINDS:
        own = [d for d in draws if d.kind == kind]
        if not own:
            continue
        right = [d for d in own if d.named]
        delays = [d.delay for d in right]
        errors = [d.error for d in right if np.isfinite(d.error)]
        soon = sum(d.delay <= IN_TIME for d in right)
        none = kind == "nothing"
        lines.append(
            f"{kind:10}{len(own):>6}{'-' if none else len(right):>7}{'-' if none else soon:>8}"
            f"{f'{np.median(delays):.1f}' if delays else '-':>10}{f'{max(delays):.1f}' if delays else '-':>9}"
            f"{f'{np.median(errors):.1%}' if errors else '-':>8}{sum(len(d.others) for d in own):>13}"
        )
    missed = [d for d in draws if (d.kind != "nothing" and not d.named) or d.others]
    lines += [
        f"  {d.kind} {d.robot} seed {d.seed}, onset {d.onset:.1f} s, size {d.truth:.3g}: "
        f"{'named' if d.named else 'not named'}{', also ' + ', '.join(d.others) if d.others else ''}"
        for d in missed
    ]
    return "\n".join(lines)
