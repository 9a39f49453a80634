"""Every effect that MuJoCo has too is there what the contract says: same sign, same size."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bdnn_ros.diagnosis.recorded.velocity_filter import reported_velocity
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.settling import settled
from bdnn_ros.effects.registry import get
from bdnn_ros.errors import DataError
from bdnn_ros.robot import Robot
from bdnn_ros.signals import flattened, prepare

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from _naming_mujoco import HIDDEN, drawn, made

ROBOT = Robot.bundled("arm2")
LOW = 5.0
WEAR = {"coulomb": "coulomb_friction", "viscous": "viscous_friction", "armature": "armature"}
PERFECT = replace(drawn(0), wrong=0.0, worn=False, rate=500, duration=12.0, noise=0.0, encoder=0.0)


def worn(truth):
    """Each joint's wear: its index, the effect and its only parameter."""
    for joint, parts in (truth["worn"] or {}).items():
        yield from ((ROBOT.joints.index(joint), (WEAR[key], amount)) for key, amount in parts.items())


@pytest.mark.parametrize("name", [name for name in HIDDEN[1:] if not get(name).kinematic])
def test_a_regression_finds_the_parameters_that_mujoco_was_given(name):
    recording, truth = made(replace(PERFECT, hidden=name))
    (one,) = truth["effects"]
    effect, link = get(name, one["variant"]), one["link"]
    joint = ROBOT.joints.index(one["joint"]) if one["joint"] else -1
    target = ROBOT.body_of(link)[0] if link else joint
    values = effect.with_defaults(one["parameters"])
    coefficients, shape = effect.coefficients(values)
    terms, known = [Term(effect, target, link).shaped(shape)], [coefficients]
    for j, (effect_of_wear, amount) in worn(truth):
        terms.append(Term(get(effect_of_wear), j))
        known.append(np.array([amount]))
    equations = build(flattened(prepare(recording), LOW), ROBOT)
    equations.use_rows(equations.usable & ~equations.rows.dwelling)  # as parameters are estimated
    noise = Noise(np.zeros((2, 3)), 1e-3 * equations.rows.effort_scale)
    pool = settled(Candidates.of(ROBOT), equations, Pool(equations, noise, terms, 1e-4))
    columns = [equations.columns.of(term) for term in terms]
    found = pool.coefficients(pool.whole, 0)
    own = (effect.kinds == 0.0).any(axis=0)
    known[0][own] = found[own]  # a box turns about itself: fitted, and not told
    part, true = (columns[0] @ some for some in (found, coefficients))
    assert np.abs(part - true).max() < 0.05 * np.abs(true).max()
    left = equations.rows.target - sum(column @ some for column, some in zip(columns, known, strict=True))
    left = left[equations.usable.all(axis=1)] / equations.rows.effort_scale
    assert np.sqrt(np.mean(left**2)) < 0.02


def test_a_reported_velocity_lags_as_mujocos_was_made_to():
    """It is in no effort: the motion alone shows it."""
    recording, truth = made(replace(PERFECT, hidden="velocity_filter"))
    (one,), (finding,) = truth["effects"], reported_velocity([recording])
    assert (finding.effect, finding.joint) == (one["effect"], one["joint"])
    assert finding.parameters["cutoff"].value == pytest.approx(one["parameters"]["cutoff"], rel=0.05)


def test_a_simulation_that_breaks_down_is_no_recording(monkeypatch, tmp_path):
    """MuJoCo goes on from the start where its numbers overflow, and says so in a file."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(mujoco, "mj_step", broken_down(mujoco.mj_step))
    with pytest.raises(DataError, match="unstable"):
        made(replace(PERFECT, hidden="armature"))


def broken_down(step):
    """MuJoCo's step with a velocity that nothing can have."""

    def one(model, data):
        data.qvel[:] = 1e200
        step(model, data)

    return one
