"""The error that /diagnostics tells of: of the last seconds, whatever a wrong reading says."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from bdnn_ros.nodes.error_now import MEMORY, SPREAD_MEMORY, ErrorNow

RATE = 120.0
SPREAD = np.array([10.0, 1.0])


class Told:
    """Efforts of a motion, and an error of a tenth of their spread."""

    def __init__(self) -> None:
        self.error = ErrorNow()
        self.generator = np.random.default_rng(0)
        self.time = 1000.0

    def go_on(self, seconds: float, share=0.1, moving=1.0, wrong=0.0, estimated=0.0) -> np.ndarray:
        for _ in range(round(seconds * RATE)):
            self.time += 1.0 / RATE
            effort = 5.0 + moving * SPREAD * np.sqrt(2.0) * np.sin(np.array([5.0, 3.0]) * self.time)
            told = effort + share * SPREAD * self.generator.standard_normal(2)
            self.error.add(round(self.time * 1e9), effort + wrong, told + estimated)
        return self.error.nrmse


@pytest.fixture
def told():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield Told()


def test_it_is_of_the_last_seconds(told):
    assert told.error.nrmse.shape == (0,)
    np.testing.assert_allclose(told.go_on(20.0), 0.1, rtol=0.15)
    np.testing.assert_allclose(told.go_on(MEMORY + 0.3, share=0.5), 0.5, rtol=0.15)
    np.testing.assert_allclose(told.go_on(MEMORY + 0.3), 0.1, rtol=0.15)


@pytest.mark.parametrize("wrong", [1e200, 1e9, 1e4, 300.0])
@pytest.mark.parametrize("field", ["wrong", "estimated"])
@pytest.mark.parametrize("before", [0.0, 1.0, 20.0])
def test_a_wrong_reading_is_not_all_that_is_seen(told, wrong, field, before):
    """A measured one, or one from which an effort is estimated; low-passed, it lasts 0.11 s."""
    told.go_on(before)
    assert np.isfinite(told.go_on(0.11, **{field: wrong})).all()
    np.testing.assert_allclose(told.go_on(2.0), 0.1, rtol=0.3)
    np.testing.assert_allclose(told.go_on(5.0), 0.1, rtol=0.15)


def test_an_error_that_lasts_counts(told):
    told.go_on(20.0)
    assert np.all(told.go_on(1.0, estimated=1000.0) > 10.0)
    np.testing.assert_allclose(told.go_on(MEMORY + 0.3), 0.1, rtol=0.15)


def test_a_motion_after_rest_counts(told):
    """A robot that stood for long has only its noise; as soon as it moves, what it is compared with is the motion."""
    told.go_on(SPREAD_MEMORY, share=0.001, moving=0.0)
    told.go_on(0.3, moving=0.001)
    np.testing.assert_allclose(told.go_on(30.0), 0.1 * np.sqrt(SPREAD_MEMORY / 30.0), rtol=0.15)


def test_what_is_kept_is_limited(told):
    told.go_on(SPREAD_MEMORY + 10.0)
    assert len(told.error._blocks) <= SPREAD_MEMORY / 0.25 + 1


def test_other_joints_begin_anew(told):
    told.go_on(2.0)
    told.error.add(round(told.time * 1e9), np.ones(3), np.ones(3))
    assert told.error.nrmse.shape == (3,)


@pytest.mark.parametrize("level", [0.0, -37.2, 1e4])
def test_an_effort_that_never_changes_has_no_error(told, level):
    """A driver fills in what it has no sensor for; where a sensor starts after all, its error begins."""
    error, estimated = ErrorNow(), np.array([0.3, 0.5])

    def go_on(first: int, count: int, wave: float) -> np.ndarray:
        for k in range(first, first + count):
            measured = np.array([np.sin(0.1 * k), level + wave * np.cos(0.1 * k)])
            error.add(10**18 + k * 10_000_000, measured, estimated)
        return np.isnan(error.nrmse)

    assert go_on(0, 2000, 0.0).tolist() == [False, True]
    assert go_on(2000, 300, 1.0).tolist() == [False, False]


def test_a_quiet_effort_of_a_robot_at_rest_has_an_error(told):
    rng = np.random.default_rng(0)
    for k in range(500):
        told.error.add(10**18 + k * 10_000_000, 5.0 + 1e-4 * rng.standard_normal(2), np.full(2, 5.0))
    np.testing.assert_allclose(told.error.nrmse, 1.0, rtol=0.1)
