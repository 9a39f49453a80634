"""Efforts that say nothing of what acts: they do not count, are told, and nothing is named for them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from reading_cases import clipped, dropped, glitched, without_effort

from bdnn_ros import bags
from bdnn_ros.checks import efforts
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import RecordingError
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import flattened, prepare
from bdnn_ros.signals.unmeasured import absent, cut_off, held, unmeasured
from bdnn_ros.simulation.simulate import simulate

STRIBECK = "stribeck_friction@arm2_joint1:coulomb=1.0,static=2.0,velocity=0.05"
LOW = 5.0
"""A low-pass that diagnoses use [Hz]."""


@pytest.fixture(scope="module")
def arm() -> Robot:
    return Robot.bundled("arm2")


@pytest.fixture(scope="module")
def plain(arm: Robot) -> Recording:
    return simulate(arm, seed=3, duration=20.0).recording


def usable(recording: Recording, robot: Robot) -> np.ndarray:
    return build(flattened(prepare(recording), LOW), robot).usable


def test_runs_at_an_extreme_are_a_limit_and_a_short_one_is_a_peak():
    effort = np.sin(np.arange(100.0))[:, None] * [1.0, 1.0]
    effort[20:26, 0] = 1.5
    effort[40:44, 1] = -1.5
    assert np.flatnonzero(cut_off(effort)[:, 0]).tolist() == list(range(20, 26))
    assert not cut_off(effort)[:, 1].any()


TIME = np.arange(10000) / 500.0
SQUARE = np.sign(np.sin(1.6 * np.pi * TIME + 1e-9))
HEIGHTS = np.random.default_rng(0).uniform(1.0, 2.0, 20)
STEPS = {
    "square": np.where((TIME > 0.1) & (TIME < 19.7), SQUARE, 0.0),
    "reversing": np.tile(np.repeat([0.0, 1.0, 0.0, -1.0], [3, 250, 3, 250]), 20),
    "random": np.pad(np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], 400), 25), 50),
    "rest": np.pad(np.where(TIME > 8.0, (SQUARE > 0.0).astype(float), 0.0), 5000),
    "step": (TIME > 1.0).astype(float),
    "pulses": np.concatenate([np.repeat([0.0, height], [950, 50]) for height in HEIGHTS]),
    "after sines": np.concatenate([0.8 * np.sin(TIME + 0.05 * TIME**2), SQUARE]),
}


@pytest.mark.parametrize("steps", STEPS.values(), ids=STEPS)
def test_an_effort_that_goes_in_steps_is_at_no_limit(steps):
    """As commands without noise may: nearly all of them were called cut off."""
    assert not cut_off(steps[:, None]).any()


SINES = np.sin(1.9 * TIME) + 0.7 * np.sin(4.8 * TIME + 1.0) + 0.3 * np.sin(12.0 * TIME)
CUT = {
    "smooth": SINES,
    "noisy": SINES + np.random.default_rng(0).normal(0.0, 0.02, len(SINES)),
    "in steps of a sensor": 0.02 * np.round(SINES / 0.02),
    "held": np.repeat(SINES[::5], 5),
    "slow": SINES[::10],
    "quick": np.sin(12.0 * TIME[::10]),
    "soon all of it": np.concatenate([np.linspace(0.0, 0.8, 5), np.ones(300)]),
}


@pytest.mark.parametrize("share", [0.4, 0.65])
@pytest.mark.parametrize("effort", CUT.values(), ids=CUT)
def test_an_effort_that_would_have_gone_on_is_at_its_limit(effort, share):
    limit = share * np.abs(effort).max()
    at = np.abs(effort) > limit
    found = cut_off(np.clip(effort, -limit, limit)[:, None])[:, 0]
    assert not found[np.abs(effort) < limit].any()
    assert found[at].mean() > 0.9


@pytest.mark.parametrize("each", [1, 3])
def test_efforts_are_held_where_they_stay_longer_than_usual(each):
    effort = np.repeat(np.random.default_rng(0).standard_normal((300, 2)), each, axis=0)
    effort[60:90] = effort[60]
    effort[120:130, 1] = 0.0
    assert np.flatnonzero(held(effort)).tolist() == list(range(61, 90))


def test_an_effort_that_never_changes_is_none():
    effort = np.stack([np.zeros(50), np.sin(np.arange(50.0))], axis=1)
    assert absent(effort).tolist() == [True, False]
    recording = Recording(np.arange(50.0), ("a", "b"), effort, None, effort)
    np.testing.assert_array_equal(unmeasured(recording), [[True, False]] * 50)


@pytest.mark.slow
@pytest.mark.parametrize("spec", [STRIBECK, None])
def test_wrong_readings_change_no_verdict(arm, spec):
    hidden = [] if spec is None else [parse_spec(spec, arm)]
    recording = simulate(arm, hidden, seed=3, duration=30.0).recording
    right = diagnose([recording], arm)
    assert not any("is compared" in note for note in right.notes)
    assert [finding.effect for finding in right.findings] == ([] if spec is None else ["stribeck_friction"])
    for wrong in (glitched(recording), clipped(recording, 0.75), dropped(recording)):
        found = diagnose([wrong], arm)
        assert found.verdict == right.verdict
        assert [(f.effect, f.joint) for f in found.findings] == [(f.effect, f.joint) for f in right.findings]


@pytest.mark.slow
def test_a_joint_whose_effort_is_not_reported_is_left_out_and_the_others_are_told(arm):
    recording = simulate(arm, [parse_spec(STRIBECK, arm)], seed=3, duration=30.0).recording
    found = diagnose([without_effort(recording, 1)], arm)
    (finding,) = found.findings
    assert (finding.effect, finding.joint) == ("stribeck_friction", "arm2_joint1")
    assert all(one[1] == 0.0 for one in found.effort_rmse.values())
    (note,) = (one for one in found.notes if "is compared" in one)
    assert note.startswith("No effort of arm2_joint2 is compared")


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [dropped, lambda recording: without_effort(recording, 1)])
def test_identification_leaves_out_what_was_not_measured(arm, plain, wrong):
    """A joint without a sensor keeps what is believed of it, and the other is as good as ever."""
    signals = prepare(plain)

    def error(one: Recording) -> np.ndarray:
        model = Identifier(arm).fit([one])
        np.testing.assert_allclose(model.robot.inertials, arm.inertials, atol=0.1)
        left = signals.smooth(signals.effort - model.predict(signals))[signals.interior]
        return np.std(left, axis=0) / np.std(signals.effort, axis=0)

    left = error(wrong(plain))
    assert left[0] < 1.1 * error(plain)[0] + 1e-3
    assert left[1] < 0.7


def test_rows_that_saw_a_limit_do_not_count_for_its_joint(arm, plain):
    effort = plain.require_effort()
    cut = replace(plain, effort=np.minimum(effort, [0.8 * effort[:, 0].max(), np.inf]))
    before = build(flattened(prepare(plain), LOW), arm)
    lost = before.usable & ~usable(cut, arm)
    assert not lost[:, 1].any()
    at = cut_off(cut.require_effort())[:, 0].astype(float)
    at_limit = np.interp(before.rows.time, plain.time, at) > 0.5
    assert lost[at_limit & before.usable[:, 0], 0].all()
    assert 0.02 < lost[:, 0].mean() < 0.5


def test_every_kind_is_remarked_on(arm, plain):
    def about(recording):
        return [
            (one.about, one.problem)
            for one in (*efforts.unread(recording), *efforts.saturated(recording, arm))
        ]

    effort = plain.require_effort()
    assert about(plain) == []
    ((joint, problem),) = about(without_effort(plain, 1))
    assert joint == arm.joints[1] and "never changes" in problem
    ((_, problem),) = about(dropped(plain))
    assert "stand still for 0.2" in problem
    ((joint, problem),) = about(replace(plain, effort=np.minimum(effort, [np.inf, 0.7 * effort[:, 1].max()])))
    assert joint == arm.joints[1] and "at its effort limit" in problem


def test_info_says_that_a_joint_reports_no_effort(arm, plain, tmp_path, capsys):
    main(["info", str(bags.write(without_effort(plain, 1), tmp_path / "bag")), "--json"])
    (concern,) = json.loads(capsys.readouterr().out)["concerns"]
    assert "the effort of arm2_joint2 never changes" in concern


def test_efforts_that_never_change_are_refused(arm, plain):
    with pytest.raises(RecordingError, match="stands still"):
        usable(replace(plain, effort=np.zeros_like(plain.require_effort())), arm)
