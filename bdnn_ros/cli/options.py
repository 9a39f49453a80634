"""Options that several verbs share, and the recordings and the robot they ask for."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

from tqdm import tqdm

from bdnn_ros import bags
from bdnn_ros.efforts import EffortConvention
from bdnn_ros.errors import BdnnError, RecordingError, RobotError, UsageError, listed
from bdnn_ros.left_out import disturbing, standing
from bdnn_ros.recording import Recording, moving
from bdnn_ros.robot import BUNDLED, Robot
from bdnn_ros.signals import MINIMUM_SAMPLES, mended

LEAST_SECONDS = 1.0
"""Motion that a model is identified from, at least [s]."""


def add_recording_arguments(parser: argparse.ArgumentParser, bags: Literal["one", "many"]) -> None:
    """BAG, what to read from it and how to clean it, and the robot."""
    parser.add_argument(
        "bags",
        metavar="BAG",
        nargs=1 if bags == "one" else "+",
        type=Path,
        help=".mcap file, .db3 file or rosbag2 directory",
    )
    add_robot_arguments(parser)
    parser.add_argument(
        "--joint-states", metavar="TOPIC", default="/joint_states", help="default: %(default)s"
    )
    parser.add_argument(
        "--effort-commands", metavar="TOPIC", help="std_msgs/Float64MultiArray, for --effort command"
    )
    parser.add_argument(
        "--effort",
        choices=("measured", "command"),
        default="measured",
        help="take the effort of the joint states or the commanded one (default: %(default)s)",
    )
    parser.add_argument(
        "--effort-factor",
        metavar="[JOINT=]FACTOR",
        action="append",
        default=[],
        help="N*m in each unit of effort the bag holds, where it holds currents or turned signs; repeatable",
    )
    parser.add_argument(
        "--add-gravity",
        action="store_true",
        help="the bag's efforts leave out what the controller adds for gravity: add the robot description's",
    )
    parser.add_argument(
        "--joints",
        metavar="A,B,C",
        type=_names,
        default=(),
        help="joints and their order (default: the URDF's)",
    )
    parser.add_argument(
        "--rename",
        metavar="RULE",
        action="append",
        default=[],
        help="map joint names of the bag: old=new or s/pattern/replacement/; repeatable",
    )
    parser.add_argument(
        "--cutoff", metavar="HZ", type=float, help="low-pass of all signals (default: 10, or less)"
    )
    parser.add_argument(
        "--drop-invalid",
        action="store_true",
        help="leave out samples that are NaN or late, and join the parts of a clock that was set back",
    )


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    """--urdf and --robot."""
    parser.add_argument("--urdf", metavar="FILE", type=Path, help="robot description (default: the bag's)")
    parser.add_argument("--robot", metavar="NAME", help=f"a bundled robot: {', '.join(BUNDLED)}")


def load(
    args: argparse.Namespace,
    *,
    joints: Sequence[str] = (),
    moves: bool = True,
    needs_robot: bool = True,
    undisturbed: bool = False,
) -> tuple[list[Recording], Robot | None]:
    """The recordings that the arguments ask for, all with the same joints, and their robot.

    The robot is that of --urdf, else of the (first) bag's description, else of --robot; None without any.
    Its joints and the recordings' are `joints`, else --joints, else those of the robot that every bag has.
    What is left out or repaired is said on stderr.

    Args:
        joints: joints that must be there, in this order (a model's).
        moves: refuse recordings in which no joint moves.
        needs_robot: a description in a bag that does not fit is an error; otherwise it counts as none.
        undisturbed: refuse recordings in which joints that are left out move so that the others feel it.

    Raises:
        BdnnError: as `bags.read` and `Robot.from_urdf`; or the robot and the bag share no joint.
    """
    required = tuple(joints) or args.joints
    given = Robot.from_file(args.urdf) if args.urdf else None
    bundled = Robot.bundled(args.robot) if args.robot is not None else None
    recordings = [
        _read(path, args, args.joints or required, given.joints if given else ()) for path in args.bags
    ]
    robot = given or _own_robot(bundled, args.robot, recordings, needs_robot)
    chosen = required or _common_joints(recordings, robot)
    whole = recordings
    recordings = [_with_notes(recording.select(chosen)) for recording in recordings]
    for recording in recordings:
        for note in recording.notes:
            say(note)
        if moves:
            require_motion(recording)
    if robot is None:
        return _converted(recordings, None, args), None
    try:
        if required and set(required) < set(robot.joints):
            whole = _of_all_joints(args, robot)
        robot = _with_joints(robot, chosen, whole, undisturbed)
    except RobotError:
        if given or needs_robot:
            raise
        robot = None
    return _converted(recordings, robot, args), robot


def _of_all_joints(args: argparse.Namespace, robot: Robot) -> list[Recording]:
    """What the bags hold of all the robot's joints, but for those where they cannot be read: a gripper may say NaN."""
    found = []
    for path in args.bags:
        with suppress(BdnnError):
            found.append(_read(path, args, (), robot.joints))
    return found


def _with_joints(robot: Robot, chosen: Sequence[str], whole: Sequence[Recording], undisturbed: bool) -> Robot:
    """The robot with the chosen joints, others where the whole recordings have them stand; what is left out is said."""
    out = [joint for joint in robot.joints if joint not in chosen]
    held = standing(whole, out)
    looked_at = Robot.from_urdf(robot.urdf, chosen, held)
    unknown = [joint for joint in out if joint not in held]
    if unknown:
        say(f"No message that is used holds {listed(unknown)} of the URDF; held at zero.")
    for recording in whole if held else ():
        felt = disturbing(recording, robot, looked_at)
        if felt and undisturbed:
            raise UsageError(
                f"{recording.name}: {listed(felt)} moves and is left out: what the others feel of it would pass for causes.",
                "Take it in (--joints), or record the others while it stands still.",
            )
        if felt:
            say(f"{recording.name}: {listed(felt)} moves and is left out; the model takes it to stand still.")
    return looked_at


def _converted(recordings: list[Recording], robot: Robot | None, args: argparse.Namespace) -> list[Recording]:
    """The recordings with the efforts that drive the joints."""
    if not args.effort_factor and not args.add_gravity:
        return recordings
    if args.add_gravity and robot is None:
        raise UsageError("--add-gravity needs a robot description.", "Give --urdf FILE or --robot NAME.")
    convention = EffortConvention.of(
        args.effort_factor, recordings[0].joints, robot if args.add_gravity else None
    )
    return [convention.applied(recording) for recording in recordings]


def _with_notes(recording: Recording) -> Recording:
    """The recording as it was read, with notes on what every use of it will mend."""
    return replace(recording, notes=mended(recording).notes)


def require_motion(recording: Recording) -> None:
    """Says which joints do not move.

    Raises:
        RecordingError: there are too few samples to tell, or no joint moves.
    """
    if len(recording) < MINIMUM_SAMPLES:
        raise RecordingError(
            f"{recording.name}: {len(recording)} samples are too few to tell a motion.",
            "Record at least some seconds of motion.",
        )
    moves = moving(recording)
    if not moves.any():
        raise RecordingError(f"{recording.name}: no joint moves.", "Record the robot in motion.")
    still = [joint for joint, moved in zip(recording.joints, moves, strict=True) if not moved]
    if still:
        say(f"{recording.name}: {listed(still)} does not move: nothing can be learned about it.")


def require_length(recordings: Sequence[Recording]) -> None:
    """Says how little there is to learn from.

    Raises:
        RecordingError: the recordings last less than `LEAST_SECONDS` together.
    """
    together = sum(recording.recorded for recording in recordings)
    if together < LEAST_SECONDS:
        raise RecordingError(
            f"{recordings[0].name}: {together:.2g} s of motion are too short to learn from.",
            "Record at least 10 s, better 30 s.",
        )


def say(sentence: str) -> None:
    """Tells the user something beside the result."""
    print(f"bdnn: note: {sentence}", file=sys.stderr)


def shortened(sentences: Sequence[str], most: int, where: Path) -> list[str]:
    """The first of some sentences, and how many more there are elsewhere."""
    more = len(sentences) - most
    return [*sentences[:most], f"{more} more in {where}."] if more > 0 else list(sentences)


@contextmanager
def progress(label: str) -> Iterator[bags.Progress]:
    """A bar on stderr, on a terminal only: a callback that takes what is done and how much there is."""
    with tqdm(desc=label, disable=not sys.stderr.isatty(), leave=False, unit_scale=True) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield show


def _read(
    path: Path, args: argparse.Namespace, joints: Sequence[str], robot_joints: Sequence[str]
) -> Recording:
    with progress(f"reading {path.name}") as show:
        return bags.read(
            path,
            args.joint_states,
            args.effort_commands,
            args.effort,
            args.drop_invalid,
            show,
            rename=args.rename,
            joints=joints,
            robot_joints=robot_joints,
        )


def _own_robot(
    bundled: Robot | None, name: str | None, recordings: Sequence[Recording], needed: bool
) -> Robot | None:
    """The robot of the first bag's description, else the bundled one of that name."""
    described = [recording for recording in recordings if recording.urdf]
    if described:
        if name:
            say(f"--robot {name} is not needed: {described[0].name} holds a robot description.")
        if len({recording.urdf for recording in described}) > 1:
            say(f"The bags hold different robot descriptions; that of {described[0].name} is taken.")
        try:
            return Robot.from_urdf(described[0].urdf or "")
        except RobotError:
            if needed:
                raise
            return None
    return bundled


def _common_joints(recordings: Sequence[Recording], robot: Robot | None) -> tuple[str, ...]:
    """Joints of the robot, else of the first recording, that every recording has."""
    candidates = robot.joints if robot else recordings[0].joints
    chosen = tuple(joint for joint in candidates if all(joint in r.joints for r in recordings))
    if chosen:
        return chosen
    theirs = listed(dict.fromkeys(joint for r in recordings for joint in r.joints), 20)
    if robot is None:
        raise UsageError(
            f"The bags share no joint; they have {theirs}.", "Map the names with --rename old=new."
        )
    if all(set(r.joints) & set(candidates) for r in recordings):
        raise UsageError(
            f"No joint of the robot is in all bags; they have {theirs}.", "Give bags of the same joints."
        )
    strange = next(r for r in recordings if not set(r.joints) & set(candidates))
    theirs = listed(strange.joints, 20)
    whose = f"{strange.name}: its" if len(recordings) > 1 else "The bag's"
    raise UsageError(
        f"{whose} joints ({theirs}) are none of the URDF's ({listed(robot.joints, 20)}).",
        "Map the names with --rename old=new or --rename s/pattern/replacement/, or pass the robot's --urdf.",
    )


def _names(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(","))
    if not any(names):
        raise UsageError(
            "--joints names no joint.", "Name at least one, or leave the option out to take all of them."
        )
    if not all(names):
        raise UsageError(f"--joints {text} has a name that is empty.", "Write for example joint1,joint2.")
    return names
