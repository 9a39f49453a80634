"""`bdnn excite`: plans a motion that distinguishes the rivals of a diagnosis."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bdnn_ros.bdnn.modelfile import FILE_NAME
from bdnn_ros.cli import loading, options, outputs
from bdnn_ros.cli.describing import robot_of_file
from bdnn_ros.cli.tables import csv_header
from bdnn_ros.diagnosis.judging.identifiability import TIE
from bdnn_ros.diagnosis.recorded.excerpts import ENOUGH
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.excitation.bounds import Bounds
from bdnn_ros.excitation.choice import DECISIVE, Excitation, excite
from bdnn_ros.excitation.rivals import Case, joints_of, read_case
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.likeness import description_of
from bdnn_ros.models import Model, load_model
from bdnn_ros.robot import BUNDLED, Robot
from bdnn_ros.robot.mimics import held_mimics
from bdnn_ros.robot.urdf import OPEN_VELOCITY
from bdnn_ros.simulation.excitation import Trajectory

OPEN, BLIND = "may stay open: a longer or wider motion may help", "hardly any motion tells these apart"
NOTHING = 0.01
"""Evidence below which more of a motion does not help, either."""
MOST_SAID = 1000.0
"""Larger expected evidence says no more than that it is large [nats]."""
CSV, YAML = "trajectory.csv", "trajectory.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn excite`."""
    parser.add_argument(
        "model",
        metavar="MODEL",
        nargs="?",
        type=Path,
        help="a model of the robot, as a diagnosis writes it (default: the one beside the file --for)",
    )
    options.add_robot_arguments(parser)
    options.add_joints_argument(
        parser,
        "joints that move, and their order (default: the model's, else the diagnosis's, else the URDF's)",
    )
    parser.add_argument(
        "--for",
        dest="case",
        metavar="FILE",
        type=Path,
        help="diagnosis.json whose rivals are to be told apart (default: show all parameters)",
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, default=Path("excitation"), help=f"directory for {CSV} and {YAML}"
    )
    _numbers(parser)
    parser.add_argument(
        "--range",
        dest="ranges",
        metavar="JOINT=LOW:HIGH",
        action="append",
        default=[],
        help="range of a joint inside its limits [rad], repeatable: collisions are not looked at",
    )


def _numbers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=int, default=0, help="of the draws (default: %(default)s)")
    for name, value, text in (
        ("--duration", 30.0, "at most so many seconds"),
        ("--rate", 100.0, "points a second"),
        ("--margin", 0.05, "share of each joint's range kept free at both ends"),
        ("--velocity", 0.8, "share of the velocity limits to use"),
        ("--effort", 0.8, "share of the effort limits to use"),
    ):
        parser.add_argument(
            name, metavar="X", type=float, default=value, help=f"{text} (default: %(default)s)"
        )
    parser.add_argument(
        "--acceleration",
        metavar="X",
        type=float,
        help="limit [rad/s²] (default: thrice the velocity that may be used, per second)",
    )


def run(args: argparse.Namespace) -> int:
    """Plan the motion, write it, and print what it is expected to decide."""
    if args.seed < 0:
        raise UsageError(f"--seed {args.seed} is negative.", "Use a whole number from 0.")
    outputs.require_directory(args.out)
    robot, model = _given(args)
    joints = loading.shown(args, robot.joints)
    options.say_mimics(robot)
    if not (args.joints or args.case or args.model):
        _say_leading(robot)
    _say_open(robot)
    if args.duration < ENOUGH:
        options.say(
            f"a recording of {args.duration:g} s is mostly too short for `bdnn diagnose`, which asks for "
            f"{ENOUGH:g} s, better 30 s."
        )
    case = read_case(args.case, robot) if args.case else None
    bounds = Bounds.of(
        robot,
        margin=args.margin,
        velocity=args.velocity,
        acceleration=args.acceleration,
        effort=args.effort,
        ranges=_ranges(args.ranges),
        model=model,
    )
    with options.stages("planning") as say:
        found = excite(
            robot,
            case,
            bounds=bounds,
            duration=args.duration,
            rate=args.rate,
            seed=args.seed,
            progress=say,
        )
    motion = found.trajectory.of([robot.joints.index(joint) for joint in joints])
    with outputs.written_together(args.out) as place:
        with outputs.written_whole(place / CSV) as file:
            file.writelines(csv_lines(motion, joints))
        with outputs.written_whole(place / YAML) as file:
            file.writelines(yaml_lines(motion, joints))
    print("\n".join(_summary(found, robot, case)))
    print(f"trajectory: {args.out / CSV}, {args.out / YAML}")
    return 0


def _say_leading(robot: Robot) -> None:
    """Report joints that a mimic joint follows: recordings leave them out, and the rest of the arm may feel them move."""
    leading = {leader: joint for joint, leader in held_mimics(robot).items() if leader in robot.joints}
    others = [joint for joint in robot.joints if joint not in leading]
    if leading and others:
        options.say(
            f"{listed(leading)} will be left out of a bag of this motion, where {listed(leading.values())} moves as well: "
            f"--joints {','.join(others)} leaves the motion to the others."
        )


def _say_open(robot: Robot) -> None:
    """Report limits that are missing in the description, and what is assumed for them."""
    limits = robot.limits
    within = np.isfinite(limits.lower) & np.isfinite(limits.upper)
    for known, taken in (
        (
            within,
            "position limits: a turn (or 2π m) about zero, or from the limit that it has, is taken unless --range gives others.",
        ),
        (np.isfinite(limits.velocity), f"velocity limit: {OPEN_VELOCITY:g} rad/s (or m/s) is taken."),
        (np.isfinite(limits.effort), "effort limit: none is kept."),
    ):
        if not known.all():
            joints = listed([joint for joint, one in zip(robot.joints, known, strict=True) if not one])
            options.say(f"the description gives {joints} no {taken}")


def csv_lines(motion: Trajectory, joints: tuple[str, ...]) -> Iterator[str]:
    """A header and one line a point: time [s], then position, velocity, acceleration of each joint."""
    names = [f"{joint}.{what}" for what in ("position", "velocity", "acceleration") for joint in joints]
    yield csv_header(["time", *names])
    for row in np.column_stack([motion.time, motion.position, motion.velocity, motion.acceleration]):
        yield ",".join(f"{value:.9g}" for value in row) + "\n"


def yaml_lines(motion: Trajectory, joints: tuple[str, ...]) -> Iterator[str]:
    """A trajectory_msgs/JointTrajectory."""
    yield "header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}\njoint_names:\n"
    for joint in joints:
        yield f"- {json.dumps(joint, ensure_ascii=False)}\n"
    yield "points:\n"
    rows = zip(motion.time.tolist(), motion.position, motion.velocity, motion.acceleration, strict=True)
    for time, *values in rows:
        nanoseconds = round(time * 1e9)
        for start, name, row in zip("-  ", ("positions", "velocities", "accelerations"), values, strict=True):
            yield f"{start} {name}: [{', '.join(f'{value:.9g}' for value in row)}]\n"
        yield "  effort: []\n"
        second, rest = divmod(nanoseconds, 10**9)
        yield f"  time_from_start: {{sec: {second}, nanosec: {rest}}}\n"


def _given(args: argparse.Namespace) -> tuple[Robot, Model | None]:
    """The robot of MODEL with the model, or that of --urdf or --robot.

    Otherwise that of the diagnosis: of the model beside its file, or the description that it names.
    """
    given = [name for name in ("model", "urdf", "robot") if getattr(args, name) is not None]
    if len(given) > 1:
        raise UsageError("More than one robot is given.", "Give MODEL, --urdf or --robot.")
    joints, source = joints_of(args.case) if args.case else ((), "")
    loading.require_joints(args, joints, "diagnosis")
    if args.model:
        model = load_model(args.model)
        robot = description_of(model)
        if robot is None:
            raise UsageError(
                f"{args.model} is a black box: it does not know the robot's limits.", "Give --urdf instead."
            )
        loading.require_joints(args, robot.joints)
        return robot, model
    joints = args.joints or joints
    if args.case and not given:
        extended = _beside(args.case, joints)
        if extended is not None:
            return extended.robot, extended
    if args.robot is not None or (not given and source in BUNDLED):
        return Robot.bundled(source if args.robot is None else args.robot, joints), None
    if args.urdf or (not given and source and Path(source).is_file() and Path(source).suffix == ".urdf"):
        return robot_of_file(args.urdf or Path(source), joints), None
    raise UsageError(
        "There is no robot.", "Give MODEL (a diagnosis's directory), --urdf FILE or --robot NAME."
    )


def _beside(case: Path, joints: Sequence[str]) -> ExtendedModel | None:
    """The extended model that a diagnosis of some joints left beside its file; None where there is none."""
    path = case.parent / FILE_NAME
    model = load_model(path) if path.is_file() else None
    return model if isinstance(model, ExtendedModel) and {*model.joints} == {*joints} else None


def _ranges(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges by joint; one for each, since of two the wider might be the one that is forgotten."""
    ranges: dict[str, tuple[float, float]] = {}
    for joint, ends in map(_range, texts):
        if joint in ranges:
            raise UsageError(f"--range is given twice for {joint}.", "Give each joint one range.")
        ranges[joint] = ends
    return ranges


def _range(text: str) -> tuple[str, tuple[float, float]]:
    joint, _, values = text.partition("=")
    low, _, high = values.partition(":")
    try:
        return joint, (float(low), float(high))
    except ValueError:
        raise UsageError(
            f"--range {text} is not JOINT=LOW:HIGH.", "Write for example elbow=-1.5:0.5."
        ) from None


def _summary(found: Excitation, robot: Robot, case: Case | None) -> list[str]:
    seconds = found.trajectory.time[-1]
    if not found.separations:
        shown = "the parameters of the joints that move" if found.still else "all parameters"
        return [f"A motion of {seconds:.1f} s; {_unasked(case)}it shows {shown}.", *found.notes]
    lines = [f"A motion of {seconds:.1f} s; expected evidence ({DECISIVE:g} settles a question):"]
    for one in found.separations:
        pair = f"{one.finding.words(robot)} or {one.rival.words(robot)}"
        doubt = "" if one.settled else f"  ({BLIND if one.evidence < NOTHING else OPEN})"
        evidence = f"{one.evidence:.3g}" if one.evidence < MOST_SAID else f"over {MOST_SAID:g}"
        lines.append(f"  {pair}: {evidence}{doubt}")
    return [*lines, *found.notes]


def _unasked(case: Case | None) -> str:
    """Why a motion tells no rivals apart, where it was to."""
    if case is None:
        return ""
    if not case.questions:
        return "the diagnosis names no cause: "
    if case.open:
        return "what is open, no other motion settles: "
    return f"no rival is open, since none is {100 * TIE:.0f} % probable: "
