"""Examinations made by hand for the tests of the report: the effects are given, not searched for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.gains import share_of
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.result import Diagnosis, Finding, Rival
from bdnn_ros.diagnosis.telling.unexplained import Remainder
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.recording import Recording
from bdnn_ros.report.report import render
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, prepare

NOISE = 0.1
"""White noise on the effort, as a share of each joint's spread."""


def fourier_motion(robot: Robot, duration: float = 20.0, rate: float = 200.0, seed: int = 0) -> Recording:
    """Five harmonics on every joint, inside the limits, without effort."""
    generator = np.random.default_rng(seed)
    time = np.arange(0.0, duration, 1.0 / rate)
    low = np.maximum(robot.limits.lower, -np.pi)
    high = np.minimum(robot.limits.upper, np.pi)
    position = np.tile(0.5 * (low + high), (len(time), 1))
    velocity = np.zeros_like(position)
    for k in range(1, 6):
        pulse = 2.0 * np.pi * 0.15 * k
        size = generator.normal(size=robot.width) * 0.16 * (high - low) / k
        phase = pulse * time[:, None] + generator.uniform(0.0, 2.0 * np.pi, robot.width)
        position += size * np.sin(phase)
        velocity += size * pulse * np.cos(phase)
    return Recording(time, robot.joints, position, velocity, name=f"{robot.joints[0]} motion")


def worn(robot: Robot, specs: Sequence[str], recording: Recording, seed: int = 1) -> Recording:
    """The recording with the effort of a robot that has some effects, and noise."""
    signals = prepare(replace(recording, velocity=None), cutoff=recording.rate / 6.0)
    load = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    motion = Motion(signals, robot, load)
    effort = load.copy()
    for spec in specs:
        installed = parse_spec(spec, robot)
        coefficients, shape = installed.effect.coefficients(installed.values)
        effort += installed.effect.columns(motion, installed.target, shape, installed.link) @ coefficients
    generator = np.random.default_rng(seed)
    effort += NOISE * effort.std(axis=0) * generator.normal(size=effort.shape)
    return Recording(
        signals.time, robot.joints, signals.position, signals.velocity, effort, name=recording.name
    )


@dataclass(frozen=True)
class LeastSquares:
    """Stands for the pool and the fit of a search: links and given terms by least squares."""

    equations: Equations
    terms: tuple[Term, ...]
    coefficients: np.ndarray
    covariance: np.ndarray
    link_error: float = 0.03

    @classmethod
    def of(cls, equations: Equations, terms: Sequence[Term]) -> LeastSquares:
        columns = [equations.rigid, *(equations.columns.of(term) for term in terms)]
        whole = np.concatenate(columns, axis=2) / equations.rows.effort_scale[:, None]
        tall = whole[equations.usable]
        target = (equations.rows.target / equations.rows.effort_scale)[equations.usable]
        links = equations.rigid.shape[2]
        prior = np.concatenate([np.full(links, cls.link_error), np.full(tall.shape[1] - links, 1e3)])
        covariance = np.linalg.inv(tall.T @ tall / 0.02**2 + np.diag(prior**-2.0))
        return cls(equations, tuple(terms), covariance @ tall.T @ target / 0.02**2, covariance)

    def residual(self, fit: object, blur: bool = True) -> np.ndarray:
        equations = self.equations
        left = equations.rows.target - equations.rigid @ self.coefficients[: equations.rigid.shape[2]]
        for estimate in self.estimates():
            left = left - equations.columns.of(estimate.term) @ estimate.coefficients
        return np.asarray(left)

    def estimates(self) -> list[Estimate]:
        """The terms, with shapes taken as known to a part in a thousand."""
        found, at = [], self.equations.rigid.shape[2]
        for term in self.terms:
            size = self.equations.columns.of(term).shape[2]
            rows = slice(at, at + size)
            spread = [1e-6 * max(value**2, 1e-6) for _, value in term.shape]
            covariance = np.zeros((size + len(spread),) * 2)
            covariance[:size, :size] = self.covariance[rows, rows]
            covariance[size:, size:] = np.diag(spread)
            found.append(Estimate(term, self.coefficients[rows], *[covariance] * 3))
            at += size
        return found


def terms_of(robot: Robot, specs: Sequence[str]) -> list[Term]:
    """The terms that stand for some effects."""
    terms = []
    for spec in specs:
        installed = parse_spec(spec, robot)
        shape = installed.effect.coefficients(installed.values)[1]
        terms.append(Term(installed.effect, installed.target, installed.link).shaped(shape))
    return terms


def examined(
    robot: Robot,
    recording: Recording,
    specs: Sequence[str],
    *,
    verdict: str = "explained",
    rivals: Sequence[Rival] = (),
    advice: Sequence[str] = (),
    notes: Sequence[str] = (),
    depends_on: str = "",
) -> Examination:
    """An examination that has found these effects, the first with these rivals."""
    signals: Signals = prepare(recording)
    equations = build(signals, robot)
    test = equations.rows.block % 5 == 2
    fit = LeastSquares.of(equations, terms_of(robot, specs))
    found, residual = fit.estimates(), fit.residual(None)
    remainder = _remainder(equations, residual, depends_on)
    held = equations.usable & test[:, None]
    before = float(np.sum(equations.rows.target[held] ** 2))
    findings = []
    for k, estimate in enumerate(found):
        term = estimate.term
        part = equations.columns.of(term) @ estimate.coefficients
        joint = robot.joints[term.target] if term.target >= 0 and not term.link else None
        where = term.link or joint or "The base"
        effect = term.effect.at(robot, term.target, term.link)
        units = {p.name: p.unit_at(effect.slides) for p in effect.parameters}
        findings.append(
            Finding(
                term.effect.name,
                joint,
                term.link,
                {name: replace(q, unit=units[name]) for name, q in estimate.quantities.items()},
                float(np.sum((residual + part)[held] ** 2) - np.sum(residual[held] ** 2)) / before,
                0.55 if rivals and k == 0 else 0.996,
                tuple(rivals) if k == 0 else (),
                term.effect.sentence(where, estimate.values),
            )
        )
    findings.sort(key=lambda finding: -finding.share)

    def rms(values: np.ndarray) -> np.ndarray:
        return np.sqrt(np.mean(np.where(held, values, 0.0) ** 2, axis=0) / held.mean(axis=0))

    simulation, extended = rms(equations.rows.target), rms(residual)
    gain = 1.0 - float(np.sqrt(np.sum(residual[held] ** 2) / before))
    diagnosis = Diagnosis(
        source={
            "bags": [recording.name],
            "duration": round(recording.duration, 3),
            "samples": len(recording),
            "rate": round(recording.rate, 3),
            "cutoff": signals.cutoff,
            "urdf": "",
            "joints": list(robot.joints),
        },
        verdict=verdict,
        findings=tuple(findings),
        effort_rmse={
            "simulation": simulation,
            "extended": extended,
            "noise_floor": np.minimum(remainder.floor, extended),
        },
        gain=gain,
        gain_interval=(gain - 0.02, gain + 0.01),
        unexplained_share=0.01,
        unexplained_depends_on=tuple(remainder.depends_on()),
        unexplained_sentence="What is left looks like noise.",
        advice=tuple(advice),
        notes=tuple(notes),
    )
    links = equations.rigid @ fit.coefficients[: equations.rigid.shape[2]]
    by_links = share_of(links, residual, equations.rows.target, held)
    return Examination(
        diagnosis, (recording,), robot, equations, fit, fit, tuple(found), test, residual, by_links, remainder
    )


def _remainder(equations: Equations, residual: np.ndarray, depends_on: str) -> Remainder:
    """A remainder that depends on nothing, or on the position of one joint."""
    floor = 0.95 * np.sqrt(np.mean(residual**2, axis=0))
    predicted = np.zeros_like(residual)
    if not depends_on:
        return Remainder(floor, {}, predicted)
    j = equations.motion.signals.joints.index(depends_on)
    position = equations.motion.position[equations.rows.samples, j]
    predicted[:, j] = np.polyval(np.polyfit(position, residual[:, j], 3), position)
    return Remainder(floor, {depends_on: {f"{depends_on}.position": 1.0}}, predicted)


def unchanged(examination: Examination) -> ExtendedModel:
    """Stands for the extended model: the robot as it was believed to be."""
    return ExtendedModel(examination.robot, (), np.zeros(examination.robot.width))


def rendered(examination: Examination, data_check: Sequence[str] = ()) -> str:
    """The report's HTML, for a model that leaves the links as they were."""
    return render(examination, unchanged(examination), data_check)
