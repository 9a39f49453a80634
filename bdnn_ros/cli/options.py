"""Options that several verbs share, and output to the user."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from tqdm import tqdm

from bdnn_ros.bags import Progress
from bdnn_ros.errors import UsageError
from bdnn_ros.robot import BUNDLED, Robot
from bdnn_ros.robot.mimics import held_mimics, standing_still

USUAL_CUTOFF = "low-pass of all signals (default: 10, or a sixth of the rate if that is less)"


def add_recording_arguments(
    parser: argparse.ArgumentParser, bags: Literal["one", "many"], cutoff: str = USUAL_CUTOFF
) -> None:
    """BAG, what to read from it and how to filter it, and the robot.

    Args:
        cutoff: what the low-pass does for the verb.
    """
    parser.add_argument(
        "bags",
        metavar="BAG",
        nargs=1 if bags == "one" else "+",
        type=Path,
        help=".mcap file, .db3 file or rosbag2 directory",
    )
    parser.add_argument(
        "--urdf",
        metavar="FILE",
        type=Path,
        help="robot description (default: the bag's /robot_description)",
    )
    parser.add_argument(
        "--robot",
        metavar="NAME",
        help=f"a bundled robot, where there is no usable description: {', '.join(BUNDLED)}",
    )
    parser.add_argument(
        "--joint-states", metavar="TOPIC", default="/joint_states", help="default: %(default)s"
    )
    _add_effort_arguments(parser)
    add_joints_argument(
        parser,
        "joints and their order (default: the model's, else those of the robot description that the bags have)",
    )
    parser.add_argument(
        "--rename",
        metavar="RULE",
        action="append",
        default=[],
        help="map joint names of the bag: old=new or s/pattern/replacement/ (a slash in one: \\/); repeatable: a=b and b=a "
        "exchange two",
    )
    parser.add_argument(
        "--cutoff",
        metavar="HZ",
        type=float,
        help=cutoff,
    )
    parser.add_argument(
        "--drop-invalid",
        action="store_true",
        help="leave out samples that are NaN or late, and join the parts of a clock that was set back",
    )


def _add_effort_arguments(parser: argparse.ArgumentParser) -> None:
    """Which efforts to read, and how to convert them."""
    parser.add_argument(
        "--effort-commands",
        metavar="TOPIC",
        help="std_msgs/Float64MultiArray, read with --effort command (default: the bag's only one)",
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
        help="N*m in each unit of effort the bag holds, where it holds currents or turned signs; repeatable: "
        "one JOINT=FACTOR a joint, and one FACTOR for all others",
    )
    parser.add_argument(
        "--add-gravity",
        action="store_true",
        help="the bag's efforts leave out what the controller adds for gravity: add the robot description's",
    )


def add_model_argument(parser: argparse.ArgumentParser) -> None:
    """MODEL, required."""
    parser.add_argument(
        "model", metavar="MODEL", type=Path, help="model.bdnn, or the directory that holds it"
    )


def add_robot_arguments(parser: argparse.ArgumentParser) -> None:
    """--urdf and --robot, for a verb that reads no bag."""
    parser.add_argument("--urdf", metavar="FILE", type=Path, help="robot description")
    parser.add_argument("--robot", metavar="NAME", help=f"a bundled robot: {', '.join(BUNDLED)}")


def add_joints_argument(parser: argparse.ArgumentParser, text: str) -> None:
    """--joints, with what it does for the verb."""
    parser.add_argument("--joints", metavar="A,B,C", type=_names, default=(), help=text)


def say(sentence: str) -> None:
    """Tell the user something on stderr."""
    print(f"bdnn: note: {sentence}", file=sys.stderr)


def say_unread_commands(args: argparse.Namespace) -> None:
    """Warn that --effort-commands has no effect without --effort command."""
    if args.effort_commands is not None and args.effort != "command":
        say(
            f"--effort-commands {args.effort_commands} is not read: the efforts are the measured ones. "
            "Pass --effort command to take the commanded ones."
        )


def say_mimics(robot: Robot) -> None:
    """Report joints that a motion leaves out because they mimic another."""
    if mimics := held_mimics(robot):
        say(f"{standing_still(mimics)}, not moved on its own.")


def counted(count: int, what: str) -> str:
    """A count with its noun: `1 joint`, `2 joints`."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def shortened(sentences: Sequence[str], most: int, where: Path) -> list[str]:
    """The first sentences, and how many more there are in a file."""
    more = len(sentences) - most
    return [*sentences[:most], f"{more} more in {where}."] if more > 0 else list(sentences)


@contextmanager
def progress(label: str) -> Iterator[Progress]:
    """A progress bar on stderr (terminals only): a function of the amount done and the total."""
    with tqdm(desc=label, disable=not sys.stderr.isatty(), leave=False, unit_scale=True) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        yield show


@contextmanager
def stages(label: str) -> Iterator[Callable[[str], None]]:
    """A line on stderr (terminals only) that shows the present stage: a function of its name."""
    with tqdm(
        total=0,
        bar_format="{desc} ({elapsed})",
        disable=not sys.stderr.isatty(),
        leave=False,
        desc=label,
    ) as bar:
        yield lambda text: bar.set_description_str(f"{label}: {text}")


def _names(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(","))
    if not any(names):
        raise UsageError(
            "--joints names no joint.", "Name at least one, or leave the option out to take all of them."
        )
    if not all(names):
        raise UsageError(f"--joints {text} has a name that is empty.", "Write for example joint1,joint2.")
    if len({*names}) < len(names):
        raise UsageError(f"--joints {text} names a joint twice.", "Name each joint once.")
    return names
