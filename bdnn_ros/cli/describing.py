"""The robot for some recordings: which description is used, and which of its joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import SequenceMatcher
from itertools import product
from pathlib import Path

from bdnn_ros import bags
from bdnn_ros.cli.options import say
from bdnn_ros.errors import RobotError, UsageError, listed
from bdnn_ros.left_out import disturbing, led, standing
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import held_mimics, standing_still, with_mimics
from bdnn_ros.robot.urdf import Held, free_joints, refuse_free
from bdnn_ros.robot.urdf_file import text_of


def robot_of_file(path: Path, joints: Sequence[str] = ()) -> Robot:
    """As `Robot.from_file`, with the path in every error message.

    Raises:
        RobotError: the file cannot be read, or its robot cannot be used.
    """
    text = text_of(path)
    try:
        return Robot.from_urdf(text, joints)
    except RobotError as error:
        raise RobotError(f"{path}: {error.problem}", error.remedy) from None


def described_robot(
    bags: Mapping[str, str | None], name: str | None, needed: bool, chosen: bool = False
) -> Robot | None:
    """The robot described in the bags, else the bundled robot of this name; None without either.

    The first usable description is taken. Unusable ones before it are reported to the user.

    Args:
        bags: the description in each of some bags, None where there is none.
        needed: refuse descriptions of which none can be used; otherwise they count as none.
        chosen: the joints are chosen already; only then may the description have joints with several degrees of freedom.

    The first description that can be used counts. Those before it that cannot are said.

    Raises:
        RobotError: a robot is needed, and none of the descriptions can be used.
        UsageError: there is no bundled robot of that name.
    """
    bundled = Robot.bundled(name) if name is not None else None
    described = {bag: urdf for bag, urdf in bags.items() if urdf is not None}
    left_out: list[tuple[str, RobotError]] = []
    for bag, urdf in described.items():
        try:
            robot = Robot.from_urdf(urdf)
            if not chosen:
                refuse_free(urdf)
        except RobotError as reason:
            left_out.append((bag, reason))
            continue
        _say_left_out(left_out, f"that of {bag}")
        if bundled:
            say(f"--robot {name} is not needed: {bag} holds a robot description.")
        if len({*described.values()}) > 1:
            say(f"The bags hold different robot descriptions; that of {bag} is taken.")
        return robot
    if bundled:
        _say_left_out(left_out, f"--robot {name}")
    elif left_out and needed:
        where, error = left_out[0]
        raise RobotError(f"{where}: {error.problem}", "Give another with --urdf FILE or --robot NAME.")
    return bundled


def unusable(recordings: Sequence[Recording]) -> str | None:
    """What is wrong with the first description in the bags, and what to do; None without one, or if it is usable."""
    for recording in recordings:
        if recording.urdf is not None:
            try:
                Robot.from_urdf(recording.urdf, recording.joints)
                refuse_free(recording.urdf)
            except RobotError as error:
                return f"{recording.name}: {error.problem} Give another with --urdf FILE or --robot NAME."
            return None
    return None


def unheld(robot: Robot | None, recording: Recording) -> tuple[list[str], list[str]]:
    """Movable joints of the description that the recording lacks and whose position nothing tells, and a note on them."""
    if robot is None:
        return [], []
    complete = Robot.from_urdf(robot.urdf)
    known = {*recording.joints, *dict(robot.held)}
    joints = [joint for joint in complete.joints if joint not in known]
    if not joints:
        return [], []
    are, their, it = ("is", "its", "it stands") if len(joints) == 1 else ("are", "their", "they stand")
    return joints, [
        f"{listed(joints)} of the URDF {are} in no message that is used: the other joints feel {their} motion, "
        f"which cannot be known, and {it} at zero for the model.{_misnamed(joints, _strangers(complete, [recording]))}"
    ]


def _strangers(complete: Robot, recordings: Sequence[Recording]) -> list[str]:
    """Joints in the recordings' bags that the complete robot does not have."""
    known = {*with_mimics(complete), *free_joints(complete.urdf)}
    return [joint for joint in bags.left_over(recordings) if joint not in known]


def _misnamed(joints: Sequence[str], strangers: Sequence[str]) -> str:
    """A sentence (after a blank) on unknown joints in the bag that may be missing joints under other names; empty without any."""
    if not joints or not strangers:
        return ""
    verb, it = ("is", "it is") if len(strangers) == 1 else ("are", "one of them is")
    stranger, joint = max(product(strangers, joints), key=lambda pair: SequenceMatcher(None, *pair).ratio())
    wanted = joint if len(joints) == 1 else f"one of these, as {joint}"
    return (
        f" {listed(strangers)} of the bag {verb} not in the URDF: if {it} {wanted}, under another name, "
        f"pass --rename {stranger}={joint}."
    )


def without_led(robot: Robot, joints: Sequence[str], recordings: Sequence[Recording]) -> tuple[str, ...]:
    """The joints without those that a mimic joint follows (as in a gripper), which is reported; all if no other joint is left."""
    leading = {leader: joint for leader, joint in led(robot, recordings).items() if leader in joints}
    others = tuple(joint for joint in joints if joint not in leading)
    if not leading or not others:
        return tuple(joints)
    for leader, joint in leading.items():
        say(f"{leader} is left out: it moves {joint} as well, which mimics it (--joints takes it in).")
    return others


def acting(named: Sequence[str], recordings: Sequence[Recording], robot: Robot | None) -> tuple[str, ...]:
    """Those of the joints named for effort commands that the recordings and the robot have; all if none is known.

    The others only mark places among the values of a command.
    """
    known = {*named}.intersection(*(recording.joints for recording in recordings))
    if robot is not None:
        known &= {*with_mimics(robot)}
    others = [joint for joint in named if joint not in known]
    if not known or not others:
        return tuple(named)
    stand, them = ("stands", "it") if len(others) == 1 else ("stand", "them")
    say(
        f"{listed(others, 20)} only {stand} for what the commands hold: the joint states or the URDF lack {them}."
    )
    return tuple(joint for joint in named if joint in known)


def with_joints(
    robot: Robot, chosen: Sequence[str], whole: Sequence[Recording], undisturbed: bool, known: Held
) -> Robot:
    """The robot with the chosen joints, the others held where the recordings show them; reports what is left out.

    Args:
        known: where joints stand that no recording holds.
        undisturbed: refuse recordings in which joints that are left out move so that the others feel it.

    Raises:
        RobotError: the robot lacks a joint.
        UsageError: a recording is disturbed.
    """
    complete = Robot.from_urdf(robot.urdf, with_mimics(robot))
    out = [joint for joint in complete.joints if joint not in chosen]
    held = {joint: at for joint, at in known.items() if joint in out}
    held |= standing(whole, out, robot.urdf)
    free = free_joints(robot.urdf)
    if free:
        say(f"{listed(free)} of the URDF, of more than one degree of freedom, held where it puts the robot.")
    try:
        looked_at = Robot.from_urdf(robot.urdf, chosen, held)
    except RobotError as error:
        if {*chosen} <= {*complete.joints, *free}:
            raise
        raise RobotError(
            error.problem, f"{error.remedy[:-1]}, or map the bag's names with --rename."
        ) from None
    mimics = {joint: leader for joint, leader in held_mimics(looked_at).items() if leader in chosen}
    if mimics:
        say(f"{standing_still(mimics)}, unless --joints names it.")
    unknown = [joint for joint in out if joint not in held and joint not in mimics]
    if unknown:
        say(
            f"No message that is used holds {listed(unknown)} of the URDF; held at zero, or at the nearest limit."
            + _misnamed([joint for joint in unknown if joint in robot.joints], _strangers(robot, whole))
        )
    for recording in whole if held else ():
        felt = disturbing(recording, complete, looked_at)
        if felt:
            _disturbed(recording.name, felt, undisturbed)
    return looked_at


def _disturbed(name: str, felt: Sequence[str], undisturbed: bool) -> None:
    """Report joints that move although they are left out, or refuse the recording."""
    one = len(felt) == 1
    it, does = ("it", "moves and is") if one else ("them", "move and are")
    problem = f"{name}: {listed(felt)} {does} left out"
    if undisturbed:
        raise UsageError(
            f"{problem}: what the others feel of {it} would pass for causes.",
            f"Take {it} in (--joints), or record the others while {'it stands' if one else 'they stand'} still.",
        )
    say(f"{problem}; the model takes {it} to stand still.")


def _say_left_out(left_out: Sequence[tuple[str, RobotError]], taken: str) -> None:
    for where, error in left_out:
        problem = error.problem[:1].lower() + error.problem[1:]
        say(f"The description in {where} is left out and {taken} taken: {problem}")
