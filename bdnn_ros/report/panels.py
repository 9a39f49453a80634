"""The charts of a report: effort against time, residuals against inputs, evidence for the causes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.regression.noise import rms
from bdnn_ros.diagnosis.result import reference
from bdnn_ros.report.chart import ROBUST, Axes, Panel, Range, span
from bdnn_ros.report.view import Cause, View
from bdnn_ros.report.words import named as name_of

BINS = 36
"""Most bins along an input; half as many of even width, half with as many points each."""
LEAST_IN_BIN = 4
CLOSE = 0.02
"""Inputs that explain a cause's contribution nearly alike: the first in the order of the view is drawn."""
READABLE = 0.6
"""Below this, no single input makes a curve of a cause: it is drawn against its own prediction instead."""
SMOOTH = 0.97
"""A contribution explained this well by one input is drawn as a curve, otherwise as dots."""
EFFECT_POINTS = 250
"""Dots of such a contribution, few enough to leave the measured ones visible."""
CHANGED = 0.1
"""Residuals that differ by less than this share are drawn once."""
SAME_CURVE = 0.12
"""Curves of the two directions closer than this share of their range are drawn as one."""
UNITS = {"velocity": "{p}/s", "position": "{p}", "load": "{e}", "acceleration": "{p}/s²", "time": "s"}


@dataclass(frozen=True)
class Evidence:
    """The residual before and after a cause is removed, against the input that shows it best.

    Attributes:
        against: that input in words.
        joint: name of the joint that is drawn.
    """

    cause: Cause
    against: str
    joint: str
    before: Panel
    after: Panel | None


def effort_panel(shown: View, joint: int) -> Panel:
    """Measured, simulated and extended effort against time."""
    rows, runs = shown.excerpt, shown.runs
    time = shown.time[rows]
    series = {name: getattr(shown, name)[rows, joint] for name in ("measured", "simulated", "extended")}
    axes = Axes(_time_range(time), span(list(series.values())))
    axes.band("held", shown.held_spans())
    for name, values in series.items():
        axes.line(name, time, values, runs)
    name, unit = shown.joints[joint], shown.units[joint][0]
    return axes.panel(
        "time [s]",
        ("effort", unit),
        f"Effort of {name} against time: measured, by the {reference(shown.since)}, by the extended model.",
        x_most=9,
    )


def residual_panel(shown: View, joint: int) -> Panel:
    """Residuals of the simulation and of the extended model against time."""
    rows, runs = shown.excerpt, shown.runs
    time = shown.time[rows]
    before, after = shown.before[rows, joint], shown.after[rows, joint]
    axes = Axes(_time_range(time), span([before, after], ROBUST))
    axes.band("held", shown.held_spans())
    axes.line("before", time, before, runs)
    axes.line("after", time, after, runs)
    name, unit = shown.joints[joint], shown.units[joint][0]
    errors = [rms(values) for values in (before, after)]
    return axes.panel(
        "time [s]",
        ("residual", unit),
        f"Residual of {name} against time: RMS {errors[0]:.3g} {unit} with the {reference(shown.since)}, "
        f"{errors[1]:.3g} {unit} with the extended model.",
        x_most=9,
    )


def dependence_panels(shown: View, joint: int) -> list[Panel]:
    """Residual before and after against velocity, position, load and time, with the named causes drawn as lines.

    If a cause is named, "before" already includes the link corrections: it is what the causes have to explain.
    """
    rows = shown.usable[:, joint]
    after, named = shown.residual[rows, joint], shown.named[rows, joint]
    before = after + named if named.any() else shown.before[rows, joint]
    changed = rms(before - after) > CHANGED * rms(before)
    direction = shown.direction[rows, joint]
    limits = span([before, after], ROBUST)
    panels = []
    for key in ("velocity", "position", "load", "time"):
        x = shown.inputs[key][rows, joint]
        axes = Axes(span([x], 0.0, 0.03), limits)
        if changed:
            axes.cloud("before", x, before)
        axes.cloud("after", x, after)
        if named.any() and explained(x, named, direction) >= READABLE:
            draw_effect(axes, x, named, direction)
        alt = f"Residual of {shown.joints[joint]} against {key}, before and after the causes are taken out."
        panels.append(axes.panel(_label(shown, key, joint), ("residual", shown.units[joint][0]), alt))
    return panels


def evidence(shown: View, cause: Cause) -> Evidence | None:
    """The residual with all other causes removed, and the curve of this cause through it."""
    if cause.part is None:
        return _velocity_evidence(shown, cause)
    j = cause.joint
    rows = shown.usable[:, j]
    part, after = cause.part[rows, j], shown.residual[rows, j]
    direction = shown.direction[rows, j]
    key = best_input(shown, cause)
    x = part if key is None else shown.inputs[key][rows, j]
    label = f"its predicted effort [{shown.units[j][0]}]" if key is None else _label(shown, key, j)
    before = after + part
    ranges = span([x], 0.0, 0.03), span([before, after], ROBUST)
    name = name_of(cause.finding)
    against = "its prediction" if key is None else key
    panels = []
    for what, cloud in (("before", before), ("after", after)):
        axes = Axes(*ranges)
        axes.cloud(what, x, cloud)
        if what == "before":
            draw_effect(axes, x, part, direction)
        else:
            axes.line("zero", np.array(ranges[0]), np.zeros(2))
        without = "with everything else taken out" if what == "before" else "with this taken out, too"
        alt = f"Residual of {shown.joints[j]} against {against}, {without}: {name}."
        panels.append(axes.panel(label, ("residual", shown.units[j][0]), alt, _heading(what)))
    return Evidence(cause, against, shown.joints[j], *panels)


def rest_panels(shown: View) -> list[Panel]:
    """The residual after the named causes against the inputs it depends on, with what these inputs predict of it."""
    remainder, diagnosis = shown.examination.remainder, shown.examination.diagnosis
    panels = []
    for key, at in [*remainder.depends_on(diagnosis.above or diagnosis.slight).items()][:3]:
        joint = shown.joints.index(at)
        name, _, kind = key.rpartition(".")
        source = shown.joints.index(name) if name else joint
        rows = shown.usable[:, joint]
        x = shown.inputs[kind][rows, source]
        y = shown.residual[rows, joint]
        axes = Axes(span([x], 0.0, 0.03), span([y], ROBUST))
        axes.cloud("after", x, y)
        draw_effect(axes, x, remainder.predicted[rows, joint], shown.direction[rows, joint])
        alt = f"What is left at {shown.joints[joint]} against {key}, with what can be predicted of it."
        label = _label(shown, kind, source)
        heading = f"Left at {shown.joints[joint]}"
        panels.append(
            axes.panel(f"{name} {label}".strip(), ("residual", shown.units[joint][0]), alt, heading)
        )
    return panels


def best_input(shown: View, cause: Cause) -> str | None:
    """The input of which a cause's contribution is most nearly a function, per direction of motion."""
    assert cause.part is not None
    rows = shown.usable[:, cause.joint]
    part, direction = cause.part[rows, cause.joint], shown.direction[rows, cause.joint]
    scores = {
        key: explained(values[rows, cause.joint], part, direction) for key, values in shown.inputs.items()
    }
    best = max(scores.values())
    return None if best < READABLE else next(key for key, score in scores.items() if score >= best - CLOSE)


def explained(x: np.ndarray, y: np.ndarray, direction: np.ndarray) -> float:
    """Share of the variance of y (N,) explained by its mean in each bin of x and direction."""
    spread = float(np.var(y))
    if spread < 1e-6 * float(np.mean(y**2)) or spread == 0.0:
        return 1.0
    left = y.astype(float).copy()
    for side in (-1.0, 1.0):
        rows = direction == side
        if rows.any():
            index, count = _bins(x[rows])
            means = np.bincount(index, y[rows], count) / np.maximum(np.bincount(index, minlength=count), 1)
            left[rows] -= means[index]
    return 1.0 - float(np.mean(left**2)) / spread


def draw_effect(axes: Axes, x: np.ndarray, y: np.ndarray, direction: np.ndarray) -> None:
    """A contribution y (N,) against x: one curve, or one per direction of motion, or dots if it is no function of x."""
    if explained(x, y, direction) < SMOOTH:
        axes.cloud("effect", x, y, EFFECT_POINTS)
        return
    sides = [curve(x[direction == side], y[direction == side]) for side in (-1.0, 1.0)]
    sides = [side for side in sides if len(side[0]) > 1]
    if len(sides) == 2 and sides[0][0][-1] <= sides[1][0][0]:
        sides = [(np.concatenate([sides[0][0], sides[1][0]]), np.concatenate([sides[0][1], sides[1][1]]))]
    elif len(sides) == 2 and _same(sides[0], sides[1], float(np.ptp(y))):
        sides = [curve(x, y)]
    for centres, means in sides:
        axes.line("effect", centres, means)


def curve(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Means of x and y in bins of x, in the order of x."""
    if len(x) < 2 * LEAST_IN_BIN:
        return np.empty(0), np.empty(0)
    index, count = _bins(x)
    sizes = np.bincount(index, minlength=count)
    # a named effect is no noise: where points are sparse, each says where it is
    some = sizes > 0
    centres, means = (np.bincount(index, v, count)[some] / sizes[some] for v in (x, y))
    return centres, means


def _bins(x: np.ndarray) -> tuple[np.ndarray, int]:
    """Bin of each x (N,): half of the edges even in x, half even in the number of points."""
    count = int(np.clip(len(x) // (2 * LEAST_IN_BIN), 1, BINS // 2))
    even = np.linspace(float(x.min()), float(x.max()), count + 1)[1:-1]
    edges = np.unique(np.concatenate([even, np.quantile(x, np.linspace(0.0, 1.0, count + 1)[1:-1])]))
    return np.searchsorted(edges, x), len(edges) + 1


def _same(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray], height: float) -> bool:
    low, high = max(a[0][0], b[0][0]), min(a[0][-1], b[0][-1])
    inside = (a[0] >= low) & (a[0] <= high)
    if inside.sum() < BINS // 8:
        return False
    apart = a[1][inside] - np.interp(a[0][inside], *b)
    return bool(np.sqrt(np.mean(apart**2)) <= SAME_CURVE * max(height, 1e-12))


def _velocity_evidence(shown: View, cause: Cause) -> Evidence | None:
    """Evidence for a low-passed velocity: its error is minus the lag times the acceleration."""
    signals, quantity = shown.examination.equations.motion.signals, cause.finding.parameters.get("cutoff")
    if signals.reported_velocity is None or quantity is None:
        return None
    j, unit = cause.joint, shown.units[cause.joint][1]
    rows = signals.interior & ~signals.at_rest[:, j]
    x = signals.acceleration[rows, j]
    error = (signals.reported_velocity - signals.velocity)[rows, j]
    axes = Axes(span([x], ROBUST, 0.03), span([error], ROBUST))
    axes.cloud("before", x, error)
    ends = np.array(axes.x)
    axes.line("effect", ends, -ends / (2.0 * np.pi * quantity.value))
    alt = (
        f"Error of the reported velocity of {shown.joints[j]} against acceleration: a lag is a falling line."
    )
    panel = axes.panel(
        f"acceleration [{unit}/s²]",
        ("reported − true velocity", f"{unit}/s"),
        alt,
        "Reported velocity",
        x_most=4,
    )
    return Evidence(cause, "acceleration", shown.joints[j], panel, None)


def _heading(what: str) -> str:
    return "Before: all else taken out" if what == "before" else "After: this taken out, too"


def _label(shown: View, key: str, joint: int) -> str:
    effort, position = shown.units[joint]
    return f"{key} [{UNITS[key].format(e=effort, p=position)}]"


def _time_range(time: np.ndarray) -> Range:
    return (float(time[0]), float(max(time[-1], time[0] + 1e-3)))
