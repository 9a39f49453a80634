"""PNG figures of measured and modelled effort, joint by joint."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.report.view import view
from bdnn_ros.report.words import headline
from bdnn_ros.robot.units import along, printed
from bdnn_ros.signals import Signals
from bdnn_ros.written import whole

INK, SOFT, RULE = "#1a1f26", "#57616d", "#dde1e6"
STYLES: dict[str, dict[str, Any]] = {
    "measured": {"color": "#9aa3ad", "linewidth": 3.2, "solid_capstyle": "round"},
    "model": {"color": "#0b6bb0", "linewidth": 1.2},
    "nominal": {"color": "#c9570c", "linewidth": 1.1, "linestyle": (0, (4, 2.5))},
}
"""Told apart by colour, width and dashes, so that no one of them has to be seen."""
SETTINGS: Any = {"font.size": 8.5, "font.family": "sans-serif", "text.parse_math": False}
"""Names of joints are drawn as they are: no mathematics in them."""
WIDTH, ROW, HEAD = 10.0, 1.25, 1.0
"""Width of a figure, height of a joint's row, and of the title and time axis [inch]."""
LONGEST = 60.0
"""Seconds that a figure shows at most."""


@dataclass(frozen=True)
class Series:
    """Effort (N, n) of all joints with its name in the legend and its style, a key of `STYLES`."""

    label: str
    style: str
    values: np.ndarray


def effort_figure(examination: Examination, path: Path) -> None:
    """Write a PNG of measured, simulated and extended effort of every joint.

    Args:
        path: the file; written whole or not at all.
    """
    shown = view(examination)
    rows = shown.excerpt
    series = [
        Series("measured", "measured", shown.measured[rows]),
        Series("earlier model" if shown.since else "simulated", "nominal", shown.simulated[rows]),
        Series("extended model", "model", shown.extended[rows]),
    ]
    units = [unit for unit, _ in shown.units]
    title = headline(examination.diagnosis, shown.since)
    _write(path, shown.joints, units, shown.time[rows], series, title, shown.runs)


def identification_png(
    path: Path,
    signals: Signals,
    identified: np.ndarray,
    nominal: np.ndarray | None = None,
    slides: np.ndarray | None = None,
) -> None:
    """Write a PNG of measured, nominal and identified effort of every joint along a motion.

    Args:
        path: the file; written whole or not at all.
        signals: the motion, with effort.
        identified, nominal: predicted effort, (N, n) [N·m]; None where there is no URDF.
        slides: whether a joint is prismatic, (n,) bool; None for none.
    """
    assert signals.effort is not None
    sliding = np.zeros(signals.width, bool) if slides is None else slides
    units = [printed(along("N*m", slide)) for slide in sliding.tolist()]
    inside = signals.interior & (signals.time <= signals.time[signals.interior][0] + LONGEST)
    before = np.concatenate([[0], np.cumsum(inside)])  # rows drawn of those before each sample
    runs = [slice(before[rows.start], before[rows.stop]) for rows in signals.segments]
    efforts = [("measured", "measured", signals.effort), ("nominal", "nominal", nominal)]
    efforts.append(("identified", "model", identified))
    series = [
        Series(label, style, signals.smooth(effort)[inside])
        for label, style, effort in efforts
        if effort is not None
    ]
    _write(path, signals.joints, units, signals.time[inside], series, "", runs)


def _write(
    path: Path,
    joints: Sequence[str],
    units: Sequence[str],
    time: np.ndarray,
    series: Sequence[Series],
    title: str,
    runs: Iterable[slice],
) -> None:
    """One row per joint with a common time axis; lines are interrupted between runs."""
    height, pieces = HEAD + ROW * len(joints), list(runs)

    def broken(values: np.ndarray) -> np.ndarray:
        return np.concatenate([np.append(values[run], np.nan) for run in pieces])

    with rc_context(SETTINGS):
        figure = Figure((WIDTH, height), dpi=120, facecolor="white")
        FigureCanvasAgg(figure)
        rows = figure.subplots(len(joints), 1, sharex=True, squeeze=False)[:, 0]
        figure.subplots_adjust(0.075, 0.45 / height, 0.985, 1.0 - 0.62 / height, hspace=0.32)
        for j, axes in enumerate(rows):
            for one in series:
                axes.plot(broken(time), broken(one.values[:, j]), label=one.label, **STYLES[one.style])
            _dress(axes, f"{joints[j]} [{units[j]}]")
        rows[0].set_xlim(time[0], time[-1])
        rows[-1].set_xlabel("time [s]", color=SOFT)
        if title:
            figure.text(0.075, 1.0 - 0.3 / height, title, fontsize=11, fontweight="bold", color=INK)
        lines, labels = rows[0].get_legend_handles_labels()
        figure.legend(
            lines,
            labels,
            loc="upper right",
            bbox_to_anchor=(0.985, 1.0 - 0.08 / height),
            ncols=len(series),
            frameon=False,
        )
        with whole(path) as beside:
            figure.savefig(beside, format="png")


def _dress(axes: Axes, title: str) -> None:
    """Plain axes: only the lines needed to read values."""
    axes.set_title(title, loc="left", fontsize=8.5, color=SOFT, pad=2.5)
    axes.grid(axis="y", color=RULE, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.locator_params(axis="y", nbins=4)
    axes.tick_params(length=0, colors=SOFT)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(RULE)
