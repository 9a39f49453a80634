"""Which blocks are held out: others where the first are not like the rest, and of both the less surprising."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import equations_of, term, white

from bdnn_ros.diagnosis.judging import attempt as module
from bdnn_ros.diagnosis.judging.attempt import SURPRISING, Attempt, completed, surprise
from bdnn_ros.diagnosis.judging.posterior import estimates
from bdnn_ros.diagnosis.judging.without_harm import without_harm
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.gains import held_out_gain
from bdnn_ros.diagnosis.regression.noise import ORDER, Noise
from bdnn_ros.robot import Robot


def left_by(test: np.ndarray, held: float) -> np.ndarray:
    """Errors that are 0.1 but for the rows that were held out."""
    return np.where(test, held, 0.1)[:, None]


def test_a_surprise_is_a_held_out_error_above_the_rest_that_is_large_enough_to_matter():
    sure, test = np.ones((100, 1), bool), np.arange(100) % 5 == 2
    assert surprise(left_by(test, 0.3), sure, test, np.ones(1)) == pytest.approx(3.0)
    assert surprise(0.01 * left_by(test, 0.3), sure, test, np.ones(1)) == 0.0
    assert surprise(left_by(test, 0.3), sure & ~test[:, None], test, np.ones(1)) == 0.0


@pytest.mark.parametrize(
    "at_first, in_the_end, looks, tried, taken",
    [
        ({2: 0.15, 4: 0.9}, {2: 0.15, 4: 0.9}, [2], [2], 2),
        ({2: 0.15, 4: 0.9}, {2: 0.9, 4: 0.15}, [2, 4], [2, 4], 4),
        ({2: 0.15, 4: 0.9}, {2: 0.3, 4: 0.9}, [2, 4], [2, 4], 2),
        ({2: 0.15, 4: 0.9}, {2: 0.9, 4: 0.3}, [2, 4], [2, 4], 4),
        ({2: 0.9, 4: 0.3}, {2: 0.15, 4: 0.15}, [2, 4], [4], 4),
        ({2: 0.3, 4: 0.9}, {2: 0.15, 4: 0.15}, [2, 4], [2], 2),
        ({2: 0.9, 4: 0.3}, {2: 0.15, 4: 0.9}, [2, 4], [4, 2], 2),
    ],
)
def test_the_first_attempt_that_is_no_surprise_or_the_smaller_one(
    monkeypatch, at_first, in_the_end, looks, tried, taken
):
    """At each look, and at each attempt, the rows that were held out tell which of the blocks those are."""
    assert 1.5 < SURPRISING < 3.0
    block, sure = np.arange(100) % 10, np.ones((100, 1), bool)
    looked, attempts = [], []
    equations = SimpleNamespace(
        usable=sure,
        motion="at first",
        rows=SimpleNamespace(block=block, effort_scale=np.ones(1), sticking_doubt=np.zeros((100, 1))),
    )
    equations.use_motion = lambda motion: setattr(equations, "motion", motion)
    equations.use_rows = lambda rows: setattr(equations, "usable", rows)

    class Looking:
        def __init__(self, *given: object) -> None:
            self.equations = equations

        def first(self) -> SimpleNamespace:
            self.test = ~equations.usable[:, 0]
            phase = int(block[self.test][0] % 5)
            looked.append(phase)
            equations.motion = f"as {phase} looks"
            left = left_by(self.test, at_first[phase])
            pool = SimpleNamespace(
                noise=SimpleNamespace(sure=lambda doubt: sure), residual=lambda fit, blur: left
            )
            return SimpleNamespace(pool=pool, fit=None)

    def attempted(search, first, whole, test):
        assert whole is sure and (search.test == test).all()
        phase = int(block[test][0] % 5)
        assert equations.motion == f"as {phase} looks"
        attempts.append(phase)
        equations.motion = f"of {phase}"
        return Attempt(test, [], SimpleNamespace(sure=sure), left_by(test, in_the_end[phase]))

    monkeypatch.setattr(module, "Search", Looking)
    monkeypatch.setattr(module, "attempted", attempted)
    best = module.best_attempt(module.Looks(equations, None, (0.1,), lambda text: None))
    assert (looked, attempts) == (looks, tried)
    assert (best.test == (block % 5 == taken)).all() and equations.motion == f"of {taken}"


@pytest.mark.parametrize("when, more", [((6.6, 9.4), 0.56), ((6.6, 7.6), 0.2), ((3.5, 6.5), 0.0)])
def test_a_push_between_the_held_out_blocks_is_held_out_by_a_fifth(when, more):
    """Of blocks of 2 s that from 4 s to 6 s is held out. What is left of the push predicts its middle fifth to the noise."""
    spec = f"external_wrench@arm2_link2:force_x=20,force_z=-10,start={when[0]},end={when[1]}"
    equations, (push, _) = equations_of([spec]), term(spec, Robot.bundled("arm2"))
    noise = Noise(np.zeros((equations.rows.width, ORDER)), 0.01 * equations.rows.effort_scale)
    draw = np.random.default_rng(0).standard_normal(equations.rows.target.shape)
    equations.rows.target[:] += noise.std * draw
    whole, test = equations.usable, equations.rows.block % 5 == 2
    equations.use_rows(whole & ~test[:, None])
    pool = Pool(equations, noise, [push], 0.05)
    attempt = Attempt(test, [], pool, pool.residual_of_all())
    equations.use_rows(whole)
    found = completed(equations, attempt)
    time = equations.rows.time
    middle = time[found.test & ~test]
    assert len(middle) * np.median(np.diff(time)) == pytest.approx(more, abs=0.1)
    assert (np.abs(middle - np.mean(when)) < 0.15 * (when[1] - when[0])).all()
    assert found.test[test].all() and (found.extended[test] == attempt.extended[test]).all()
    assert held_out_gain(equations, found.extended, whole & found.test[:, None])[0] > 0.95
    assert (equations.usable == whole).all()


def test_terms_that_do_harm_are_given_up() -> None:
    equations = equations_of(["viscous_friction@arm2_joint1:viscous=3"])
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    one, _ = term("viscous_friction@arm2_joint1:viscous=3", Robot.bundled("arm2"))
    pool = Pool(equations, model, [one], 1e-3)
    test = equations.rows.block % 5 == 2
    found = estimates(pool, pool.whole)
    for left, kept in ((0.1 * equations.rows.target, 1), (1.5 * equations.rows.target, 0)):
        attempt = Attempt(test, [], pool, left)
        new, plain, told = without_harm(equations, attempt, pool, found)
        assert (len(plain.terms), len(told), len(new.fitted.terms)) == (kept, kept, kept)
    assert np.sum(new.extended**2) < np.sum((1.5 * equations.rows.target) ** 2)


def test_corrections_that_do_harm_alone_are_given_up() -> None:
    """What was compared with stays as it is then, and the error does not grow."""
    equations = equations_of(["viscous_friction@arm2_joint1:viscous=3"])
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    test = equations.rows.block % 5 == 2
    pool, whole = Pool(equations, model, [], 0.05), equations.usable
    attempt = Attempt(test, [], pool, 1.5 * equations.rows.target)
    equations.rows.target[test] *= -1.0  # what is held out is the opposite of all else
    new, plain, told = without_harm(equations, attempt, pool, [])
    assert (plain.terms, told) == ([], [])
    assert not plain.whole.coefficients.any() and not new.fitted.whole.coefficients.any()
    np.testing.assert_array_equal(new.extended, equations.rows.target)
    np.testing.assert_array_equal(plain.residual_of_all(), equations.rows.target)
    assert held_out_gain(equations, new.extended, whole & test[:, None]) == (0.0, (0.0, 0.0))
    same, _, _ = without_harm(equations, replace(attempt, extended=0.1 * equations.rows.target), pool, [])
    assert same.extended is not new.extended and same.fitted is pool
