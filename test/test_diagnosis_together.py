"""Causes that act on one another: what is measured beside what acts, and bodies under a tilt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import signals_of

from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.registry import get
from bdnn_ros.extension.extend import extend
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mounting import tilt_of
from bdnn_ros.scores import described_effort
from bdnn_ros.simulation.scenario import Scenario


def examined(robot: Robot, *effects: str, wrong: float = 0.0, seed: int = 3) -> Examination:
    scenario = Scenario(robot, effects=effects, seed=seed, duration=20.0, rate=200.0, wrong=wrong)
    return examine([scenario.run()[0].recording], robot)


@pytest.mark.parametrize("scale", [0.75, 1.3])
def test_a_scaled_effort_has_the_scale_it_has(scale: float) -> None:
    """The load that the joint carries is what acts, not what is measured of it."""
    found = examined(Robot.bundled("arm2"), f"effort_scale@arm2_joint1:scale={scale}")
    first = found.diagnosis.findings[0]
    assert (first.effect, first.joint) == ("effort_scale", "arm2_joint1")
    assert first.parameters["scale"].value == pytest.approx(scale, rel=0.05)


def test_an_offset_beside_a_wrong_scale_is_told_as_it_acts() -> None:
    """Finding and extended model tell the same number, in the effort that acts: scale * measured + offset."""
    found = examined(
        Robot.bundled("arm2"), "effort_offset@arm2_joint2:offset=0.3", "effort_scale@arm2_joint2:scale=1.25"
    )
    named = {finding.effect: finding.parameters for finding in found.diagnosis.findings}
    assert set(named) == {"effort_offset", "effort_scale"}
    told = named["effort_offset"]["offset"]
    assert told.value == pytest.approx(0.3, rel=0.02) and told.std < 0.02
    (installed,) = (e.values["offset"] for e in extend(found).effects if e.effect.name == "effort_offset")
    assert installed == told.value


@pytest.mark.slow
def test_a_payload_hangs_from_a_tilted_base() -> None:
    """The tilt turns gravity for the payload as well, and the extended model errs as little as the fit."""
    robot = Robot.bundled("arm7")
    found = examined(robot, "payload@arm7_link7:mass=2,com_z=0.1", "base_tilt:pitch_deg=5", wrong=0.05)
    named = {finding.effect: finding for finding in found.diagnosis.findings}
    assert set(named) == {"payload", "base_tilt"}
    assert named["base_tilt"].parameters["pitch_deg"].value == pytest.approx(5.0, abs=0.4)
    equations, model = found.equations, extend(found)
    signals = equations.motion.signals
    left = equations.decimation.as_rows(signals.effort - model.predict(signals))
    fitted = found.pool.residual(found.fit, blur=False)
    usable = equations.usable

    def size(values: np.ndarray) -> np.ndarray:
        return np.sqrt(np.sum(np.where(usable, values, 0.0) ** 2, axis=0) / usable.sum(axis=0))

    assert (size(left) / equations.rows.effort_scale).mean() < 1.3 * (
        size(fitted) / equations.rows.effort_scale
    ).mean()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "link", "scale"),
    [
        ("backlash@arm6_joint3:gap=0.02", "arm6_link3", 0.7),
        ("load_dependent_friction@arm6_joint1:ratio=0.11", "arm6_link6", 0.6),
    ],
)
def test_a_wrong_link_is_told_beside_a_larger_cause(cause: str, link: str, scale: float) -> None:
    """Before that is known all links look far off, and one that is would be nothing special."""
    found = examined(Robot.bundled("arm6"), cause, f"link_inertia@{link}:scale={scale}", wrong=0.05, seed=4)
    named = {(finding.effect, finding.link or finding.joint) for finding in found.diagnosis.findings}
    assert named == {tuple(cause.split(":")[0].split("@")), ("link_inertia", link)}


@pytest.mark.slow
def test_what_a_soft_joint_left_at_first_is_no_cause_of_its_own() -> None:
    """The load that bends it is known once nothing else stands for what a first guess of its stiffness left."""
    found = examined(Robot.bundled("arm6"), "joint_elasticity@arm6_joint4:stiffness=22", wrong=0.05, seed=4)
    (only,) = found.diagnosis.findings
    assert (only.effect, only.joint) == ("joint_elasticity", "arm6_joint4")
    assert only.parameters["stiffness"].value == pytest.approx(22.0, rel=0.02)


def test_what_links_are_off_by_hangs_from_the_tilted_base_as_well() -> None:
    """Else errors of the links times the tilt are left, which pass for offsets of other joints."""
    robot, angles = Robot.bundled("arm7"), np.radians([6.0, -5.0])
    signals = signals_of("arm7", 20.0)
    errors = 0.1 * np.random.default_rng(0).standard_normal(relative_inertials(robot).shape[1])
    off = robot.with_inertials(robot.inertials.ravel() + relative_inertials(robot) @ errors)
    real = described_effort(off.tilted(*angles), signals)
    tilt = Term(get("base_tilt"), -1).shaped({"roll_deg": 6.0, "pitch_deg": -5.0})
    left = []
    for known in (None, (angles[0], angles[1])):
        equations = build(replace(signals, effort=real), robot, tilt=known)
        columns = np.concatenate([equations.rigid, equations.columns.of(tilt)], axis=2)[equations.usable]
        target = equations.rows.target[equations.usable]
        told = np.linalg.lstsq(columns, target, rcond=1e-10)[0]
        left.append(np.linalg.norm(target - columns @ told) / np.linalg.norm(target))
    assert left[1] < 1e-6
    assert left[0] > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize(("effects", "tilted"), [(("base_tilt:roll_deg=3,pitch_deg=-4",), True), ((), False)])
def test_a_tilt_that_stands_out_is_where_the_links_hang(effects: tuple[str, ...], tilted: bool) -> None:
    robot = Robot.bundled("arm6")
    found = examined(robot, *effects, wrong=0.05)
    motion = found.equations.motion
    assert (motion.level is robot) == tilted
    assert {finding.effect for finding in found.diagnosis.findings} == ({"base_tilt"} if tilted else set())
    np.testing.assert_allclose(
        np.degrees(tilt_of(motion.robot.gravity_vector)), (3.0, -4.0) if tilted else (0.0, 0.0), atol=0.2
    )
