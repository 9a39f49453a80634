"""Stamps that go back: what came late is left out, and a clock that starts anew is followed."""

from __future__ import annotations

import numpy as np
import pytest

from bdnn_ros.stamps import RESTART, RESTART_PAUSE, joined, runs

TIME = np.arange(1000) / 100.0


def followed(time: np.ndarray) -> tuple[np.ndarray, int, np.ndarray]:
    """Rows that are kept, how often the clock starts, and the stamps that come out."""
    kept, starts = runs(time)
    return np.flatnonzero(kept), len(starts), joined(time, kept, starts)


def test_a_clock_that_goes_on_is_left_alone() -> None:
    rows, clocks, moved = followed(TIME)
    assert (len(rows), clocks) == (1000, 1)
    np.testing.assert_array_equal(moved, TIME)
    assert followed(TIME[:0])[1] == followed(TIME[:1])[1] == 1


@pytest.mark.parametrize("late", [0.015, 5.0])
def test_a_few_late_samples_are_left_out(late: float) -> None:
    time = TIME.copy()
    time[[300, 301, 302, 700]] -= late + 0.03
    rows, clocks, moved = followed(time)
    assert clocks == 1
    np.testing.assert_array_equal(rows, np.delete(np.arange(1000), [300, 301, 302, 700]))
    np.testing.assert_array_equal(moved, TIME[rows])


@pytest.mark.parametrize("back", [0.2, 5.0, 3600.0])
def test_what_follows_a_clock_that_is_set_back_is_kept_behind_a_pause(back: float) -> None:
    rows, clocks, moved = followed(np.where(np.arange(1000) > 600, TIME - back, TIME))
    assert (len(rows), clocks) == (1000, 2)
    np.testing.assert_array_equal(moved[:601], TIME[:601])
    assert moved[601] - moved[600] == pytest.approx(RESTART_PAUSE)
    np.testing.assert_allclose(np.diff(moved[601:]), 0.01)


def test_a_clock_may_be_set_back_again_and_again() -> None:
    rows, clocks, moved = followed(np.tile(TIME[:250], 4))
    assert (len(rows), clocks) == (1000, 4)
    assert np.count_nonzero(np.diff(moved) > 1.0) == 3


def test_a_late_sample_before_the_clock_is_set_back_is_no_clock_of_its_own() -> None:
    time = np.where(np.arange(1000) > 600, TIME - 5.0, TIME)
    time[600] = time[599] - 0.5
    rows, clocks, _ = followed(time)
    assert clocks == 2
    np.testing.assert_array_equal(rows, np.delete(np.arange(1000), 600))


def test_slow_clocks_pause_longer() -> None:
    time = np.concatenate([np.arange(100.0), np.arange(100.0)])
    moved = followed(time)[2]
    assert moved[100] - moved[99] == pytest.approx(10.0)


def test_as_many_samples_in_a_row_count_as_in_a_live_stream() -> None:
    from bdnn_ros.online.stream.clock import BACKWARDS_LIMIT, PAUSE

    assert RESTART == BACKWARDS_LIMIT
    assert pytest.approx(2 * PAUSE * 1e-9) == RESTART_PAUSE
    time = TIME.copy()
    time[500 : 500 + RESTART - 1] -= 0.3
    assert followed(time)[1] == 1
    time[500 + RESTART - 1] -= 0.3
    assert followed(time)[1] == 2
