"""A description that gives joints more friction than they have: a tag in a URDF is often a guess."""

from __future__ import annotations

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.effects.registry import get
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.files import extended_urdf
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm2")
REAL = ARM.with_joint_parameters(viscous=np.array([0.6, 0.1]), coulomb=np.array([0.8, 0.0]))


@pytest.fixture(scope="module")
def recording() -> Recording:
    simulated, _ = Scenario(
        REAL, effects=["payload@arm2_link2:mass=1.5,com_x=0.1"], seed=3, duration=20.0
    ).run()
    return simulated.recording


def examined(recording: Recording, viscous: tuple[float, float], coulomb: tuple[float, float]) -> Examination:
    described = REAL.with_joint_parameters(viscous=np.array(viscous), coulomb=np.array(coulomb))
    return examine([recording], described)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("viscous", "coulomb", "less"),
    [
        ((0.6, 1.1), (0.8, 0.0), {("viscous_friction", "arm2_joint2"): 1.0}),
        (
            (1.6, 0.1),
            (2.0, 0.0),
            {("viscous_friction", "arm2_joint1"): 1.0, ("coulomb_friction", "arm2_joint1"): 1.2},
        ),
        ((0.6, 0.1), (0.8, 2.0), {("coulomb_friction", "arm2_joint2"): 2.0}),
        ((0.6, 90.0), (0.8, 0.0), {("viscous_friction", "arm2_joint2"): 89.9}),
    ],
)
def test_what_is_less_than_described_is_told_and_nothing_in_its_place(recording, viscous, coulomb, less):
    """Also where there is none of it at all, and what is hidden besides is found."""
    examination = examined(recording, viscous, coulomb)
    findings = examination.diagnosis.findings
    assert {(f.effect, f.joint) for f in findings} == {*less, ("payload", None)}
    for finding in findings:
        wanted = less.get((finding.effect, finding.joint))
        if wanted is not None:
            (quantity,) = finding.parameters.values()
            assert quantity.value == pytest.approx(-wanted, rel=0.03)
            assert finding.sentence.startswith(f"{finding.joint} has less")
    model = extend(examination)
    read = Robot.from_urdf(extended_urdf(model))
    assert read.viscous == pytest.approx(REAL.viscous, abs=0.03)
    assert (model.robot.viscous >= 0.0).all() and read.coulomb == pytest.approx(REAL.coulomb, abs=0.05)


def test_friction_that_is_described_rightly_is_no_finding(recording):
    findings = examined(recording, tuple(REAL.viscous), tuple(REAL.coulomb)).diagnosis.findings
    assert [f.effect for f in findings] == ["payload"]


def test_joints_without_dry_friction_have_none_that_leads(recording):
    """A lead that no dry friction has would be a pulse at each reversal."""
    model = extend(examined(recording, tuple(REAL.viscous), tuple(REAL.coulomb)))
    assert model.sticking[1] == 0.0


def test_every_kind_of_dry_friction_may_be_less():
    arm = ARM.with_joint_parameters(coulomb=np.array([1.5, 0.0]))
    for name in ("coulomb_friction", "stribeck_friction", "asymmetric_friction"):
        effect = get(name)
        assert effect.against(arm, 0).coefficient_bounds[0][0] == -1.5
        assert effect.against(arm, 1) is effect
        assert not effect.may_be_gone
