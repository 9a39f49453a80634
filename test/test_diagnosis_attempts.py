"""Which blocks are held out: others where the first are not like the rest, and of both the less surprising."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bdnn_ros.diagnosis import diagnose as module
from bdnn_ros.diagnosis.attempt import SURPRISING, Attempt, surprise


def attempt_with(held: float, rest: float) -> Attempt:
    test = np.arange(100) % 5 == 2
    left = np.where(test, held, rest)[:, None]
    return Attempt(test, [], SimpleNamespace(sure=np.ones((100, 1), bool)), left)


def equations(**more: object) -> SimpleNamespace:
    return SimpleNamespace(effort_scale=np.ones(1), **more)


def test_a_surprise_is_a_held_out_error_above_the_rest_that_is_large_enough_to_matter():
    assert surprise(attempt_with(0.3, 0.1), equations()) == pytest.approx(3.0)
    assert surprise(attempt_with(0.003, 0.001), equations()) == 0.0


@pytest.mark.parametrize(
    "errors, tried, taken",
    [((0.15, 0.9), 1, 0), ((0.9, 0.15), 2, 1), ((0.3, 0.9), 2, 0), ((0.9, 0.3), 2, 1)],
)
def test_the_first_attempt_that_is_no_surprise_or_the_smaller_one(monkeypatch, errors, tried, taken):
    attempts = [attempt_with(held, 0.1) for held in errors]
    assert 1.5 < SURPRISING < 3.0
    motions, seen = ["first", "second"], []

    def attempted(search, whole, test):
        seen.append(test)
        one.motion = motions[len(seen) - 1]
        return attempts[len(seen) - 1]

    one = equations(usable=None, motion="at first", block=np.zeros(100, int))
    one.take = lambda motion: setattr(one, "motion", motion)
    monkeypatch.setattr(module, "attempted", attempted)
    monkeypatch.setattr(module, "Search", lambda *given: None)
    monkeypatch.setattr(module.Candidates, "of", lambda robot: None)
    best = module._best_attempt(one, None, (0.1,), lambda text: None)
    assert len(seen) == tried and best is attempts[taken] and one.motion == motions[taken]
