"""`bdnn diagnose`: what the simulation gets wrong, the causes, and how much correcting them gains."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bdnn_ros.aside import in_two
from bdnn_ros.checks.data import check_data
from bdnn_ros.checks.handling import unloaded
from bdnn_ros.cli import loading, options, outputs
from bdnn_ros.cli.describing import unheld
from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.diagnosis.judging.identifiability import TIE
from bdnn_ros.diagnosis.recorded.compared import Compared
from bdnn_ros.diagnosis.result import Diagnosis, Finding, Rival, reference
from bdnn_ros.errors import UsageError, listed
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.files import write_model_files
from bdnn_ros.models import load_model, save_model
from bdnn_ros.report.report import write_report
from bdnn_ros.report.words import (
    UNCHANGED,
    WITHOUT_A_NAME,
    cause,
    certainty,
    change,
    corrected,
    needless,
    unshown,
)
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import printed
from bdnn_ros.written import spelled

REPORT = "report.html"
MANY = 3
"""Places at which one kind of cause is said in one line."""
MOST_REMARKS = 3
"""Sentences about the data that are printed; the report has all."""
VERDICTS = {
    "nothing_wrong": "Nothing wrong was found: no cause is needed to explain the data.",
    "explained": "Root causes identified; with them{also} the model agrees with the data:",
    "partly_explained": "Root causes identified; {beside}:",
    "cannot_tell": "The simulation disagrees with the data, and no single cause stands out.",
}
CHANGES = {
    "nothing_wrong": "Nothing has changed since the model was identified, as far as the data shows.",
    "explained": "Changes identified; with them{also} the model agrees with the data:",
    "partly_explained": "Changes identified; {beside}:",
    "cannot_tell": "The earlier model disagrees with the data, and no single change stands out.",
}
"""The verdicts where the model is one identified earlier."""
ALSO = " and with what is told of {these} below"
"""What is said of errors that are no findings, where they make up most of what is mended."""
LEFT = "beside them more than the noise is left at {where}"
OPEN = "what is told as a push may be another cause"
MOSTLY_UNNAMED = "most of what the extended model mends has no name"
AGREES = "The {reference} agrees with the measured efforts."
NO_CAUSE = "No cause is needed to explain the measured efforts."
OF_A_SENSOR = "What is found is of a reported velocity only:"
"""What follows the verdict on the efforts, where no finding is of them."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn diagnose`."""
    options.add_recording_arguments(
        parser,
        bags="many",
        cutoff="low-pass of the signals; motion and effort are compared behind 0.7 times as much (default: behind 3 "
        "to 7, the less the noisier the positions are; lower at rates below 26, and down to 1 where noise drowns slow motion)",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=Path,
        required=True,
        help="directory for diagnosis.json, report.html, model.bdnn, extended.urdf, extended.mjcf.xml, "
        "effects.yaml and effort.png",
    )
    parser.add_argument(
        "--model",
        type=Path,
        help="compare with this model, identified earlier, instead of the robot description: what changed since?",
    )


def run(args: argparse.Namespace) -> int:
    """Diagnose, write the files, print the verdict."""
    outputs.require_directory(args.out)
    earlier = load_model(args.model) if args.model else None
    if earlier is not None and (args.urdf or args.robot):
        options.say(f"the recording is compared with {args.model}, not with {args.urdf or args.robot}.")
    recordings, robot = loading.load(args, model=earlier, needs_robot=earlier is None, undisturbed=True)
    if earlier is not None:
        robot = getattr(earlier, "robot", None)
        if not isinstance(robot, Robot):
            raise UsageError(
                f"{args.model} holds networks, of which nobody knows how sure they are.",
                "Identify the earlier recording with --prior urdf and without --architecture.",
            )
    if robot is None:
        raise UsageError("There is no simulation to compare with.", "Give --urdf FILE or --robot NAME.")
    loading.require_efforts(args, recordings)
    said = [note for recording in recordings for note in recording.notes]
    known = Compared.of(earlier, robot)
    robot = known.robot
    with options.stages("diagnosing") as say:
        recordings = unloaded(recordings, robot, args.cutoff)
        examination = examine(recordings, robot, cutoff=args.cutoff, progress=say, model=earlier)
        _, notes = ([], []) if args.joints or earlier is not None else unheld(robot, recordings[0])
        told = {one.joint for one in examination.diagnosis.findings if one.of_velocity and one.joint}
        odd = check_data(known.acting(recordings), robot, args.cutoff, told)
        remarks = [*notes, *map(spelled, odd)]
        lines = verdict_lines(examination, said)
        examination = replace(examination, diagnosis=_completed(examination, args, remarks))
        say("writing")
        with outputs.written_together(args.out) as place:
            _write(examination, remarks, place)
    print("\n".join(lines))
    report = args.out / REPORT
    for sentence in options.shortened(remarks, MOST_REMARKS, report):
        print(f"Data check: {sentence}")
    print(f"report: {report}")
    return 0


def _write(examination: Examination, remarks: Sequence[str], place: Path) -> None:
    """Write what there is into a directory."""

    def figure() -> None:
        from bdnn_ros.report.plots import effort_figure  # what draws takes as long to import as to draw

        effort_figure(examination, place / "effort.png")

    def files() -> None:
        extended = extend(examination)
        save_model(place, extended)
        write_model_files(extended, place)
        write_report(examination, extended, place / REPORT, remarks)
        examination.diagnosis.save(place / "diagnosis.json")

    in_two(lambda write: write(), [figure, files])


def verdict_lines(examination: Examination, known: Sequence[str] = ()) -> list[str]:
    """The verdict in plain sentences, one a line, without notes that were reported before."""
    diagnosis = examination.diagnosis
    beside = OPEN if diagnosis.endless else MOSTLY_UNNAMED
    beside = LEFT.format(where=listed(diagnosis.above)) if diagnosis.above else beside
    also = ALSO.format(these=" and ".join(diagnosis.also)) if diagnosis.also else ""
    since = examination.model is not None
    verdict = (CHANGES if since else VERDICTS)[diagnosis.verdict]
    verdict = UNCHANGED if unshown(diagnosis, since) else verdict
    lines = [verdict.format(beside=beside, also=also)]
    if diagnosis.findings and all(finding.of_velocity for finding in diagnosis.findings):
        agrees = NO_CAUSE if corrected(diagnosis) else AGREES
        of_effort = agrees.format(reference=reference(since))
        lines[0] = f"{lines[0] if diagnosis.verdict == 'cannot_tell' else of_effort} {OF_A_SENSOR}"
    for number, group in enumerate(_grouped(diagnosis.findings), start=1):
        said = group[0].sentence if len(group) == 1 else _together(group)
        lines.append(f" {number}. {said} ({_share(group)}, probability {_probability(group)})")
        lines += [_rivals(finding) for finding in group if _close(finding)]
    lines += [note for note in diagnosis.notes if note not in known]
    lines += [*_gain(diagnosis), diagnosis.unexplained_sentence]
    return lines + [f"Advice: {sentence}" for sentence in diagnosis.advice]


def _gain(diagnosis: Diagnosis) -> list[str]:
    """The line on the gain. If no cause was needed, only a gain that is certain is reported, with what it comes from."""
    low, high = diagnosis.gain_interval
    interval = f"(95 % interval {100.0 * low:.1f} to {100.0 * high:.1f} %)"
    if needless(diagnosis):
        much = f"{100.0 * diagnosis.gain:.1f} % {interval}"
        return [f"What {WITHOUT_A_NAME}, takes {much} off the error on held-out data."] * corrected(diagnosis)
    if diagnosis.stays:
        return ["Gain on held-out data: none, and nothing grows."]
    if diagnosis.gain >= 0.0:
        return [f"Gain on held-out data: the error falls by {100.0 * diagnosis.gain:.1f} % {interval}."]
    return [f"Gain on held-out data: none, the error grows by {-100.0 * diagnosis.gain:.1f} %."]


def _grouped(findings: Sequence[Finding]) -> list[list[Finding]]:
    """Findings grouped by kind and unit, sorted by the sum of their shares."""
    kinds: dict[tuple[str, ...], list[Finding]] = {}
    for finding in findings:
        units = (quantity.unit for quantity in finding.parameters.values())
        kinds.setdefault((finding.effect, finding.variant, *units), []).append(finding)
    groups = [
        part for same in kinds.values() for part in ([same] if len(same) >= MANY else [[one] for one in same])
    ]
    return sorted(groups, key=lambda group: (group[0].of_velocity, -sum(one.share for one in group)))


def _share(group: Sequence[Finding]) -> str:
    """What would come back without each of a kind, which does not add up; of a filtered velocity its own joint's error."""
    shares = [100.0 * finding.share for finding in group]
    low, high = (f"{end(shares):.1f}" for end in (min, max))
    whole = "velocity's squared error" if group[0].of_velocity else "squared error"
    return f"{low if low == high else f'{low} to {high}'} % of the {whole}{' each' * (len(group) > 1)}"


def _probability(group: Sequence[Finding]) -> str:
    """How sure the least sure of them is; and of its place, or that it is no more, of one or the least of those in such doubt."""
    sure = sorted(f"{certainty(finding)[0]:.2f}" for finding in group)
    said = [sure[0] if sure[0] == sure[-1] else f"at least {sure[0]}"]
    doubts: dict[str, list[Finding]] = {}
    for finding in group:
        doubts.setdefault(certainty(finding)[1], []).append(finding)
    doubts.pop("", None)
    for of_that, those in doubts.items():
        whose = "" if len(group) == 1 else "at least " if len(those) > 1 else f"at {those[0].where} "
        said.append(f"{whose}{min(finding.probability for finding in those):.2f} {of_that}")
    return ", ".join(said)


def _together(group: Sequence[Finding]) -> str:
    """One sentence for the same cause at many places."""
    values = [
        f"{finding.where} " + ", ".join(f"{quantity.value:.3g}" for quantity in finding.parameters.values())
        for finding in group
    ]
    names = ", ".join(f"{name} [{printed(quantity.unit)}]" for name, quantity in group[0].parameters.items())
    than = " than the model" if {*map(change, group)} != {"more"} else ""
    return f"{cause(*group)}{than} at {len(group)} places, {names}: {'; '.join(values)}."


def _close(finding: Finding) -> list[Rival]:
    return [rival for rival in finding.rivals if rival.probability >= TIE]


def _rivals(finding: Finding) -> str:
    others = ", ".join(
        f"{_called(rival)} at {rival.where} {rival.probability:.2f}" for rival in _close(finding)
    )
    return f"    {_called(finding)} at {finding.where} could also be: {others}"


def _called(one: Finding | Rival) -> str:
    """An effect as diagnosis.json calls it, with which of its name where there are several."""
    return f"{one.effect} ({one.variant})" if one.variant else one.effect


def _completed(examination: Examination, args: argparse.Namespace, remarks: Sequence[str]) -> Diagnosis:
    """The diagnosis with its source and the results of the data check."""
    robot = examination.robot
    in_bag = any(recording.urdf == robot.urdf for recording in examination.recordings)
    described = "/robot_description of the bag" if in_bag else args.robot
    diagnosis = examination.diagnosis
    simulation = spelled(args.model or args.urdf or described)
    source = {**diagnosis.source, "urdf": simulation, "bags": [spelled(bag) for bag in args.bags]}
    return replace(diagnosis, source=source, notes=(*map(spelled, diagnosis.notes), *remarks))
