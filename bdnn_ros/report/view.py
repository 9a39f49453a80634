"""An examination as plain arrays: measured effort, model efforts, and the contribution of each cause."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.result import Finding, Quantity
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.rigid import LinkInertia
from bdnn_ros.robot import PER_LINK

LONGEST = 40.0
"""A chart against time shows at most so many seconds: more would be a solid mass."""


@dataclass(frozen=True)
class Cause:
    """A finding and its contribution to the effort.

    Attributes:
        part: rows (R, n) [N·m], or None where the finding does not show in the effort.
        effect: what the finding names, or None where no term of the fit stands for it.
        sizes: RMS of the part as a share of the spread of each joint's effort, (n,).
        joint: index of the joint that shows it best.
    """

    finding: Finding
    effect: Effect | None
    part: np.ndarray | None
    sizes: np.ndarray
    joint: int


@dataclass(frozen=True)
class View:
    """The rows of an examination.

    Attributes:
        time: [s], (R,).
        inputs: what the effort may depend on, by name, each (R, n).
        measured, simulated, extended: effort, low-passed alike, (R, n) [N·m]; `extended` by a model that was
            fitted without the held-out rows.
        before, after: measured minus simulated, and minus extended, (R, n) [N·m].
        residual: what the model fitted to all rows leaves, (R, n) [N·m].
        direction: of each joint's motion, (R, n), +1 or -1.
        usable, held: rows that count, (R, n) bool; rows kept out of the fit, (R,) bool.
        scale: spread of each joint's effort, (n,) [N·m].
    """

    examination: Examination
    time: np.ndarray
    inputs: dict[str, np.ndarray]
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    residual: np.ndarray
    direction: np.ndarray
    usable: np.ndarray
    held: np.ndarray
    scale: np.ndarray
    causes: tuple[Cause, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """n joint names."""
        return self.examination.robot.joints

    @property
    def since(self) -> bool:
        """Whether an earlier model is compared instead of the simulation: the findings are what changed since."""
        return self.examination.model is not None

    @property
    def simulated(self) -> np.ndarray:
        """Effort by the simulation, (R, n) [N·m]."""
        return self.measured - self.before

    @property
    def extended(self) -> np.ndarray:
        """Effort by the extended model, (R, n) [N·m]."""
        return self.measured - self.after

    @cached_property
    def named(self) -> np.ndarray:
        """Total contribution of all findings to the effort, (R, n) [N·m]."""
        parts = [cause.part for cause in self.causes if cause.part is not None]
        return np.sum(parts, axis=0) if parts else np.zeros_like(self.measured)

    @cached_property
    def units(self) -> tuple[tuple[str, str], ...]:
        """Units of effort and position of each joint."""
        slides = self.examination.robot.slides.tolist()
        return tuple(("N", "m") if one else ("N·m", "rad") for one in slides)

    @cached_property
    def excerpt(self) -> slice:
        """Rows to draw against time: all, or the stretch with the largest error of the simulation."""
        duration = self.time[-1] - self.time[0]
        if duration <= LONGEST:
            return slice(0, len(self.time))
        error = np.where(self.usable, self.before / self.scale, 0.0)
        total = np.concatenate([[0.0], np.cumsum(np.sum(error**2, axis=1))])
        ends = np.searchsorted(self.time, self.time + LONGEST)
        starts = np.flatnonzero(self.time + LONGEST <= self.time[-1])
        best = int(starts[np.argmax(total[ends[starts]] - total[starts])])
        return slice(best, int(ends[best]))

    @cached_property
    def runs(self) -> list[slice]:
        """Gap-free pieces of the excerpt, counted from its start."""
        first, last = self.excerpt.start, self.excerpt.stop
        pieces = [(max(r.start, first), min(r.stop, last)) for r in self.examination.equations.rows.runs]
        return [slice(a - first, b - first) for a, b in pieces if b > a]

    def held_spans(self) -> list[tuple[float, float]]:
        """Held-out stretches of time, split at pauses."""
        spans = []
        for run in self.examination.equations.rows.runs:
            time = self.time[run]
            edges = np.flatnonzero(np.diff(self.held[run].astype(int), prepend=0, append=0)).reshape(-1, 2)
            spans += [(float(time[a]), float(time[min(b, len(time) - 1)])) for a, b in edges]
        return spans


def view(examination: Examination) -> View:
    """The rows of an examination."""
    equations, pool, fit = examination.equations, examination.pool, examination.fit
    motion, rows = equations.motion, equations.rows.samples
    effort = motion.signals.effort
    assert effort is not None  # examine() refuses a recording without
    measured = motion.signals.smooth(effort)[rows]
    time = motion.time[rows]
    inputs = {
        "velocity": motion.velocity[rows],
        "position": motion.position[rows],
        "load": motion.load[rows],
        "acceleration": motion.acceleration[rows],
        "time": np.repeat(time[:, None], equations.rows.width, axis=1),
    }
    return View(
        examination=examination,
        time=time,
        inputs=inputs,
        measured=measured,
        before=equations.rows.target,
        after=examination.extended,
        residual=pool.residual(fit, blur=False),
        direction=np.where(inputs["velocity"] >= 0.0, 1.0, -1.0),
        usable=equations.usable,
        held=examination.test,
        scale=equations.rows.effort_scale,
        causes=tuple(_causes(examination)),
    )


def _causes(examination: Examination) -> Iterable[Cause]:
    """Every finding with the contribution of its term."""
    equations, robot = examination.equations, examination.robot
    terms: dict[tuple[str, str | None, str | None], list[Estimate]] = {}
    for estimate in examination.estimates:
        term = estimate.term
        joint = robot.joints[term.target] if term.target >= 0 and not term.link else None
        terms.setdefault((term.effect.name, joint, term.link), []).append(estimate)
    for finding in examination.diagnosis.findings:
        same = terms.get((finding.effect, finding.joint, finding.link), [])
        if not same:
            place = robot.joints.index(finding.joint) if finding.joint in robot.joints else 0
            yield Cause(finding, None, None, np.zeros(robot.width), place)
            continue
        # Two variants of one effect may sit at one place: their values tell them apart.
        estimate = next((e for e in same if _values(e.quantities) == _values(finding.parameters)), same[0])
        same.remove(estimate)
        part = equations.columns.of(estimate.term) @ estimate.coefficients
        sizes = (
            np.sqrt(np.mean(np.where(equations.usable, part, 0.0) ** 2, axis=0)) / equations.rows.effort_scale
        )
        yield Cause(finding, estimate.term.effect, part, sizes, int(np.argmax(sizes)))


def _values(quantities: Mapping[str, Quantity]) -> dict[str, float]:
    """Parameter values without units (a finding on a sliding joint has units of its own)."""
    return {name: quantity.value for name, quantity in quantities.items()}


@dataclass(frozen=True)
class LinkChange:
    """Correction of a link's inertial parameters beside the named causes.

    Attributes:
        nominal, corrected, spread: mass, and the standard deviation of its correction and of the scale that it has [kg].
        shift: of the centre of mass, (3,) [m].
    """

    joint: str
    link: str
    nominal: float
    corrected: float
    spread: float
    shift: np.ndarray


def link_changes(examination: Examination, links: np.ndarray) -> list[LinkChange]:
    """The corrections of all moving links in the extended model.

    Args:
        links: inertial parameters of the links, as it has them, (n, PER_LINK).
    """
    robot, equations, fit = examination.robot, examination.equations, examination.fit
    size = equations.rigid.shape[2]
    masses = equations.errors.relative[::PER_LINK]
    variance = np.sum((masses @ fit.covariance[:size, :size]) * masses, axis=1)
    for one in examination.estimates:
        if one.term.effect.name == LinkInertia.name and one.term.link is not None:
            variance[robot.body_of(one.term.link)[0]] += one.quantities["mass"].std ** 2
    result = []
    for i, joint in enumerate(robot.joints):
        old, new, spread = robot.inertials[i], links[i], float(np.sqrt(max(variance[i], 0.0)))
        centres = [v[1:4] / v[0] if v[0] > 1e-9 else np.zeros(3) for v in (old, new)]
        link = robot.moving_link(joint)
        result.append(LinkChange(joint, link, float(old[0]), float(new[0]), spread, centres[1] - centres[0]))
    return result


@dataclass(frozen=True)
class Coverage:
    """What a recording shows of a joint; shares of limits are NaN if the URDF has none."""

    joint: str
    low: float
    high: float
    range_share: float
    speed: float
    speed_share: float
    effort: float
    effort_share: float
    rest: float


def coverage(shown: View) -> list[Coverage]:
    """The share of each joint's range, speed and effort that the recordings cover."""
    examination = shown.examination
    limits, signals = examination.robot.limits, examination.equations.motion.signals
    position = np.concatenate([r.position for r in examination.recordings])
    effort = np.abs(np.concatenate([r.require_effort() for r in examination.recordings])).max(axis=0)
    speed, rest = np.abs(signals.velocity).max(axis=0), signals.at_rest.mean(axis=0)
    low, high = position.min(axis=0), position.max(axis=0)
    result = []
    for j, joint in enumerate(shown.joints):
        result.append(
            Coverage(
                joint,
                float(low[j]),
                float(high[j]),
                _part_of(high[j] - low[j], limits.upper[j] - limits.lower[j]),
                float(speed[j]),
                _part_of(speed[j], limits.velocity[j]),
                float(effort[j]),
                _part_of(effort[j], limits.effort[j]),
                float(rest[j]),
            )
        )
    return result


def _part_of(value: float, whole: float) -> float:
    return float(value / whole) if 0.0 < whole < 1e6 else float("nan")
