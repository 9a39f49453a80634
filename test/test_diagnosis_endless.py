"""Pushes that are not seen to begin or to end: loads that are taken up or put down, or anything else that changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import equations_of, term, white

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.judging.posterior import estimates
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.sentences import Kind
from bdnn_ros.diagnosis.telling.endless import endless
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.report.words import claim
from bdnn_ros.robot import Robot
from bdnn_ros.simulation import simulate

ARM = Robot.bundled("arm6")


@pytest.mark.parametrize(
    ("spec", "unseen"),
    [
        ("external_wrench@arm6_link6:start=3,end=8,force_x=12", ""),
        ("external_wrench@arm6_link6:start=-1,end=8,force_x=12", "begins"),
        ("external_wrench@arm6_link6:start=3,end=20,force_x=12", "ends"),
        ("external_wrench@arm6_link6:start=3,end=20,force_z=12", "ends"),  # nothing weighs upwards
        ("external_wrench@arm6_link6:start=-1,end=8,force_z=-12,force_x=3", ""),
        ("external_wrench@arm6_link6:start=3,end=20,force_z=-12", ""),
        ("external_wrench@arm6_joint3:start=-1,end=8,torque=12", "begins"),
        ("coulomb_friction@arm6_joint3:coulomb=12", ""),
    ],
)
def test_a_push_is_seen_to_begin_and_to_end_or_pulls_as_a_weight(spec, unseen):
    equations = equations_of([spec], "arm6")
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    one, _ = term(spec, ARM)
    if one.effect.timed:  # it is found where rows are
        time = equations.rows.time
        shape = dict(one.shape)
        shape |= {"start": max(shape["start"], time[0]), "end": min(shape["end"], time[-1])}
        one = one.shaped(shape)
    pool = Pool(equations, model, [one], 1e-3)
    (estimate,) = estimates(pool, pool.whole)
    told = [note.sentence(False) for note in endless(estimate, "the tool", equations)]
    assert [f"the tool {unseen} is not seen" in one for one in told] == [True] * bool(unseen)


@pytest.mark.parametrize(("end", "whole"), [(5.5, True), (4.0, False), (9.0, False)])
def test_what_lasts_all_through_one_of_several_recordings_may_be_a_drift_of_each(end, whole):
    """A drift is looked for from the start of the first to the end of the last."""
    push = f"external_wrench@arm6_joint3:start=-1,end={end},torque=12"
    equations = equations_of([push], "arm6")
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    motion = equations.motion
    equations.use_motion(replace(motion, signals=replace(motion.signals, begun=(float(motion.time[0]), 5.5))))
    one, _ = term(push, ARM)
    one = one.shaped({**dict(one.shape), "start": float(motion.time[equations.rows.samples][0])})
    pool = Pool(equations, model, [one], 1e-3)
    (estimate,) = estimates(pool, pool.whole)
    (told,) = endless(estimate, "the tool", equations)
    assert ("diagnose them one by one" in told.sentence(False)) == whole


def crept(amount: float, seconds: float) -> tuple[Robot, object]:
    """An arm of which the zero of a joint creeps as its sensor gets warm."""
    robot = Robot.bundled("arm2")
    recording = simulate(robot, [], seed=3, duration=30.0).recording
    creep = amount * -np.expm1(-(recording.time - recording.time[0]) / seconds)
    position = recording.position + creep[:, None] * np.array([0.0, 1.0])
    return robot, replace(recording, position=position)


@pytest.mark.slow
def test_a_zero_that_creeps_is_not_explained_by_a_push():
    robot, recording = crept(0.08, 8.0)
    told = diagnose([recording], robot)
    assert told.verdict == "partly_explained"
    assert any("begins is not seen" in note for note in told.notes) and Kind.ENDLESS in told.kinds
    assert claim(told).endswith("what is told as a push may be another cause.")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("force", "verdict"), [("force_z=-12", "explained"), ("force_x=12", "partly_explained")]
)
def test_what_pushes_to_the_end_explains_a_recording_where_it_may_be_a_load(force, verdict):
    robot = Robot.bundled("arm6")
    push = parse_spec(f"external_wrench@arm6_link6:start=9,end=40,{force}", robot)
    told = diagnose([simulate(robot, [push], seed=3, duration=20.0).recording], robot)
    assert [one.effect for one in told.findings] == ["external_wrench"] and told.verdict == verdict
