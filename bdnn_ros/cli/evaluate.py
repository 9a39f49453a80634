"""`bdnn evaluate`: how well a model predicts a recording."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace

from bdnn_ros.cli import fitness, loading, options
from bdnn_ros.cli.tables import cell, headed, labels, mean_of, resting
from bdnn_ros.errors import listed
from bdnn_ros.models import load_model
from bdnn_ros.robot import Robot
from bdnn_ros.scores import (
    RolloutError,
    Scores,
    rollout_error,
    score_description,
    score_model,
    without_effort,
)
from bdnn_ros.signals import Signals, prepare


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn evaluate`."""
    options.add_model_argument(parser)
    options.add_recording_arguments(parser, bags="one")
    parser.add_argument(
        "--holdout",
        metavar="SHARE",
        type=float,
        help="score only the last share of the bag (default: all of it)",
    )
    parser.add_argument(
        "--horizon",
        metavar="SECONDS",
        type=float,
        default=0.25,
        help="length of the motions integrated from the measured effort (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Score the model, and the URDF where there is one, on the same samples."""
    model = load_model(args.model)
    joints = loading.shown(args, model.joints)
    (recording,), robot = loading.load(args, model=model, needs_robot=False, picks=True)
    if robot is None:
        loading.say_unusable([recording])
    loading.require_efforts(args, [recording])
    model = loading.along(model, recording)
    if args.holdout is None:
        signals = prepare(recording, args.cutoff)
    else:
        _, last = fitness.split(recording, prepare(recording, args.cutoff), args.holdout)
        signals = fitness.prepared_last(last, recording, args.cutoff, args.holdout)
    held_out = score_model(model, [signals]).of(joints)
    simulation = None if robot is None else score_description(robot, [signals]).of(joints)
    rollout = rollout_error(model, signals, args.horizon)
    rollout = replace(rollout, position=rollout.position[[model.joints.index(joint) for joint in joints]])
    if args.json:
        report = {
            "held_out": held_out.as_json(),
            "joints_in_mean": held_out.in_mean,
            "rollout": rollout.as_json(),
            "cutoff": signals.cutoff,
        }
        if simulation is not None:
            report["simulation"] = simulation.as_json()
        print(json.dumps(report, indent=1, allow_nan=False))
    else:
        _print(held_out, simulation, rollout, signals.cutoff, robot or getattr(model, "robot", None))
    _say_rollout(rollout, signals)
    return 0


def _say_rollout(rollout: RolloutError, signals: Signals) -> None:
    """Report why no motion could be integrated, or only a shorter one."""
    unmeasured = without_effort(signals)
    if unmeasured:
        options.say(
            f"No motion is integrated: the effort of {listed(unmeasured)} was not measured, and what a "
            "joint does, the others feel."
        )
    elif not signals.seen.all(axis=1).any():
        options.say(
            "No motion is integrated: at no time was the effort of every joint measured, and what a joint does, the "
            "others feel."
        )
    elif not rollout.windows:
        options.say("No motion is integrated: there is too little of it.")
    elif rollout.lost:
        these = "all" if rollout.lost == rollout.windows else f"{rollout.lost} of {rollout.windows}"
        options.say(
            f"Integrated over {rollout.horizon:.3g} s without a controller, {these} motions run away, which the error "
            "leaves out where others are left; --horizon chooses a shorter time."
        )


def _print(
    held_out: Scores, simulation: Scores | None, rollout: RolloutError, cutoff: float, robot: Robot | None
) -> None:
    mean, joints = mean_of(held_out), labels(robot, held_out.joints, "N*m", "rad")
    width = max(len("joint"), len(mean), *map(len, joints))
    last = "" if simulation is None else "   URDF's NRMSE"
    error, ahead = headed(robot, "RMSE", "N*m"), headed(robot, f"after {rollout.horizon:.3g} s", "rad")
    print(f"{'joint':{width}}   {error:>10}   NRMSE   {'nMSE':>8}   {ahead}{last}")
    for k, joint in enumerate(joints):
        row = f"{joint:{width}}   {cell(held_out.rmse[k], 10, '.4g')}   {cell(held_out.nrmse[k], 5, '.3f')}"
        row += f"   {cell(held_out.nmse[k], 8, '.3g')}   {cell(rollout.position[k], len(ahead), '.4g')}"
        print(row + ("" if simulation is None else f"   {cell(simulation.nrmse[k], 12, '.3f')}"))
    row = f"{mean:{width}}   {'':10}   {cell(held_out.nrmse_mean, 5, '.3f')}"
    row += f"   {cell(held_out.nmse_mean, 8, '.3g')}   {'':{len(ahead)}}"
    print(row + ("" if simulation is None else f"   {cell(simulation.nrmse_mean, 12, '.3f')}"))
    print(f"Measured and predicted effort low-passed alike at {cutoff:.3g} Hz.")
    for sentence in resting(held_out):
        print(sentence)
