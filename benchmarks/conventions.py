"""Recordings in other conventions than the description's: how often `diagnose` refuses them, with which sentence.

    python benchmarks/conventions.py    # 2 minutes

Robots are worn or not, with one effect each, links 5 or 20 % off. A convention that leaves the efforts as good as they are (a
joint that turns about the vertical has any zero) cannot be told. As described, nothing may be refused.
"""

from __future__ import annotations

import os

from _results import keep

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from _naming_draws import Choices, scenario
from _naming_robots import robot_of
from _naming_text import text

from bdnn_ros.checks.conventions import breaches
from bdnn_ros.errors import BdnnError
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare

RESULTS = Path(__file__).resolve().parent / "results" / "conventions.json"
FIRST_SEED = 127000
WRONG = (0.05, 0.2)
CURRENTS = (8.0, 14.0)
"""Torque constants times gear ratios, from the first joint to the last [N·m/A]."""
Spoiled = Callable[[Recording, Robot, int], Recording]


def one_joint(recording: Recording, joint: int, direction: float = 1.0, degrees: float = 0.0) -> Recording:
    """One joint in another direction, or with another zero."""
    chosen = np.arange(recording.width) == joint
    sign, zero = np.where(chosen, direction, 1.0), np.where(chosen, np.deg2rad(degrees), 0.0)
    effort = sign * recording.require_effort()
    return replace(recording, position=sign * recording.position + zero, velocity=None, effort=effort)


def mounted(recording: Recording, robot: Robot, roll: float, pitch: float) -> Recording:
    """On a base that the description has level."""
    real = robot.tilted(np.deg2rad(roll), np.deg2rad(pitch)).gravity(recording.position)
    return with_effort(recording, recording.require_effort() - robot.gravity(recording.position) + real)


def exchanged(recording: Recording, joint: int) -> Recording:
    """A joint and the next one under each other's name."""
    names, other = list(recording.joints), (joint + 1) % recording.width
    names[joint], names[other] = names[other], names[joint]
    return replace(recording, joints=tuple(names)).select(recording.joints)


def with_effort(recording: Recording, effort: np.ndarray) -> Recording:
    """The recording with another effort."""
    return replace(recording, effort=effort)


def turned_effort(recording: Recording, joint: int) -> Recording:
    """One joint's effort with the other sign."""
    sign = np.where(np.arange(recording.width) == joint, -1.0, 1.0)
    return with_effort(recording, sign * recording.require_effort())


WAYS: dict[str, tuple[Spoiled, str]] = {
    "as described": (lambda r, robot, j: r, ""),
    "all efforts of the other sign": (lambda r, robot, j: with_effort(r, -r.require_effort()), "wrong sign"),
    "one effort of the other sign": (
        lambda r, robot, j: turned_effort(r, j),
        "The efforts of {joint} have the wrong sign",
    ),
    "currents": (
        lambda r, robot, j: with_effort(r, r.require_effort() / np.linspace(*CURRENTS, r.width)),
        "another unit",
    ),
    "gravity left out": (
        lambda r, robot, j: with_effort(r, r.require_effort() - robot.gravity(r.position)),
        "leave gravity out",
    ),
    "degrees": (lambda r, robot, j: replace(r, position=np.rad2deg(r.position), velocity=None), "in degrees"),
    "base upside down": (lambda r, robot, j: mounted(r, robot, 180.0, 0.0), "the base upside down"),
    "base on its side": (lambda r, robot, j: mounted(r, robot, 0.0, 90.0), "the base on its side"),
    "one joint the other way": (
        lambda r, robot, j: one_joint(r, j, direction=-1.0),
        "{joint} turning the other way",
    ),
    "one zero by 90 deg": (lambda r, robot, j: one_joint(r, j, degrees=90.0), "{joint} 90 deg back"),
    "two joints exchanged": (lambda r, robot, j: exchanged(r, j), "{joint} recorded as"),
}
"""How a recording is spoiled, and what a sentence that tells it says."""
COLUMNS = ("told", "something else told", "not told")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=60, help="default: %(default)s")
    parser.add_argument("--seed0", type=int, default=FIRST_SEED, help="default: %(default)s")
    parser.add_argument("--results", type=Path, default=RESULTS, help="default: %(default)s")
    args = parser.parse_args()
    told: dict[str, Counter[str]] = {way: Counter() for way in WAYS}
    for seed in range(args.seed0, args.seed0 + args.draws):
        draw = Choices(hidden=1, wrong=WRONG[seed % 2], duration=30.0, poor=False).draw(seed)
        try:
            recording = scenario(draw).run()[0].recording
        except BdnnError:
            continue
        robot = robot_of(draw.robot)
        joint = seed % robot.width
        for way, (spoil, words) in WAYS.items():
            problem = next(
                (one.problem for one in breaches(prepare(spoil(recording, robot, joint)), robot)), ""
            )
            rightly = bool(words) and words.format(joint=robot.joints[joint]) in problem
            told[way][COLUMNS[0] if rightly else COLUMNS[1] if problem else COLUMNS[2]] += 1
    keep(args.results, told)
    print(
        text(
            [
                ["recorded", *COLUMNS],
                *([way, *(str(counts[c]) for c in COLUMNS)] for way, counts in told.items()),
            ]
        )
    )


if __name__ == "__main__":
    main()
