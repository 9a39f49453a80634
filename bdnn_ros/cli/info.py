"""`bdnn info`: the content of a bag, and whether it is fit for identification."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bdnn_ros import bags
from bdnn_ros.checks.conventions import breaches
from bdnn_ros.checks.description import doubts
from bdnn_ros.checks.efforts import unread
from bdnn_ros.checks.handling import handled
from bdnn_ros.checks.positions import in_other_units
from bdnn_ros.checks.pushed import pushed
from bdnn_ros.checks.velocities import odd_velocity
from bdnn_ros.cli import fitness, loading, options
from bdnn_ros.cli.describing import unheld, unusable
from bdnn_ros.cli.identify import HOLDOUT
from bdnn_ros.cli.info_text import printed
from bdnn_ros.diagnosis.recorded import lateness, softness
from bdnn_ros.diagnosis.recorded.excerpts import ENOUGH
from bdnn_ros.errors import BdnnError, ConventionError
from bdnn_ros.recording import Recording, moving
from bdnn_ros.robot import Robot
from bdnn_ros.robot.urdf import Limits
from bdnn_ros.scores import numbers
from bdnn_ros.signals import DEFAULT_CUTOFF, Signals, mended, prepare, usual_cutoff
from bdnn_ros.signals.unmeasured import AT_LIMIT, at_limit
from bdnn_ros.written import spelled

CLIPPED = 0.01
"""A share of samples at a limit that is worth a word."""
UNEVEN = 0.2
"""A jitter above this share of the sample period is worth a word."""
NEARLY = 0.95
"""A cut-off above this share of the usual one is as good: of 60 Hz by a clock that scatters."""
FEW_REVERSALS = 2
"""And a joint that turns less often: friction shows where a joint moves both ways."""


@dataclass(frozen=True)
class Excitation:
    """The motion of one joint.

    Attributes:
        lower, upper: range of the position [rad].
        velocity, acceleration: highest magnitude, low-passed [rad/s], [rad/s²].
        effort: standard deviation [N·m]; NaN where it was not measured.
        reversals: changes of direction.
        standstill: share of the time at rest.
        saturated: share of samples at the effort's limit (the URDF's, else a plateau at its own extreme).
        fast: share of samples at the URDF's velocity limit.
        moves: whether it moves further than its noise.
    """

    joint: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    effort: float
    reversals: int
    standstill: float
    saturated: float
    fast: float
    moves: bool

    def as_json(self) -> dict[str, Any]:
        """Plain values, null where unknown."""
        return {k: numbers([v])[0] if isinstance(v, float) else v for k, v in vars(self).items()}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn info`."""
    options.add_recording_arguments(parser, bags="one")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print what the bag contains, then whether it is usable; if not, the reason is the error."""
    topics = bags.topics(args.bags[0])
    report: dict[str, Any] = {"bag": spelled(args.bags[0]), "topics": [vars(topic) for topic in topics]}
    problem, robot = None, None
    try:
        (recording,), robot = loading.load(args, moves=False, needs_robot=args.urdf is not None)
        report |= timing(recording)
        absent, notes = ([], []) if args.joints else unheld(robot, recording)
        report["missing"] += [f"joint {joint}" for joint in absent]
        fitness.require_samples(recording)
        signals = prepare(recording, args.cutoff)
        limits = robot.limits if robot else None
        joints = excitation(mended(recording), signals, limits)
        report["excitation"] = [joint.as_json() for joint in joints]
        fitness.require_length([recording])
        told = replace(signals, effort=None) if loading.disturbed(args, [recording], robot) else signals
        broken = [] if robot is None else list(breaches(told, robot))
        report["breaches"] = [str(breach) for breach in broken]
        report["concerns"] = [
            *notes,
            *concerns(recording, joints),
            *map(str, odd_velocity(recording, signals)),
            *_of_the_description(recording, robot),
            *report["breaches"],
            *_of_the_efforts(recording, told, robot),
        ]
        if robot is not None:
            _require_units(told, robot)
        fitness.require_motion(recording)
        loading.require_efforts(args, [recording])
        _, last = fitness.split(recording, signals, HOLDOUT)
        tested = fitness.prepared_last(last, recording, args.cutoff, HOLDOUT)
        report["concerns"] += fitness.unscored([recording], [last], [tested])
    except BdnnError as error:
        problem = error
    report |= {"usable": problem is None, "problem": str(problem) if problem else None}
    print(json.dumps(report, indent=1, allow_nan=False) if args.json else printed(report, robot))
    if problem is not None:
        raise problem
    return 0


def _of_the_description(recording: Recording, robot: Robot | None) -> list[str]:
    """Doubts about the robot description, or why the one in the bag cannot be used."""
    if robot is None:
        problem = unusable([recording])
        return [problem] if problem else []
    return [str(remark) for remark in doubts(robot)]


def _require_units(signals: Signals, robot: Robot) -> None:
    """Refuse positions that seem not to be in radians and metres: no pose of the robot is known.

    Raises:
        ConventionError: they seem to be in degrees or millimetres.
    """
    for remark in in_other_units(signals, robot):
        raise ConventionError(remark.problem, remark.remedy)


def _of_the_efforts(recording: Recording, signals: Signals, robot: Robot | None) -> list[str]:
    """Remarks on a load or contact that comes and goes, and on low-passes that the efforts have passed."""
    if robot is None or signals.effort is None:
        return []
    load = [str(remark) for told in (handled, pushed) for remark in told(recording, signals, robot)]
    late = lateness.lateness(signals, robot)
    if late.total:
        return [*load, lateness.note(recording, late)]
    own = softness.softness(signals, robot)
    return load if own is None else [*load, softness.note(recording, own)]


def timing(recording: Recording) -> dict[str, Any]:
    """Rate, jitter, gaps and missing fields of a recording, JSON-able."""
    steps = np.diff(recording.time)
    pieces = recording.segments()
    pauses = [
        float(recording.time[b.start] - recording.time[a.stop - 1])
        for a, b in zip(pieces[:-1], pieces[1:], strict=True)
    ]
    within = np.concatenate([np.diff(recording.time[rows]) for rows in pieces]) if pieces else steps
    fields = {"velocity": recording.velocity, "effort": recording.effort, "robot description": recording.urdf}
    return {
        "samples": len(recording),
        "duration": recording.duration,
        "recorded": recording.recorded,
        "rate": recording.rate,
        "jitter": float(np.std(within)) if len(within) else 0.0,
        "longest_step": float(within.max()) if len(within) else 0.0,
        "gaps": {"count": len(pauses), "longest": max(pauses, default=0.0), "total": sum(pauses)},
        "joints": list(recording.joints),
        "missing": [name for name, value in fields.items() if value is None],
    }


def excitation(recording: Recording, signals: Signals, limits: Limits | None) -> list[Excitation]:
    """The motion of each joint, and how much of it is at a limit."""
    saturated, fast = _saturated(recording, limits), np.zeros(recording.width)
    if limits is not None:
        fast = np.mean(np.abs(signals.velocity) >= AT_LIMIT * limits.velocity, axis=0)
    unknown = np.full(recording.width, np.nan)
    effort = unknown if recording.effort is None else np.std(recording.effort, axis=0)
    moves = moving(recording)
    return [
        Excitation(
            joint=joint,
            lower=float(recording.position[:, k].min()),
            upper=float(recording.position[:, k].max()),
            velocity=float(np.abs(signals.velocity[:, k]).max()),
            acceleration=float(np.abs(signals.acceleration[:, k]).max()),
            effort=float(effort[k]),
            reversals=_reversals(signals.velocity[~signals.at_rest[:, k], k]) if moves[k] else 0,
            standstill=float(signals.at_rest[:, k].mean()) if moves[k] else 1.0,
            saturated=float(saturated[k]),
            fast=float(fast[k]),
            moves=bool(moves[k]),
        )
        for k, joint in enumerate(recording.joints)
    ]


def concerns(recording: Recording, joints: Sequence[Excitation]) -> list[str]:
    """Weaknesses of a usable recording, one sentence each."""
    found = []
    if round(recording.recorded, 1) < ENOUGH:  # as it is said: 2500 samples at 250 Hz are 9.996 s
        found.append(
            f"{recording.recorded:.1f} s of motion are little, and mostly too short for `bdnn diagnose`, which asks for "
            f"{ENOUGH:g} s; 30 s and more tell causes apart."
        )
    cutoff = usual_cutoff(recording.rate)
    if cutoff < NEARLY * DEFAULT_CUTOFF:
        found.append(
            f"At {recording.rate:.3g} Hz the low-pass is lowered from {DEFAULT_CUTOFF:g} to {cutoff:.2g} Hz, and what is faster "
            "is lost, as of friction at reversals and of gears. Record at 100 Hz or more."
        )
    steps = np.concatenate([np.diff(recording.time[rows]) for rows in recording.segments()])
    if np.std(steps) > UNEVEN / recording.rate:
        found.append("Stamps are uneven: stamp the joint states where they are measured.")
    if recording.effort is not None:
        found += map(str, unread(recording))
    for joint in joints:
        if not joint.moves:
            continue
        if joint.saturated > CLIPPED:
            found.append(f"{joint.joint} is at its effort limit {100 * joint.saturated:.0f} % of the time.")
        if joint.fast > CLIPPED:
            found.append(f"{joint.joint} is at its velocity limit {100 * joint.fast:.0f} % of the time.")
        if joint.reversals < FEW_REVERSALS:
            found.append(f"{joint.joint} hardly turns back: friction and offset look alike.")
    return found


def _saturated(recording: Recording, limits: Limits | None) -> np.ndarray:
    """Share of samples whose effort is at its limit, (n,); NaN where it was not measured."""
    if recording.effort is None:
        return np.full(recording.width, np.nan)
    highest = limits.effort if limits else np.full(recording.width, np.inf)
    return np.asarray(at_limit(recording.effort, highest).mean(axis=0))


def _reversals(velocity: np.ndarray) -> int:
    """Changes of direction of a joint, from its velocity while it moves."""
    return int(np.count_nonzero(np.diff(np.sign(velocity)) != 0))
