"""Loads the recordings and the robot that the arguments of a verb name."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from bdnn_ros import bags
from bdnn_ros.cli.describing import acting, described_robot, robot_of_file, unusable, with_joints, without_led
from bdnn_ros.cli.fitness import require_distinct, require_measured, require_motion
from bdnn_ros.cli.options import progress, say, say_unread_commands
from bdnn_ros.efforts import EffortConvention
from bdnn_ros.errors import RecordingError, RobotError, UsageError, listed
from bdnn_ros.left_out import beside, disturbing
from bdnn_ros.likeness import description_of
from bdnn_ros.models import KnowsTimes, Model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import with_mimics
from bdnn_ros.robot.urdf import refuse_free
from bdnn_ros.signals import mended, without_copies

Read = TypeVar("Read")
Known = TypeVar("Known")


def load(
    args: argparse.Namespace,
    *,
    model: Model | None = None,
    moves: bool = True,
    needs_robot: bool = True,
    undisturbed: bool = False,
    picks: bool = False,
) -> tuple[list[Recording], Robot | None]:
    """The recordings that the arguments name, all with the same joints, and their robot.

    The robot is that of --urdf, else of the description in the (first) bag, else of --robot; None without any. The joints are
    those of the model, else --joints, else those of the robot that every bag has. What is left out or repaired is reported on
    stderr.

    Args:
        model: its joints must be there.
        moves: refuse recordings in which no joint moves.
        needs_robot: a description in a bag that does not fit is an error; otherwise it counts as none.
        undisturbed: refuse recordings in which joints that are left out move so that the others feel it.
        picks: --joints may leave out joints that must be there: it picks those that are shown, see `shown`.

    Raises:
        BdnnError: as `bags.read` and `Robot.from_urdf`; or the robot and the bag share no joint.
    """
    required = model.joints if model else args.joints
    if model and not picks:
        require_joints(args, model.joints)
    needs_robot |= args.add_gravity
    say_unread_commands(args)
    robot = _robot(args, needs_robot, chosen=bool(required))
    held, every = _held(args, required), _every_joint(robot, model)
    recordings = [_read_with(bags.read, path, args, held, every) for path in args.bags]
    if not model and args.effort == "command":
        required = acting(required, recordings, robot)
    chosen = required or _common_joints(recordings, robot)
    whole = recordings if robot is None else _of_all_joints(args, recordings, robot)
    if robot is not None and not required:
        chosen = without_led(robot, chosen, whole)
    recordings = [_with_notes(recording.select(chosen)) for recording in recordings]
    for recording in recordings:
        for note in recording.notes:
            say(note)
        if moves:
            require_motion(recording)
    require_distinct(recordings)
    if robot is not None:
        robot = _fitted(robot, chosen, whole, undisturbed, args.urdf is not None or needs_robot, model)
    convention = _convention(args, recordings, robot)
    commanded = args.effort == "command"
    return [convention.applied(one, commanded) if convention else one for one in recordings], robot


def require_efforts(args: argparse.Namespace, recordings: Sequence[Recording]) -> None:
    """Refuse efforts that do not respond to the motion; suggests effort commands if the bag has them.

    Raises:
        RecordingError: as `fitness.require_measured`.
    """
    for path, recording in zip(args.bags, recordings, strict=True):
        try:
            require_measured(recording)
        except RecordingError as error:
            held = [] if args.effort == "command" else bags.commands_among(bags.topics(path))
            if not held:
                raise
            which = f" with --effort-commands {held[0]}" if len(held) > 1 else ""
            raise RecordingError(
                error.problem,
                f"Check that the driver reports it, or pass --effort command{which} to use what is commanded on "
                f"{held[0]}.",
            ) from None


def disturbed(args: argparse.Namespace, recordings: Sequence[Recording], robot: Robot | None) -> bool:
    """Whether joints outside the selection move in the bags so that the selected ones feel it.

    Conventions cannot be checked by the efforts then.
    """
    if robot is None:
        return False
    complete = Robot.from_urdf(robot.urdf, with_mimics(Robot.from_urdf(robot.urdf)))
    return any(disturbing(whole, complete, robot) for whole in _of_all_joints(args, recordings, complete))


def load_every(args: argparse.Namespace, model: Model) -> bags.EveryState:
    """Every joint state of the bag that the arguments name, with the model's joints; reports on stderr what is left out.

    Raises:
        BdnnError: as `bags.read_every` and `Robot.from_urdf`.
    """
    say_unread_commands(args)
    robot, joints = _robot(args, args.add_gravity, chosen=True), model.joints
    held = _held(args, joints)
    every = _read_with(bags.read_every, args.bags[0], args, held, _every_joint(robot, model)).select(joints)
    for note in every.motion.notes:
        say(note)
    for note in _with_notes(every.motion).notes[len(every.motion.notes) :]:
        say(f"For the motion alone, {note}")
    if robot is not None:
        whole = _of_all_joints(args, [every.motion], robot)
        robot = _fitted(robot, joints, whole, False, args.urdf is not None or args.add_gravity, model)
    convention = _convention(args, [every.motion], robot)
    if convention is None:
        return every
    return replace(every, effort=convention.sensed(every.position, every.effort, args.effort == "command"))


def along(model: Known, recording: Recording) -> Known:
    """The model as it applies to a recording; effects bound to times of other recordings are left out, which is reported."""
    if not isinstance(model, KnowsTimes):
        return model
    there, left_out = model.along(recording)
    if left_out:
        say(left_out)
    return there


def shown(args: argparse.Namespace, joints: Sequence[str]) -> tuple[str, ...]:
    """The joints of a model that --joints selects, in its order; all of them without it.

    Raises:
        UsageError: it picks none, or one that the model does not have, which only the order of commands may name.
    """
    picked = tuple(joint for joint in args.joints if joint in joints)
    strange = [joint for joint in args.joints if joint not in joints]
    if strange and (args.effort != "command" or not picked):
        raise UsageError(
            f"The model does not have {listed(strange)}; it has {listed(joints, 20)}.",
            "Name joints of the model, or leave --joints out.",
        )
    return picked or tuple(joints)


def _held(args: argparse.Namespace, joints: Sequence[str]) -> Sequence[str]:
    """The joints to read from a bag: --joints (the order of its commands) if it contains all the required ones, else those."""
    return args.joints if {*joints} <= {*args.joints} else joints


def require_joints(args: argparse.Namespace, joints: Sequence[str], whose: str = "model") -> None:
    """Refuse --joints that leave out a joint of a model or a diagnosis.

    Raises:
        UsageError: they do.
    """
    missing = [joint for joint in joints if joint not in args.joints]
    if args.joints and missing:
        raise UsageError(
            f"The {whose} needs joint{'s' * (len(missing) > 1)} {listed(missing)}, which --joints leaves out.",
            f"Name all of the {whose}'s joints, or leave the option out.",
        )


def _robot(args: argparse.Namespace, needed: bool, chosen: bool) -> Robot | None:
    """The robot of --urdf, else of the bags, else of --robot; its joints decide which joint states are read.

    Raises:
        BdnnError: as `describing.robot_of_file` and `describing.described_robot`, or a bag cannot be read.
    """
    if args.robot is not None:
        Robot.bundled(args.robot)
    if args.urdf:
        robot = robot_of_file(args.urdf)
        if not chosen:
            refuse_free(robot.urdf)
        return robot
    described = {str(path): bags.read_description(path, args.joint_states) for path in args.bags}
    return described_robot(described, args.robot, needed, chosen)


def _every_joint(robot: Robot | None, model: Model | None) -> Sequence[str]:
    """All joints of the robot, else of the robot that the model describes; empty if neither is known."""
    robot = robot or description_of(model)
    return Robot.from_urdf(robot.urdf).joints if robot else ()


def _fitted(
    robot: Robot,
    joints: Sequence[str],
    whole: Sequence[Recording],
    undisturbed: bool,
    needed: bool,
    model: Model | None,
) -> Robot | None:
    """The robot with these joints, the others held where the recordings, or else the model, have them.

    None if it lacks a joint and is not needed.
    """
    own = description_of(model)
    try:
        return with_joints(robot, joints, whole, undisturbed, dict(own.held) if own else {})
    except RobotError:
        if needed:
            raise
        return None


def _of_all_joints(
    args: argparse.Namespace, recordings: Sequence[Recording], robot: Robot
) -> list[Recording]:
    """The recordings with the positions of all joints of the URDF that the bags contain."""
    return [_with_others(path, args, one, robot) for path, one in zip(args.bags, recordings, strict=True)]


def _with_others(path: Path, args: argparse.Namespace, recording: Recording, robot: Robot) -> Recording:
    others = [joint for joint in with_mimics(robot) if joint not in recording.joints]
    if not others:
        return recording
    with progress(f"reading {path.name}") as show:
        chosen = bags.Selection(args.joint_states, rename=args.rename, joints=others)
        found = bags.read_positions(path, chosen, show)
    return beside(recording, found)


def _convention(
    args: argparse.Namespace, recordings: Sequence[Recording], robot: Robot | None
) -> EffortConvention | None:
    """How reported efforts become the efforts that drive the joints; None if they are the same."""
    if not args.effort_factor and not args.add_gravity:
        return None
    if args.add_gravity and robot is None:
        raise UsageError("--add-gravity needs a robot description.", "Give --urdf FILE or --robot NAME.")
    return EffortConvention.of(args.effort_factor, recordings[0].joints, robot if args.add_gravity else None)


def _with_notes(recording: Recording) -> Recording:
    """The recording without duplicated samples, with notes on what will be repaired whenever it is used."""
    recording = without_copies(recording)
    return replace(recording, notes=mended(recording).notes)


def say_unusable(recordings: Sequence[Recording]) -> None:
    """Report why a description in the bags cannot be used for comparison."""
    problem = unusable(recordings)
    if problem:
        say(problem)


def _read_with(
    reader: Callable[..., Read],
    path: Path,
    args: argparse.Namespace,
    joints: Sequence[str],
    robot_joints: Sequence[str],
) -> Read:
    selection = bags.Selection(
        args.joint_states, args.effort_commands, args.effort, args.rename, joints, robot_joints
    )
    with progress(f"reading {path.name}") as show:
        return reader(path, selection, drop_invalid=args.drop_invalid, progress=show)


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
