"""`bdnn identify`: a model of the robot from its recordings."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bdnn_ros.cli import options
from bdnn_ros.errors import UsageError
from bdnn_ros.online.models import Model, save_model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Dynamics, Robot
from bdnn_ros.scores import Scores, score
from bdnn_ros.signals import Signals, prepare

HELP = "identify a model from recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn identify`."""
    options.add_recording_arguments(parser, bags="many")
    parser.add_argument("--out", type=Path, required=True, help="directory for model.bdnn and metrics.json")
    parser.add_argument(
        "--prior",
        choices=("urdf", "none"),
        default="urdf",
        help="start from the URDF's rigid bodies, or learn everything from the data (default: %(default)s)",
    )
    parser.add_argument("--budget", type=float, default=60.0, help="seconds of training with --prior none")
    parser.add_argument(
        "--holdout",
        type=float,
        default=0.2,
        help="last share of each bag that is kept out of training and scored (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the training with --prior none")


def run(args: argparse.Namespace) -> int:
    """Identify, score on what was held out, write the model."""
    if not args.budget > 0.0:
        raise UsageError(f"--budget {args.budget:g} is not a time.", "Give seconds above zero.")
    recordings, robot = options.load(args)
    parts = [recording.split(args.holdout) for recording in recordings]
    training, held_out = [first for first, _ in parts], [last for _, last in parts]
    if args.prior == "urdf":
        if robot is None:
            raise UsageError(
                "There is no URDF to start from.", "Give --urdf FILE or --robot NAME, or --prior none."
            )
        model: Model = _from_prior(robot, training, args.cutoff)
    else:
        model = _from_nothing(training, args)
    metrics = {
        "held_out": _scores(model, held_out, args.cutoff),
        "training": _scores(model, training, args.cutoff),
    }
    if robot is not None:
        metrics["simulation"] = _scores(robot, held_out, args.cutoff)
    path = save_model(args.out, model)
    _write(path.parent / "metrics.json", metrics)
    _print(metrics, path)
    return 0


def _from_prior(robot: Robot, training: Sequence[Recording], cutoff: float | None) -> Model:
    from bdnn_ros.online.identifier import Identifier

    return Identifier(robot, cutoff).fit(training, progress=_progress)


def _from_nothing(training: Sequence[Recording], args: argparse.Namespace) -> Model:
    from bdnn_ros.bdnn.training import identify

    parts = [recording.split(0.2) for recording in training]
    first, last = ([prepare(part[side], args.cutoff) for part in parts] for side in (0, 1))
    model: Model = identify(first, last, budget=args.budget, seed=args.seed, progress=_progress)
    return model


def _scores(model: Dynamics, recordings: Sequence[Recording], cutoff: float | None) -> Scores:
    """Measured against predicted effort of all recordings, low-passed alike."""
    measured, predicted = [], []
    for recording in recordings:
        recording.require_effort()
        signals = prepare(recording, cutoff)
        assert signals.effort is not None
        measured.append(signals.smooth(signals.effort)[signals.interior])
        predicted.append(signals.smooth(_predict(model, signals))[signals.interior])
    return score(np.concatenate(measured), np.concatenate(predicted), model.joints)


def _predict(model: Dynamics, signals: Signals) -> np.ndarray:
    predict = getattr(model, "predict", None)
    if predict is not None:
        return np.asarray(predict(signals))
    return model.inverse_dynamics(signals.position, signals.velocity, signals.acceleration)


def _write(path: Path, metrics: dict[str, Scores]) -> None:
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    beside.write_text(json.dumps({key: value.as_json() for key, value in metrics.items()}, indent=1) + "\n")
    os.replace(beside, path)


def _print(metrics: dict[str, Scores], path: Path) -> None:
    held_out, simulation = metrics["held_out"], metrics.get("simulation")
    width = max(len(joint) for joint in held_out.joints)
    print(f"{'held out':{width}}   RMSE [N·m]   NRMSE" + ("   URDF's NRMSE" if simulation else ""))
    for k, joint in enumerate(held_out.joints):
        row = f"{joint:{width}}   {held_out.rmse[k]:10.4g}   {held_out.nrmse[k]:5.3f}"
        print(row + (f"   {simulation.nrmse[k]:12.3f}" if simulation else ""))
    row = f"{'mean':{width}}   {'':10}   {held_out.nrmse_mean:5.3f}"
    print(row + (f"   {simulation.nrmse_mean:12.3f}" if simulation else ""))
    print(f"model: {path}")


def _progress(share: float, what: str) -> None:
    """Progress on a terminal only: a log wants none of it."""
    if sys.stderr.isatty():
        print(
            f"\r{100.0 * share:3.0f} % {what:40.40}",
            end="" if share < 1.0 else "\n",
            file=sys.stderr,
            flush=True,
        )
