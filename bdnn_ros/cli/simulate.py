"""`bdnn simulate`: records a simulated robot, with the truth beside the bag."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import yaml

from bdnn_ros import bags
from bdnn_ros.checks.description import require_mass
from bdnn_ros.cli import options, outputs
from bdnn_ros.cli.describing import robot_of_file
from bdnn_ros.cli.options import counted
from bdnn_ros.effects.registry import EFFECTS
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.extension.effects_file import EffectsFile
from bdnn_ros.robot import BUNDLED, Robot
from bdnn_ros.simulation.possible import never_acting
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.simulate import Simulated
from bdnn_ros.simulation.trajectory_file import read_trajectory

BAG, TRUTH = "bag", "truth.yaml"
HARDLY = 0.5
"""A joint that moves over less than this part of what is planned is told of."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn simulate`."""
    parser.add_argument("--urdf", metavar="FILE", type=Path, help="the robot to simulate")
    parser.add_argument("--robot", metavar="NAME", help=f"or a bundled one: {', '.join(BUNDLED)}")
    options.add_joints_argument(
        parser, "joints that move, and their order (default: all but those that mimic another)"
    )
    parser.add_argument(
        "--effect",
        metavar="SPEC",
        action="append",
        default=[],
        help="effect[@joint or link][:key=value,...], repeatable; effects: " + ", ".join(EFFECTS),
    )
    parser.add_argument(
        "--effects",
        metavar="FILE",
        type=Path,
        help="effects.yaml of an extended model (or a truth.yaml, of which --worn and --wrong are asked for anew)",
    )
    parser.add_argument("--hide", metavar="N", type=int, default=0, help="N random effects more, not printed")
    parser.add_argument(
        "--seed", type=int, default=0, help="of motion, noise and hidden effects (default: %(default)s)"
    )
    parser.add_argument(
        "--duration", metavar="S", type=float, default=30.0, help="seconds (default: %(default)s)"
    )
    parser.add_argument(
        "--rate", metavar="HZ", type=float, default=500.0, help="samples a second (default: %(default)s)"
    )
    _add_sensor_arguments(parser)
    parser.add_argument(
        "--wrong", metavar="SHARE", type=float, default=0.0, help="real links off by this share (default: 0)"
    )
    parser.add_argument("--worn", action="store_true", help="friction and rotor inertia on every joint")
    parser.add_argument("--poor", action="store_true", help="move one joint slowly and a little")
    parser.add_argument(
        "--trajectory",
        metavar="CSV",
        type=Path,
        help="follow this motion, as bdnn excite writes it, for as long as it lasts",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a recording that is there")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True, help=f"directory for {BAG}/ (rosbag2) and {TRUTH}"
    )


def _add_sensor_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments for the quality of the sensors."""
    parser.add_argument(
        "--noise",
        metavar="SHARE",
        type=float,
        default=Scenario.noise,
        help="effort noise per range of each joint's effort, with position noise in proportion (default: "
        "%(default)s, and 5e-5 rad)",
    )
    parser.add_argument("--coloured", action="store_true", help="effort noise correlated over 50 ms")
    parser.add_argument(
        "--resolution", metavar="RAD", type=float, default=0.0, help="step of the encoders (default: none)"
    )
    parser.add_argument(
        "--velocity",
        choices=("sensor", "differentiated", "none"),
        default="sensor",
        help="reported velocity: measured, the difference of positions, or none (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> int:
    """Simulate, write the bag and the truth, print where."""
    outputs.require_directory(args.out)
    robot, found = _robot(args), None
    if args.effects:
        found = EffectsFile.read(args.effects)
        robot = found.robot(robot)
        if args.joints and robot.joints != args.joints:
            raise UsageError(
                f"{args.effects} is of the joints {listed(robot.joints, 20)}, in this order.",
                "Leave --joints out.",
            )
        _say_left_out(found, args)
        if robot.held:
            held = listed(f"{joint} at {position:.4g}" for joint, position in robot.held)
            options.say(f"Held as {args.effects} has it: {held}.")
    require_mass(robot)
    options.say_mimics(robot)
    installed = found.effects(robot) if found else []
    scenario = Scenario(
        robot,
        effects=args.effect,
        hide=args.hide,
        seed=args.seed,
        duration=args.duration,
        rate=args.rate,
        noise=args.noise,
        coloured=args.coloured,
        resolution=args.resolution,
        velocity=args.velocity,
        wrong=args.wrong,
        worn=args.worn,
        poor=args.poor,
        name=args.robot or args.urdf.stem,
        installed=installed,
        known=found is not None and found.identified,
        plan=read_trajectory(args.trajectory, robot, args.rate) if args.trajectory else None,
    )
    if args.seed < 0:
        raise UsageError(f"--seed {args.seed} is negative.", "Use a whole number from 0.")
    bag, truth = args.out / BAG, args.out / TRUTH
    _refuse_existing(bag, args.overwrite)
    for sentence in never_acting(installed, robot, scenario.seconds):  # of a recording that lasted longer
        options.say(f"{sentence[:-1]}: it never acts.")
    with options.progress("simulating") as show:
        simulated, content = scenario.run(show)
    _say_held(simulated)
    with outputs.written_together(args.out, lambda: _refuse_existing(bag, args.overwrite)) as place:
        bags.write(simulated.recording, place / BAG)
        with outputs.written_whole(place / TRUTH) as file:
            yaml.safe_dump(content, file, sort_keys=False)
    for one in simulated.effects[: len(installed) + len(args.effect)]:
        print(one.sentence(robot))
    if args.hide:
        print(f"{args.hide} hidden: see {truth}, after a guess.")
    print(f"{bag}: {counted(len(simulated.recording), 'sample')} of {counted(robot.width, 'joint')}.")
    return 0


def _refuse_existing(bag: Path, overwrite: bool) -> None:
    if bag.exists() and not overwrite:
        raise UsageError(f"{bag} is there already.", "Choose another --out, or pass --overwrite.")
    bags.refuse_existing(bag, overwrite)


def _say_left_out(found: EffectsFile, args: argparse.Namespace) -> None:
    """Report the parts of a truth.yaml other than effects (friction, rotors, links of its robot) that are not used."""
    truth, what, needed = found.content, list[str](), list[str]()
    wrong = truth.get("wrong") or 0.0
    if truth.get("worn"):
        what.append("worn joints")
        needed += [] if args.worn else ["--worn"]
    if truth.get("links"):
        what.append("links that are off")
        needed += [] if args.wrong == wrong else [f"--wrong {wrong}"]
    if what and truth.get("seed", args.seed) != args.seed:
        needed.append(f"--seed {truth['seed']}")
    if needed:
        options.say(
            f"{args.effects}: its robot had {' and '.join(what)}, which are no effects and differ here. "
            f"Pass {' '.join(needed)} as well for the same robot."
        )


def _say_held(simulated: Simulated) -> None:
    """Report joints that hardly follow the plan."""
    planned, moved = (np.ptp(each, axis=0) for each in (simulated.plan.position, simulated.motor_position))
    for joint, want, did in zip(simulated.recording.joints, planned, moved, strict=True):
        if did < HARDLY * want:
            options.say(
                f"{joint} moves {100.0 * did / want:.2g} % of what is planned: the effects are too strong for its position "
                "loop."
            )


def _robot(args: argparse.Namespace) -> Robot:
    if args.urdf and args.robot is not None:
        raise UsageError("Both --urdf and --robot are given.", "Give one of them.")
    if args.urdf:
        return robot_of_file(args.urdf, args.joints)
    if args.robot is not None:
        return Robot.bundled(args.robot, args.joints)
    raise UsageError(
        "There is no robot to simulate.", f"Give --urdf FILE, or --robot with one of {', '.join(BUNDLED)}."
    )
