"""What a wrong effort scale does beside a rotor without a name: along a joint that lifts a constant weight nearly an offset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import CUTOFF, RATE, term, white

from bdnn_ros.diagnosis.judging.identifiability import judge
from bdnn_ros.diagnosis.judging.scaled import scaled
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.search import Search
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.effects.motion import Motion
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import flattened, prepare
from bdnn_ros.simulation.excitation import fourier

BODY = '<inertial><mass value="{}"/><inertia ixx=".2" iyy=".2" izz=".2" ixy="0" ixz="0" iyz="0"/></inertial>'
JOINT = """<joint name="{0}" type="prismatic"><parent link="{1}"/><child link="{2}"/><axis xyz="{3}"/>
<limit lower="-1" upper="1" velocity="1" effort="200"/></joint>"""
LIFT = Robot.from_urdf(
    f'<robot name="lift"><link name="base"/><link name="cart">{BODY.format(9)}</link><link name="fork">{BODY.format(5)}</link>'
    + JOINT.format("rail", "base", "cart", "1 0 0")
    + JOINT.format("mast", "cart", "fork", "0 0 1")
    + "</robot>"
)


def judged(scale: float, rotor: float, offset: float) -> dict[str, float]:
    """Rivals of an offset of the mast's effort on a recording with a wrong scale and a rotor there, or with an offset."""
    time = np.arange(round(20.0 * RATE)) / RATE
    plan = fourier(LIFT, time, np.random.default_rng(0))
    recording = Recording(time, LIFT.joints, plan.position, plan.velocity, np.zeros_like(plan.position))
    signals = flattened(prepare(recording), CUTOFF)
    effort = described_effort(LIFT, signals)
    own, kilograms = term(f"armature@mast:armature={rotor}", LIFT)
    motion = Motion(signals, LIFT, effort)
    effort = effort + own.effect.columns(motion, own.target, dict(own.shape), own.link) @ kilograms
    effort = effort / np.array([1.0, scale]) - np.array([0.0, offset])
    equations = build(replace(signals, effort=effort, unmeasured=None), LIFT)
    noise, model = white(equations, 0.2)
    equations = equations.with_target(equations.rows.target + noise)
    specs = ("effort_offset@mast:offset=-1", "armature@mast:armature=1", "effort_scale@mast:scale=1.1")
    pool = Pool(equations, model, [term(spec, LIFT)[0] for spec in specs], 0.05)
    search = Search(equations, Candidates.of(LIFT), lambda text: None)
    selection = Selection(pool, (0,), pool.fit((0,)))
    (judgement,) = judge(search, selection)
    assert set(scaled(search.moves, pool, [], 0)) <= {2} and scaled(search.moves, pool, [0], 1) == {}
    return {rival.effect.name: probability for rival, probability in judgement.rivals}


@pytest.mark.parametrize(
    ("scale", "rotor", "offset"), [(1.2, 0.9, 0.0), (1.2, 1.0, 0.0), (1.2, 1.1, 0.0), (1.0, 0.0, 8.0)]
)
def test_an_offset_that_a_scale_and_a_rotor_explain_as_well_is_not_sure(scale, rotor, offset):
    assert 0.05 < judged(scale, rotor, offset)["effort_scale"] <= 0.5


def test_an_offset_that_no_rotor_lets_a_scale_explain_has_no_such_rival():
    """A joint that seems to lift more than it does would move as heavy a body as it lifts."""
    assert "effort_scale" not in judged(1.0, 0.0, -8.0)
