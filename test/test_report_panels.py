"""What the report draws: the right input, the right parts, the right stretch of time."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from cli_cases import sliding_arm
from report_cases import examined, fourier_motion, rendered, worn
from report_page import Page
from scipy.signal import lfilter

from bdnn_ros.diagnosis.recorded.velocity_filter import reported_velocity
from bdnn_ros.report import panels
from bdnn_ros.report.view import view
from bdnn_ros.robot import Robot


def test_the_rest_is_drawn_against_what_it_depends_on() -> None:
    arm = Robot.bundled("arm7")
    hidden = ["joint_spring@arm7_joint6:stiffness=3,rest=1"]
    recording = worn(arm, hidden, fourier_motion(arm))
    examination = examined(arm, recording, [], verdict="cannot_tell", depends_on="arm7_joint6")
    found = panels.rest_panels(view(examination))
    assert [panel.title for panel in found] == ["Left at arm7_joint6"]
    assert found[0].x_label == "arm7_joint6 position [rad]"
    assert "arm7_joint6.position" in Page(rendered(examination)).words


def test_the_rest_is_drawn_where_more_than_noise_is_left() -> None:
    """It was drawn at the joint of the input's name, or at the first that depends on anything."""
    arm = Robot.bundled("arm2")
    examination = examined(arm, worn(arm, [], fourier_motion(arm, 15.0)), [])
    inputs = {
        "arm2_joint1": {"arm2_joint1.velocity": 9.0, "time": 2.0},
        "arm2_joint2": {"arm2_joint1.velocity": 1.0, "time": 0.5},
    }
    remainder = replace(examination.remainder, inputs=inputs)
    for above, at in ((("arm2_joint2",), "arm2_joint2"), ((), "arm2_joint1")):
        diagnosis = replace(examination.diagnosis, above=above)
        found = panels.rest_panels(view(replace(examination, diagnosis=diagnosis, remainder=remainder)))
        assert [panel.title for panel in found] == [f"Left at {at}"] * 2
        assert [panel.x_label for panel in found] == ["arm2_joint1 velocity [rad/s]", "time [s]"]


@pytest.mark.parametrize(
    ("spec", "shown_by"),
    [
        ("coulomb_friction@arm2_joint1:coulomb=1", "velocity"),
        ("viscous_friction@arm2_joint1:viscous=1", "velocity"),
        ("armature@arm2_joint1:armature=1", "acceleration"),
        ("joint_spring@arm2_joint1:stiffness=4,rest=0", "position"),
        ("cogging@arm2_joint1:amplitude=1,periods_per_rev=4,phase=0.2", "position"),
        ("load_dependent_friction@arm2_joint1:ratio=0.3", "load"),
        ("external_wrench@arm2_joint1:start=4,end=9,torque=2", "time"),
    ],
)
def test_a_cause_is_drawn_against_what_it_is_a_function_of(spec: str, shown_by: str) -> None:
    robot = Robot.bundled("arm2")
    examination = examined(robot, worn(robot, [spec], fourier_motion(robot, 15.0)), [spec])
    shown = view(examination)
    assert panels.best_input(shown, shown.causes[0]) == shown_by
    proof = panels.evidence(shown, shown.causes[0])
    assert proof is not None and proof.after is not None and proof.joint == "arm2_joint1"
    assert any(layer.kind.endswith(" effect") for layer in proof.before.layers)
    assert not any(layer.kind.endswith(" effect") for layer in proof.after.layers)
    assert proof.before.y_ticks == proof.after.y_ticks


def test_a_filtered_velocity_is_shown_by_its_lag() -> None:
    robot = Robot.bundled("arm2")
    recording = worn(robot, [], fourier_motion(robot, 20.0))
    assert recording.velocity is not None
    keep = np.exp(-2.0 * np.pi * 3.0 / recording.rate)
    slow = recording.velocity.copy()
    slow[:, 0] = lfilter([1.0 - keep], [1.0, -keep], slow[:, 0])
    recording = replace(recording, velocity=slow)
    findings = tuple(reported_velocity([recording]))
    assert [finding.joint for finding in findings] == ["arm2_joint1"]
    examination = examined(robot, recording, [])
    examination = replace(examination, diagnosis=replace(examination.diagnosis, findings=findings))
    shown = view(examination)
    assert shown.causes[0].part is None
    proof = panels.evidence(shown, shown.causes[0])
    assert proof is not None and proof.after is None and proof.against == "acceleration"
    found = Page(rendered(examination))
    assert found.problems == [] and "of the velocity's error" in found.words


def test_sliding_joints_have_their_units() -> None:
    robot = sliding_arm()
    shown = view(examined(robot, worn(robot, [], fourier_motion(robot, 12.0)), []))
    assert shown.units == (("N·m", "rad"), ("N", "m"))
    assert panels.effort_panel(shown, 1).y_label.endswith("N]")


def test_two_pushes_on_a_sliding_joint_have_a_chart_each() -> None:
    """Findings of one effect at one joint are told apart by their values; their units are the joint's own."""
    robot = sliding_arm()
    specs = [f"external_wrench@arm2_joint2:start={a},end={a + 3},torque={f}" for a, f in ((3, 5), (8, 30))]
    examination = examined(robot, worn(robot, specs, fourier_motion(robot, 14.0)), specs)
    findings = examination.diagnosis.findings
    assert [finding.parameters["torque"].unit for finding in findings] == ["N", "N"]
    for order in (findings, findings[::-1]):
        diagnosis = replace(examination.diagnosis, findings=order)
        found = view(replace(examination, diagnosis=diagnosis))
        for cause in found.causes:
            assert cause.part is not None
            size = np.abs(cause.part[:, 1])
            begun = found.time[np.argmax(size > 0.5 * size.max())]
            assert begun == pytest.approx(cause.finding.parameters["start"].value, abs=0.2)


@pytest.mark.parametrize(("sliding", "unit"), [((), "N·m"), ((0,), None), ((0, 1), "N")])
def test_the_error_of_all_joints_has_their_unit_or_is_told_by_joint(
    sliding: tuple[int, ...], unit: str | None
) -> None:
    """Newtons and newton metres have no mean."""
    urdf = Robot.bundled("arm2").urdf
    for joint in sliding:
        before, name, after = urdf.partition(f'name="arm2_joint{joint + 1}"')
        urdf = before + name + after.replace('"revolute"', '"prismatic"', 1)
    robot = Robot.from_urdf(urdf)
    html = rendered(examined(robot, worn(robot, [], fourier_motion(robot, 12.0)), []))
    tiles = html[html.index('class="tiles"') : html.index("</dl>")]
    assert re.findall('<span class="to">(N.*?)</span>', tiles) == ([unit] * 2 if unit else [])
    assert tiles.count('<a href="#gain">by joint</a>') == (0 if unit else 2)


def test_a_function_of_its_input_is_explained_and_noise_is_not() -> None:
    generator = np.random.default_rng(3)
    x = generator.uniform(-1.0, 1.0, 3000)
    direction = np.where(generator.uniform(size=3000) < 0.5, -1.0, 1.0)
    assert panels.explained(x, np.sin(4.0 * x), direction) > 0.98
    assert panels.explained(x, direction * (1.0 + x), direction) > 0.98
    assert panels.explained(x, np.full(3000, 2.0), direction) == 1.0
    assert panels.explained(x, generator.normal(size=3000), direction) < 0.1


def test_a_curve_follows_its_function() -> None:
    x = np.linspace(-2.0, 2.0, 2000)
    centres, means = panels.curve(x, x**2)
    np.testing.assert_allclose(means, centres**2, atol=0.02)
    assert (np.diff(centres) > 0).all()


def test_a_curve_reaches_the_ends_of_its_data() -> None:
    """Where few points go fast the line ended far before them."""
    x = np.concatenate([np.linspace(-0.7, 0.7, 1000), [-2.0, -1.6, 1.4, 1.95, 2.0]])
    centres, means = panels.curve(x, 3.0 * x)
    assert centres[0] == -2.0 and centres[-1] == pytest.approx(2.0, abs=0.05)
    np.testing.assert_allclose(means, 3.0 * centres, atol=1e-9)


def test_the_parts_add_up_to_what_the_simulation_leaves() -> None:
    robot = Robot.bundled("arm7")
    specs = ["coulomb_friction@arm7_joint4:coulomb=1.3", "payload@arm7_joint7:mass=1.2,com_z=0.08"]
    examination = examined(robot, worn(robot, specs, fourier_motion(robot)), specs)
    shown, equations = view(examination), examination.equations
    links = equations.rigid @ examination.fit.coefficients[: equations.rigid.shape[2]]
    np.testing.assert_allclose(shown.residual + shown.named + links, shown.before, atol=1e-9)
    np.testing.assert_allclose(shown.simulated + shown.before, shown.measured)
    assert [cause.finding for cause in shown.causes] == list(examination.diagnosis.findings)


def test_a_long_recording_is_drawn_where_the_simulation_errs_most() -> None:
    robot = Robot.bundled("arm2")
    spec = "external_wrench@arm2_joint1:start=80,end=95,torque=3"
    examination = examined(robot, worn(robot, [spec], fourier_motion(robot, 120.0, 100.0)), [])
    shown = view(examination)
    begin, end = shown.time[shown.excerpt][[0, -1]]
    assert end - begin <= 40.1 and begin <= 80.1 and end >= 94.9
    assert "where the simulation errs most" in Page(rendered(examination)).words
