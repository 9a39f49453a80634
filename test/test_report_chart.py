"""Charts of the report: ticks, ranges, paths."""

from __future__ import annotations

import re

import numpy as np
import pytest

from bdnn_ros.report.chart import MOST_POINTS, SIZE, Axes, span, ticks


def numbers(path: str) -> np.ndarray:
    return np.array([float(x) for x in re.findall(r"-?\d+", path)])


@pytest.mark.parametrize(
    ("of", "labels"),
    [
        ((-1.0, 1.0), ["−1.0", "−0.5", "0", "0.5", "1.0"]),
        ((0.0, 40.0), ["0", "10", "20", "30", "40"]),
        ((-0.3, 9.7), ["0", "2", "4", "6", "8"]),
        ((-0.3, 12.4), ["0", "2.5", "5.0", "7.5", "10.0"]),
        ((1001.0, 1003.0), ["1001.0", "1001.5", "1002.0", "1002.5", "1003.0"]),
    ],
)
def test_ticks_are_round_numbers(of: tuple[float, float], labels: list[str]) -> None:
    assert [tick.text for tick in ticks(of, 5)] == labels


@pytest.mark.parametrize("low", [-3e4, -1.0, -1e-6, 0.0, 2e-3, 17.0])
@pytest.mark.parametrize("width", [1e-6, 0.03, 1.0, 7.3, 123.0, 1e6])
@pytest.mark.parametrize("most", [3, 5, 9])
def test_ticks_stand_where_they_say(low: float, width: float, most: int) -> None:
    found = ticks((low, low + width), most)
    assert most / 3 <= len(found) <= most
    assert len({tick.text for tick in found}) == len(found) or width < 1e-3 * abs(low)
    for tick in found:
        value = float(tick.text.replace("−", "-"))
        assert low + tick.place / 100.0 * width == pytest.approx(value, abs=0.006 * width + 1e-3 * abs(low))


def test_span_holds_the_values_and_is_never_empty() -> None:
    low, high = span([np.array([1.0, 3.0]), np.array([2.0])])
    assert low < 1.0 < 3.0 < high
    for values in (np.zeros(5), np.full(3, 1e6), np.empty(0), np.array([np.nan, np.inf])):
        low, high = span([values])
        assert low < high


def test_a_robust_span_leaves_outliers_out() -> None:
    values = np.concatenate([np.linspace(-1.0, 1.0, 2000), [1e9]])
    assert span([values], 0.002)[1] < 1.2


def test_a_line_runs_from_corner_to_corner_and_breaks_at_gaps() -> None:
    axes = Axes((0.0, 2.0), (-1.0, 1.0))
    axes.line("measured", np.array([0.0, 2.0]), np.array([-1.0, 1.0]))
    assert axes.layers[0].path == f"M0 {SIZE}L{SIZE} 0"
    time = np.linspace(0.0, 2.0, 10)
    axes.line("measured", time, np.zeros(10), [slice(0, 4), slice(4, 10), slice(10, 10)])
    assert axes.layers[1].path.count("M") == 2


def test_a_cloud_keeps_inside_the_axes_and_below_its_number() -> None:
    generator = np.random.default_rng(0)
    axes = Axes((-1.0, 1.0), (-1.0, 1.0))
    axes.cloud("before", generator.normal(size=5000), generator.normal(size=5000))
    path = axes.layers[0].path
    assert path.count("M") == MOST_POINTS
    places = numbers(path.replace("h0", ""))
    assert places.min() >= 0 and places.max() <= SIZE


def test_a_cloud_of_a_periodic_motion_shows_all_its_phases() -> None:
    phase = np.arange(MOST_POINTS * 10) % 10
    axes = Axes((-0.5, 9.5), (-1.0, 1.0))
    axes.cloud("before", phase.astype(float), np.zeros(len(phase)))
    columns = set(re.findall(r"M(\d+) ", axes.layers[0].path))
    assert len(columns) == 10


def test_values_far_outside_make_no_long_numbers() -> None:
    axes = Axes((0.0, 1.0), (0.0, 1.0))
    axes.line("measured", np.array([0.0, 1.0]), np.array([-1e30, 1e30]))
    assert np.abs(numbers(axes.layers[0].path)).max() <= 2 * SIZE


def test_a_band_ends_at_the_edge() -> None:
    axes = Axes((0.0, 10.0), (0.0, 1.0))
    axes.band("held", [(-5.0, 5.0), (20.0, 30.0)])
    assert axes.layers[0].path == f"M0 0h{SIZE // 2}v{SIZE}h-{SIZE // 2}z"


def test_small_values_are_labelled_in_thousandths() -> None:
    panel = Axes((0.0, 1.0), (-0.02, 0.02)).panel("time [s]", ("residual", "N·m"), "alt")
    assert panel.y_label == "residual [mN·m]"
    assert [tick.text for tick in panel.y_ticks] == ["−20", "−10", "0", "10", "20"]
    panel = Axes((0.0, 1.0), (-2.0, 2.0)).panel("time [s]", ("residual", "N·m"), "alt")
    assert panel.y_label == "residual [N·m]"
