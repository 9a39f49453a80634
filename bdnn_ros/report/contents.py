"""The content of a report as plain values for the template."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.diagnosis.judging.identifiability import TIE
from bdnn_ros.diagnosis.regression.gains import squares
from bdnn_ros.diagnosis.result import Diagnosis, Finding, reference
from bdnn_ros.report import words
from bdnn_ros.report.view import Cause, LinkChange, View
from bdnn_ros.robot.units import printed

CLOSE_RIVAL = 0.03
"""Causes without a rival of this probability need no bars."""


@dataclass(frozen=True)
class Root:
    """A line in the list of root causes; `ties` are rivals too probable to leave out.

    `of_that` is the probability of its place, or that there is no more to it, if that is in doubt; otherwise empty.
    """

    title: str
    where: str
    amounts: tuple[str, ...]
    sentence: str
    share: float
    share_of: str
    probability: str
    of_that: str
    ties: tuple[str, ...]


@dataclass(frozen=True)
class Bar:
    """A candidate for a finding with its probability."""

    name: str
    probability: float
    chosen: bool


@dataclass(frozen=True)
class Contest:
    """A finding and its rivals, most probable first; `rest` is the probability of all others and of no effect."""

    name: str
    bars: tuple[Bar, ...]
    rest: float


@dataclass(frozen=True)
class JointError:
    """Held-out errors of a joint, in its unit; `*_width` are bar lengths in per cent, on one scale for all joints.

    If the joint's effort was not measured, all are NaN and the bars have no length.
    """

    joint: str
    index: int
    unit: str
    spread: float
    simulation: float
    extended: float
    floor: float
    simulation_width: float
    extended_width: float
    floor_width: float


@dataclass(frozen=True)
class ParameterRow:
    """A line of the parameter table; `first` is the number of lines of its finding in the first one, else 0."""

    title: str
    where: str
    first: int
    name: str
    value: str
    interval: str
    unit: str


@dataclass(frozen=True)
class LinkRow:
    """A line of the table of link corrections; `clear` if the correction of the mass exceeds its interval."""

    link: str
    joint: str
    nominal: str
    corrected: str
    change: str
    shift: str
    clear: bool


def roots(diagnosis: Diagnosis) -> list[Root]:
    """The list of root causes."""
    return [_root(finding) for finding in sorted(diagnosis.findings, key=lambda finding: finding.of_velocity)]


def contests(diagnosis: Diagnosis) -> list[Contest]:
    """The findings with rivals worth showing."""
    result = []
    for finding in diagnosis.findings:
        if not any(rival.probability >= CLOSE_RIVAL for rival in finding.rivals):
            continue
        bars = [Bar(words.named(finding), finding.probability, True)]
        bars += [Bar(words.named(rival), rival.probability, False) for rival in finding.rivals]
        bars.sort(key=lambda bar: -bar.probability)
        rest = max(1.0 - sum(bar.probability for bar in bars), 0.0)
        result.append(Contest(words.named(finding), tuple(bars), rest))
    return result


def joint_errors(shown: View) -> list[JointError]:
    """Held-out errors of every joint; bars relative to the spread of its effort."""
    measured = _measured(shown)
    errors = {
        key: np.where(measured, v, np.nan) for key, v in shown.examination.diagnosis.effort_rmse.items()
    }
    relative = {key: np.nan_to_num(values / shown.scale) for key, values in errors.items()}
    most = max(float(np.max(values)) for values in relative.values()) or 1.0
    width = {key: 100.0 * values / most for key, values in relative.items()}
    return [
        JointError(
            joint,
            j,
            shown.units[j][0],
            float(shown.scale[j]) if measured[j] else math.nan,
            float(errors["simulation"][j]),
            float(errors["extended"][j]),
            float(errors["noise_floor"][j]),
            float(width["simulation"][j]),
            float(width["extended"][j]),
            float(width["noise_floor"][j]),
        )
        for j, joint in enumerate(shown.joints)
    ]


def overall(shown: View) -> dict[str, float]:
    """Held-out RMS error over all rows that count, on which the gain is based, in the units of the efforts."""
    errors, rows = shown.examination.diagnosis.effort_rmse, shown.usable & shown.held[:, None]
    return {key: math.sqrt(squares(v**2, rows) / rows.sum()) for key, v in errors.items()}


def _measured(shown: View) -> np.ndarray:
    """Joints whose effort was measured in the held-out rows, (n,) bool."""
    return np.asarray((shown.usable & shown.held[:, None]).any(axis=0))


def parameter_rows(causes: Sequence[Cause]) -> list[ParameterRow]:
    """Every parameter of every finding."""
    rows = []
    for cause in causes:
        finding = cause.finding
        possible = {one.name: one for one in cause.effect.parameters} if cause.effect is not None else {}
        for k, (name, quantity) in enumerate(finding.parameters.items()):
            value, interval = words.estimate(name, quantity, possible.get(name))
            rows.append(
                ParameterRow(
                    title=words.cause(finding),
                    where=finding.where,
                    first=len(finding.parameters) if k == 0 else 0,
                    name=words.label(name),
                    value=value,
                    interval=interval,
                    unit=printed(quantity.unit) or "–",
                )
            )
    return rows


def link_rows(changes: list[LinkChange]) -> list[LinkRow]:
    """Corrections of the links' masses and centres of mass."""
    rows = []
    for change in changes:
        decimals = words.decimals_of(words.INTERVAL * change.spread)
        moved = change.corrected - change.nominal
        rows.append(
            LinkRow(
                link=change.link,
                joint=change.joint,
                nominal=words.number(change.nominal),
                corrected=f"{words.fixed(change.corrected, decimals)} ± "
                f"{words.fixed(words.INTERVAL * change.spread, decimals)}",
                change=words.percent(moved / change.nominal, 1) if change.nominal > 0.0 else "–",
                shift=words.fixed(1e3 * float(np.linalg.norm(change.shift)), 1),
                clear=abs(moved) > words.INTERVAL * change.spread,
            )
        )
    return rows


def recorded(examination: Examination) -> str:
    """When the first recording began, if its clock tells."""
    epoch = min(recording.epoch for recording in examination.recordings)
    if epoch < 10**18:
        return ""  # a clock that starts with the machine or the simulation
    start = datetime.datetime.fromtimestamp(epoch * 1e-9, tz=datetime.timezone.utc)
    return start.strftime("%Y-%m-%d %H:%M UTC")


def method(shown: View) -> list[tuple[str, str]]:
    """How the result was computed: terms, each with an explanation."""
    examination = shown.examination
    equations, pool = examination.equations, examination.pool
    signals, compared = equations.motion.signals, reference(shown.since)
    held = len(np.unique(equations.rows.block[shown.held]))
    seconds = float(np.median([b - a for a, b in shown.held_spans()])) if shown.held.any() else 0.0
    doubt = f"{100.0 * pool.link_error:.0f} "
    slower = f"{signals.raw_rate:.4g}" != f"{signals.rate:.4g}"
    rates = f"from {signals.raw_rate:.4g} to {signals.rate:.4g} Hz" if slower else f"at {signals.rate:.4g} Hz"
    identified = equations.errors.joints is not None
    doubt += "standard deviations of what was identified" if identified else "%"
    return [
        (
            "Low-pass",
            f"{signals.cutoff:.3g} Hz at −3 dB, zero phase, Gaussian, alike for position, its derivatives, "
            f"measured and modelled effort; {rates}.",
        ),
        (
            "Held out",
            f"{held} of {equations.rows.blocks} blocks of time, about {seconds:.1f} s each, spread over the "
            "recording (shaded in the charts). Neither the search nor the model that is scored has seen "
            "them. Of what came and went between them the middle fifth of its time is held out from the model "
            "that is scored there. Errors, shares and gain are measured on all of these.",
        ),
        (
            "Left out",
            "Moments at which a joint rests or sticks: there dry friction may be anything between its values in "
            "both directions. Where a joint turns round, rows weigh as little as the residual there asks for.",
        ),
        (
            "Gain",
            f"1 − RMS error of the extended model / RMS error of the {compared}, over all joints; interval "
            "of 95 % from a bootstrap of the held-out blocks in which each joint moves.",
        ),
        (
            "Share",
            f"Part of the {compared}'s squared error that returns when the cause is taken out of the "
            "extended model. Causes overlap, so shares need not add up to 100 %.",
        ),
        (
            "Probability",
            "Bayesian evidence of the cause against its rivals and against no effect at its place, errors "
            f"of all links left free around their values (± {doubt} at first).",
        ),
        (
            "Intervals",
            "Value ± 1.96 standard deviations, joint with all other causes and the links, for noise that is "
            "coloured as the residual is.",
        ),
        (
            "Noise floor",
            "RMS of what neither position, velocity, acceleration, load nor time predicts of the residual.",
        ),
    ]


def _root(finding: Finding) -> Root:
    sure, of_that = words.certainty(finding)
    return Root(
        title=words.cause(finding),
        where=words.at(finding.joint, finding.link, finding.effect),
        amounts=tuple(words.amounts(finding)),
        sentence=finding.sentence,
        share=finding.share,
        share_of="of the velocity's error" if finding.of_velocity else "of the error",
        probability=words.probability(sure),
        of_that=f"{words.probability(finding.probability)} {of_that}" if of_that else "",
        ties=tuple(
            f"{words.named(rival)} ({words.probability(rival.probability)})"
            for rival in finding.rivals
            if rival.probability >= TIE
        ),
    )
