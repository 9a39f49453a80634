"""`bdnn diagnose`: what the simulation gets wrong, the cause, and the gain of mending it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from bdnn_ros.cli import options
from bdnn_ros.diagnosis.diagnose import Examination, Progress, examine
from bdnn_ros.diagnosis.extension import extend
from bdnn_ros.diagnosis.files import write_extension
from bdnn_ros.diagnosis.result import Diagnosis
from bdnn_ros.errors import UsageError
from bdnn_ros.online.models import load_model, save_model
from bdnn_ros.report.plots import effort_figure
from bdnn_ros.report.report import write_report
from bdnn_ros.robot import Robot

HELP = "name what the simulation gets wrong, with the gain of mending it"
VERDICTS = {
    "nothing_wrong": "The simulation agrees with the data: nothing wrong was found.",
    "explained": "Root causes identified; with them the model agrees with the data:",
    "partly_explained": "Root causes identified; they explain a part of the difference:",
    "cannot_tell": "The simulation disagrees with the data, and no known cause explains it.",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn diagnose`."""
    options.add_recording_arguments(parser, bags="many")
    parser.add_argument(
        "--out", type=Path, required=True, help="directory for the diagnosis, report and model"
    )
    parser.add_argument(
        "--model", type=Path, help="compare with this model, identified earlier: what changed since?"
    )


def run(args: argparse.Namespace) -> int:
    """Diagnose, write the files, say the verdict."""
    earlier = load_model(args.model) if args.model else None
    joints = earlier.joints if earlier else ()
    recordings, robot = options.load(args, joints=joints)
    if earlier is not None:
        robot = getattr(earlier, "robot", None)
        if not isinstance(robot, Robot):
            raise UsageError(
                f"{args.model} is a black box without a robot description.",
                "Identify the earlier recording with --prior urdf.",
            )
    if robot is None:
        raise UsageError("There is no simulation to compare with.", "Give --urdf FILE or --robot NAME.")
    with _progress() as say:
        examination = examine(recordings, robot, cutoff=args.cutoff, progress=say, model=earlier)
        examination = replace(examination, diagnosis=_sourced(examination.diagnosis, args))
        say("writing")
        args.out.mkdir(parents=True, exist_ok=True)
        save_model(args.out, extend(examination))
        write_extension(examination, args.out)
        write_report(examination, args.out / "report.html")
        effort_figure(examination, args.out / "effort.png")
        examination.diagnosis.save(args.out / "diagnosis.json")
    print("\n".join(verdict_lines(examination)))
    print(f"report: {args.out / 'report.html'}")
    return 0


def verdict_lines(examination: Examination) -> list[str]:
    """The verdict as a person would write it, a line each."""
    diagnosis = examination.diagnosis
    lines = [VERDICTS[diagnosis.verdict]]
    for number, finding in enumerate(diagnosis.findings, start=1):
        share = f"{100.0 * finding.share:.1f} % of the squared error"
        lines.append(f" {number}. {finding.sentence} ({share}, probability {finding.probability:.2f})")
        close = [r for r in finding.rivals if r.probability >= 0.1]
        if close:
            others = ", ".join(
                f"{r.effect} at {r.link or r.joint or 'base'} {r.probability:.2f}" for r in close
            )
            lines.append(f"    could also be: {others}")
    low, high = diagnosis.gain_interval
    lines.append(
        f"Gain on held-out data: the error falls by {100.0 * diagnosis.gain:.1f} % "
        f"(95 % interval {100.0 * low:.1f} to {100.0 * high:.1f} %)."
    )
    lines.append(diagnosis.unexplained_sentence)
    return lines + [f"Advice: {sentence}" for sentence in diagnosis.advice]


def _sourced(diagnosis: Diagnosis, args: argparse.Namespace) -> Diagnosis:
    simulation = str(args.model or args.urdf or args.robot or "/robot_description of the bag")
    return replace(
        diagnosis, source={**diagnosis.source, "urdf": simulation, "bags": [str(b) for b in args.bags]}
    )


@contextmanager
def _progress() -> Iterator[Progress]:
    """What is being done, on one line of a terminal."""
    with tqdm(
        total=0,
        bar_format="{desc} ({elapsed})",
        disable=not sys.stderr.isatty(),
        leave=False,
        desc="diagnosing",
    ) as bar:
        yield lambda text: bar.set_description_str(f"diagnosing: {text}")
