"""The identification's benchmark on real recordings, and from a bag to a model."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from _physical_data import real, sensed
from _physical_measures import LeastSquares

from bdnn_ros import bags
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import score, score_model
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.excitation import fourier

RECORDINGS = {
    "ur10": ("ur10_unisa/ur10", (), (), 0.125),
    "panda": ("panda_unisa/panda", ("s/fer_/panda_/",), (), 0.14),
    "tx40": ("tx40_figaroh/tx40", (), (4,), 0.16),
}
"""Files, renaming, coupled motors that least squares is told of (ours finds them), and the error aimed at."""
HOLDOUT = 0.4
BAG_SECONDS, BAG_RATE = 60.0, 1000.0


def load(data: Path, name: str) -> tuple[Robot, Recording]:
    """A real recording and the robot's description."""
    path, rules, _, _ = RECORDINGS[name]
    robot = Robot.from_file(data / f"{path}.urdf")
    recording = bags.read(data / f"{path}.mcap")
    recording = recording.rename(rules) if rules else recording
    joints = [joint for joint in robot.joints if joint in recording.joints]
    return Robot.from_urdf(robot.urdf, joints), recording.select(joints)


def recorded(args: argparse.Namespace) -> dict[str, Any]:
    """NRMSE on the last 40 % of real recordings: description, least squares, ours."""
    result: dict[str, Any] = {}
    if not args.data.is_dir():
        print(f"no recordings at {args.data}: left out (--data DIR)")
        return result
    for name, (_, _, coupled, target) in RECORDINGS.items():
        robot, recording = load(args.data, name)
        first, last = recording.split(HOLDOUT)
        seen, tested = prepare(first), prepare(last)
        assert tested.effort is not None
        nominal = robot.inverse_dynamics(tested.position, tested.velocity, tested.acceleration)
        inside = tested.interior
        scores = {
            "URDF": score(tested.smooth(tested.effort)[inside], tested.smooth(nominal)[inside], robot.joints),
            "least squares": LeastSquares.fit(robot, [seen], coupled).score([tested]),
            "ours": score_model(Identifier(robot).fit([first]), [tested]),
        }
        print(
            f"{name}, low-pass at {tested.cutoff:.3g} Hz"
            + "".join(f"{j:>8}" for j in ("mean", *range(1, robot.width + 1)))
        )
        for label, one in scores.items():
            note = f"   (aim {target:g})" if label == "ours" else ""
            print(f"{label:>27} {one.nrmse_mean:8.3f}" + "".join(f"{x:8.3f}" for x in one.nrmse) + note)
        result[name] = {label: one.as_json() for label, one in scores.items()}
    return result


def from_bag(args: argparse.Namespace) -> dict[str, Any]:
    """`bdnn identify` on 60 s of seven joints at 1 kHz: time and peak memory, from bag to model."""
    one = real(0, "unmodelled")
    rng = np.random.default_rng(0)
    plan = fourier(one.nominal, np.arange(round(BAG_SECONDS * BAG_RATE)) / BAG_RATE, rng)
    recording = sensed(one, plan, rng)
    with tempfile.TemporaryDirectory() as name:
        bag = bags.write(recording, Path(name) / "bag")
        command = [sys.executable, "-c", CHILD, "identify", str(bag), "--out", str(Path(name) / "model")]
        start = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds = time.perf_counter() - start
    memory = float(done.stdout.splitlines()[-1]) / 1024.0
    print(f"{len(recording)} samples: {seconds:.1f} s (aim 10), peak memory {memory:.0f} MB (aim 1000)")
    return {"samples": len(recording), "seconds": seconds, "peak_mb": memory}


CHILD = """
import sys
from bdnn_ros.cli.main import main
status = main(sys.argv[1:])
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
sys.exit(status)
"""
