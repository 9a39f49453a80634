"""The learning options of `bdnn identify`: prior, architecture, spread."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict, fields

from bdnn_ros.bdnn.training import ARCHITECTURES
from bdnn_ros.checks.description import GIVE_MASS, require_mass
from bdnn_ros.cli import fitness
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.models import Model
from bdnn_ros.physical.parameters import WIDEST_SPREAD, Spread
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare

STOPS_BY = 0.2
"""Share of the motion that training a BDNN keeps to itself to choose and to stop by."""


def add_learning_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments that choose the prior, the architecture and the budget."""
    parser.add_argument(
        "--prior",
        choices=("urdf", "none"),
        default="urdf",
        help="start from the URDF's rigid bodies, or learn everything from the data (default: %(default)s)",
    )
    parser.add_argument(
        "--architecture",
        choices=ARCHITECTURES,
        help="of the BDNN: with --prior none chain (a serial chain whose axes are learned, the default) or networks (H and R "
        "networks alone, as in the paper); with --prior urdf networks on the URDF's bodies, instead of the physical "
        "parameters that are identified without this option",
    )
    parser.add_argument(
        "--spread",
        metavar="NAME=SHARE",
        action="append",
        default=[],
        help="how far the real robot may be from the URDF, repeatable: "
        + ", ".join(f"{name}={share:g}" for name, share in asdict(Spread()).items())
        + " (these are the defaults; docs/identification.md says of what)",
    )
    parser.add_argument(
        "--budget",
        metavar="SECONDS",
        type=float,
        default=60.0,
        help="seconds of training with --prior none or --architecture (default: %(default)s)",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        help="seed of the training with --prior none or --architecture (default: %(default)s)",
    )


def checked_spread(args: argparse.Namespace) -> Spread | None:
    """The prior spread given by --spread, None without; checks that the arguments are compatible.

    Raises:
        UsageError: it is none, or the arguments do not go together.
    """
    if not 0.0 < args.budget < float("inf"):
        raise UsageError(f"--budget {args.budget:g} is not a time.", "Give seconds above zero.")
    if args.seed < 0:
        raise UsageError(f"--seed {args.seed} is negative.", "Use a whole number from 0.")
    if args.prior == "urdf" and args.architecture == "chain":
        raise UsageError(
            "--architecture chain learns axes and bodies that the URDF tells.",
            "Add --prior none, or leave --architecture out.",
        )
    spread = _spread(args.spread)
    if spread is not None and args.prior == "none":
        raise UsageError(
            "--spread is about the URDF, which --prior none leaves out.", "Leave one of them out."
        )
    if spread is not None and args.architecture is not None:
        raise UsageError(
            f"--spread is for physical parameters, which --architecture {args.architecture} does not identify.",
            "Leave one of them out.",
        )
    return spread


def has_parameters(args: argparse.Namespace) -> bool:
    """Whether the model has physical parameters of links and joints, rather than being a BDNN."""
    return args.prior == "urdf" and args.architecture is None


def learned(
    args: argparse.Namespace, robot: Robot | None, training: Sequence[Recording], spread: Spread | None
) -> Model:
    """The model identified from the recordings.

    Raises:
        BdnnError: there is no URDF to start from or it has no masses, or the recordings do not suffice.
    """
    if args.prior == "none":
        return _bdnn(args, None, training)
    if robot is None:
        raise UsageError(
            "There is no URDF to start from.", "Give --urdf FILE or --robot NAME, or --prior none."
        )
    require_mass(robot, f"{GIVE_MASS[:-1]}, or pass --prior none.")
    if not has_parameters(args):
        return _bdnn(args, robot, training)
    from bdnn_ros.online.identifier import Identifier

    return Identifier(robot, args.cutoff, spread).fit(training, progress=_progress)


def _spread(given: Sequence[str]) -> Spread | None:
    """The spread that --spread asks for, None where it is not given."""
    names = [field.name for field in fields(Spread)]
    chosen: dict[str, float] = {}
    for text in given:
        name, _, share = text.partition("=")
        try:
            chosen[name] = float(share)
        except ValueError:
            chosen[name] = float("nan")
        if name not in names or not 0.0 < chosen[name] <= WIDEST_SPREAD:
            raise UsageError(
                f"--spread {text} is no spread.",
                f"Give NAME=SHARE with one of {listed(names)} and a share above 0, at most {WIDEST_SPREAD:g}.",
            )
    return Spread(**chosen) if chosen else None


def _bdnn(args: argparse.Namespace, prior: Robot | None, training: Sequence[Recording]) -> Model:
    """A BDNN, validated on the last part of the training recordings."""
    from bdnn_ros.bdnn.training import identify

    parts = [(one, fitness.split(one, prepare(one, args.cutoff), STOPS_BY)) for one in training]
    first, last = (
        [
            fitness.prepared(part[side], whole, args.cutoff, "a part of what is left to learn from")
            for whole, part in parts
        ]
        for side in (0, 1)
    )
    architecture = args.architecture or ARCHITECTURES[0]
    model: Model = identify(first, last, prior, args.budget, args.seed, _progress, architecture=architecture)
    return model


def _progress(share: float, what: str) -> None:
    """Progress on a terminal only, not in logs."""
    if sys.stderr.isatty():
        end = "" if share < 1.0 else "\n"
        print(f"\r{100.0 * share:3.0f} % {what:40.40}", end=end, file=sys.stderr, flush=True)
