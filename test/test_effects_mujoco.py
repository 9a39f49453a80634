"""Every effect that MuJoCo has too is there what the contract says: same sign, same size."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros.diagnosis.building import build
from bdnn_ros.diagnosis.equations import Term
from bdnn_ros.diagnosis.evidence import Pool
from bdnn_ros.diagnosis.noise import Noise
from bdnn_ros.effects.registry import get
from bdnn_ros.robot import Robot
from bdnn_ros.signals import flattened, prepare

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from _naming_mujoco import HIDDEN, drawn, made

ROBOT = Robot.bundled("arm2")
LOW = 5.0


@pytest.mark.parametrize("name", HIDDEN[1:])
def test_a_regression_finds_the_parameters_that_mujoco_was_given(name):
    perfect = replace(drawn(0), hidden=name, wrong=0.0, worn=False, rate=500, duration=12.0)
    recording, truth = made(replace(perfect, noise=0.0, encoder=0.0))
    (one,) = truth["effects"]
    effect, link = get(name, one["variant"]), one["link"]
    target = ROBOT.joints.index(one["joint"]) if one["joint"] else ROBOT.width - 1 if link else -1
    values = effect.with_defaults(one["parameters"])
    if name == "external_wrench":  # MuJoCo pushes at the centre of mass
        mass, *moment = ROBOT.inertials[-1][:4]
        values |= dict(zip(("point_x", "point_y", "point_z"), np.array(moment) / mass, strict=True))
    coefficients, shape = effect.coefficients(values)
    equations = build(flattened(prepare(recording), LOW), ROBOT)
    term = Term(effect, target, link).shaped(shape)
    pool = Pool(equations, Noise(np.zeros((2, 3)), 1e-3 * equations.effort_scale), [term], 1e-4)
    found = pool.coefficients(pool.whole, 0)
    part, true = (equations.columns(term) @ some for some in (found, coefficients))
    assert np.abs(part - true).max() < 0.05 * np.abs(true).max()
    left = (equations.target - true)[equations.usable.all(axis=1)] / equations.effort_scale
    assert np.sqrt(np.mean(left**2)) < 0.02
