"""One picture a robot: mass matrix, gravity and friction of the true robot and of what was learned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from _bdnn_judging import Judged
from _bdnn_methods import METHODS
from _motion import Data
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bdnn_ros.dynamics import Dynamics

SHOWN = ("chain", "networks")
SECONDS = 6.0
"""Of a held-out motion along which M and g are drawn."""
STYLES: dict[str, dict[str, Any]] = {
    "true": {"color": "#b3bac2", "linewidth": 3.6, "solid_capstyle": "round"},
    "chain": {"color": "#0b6bb0", "linewidth": 1.2},
    "networks": {"color": "#c9570c", "linewidth": 1.1, "linestyle": (0, (4, 2))},
}
SETTINGS: Any = {
    "font.size": 8.5,
    "text.parse_math": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
}
WIDTH, ROW, HEAD = 10.0, 1.25, 0.9
"""Of a figure, of a joint's row, and of the legend [inch]."""


def learned(given: Data, robot: str, scale: float) -> dict[str, Judged]:
    """The models that are drawn."""
    return {name: METHODS[name].learn(given, scale * METHODS[name].budget(robot), 0) for name in SHOWN}


def draw(path: Path, given: Data, models: Mapping[str, Judged]) -> None:
    """Write the picture of one robot."""
    signals = given.test[0]
    rows = np.flatnonzero(signals.interior)[: int(SECONDS * signals.rate)]
    q, time = signals.position[rows], signals.time[rows] - signals.time[rows[0]]
    pose = np.median(q, axis=0)
    fastest = np.abs(np.concatenate([s.velocity for s in given.test])).max(axis=0)
    share = np.linspace(-1.0, 1.0, 401)[:, None]
    n = given.truth.width
    views: list[tuple[str, str, np.ndarray, Callable[[Dynamics], np.ndarray]]] = [
        ("M_ii(q) [kg·m²]", "time of a held-out motion [s]", np.tile(time[:, None], n), _diagonal(q)),
        ("g_i(q) [N·m]", "time of a held-out motion [s]", np.tile(time[:, None], n), lambda m: m.gravity(q)),
        (
            "friction_i [N·m]",
            "velocity of joint i alone [rad/s]",
            share * fastest,
            lambda m: _friction(m, pose, share, fastest),
        ),
    ]
    with rc_context(SETTINGS):
        figure = Figure((WIDTH, HEAD + ROW * n), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(n, len(views), squeeze=False, sharex="col" if n > 1 else False)
        for column, (heading, below, across, value) in enumerate(views):
            for name, model in {"true": given.truth, **models}.items():
                values = value(model)
                for joint in range(n):
                    axes[joint, column].plot(across[:, joint], values[:, joint], **STYLES[name])
            axes[0, column].set_title(heading, loc="left")
            axes[-1, column].set_xlabel(below)
        for joint, name in enumerate(given.truth.joints):
            axes[joint, 0].set_ylabel(name)
        _legend(figure, axes[0, 0])
        beside = path.with_suffix(".tmp.png")
        figure.savefig(beside, dpi=110)
    beside.replace(path)


def _diagonal(q: np.ndarray) -> Callable[[Dynamics], np.ndarray]:
    return lambda model: np.diagonal(model.mass_matrix(q), axis1=1, axis2=2)


def _friction(model: Dynamics, pose: np.ndarray, share: np.ndarray, fastest: np.ndarray) -> np.ndarray:
    """Friction of each joint while it alone moves, (401, n)."""
    columns = []
    for joint, speed in enumerate(fastest):
        velocity = np.zeros((len(share), len(fastest)))
        velocity[:, joint] = share[:, 0] * speed
        columns.append(model.friction(np.tile(pose, (len(share), 1)), velocity)[:, joint])
    return np.stack(columns, axis=1)


def _legend(figure: Figure, axes: Axes) -> None:
    labels = ["true robot", *(METHODS[name].label for name in SHOWN)]
    figure.legend(axes.get_lines(), labels, loc="outside upper left", ncols=3, frameon=False)
