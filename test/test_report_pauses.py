"""What the report and its figures show where nothing was recorded."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from report_cases import examined, fourier_motion, rendered, worn
from report_page import Page

from bdnn_ros.cli.identify import _picture
from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.report.plots import effort_figure
from bdnn_ros.report.view import view
from bdnn_ros.robot import Robot

PAUSE = (6.0, 9.0)
"""Nothing was recorded between these [s]."""


@pytest.fixture(scope="module")
def paused() -> Examination:
    robot = Robot.bundled("arm2")
    specs = ["coulomb_friction@arm2_joint2:coulomb=0.1"]
    recording = worn(robot, specs, fourier_motion(robot, 15.0))
    recorded = (recording.time < PAUSE[0]) | (recording.time > PAUSE[1])
    return examined(robot, recording.part(recorded), specs)


def over_the_pause(x: np.ndarray) -> bool:
    """Whether a line along these moments is drawn where nothing was recorded."""
    return bool((np.diff(x) > 1.0).any())  # NaN breaks it


def test_no_line_of_a_figure_is_drawn_over_a_pause(
    paused: Examination, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    drawn: list[np.ndarray] = []
    plot = Axes.plot
    monkeypatch.setattr(Axes, "plot", lambda self, x, y, **k: (drawn.append(x), plot(self, x, y, **k))[1])
    effort_figure(paused, tmp_path / "effort.png")
    robot, signals = paused.robot, paused.equations.motion.signals
    _picture(tmp_path / "identified.png", ExtendedModel(robot, (), np.ones(2)), robot, signals)
    assert len(drawn) == 2 * 2 * 3
    for x in drawn:
        assert np.nanmin(x) < PAUSE[0] and np.nanmax(x) > PAUSE[1] and not over_the_pause(x)


def test_what_was_held_out_ends_where_a_pause_begins(paused: Examination) -> None:
    shown = view(paused)
    before = (shown.time < PAUSE[0]) & (shown.time > PAUSE[0] - 1.0)
    held = replace(shown, held=before | (shown.time > PAUSE[1]))
    assert over_the_pause(shown.time)
    (a, b), (c, d) = held.held_spans()
    assert (a, b, c, d) == pytest.approx((5.0, *PAUSE, shown.time[-1]), abs=0.3)
    assert b <= PAUSE[0] and c >= PAUSE[1]


def test_how_much_of_the_time_does_not_count_is_said_where_a_joint_hardly_moves(paused: Examination) -> None:
    usable = paused.equations.usable.copy()
    usable[: len(usable) // 4, 1] = False
    equations = copy(paused.equations)
    equations.use_rows(usable)
    words = Page(rendered(replace(paused, equations=equations))).words
    share = round(100 * (1.0 - usable[:, 1].mean()))
    assert f"{share} % of the time does not count: arm2_joint2" in words.replace("\N{NO-BREAK SPACE}", " ")
    assert "does not count: arm2_joint1" not in words
