"""`bdnn identify`: identifies a model of the robot from its recordings."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bdnn_ros.bdnn.modelfile import model_place
from bdnn_ros.cli import fitness, learning, loading, options, outputs
from bdnn_ros.cli.tables import cell, headed, labels, mean_of, resting
from bdnn_ros.errors import BdnnError
from bdnn_ros.models import Model, load_model, save_model
from bdnn_ros.physical.parameters import Spread
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import Scores, described_effort, score_description, score_model
from bdnn_ros.signals import Signals, usual_cutoff

if TYPE_CHECKING:
    from bdnn_ros.physical.agreement import Agreement
    from bdnn_ros.physical.remark import Remark

PARAMETERS = "parameters.json"
MOST_REMARKS = 8
"""Sentences about the data that are printed; parameters.json has all."""

HOLDOUT = 0.2
"""Share of each bag that is kept out of training, unless another is asked for."""


class Told(NamedTuple):
    """Remarks on the data, and the parameters on which several recordings agree or differ."""

    remarks: list[Remark]
    agreements: list[Agreement]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn identify`."""
    options.add_recording_arguments(parser, bags="many")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="directory for model.bdnn, metrics.json, effort.png and, of physical parameters, parameters.json; "
        "or a .bdnn file, with the others beside it",
    )
    learning.add_learning_arguments(parser)
    parser.add_argument(
        "--holdout",
        metavar="SHARE",
        type=float,
        default=HOLDOUT,
        help="last share of each bag's motion, without pauses and rests, that is kept out of training and scored "
        "(default: %(default)s)",
    )


def run(args: argparse.Namespace) -> int:
    """Identify, score on the held-out parts, write the model."""
    outputs.require_model_place(args.out)
    spread = learning.checked_spread(args)
    recordings, robot = loading.load(args, needs_robot=args.prior == "urdf")
    if robot is None:
        loading.say_unusable(recordings)
    fitness.require_length(recordings)
    loading.require_efforts(args, recordings)
    parts = fitness.parted(recordings, args.holdout, args.cutoff)
    training, lasts = [first for first, _ in parts], [last for _, last in parts]
    # scores of all bags are one number, so all pass one low-pass: that of the slowest; each is learned from behind its own
    alike = min(usual_cutoff(one.rate) for one in recordings) if args.cutoff is None else args.cutoff
    tested = [
        fitness.prepared_last(last, whole, alike, args.holdout)
        for whole, last in zip(recordings, lasts, strict=True)
    ]
    seen = [
        fitness.prepared(first, whole, alike, "what is left to learn from")
        for whole, first in zip(recordings, training, strict=True)
    ]
    model = learning.learned(args, robot, training, spread)
    metrics = {"held_out": score_model(model, tested), "training": score_model(model, seen)}
    if robot is not None:
        metrics["simulation"] = score_description(robot, tested)
    path, told = model_place(args.out), None
    has_parameters = learning.has_parameters(args)
    outdated = not has_parameters and _are_parameters_of(path, path.with_name(PARAMETERS))
    with outputs.written_together(path.parent) as place:
        save_model(place / path.name, model)
        _write(place / "metrics.json", {key: value.as_json() for key, value in metrics.items()})
        if has_parameters and robot is not None:
            disturbed = loading.disturbed(args, recordings, robot)
            content, told = _parameters(robot, model, training, args.cutoff, spread, disturbed)
            _write(place / PARAMETERS, content)
        _picture(place / "effort.png", model, robot, tested[0])
    if outdated:
        path.with_name(PARAMETERS).unlink()
    elif told is not None:
        _tell(told, path.with_name(PARAMETERS))
    scores = metrics["held_out"], metrics.get("simulation")
    worse = fitness.worse(*scores, args.prior == "none") + fitness.hardly_better(*scores, recordings)
    for sentence in fitness.unscored(recordings, lasts, tested) + worse:
        options.say(sentence)
    _print(metrics, alike, path, robot)
    return 0


def _picture(path: Path, model: Model, robot: Robot | None, signals: Signals) -> None:
    """Draw measured, simulated and identified effort of the held-out part."""
    from bdnn_ros.report.plots import identification_png

    nominal = None if robot is None else described_effort(robot, signals)
    slides = None if robot is None else robot.slides
    identification_png(path, signals, model.predict(signals), nominal, slides)


def _parameters(
    robot: Robot,
    model: Model,
    training: Sequence[Recording],
    cutoff: float | None,
    spread: Spread | None,
    disturbed: bool,
) -> tuple[dict[str, Any], Told]:
    """The content of parameters.json, and the remarks on the data."""
    from bdnn_ros.checks import data
    from bdnn_ros.online.identifier import Identifier
    from bdnn_ros.physical import agreement, parameters_report
    from bdnn_ros.physical.model import PhysicalModel

    assert isinstance(model, PhysicalModel)
    remarks = data.check(training, robot, model, cutoff, spread, disturbed)
    agreements = []
    if len(training) > 1:
        each = [Identifier(robot, cutoff, spread).fit([recording]) for recording in training]
        agreements = agreement.agreement(each)
    return parameters_report.as_json(model, remarks, agreements), Told(remarks, agreements)


def _tell(told: Told, path: Path) -> None:
    """Print the most important remarks, and the file that has the rest."""
    for sentence in options.shortened([str(remark) for remark in told.remarks], MOST_REMARKS, path):
        options.say(sentence)
    differing = sorted((one for one in told.agreements if one.differs), key=lambda one: one.by_motion)
    if told.agreements:
        agreed = len(told.agreements) - len(differing)
        options.say(f"The recordings agree on {agreed} of {len(told.agreements)} parameters.")
    for sentence in options.shortened([one.sentence() for one in differing], MOST_REMARKS, path):
        options.say(sentence)


def _are_parameters_of(model: Path, path: Path) -> bool:
    """Whether the file is the parameters.json of this model, and not another model's or somebody else's."""
    from bdnn_ros.physical import parameters_report
    from bdnn_ros.physical.model import PhysicalModel

    try:
        content, known = json.loads(path.read_text(encoding="utf-8")), load_model(model)
    except (OSError, ValueError, RecursionError, BdnnError):
        return False
    if not (isinstance(content, dict) and isinstance(known, PhysicalModel)):
        return False
    own = parameters_report.as_json(known)
    return all(content.get(key) == own[key] for key in ("format", "joints", "parameters"))


def _write(path: Path, content: dict[str, Any]) -> None:
    with outputs.written_whole(path) as file:
        json.dump(content, file, indent=1, allow_nan=False)
        file.write("\n")


def _print(metrics: dict[str, Scores], cutoff: float, path: Path, robot: Robot | None) -> None:
    held_out, simulation = metrics["held_out"], metrics.get("simulation")
    mean, joints = mean_of(held_out), labels(robot, held_out.joints, "N*m")
    width = max(len("held out"), len(mean), *map(len, joints))
    error = headed(robot, "RMSE", "N*m")
    print(f"{'held out':{width}}   {error:>10}   NRMSE" + ("   URDF's NRMSE" if simulation else ""))
    for k, joint in enumerate(joints):
        row = f"{joint:{width}}   {cell(held_out.rmse[k], 10, '.4g')}   {cell(held_out.nrmse[k], 5, '.3f')}"
        print(row + (f"   {cell(simulation.nrmse[k], 12, '.3f')}" if simulation else ""))
    row = f"{mean:{width}}   {'':10}   {cell(held_out.nrmse_mean, 5, '.3f')}"
    print(row + (f"   {cell(simulation.nrmse_mean, 12, '.3f')}" if simulation else ""))
    print(f"Measured and predicted effort low-passed alike at {cutoff:.3g} Hz.")
    for sentence in resting(held_out):
        print(sentence)
    print(f"model: {path}\npicture: {path.with_name('effort.png')}")
