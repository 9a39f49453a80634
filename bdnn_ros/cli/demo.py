"""`bdnn demo`: simulates a worn robot with a hidden effect, identifies, diagnoses, and then reveals the truth."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from bdnn_ros.cli import diagnose, identify, simulate
from bdnn_ros.errors import UsageError

WORN = ("coulomb_friction", "viscous_friction", "armature")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn demo`."""
    parser.add_argument("--out", type=Path, default=Path("demo_output"), help="default: %(default)s")
    parser.add_argument("--robot", default="arm7", help="a bundled robot (default: %(default)s)")
    parser.add_argument(
        "--seed", type=int, default=3, help="of everything, the hidden effect included (default: %(default)s)"
    )
    parser.add_argument(
        "--duration", type=float, default=40.0, help="seconds of motion (default: %(default)s)"
    )


def run(args: argparse.Namespace) -> int:
    """Simulate, identify, diagnose, reveal."""
    bag = args.out / "recording"
    _say("1. A worn robot moves. Its links are 5 % off, every joint rubs, and something is hidden in it.")
    _verb(
        simulate,
        [
            *("--robot", args.robot, "--worn", "--wrong", "0.05", "--hide", "1", "--seed", str(args.seed)),
            *("--duration", str(args.duration), "--out", str(bag), "--overwrite"),
        ],
    )
    _say("2. Identify a model from the bag, scored on its last fifth.")
    _verb(identify, [str(bag), "--out", str(args.out / "model")])
    _say("3. Diagnose: what does the robot's description get wrong?")
    _verb(diagnose, [str(bag), "--out", str(args.out / "diagnosis")])
    print(f"picture: {args.out / 'diagnosis' / 'effort.png'}")
    _say("4. The truth, opened only now.")
    print("\n".join(revealed(_truth(bag / "truth.yaml"))))
    return 0


def revealed(truth: Mapping[str, Any]) -> list[str]:
    """The hidden effects, one line each."""
    lines = []
    for effect in truth["effects"]:
        numbers = ", ".join(f"{name} {value:.3g}" for name, value in effect["parameters"].items())
        place = effect.get("link") or effect.get("joint") or "the whole robot"
        lines.append(f" hidden: {effect['effect']} at {place} ({numbers})")
    return [*lines, f" beside it, on every joint: {', '.join(WORN)}"]


def _truth(path: Path) -> dict[str, Any]:
    truth: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return truth


def _verb(module: Any, words: list[str]) -> None:
    """Run another verb as its command line would."""
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)
    status = module.run(parser.parse_args(words))
    if status:
        raise UsageError(
            f"The demo stopped with status {status}.", f"Its command was: {' '.join(words)}{os.linesep}"
        )


def _say(text: str) -> None:
    print(f"\n{text}", flush=True)
