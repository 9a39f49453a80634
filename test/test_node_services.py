"""Saving, loading, resuming, resetting, pausing and diagnosing through the node's services."""

from __future__ import annotations

import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bdnn_cases import black_box, scales
from diagnostic_msgs.msg import DiagnosticArray
from live_support import (
    Robotics,
    motion,
    node_process,
    pose,
    real_robot,
    status,
    urdf_file,
    wait_until,
)
from rcl_interfaces.srv import GetParameters
from std_srvs.srv import SetBool, Trigger

from bdnn_interfaces.msg import DynamicsEstimate, Findings
from bdnn_interfaces.srv import Diagnose, ForwardDynamics, InverseDynamics, LoadModel, SaveModel
from bdnn_ros.diagnosis.recorded.excerpts import SHORTEST
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import UsageError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.models import load_model, save_model
from bdnn_ros.nodes.services import Services
from bdnn_ros.online.serving import nominal
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

NODE = "/identification_node"
ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)


def asked_effort(ros: Robotics) -> np.ndarray:
    answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **pose(ARM))
    assert answer.success, answer.message
    return np.array(answer.effort)


def test_the_life_of_a_model(tmp_path):
    """Learned, saved, forgotten, loaded, kept at the end, and gone on from by the next node."""
    kept = tmp_path / "models"
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": kept, "diagnosis_period": 0.0}
    real = np.array(REAL.inverse_dynamics(*(np.array(x) for x in pose(ARM).values())))
    described = np.array(ARM.inverse_dynamics(*(np.array(x) for x in pose(ARM).values())))
    with node_process(tmp_path, 111, **parameters) as node, Robotics(111) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        ros.stream(motion(REAL, 5.5, 250.0))
        wait_until(lambda: diagnostics and int(status(diagnostics)["model_version"]) >= 3)
        np.testing.assert_allclose(asked_effort(ros), real, rtol=0.03, atol=0.03)
        answer = ros.call(SaveModel, f"{NODE}/save_model", name="first")
        assert answer.success and str(kept / "first" / "model.bdnn") in answer.message
        saved = load_model(kept / "first")
        np.testing.assert_allclose(
            saved.inverse_dynamics(*(np.array(x) for x in pose(ARM).values())), asked_effort(ros)
        )

        # what leads out of the directory is refused, in both directions
        outside = tmp_path / "outside"
        save_model(outside, nominal(ARM))
        os.symlink(outside, kept / "link")
        for name in (
            "../outside",
            str(outside),
            "a/../../outside",
            "link",
            "..",
            "a//b",
            "x" * 300,
        ):
            for kind, service in ((SaveModel, "save_model"), (LoadModel, "load_model")):
                answer = ros.call(kind, f"{NODE}/{service}", name=name)
                assert answer.success is False and "model_directory" in answer.message, name
        assert sorted(path.name for path in outside.iterdir()) == ["model.bdnn"]
        answer = ros.call(LoadModel, f"{NODE}/load_model", name="absent")
        assert answer.success is False and "no model" in answer.message
        save_model(kept / "other", nominal(Robot.bundled("arm6")))
        answer = ros.call(LoadModel, f"{NODE}/load_model", name="other")
        assert answer.success is False and "arm6_joint1" in answer.message
        (kept / "damaged").mkdir()
        (kept / "damaged" / "model.bdnn").write_bytes(b"not a model")
        assert ros.call(LoadModel, f"{NODE}/load_model", name="damaged").success is False

        assert ros.call(Trigger, f"{NODE}/reset").success
        np.testing.assert_allclose(asked_effort(ros), described)
        answer = ros.call(LoadModel, f"{NODE}/load_model", name="first")
        assert answer.success, answer.message
        np.testing.assert_allclose(asked_effort(ros), real, rtol=0.03, atol=0.03)
        learned = asked_effort(ros)
        assert node.end() == 0
    np.testing.assert_allclose(
        load_model(kept).inverse_dynamics(*(np.array(x) for x in pose(ARM).values())), learned
    )
    with node_process(tmp_path, 112, joints=f"[{', '.join(ARM.joints)}]", **parameters), Robotics(112) as ros:
        np.testing.assert_allclose(asked_effort(ros), learned)  # before it saw the robot move


@pytest.mark.slow
def test_a_model_in_another_order_of_joints_serves_in_ours(tmp_path):
    """It answers in the node's order, and learning goes on from it."""
    real = real_robot(ARM)
    save_model(tmp_path / "models" / "kept", nominal(real))
    save_model(tmp_path / "models" / "networks.bdnn", black_box(ARM.joints, scales(2), hidden=4))
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": tmp_path / "models"}
    turned = ARM.joints[::-1]
    asked = {"position": [0.1, -0.4], "velocity": [0.5, 0.2], "acceleration": [1.0, -2.0]}
    expected = real.inverse_dynamics(*(np.array(numbers[::-1]) for numbers in asked.values()))[::-1]
    with (
        node_process(tmp_path, 164, joints=f"[{', '.join(turned)}]", diagnosis_period=0.0, **parameters),
        Robotics(164) as ros,
    ):
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        estimates = ros.keep(DynamicsEstimate, f"{NODE}/estimate")
        answer = ros.call(LoadModel, f"{NODE}/load_model", name="kept")
        assert answer.success and "training goes on from it" in answer.message, answer.message
        answer = ros.call(LoadModel, f"{NODE}/load_model", name="networks")
        assert answer.success and "training is paused, it cannot go on" in answer.message, answer.message
        wait_until(lambda: diagnostics and status(diagnostics)["training"] == "false")
        (wanted,) = ros.call(GetParameters, f"{NODE}/get_parameters", names=["training"]).values
        assert wanted.bool_value  # nobody switched it off
        assert ros.call(Trigger, f"{NODE}/reset").success
        assert ros.call(SetBool, f"{NODE}/set_training", data=False).success
        answer = ros.call(LoadModel, f"{NODE}/load_model", name="kept")
        assert answer.success and "training is switched off" in answer.message, answer.message
        assert ros.call(Trigger, f"{NODE}/reset").success
        assert ros.call(SetBool, f"{NODE}/set_training", data=True).message == "Training goes on."
        answer = ros.call(LoadModel, f"{NODE}/load_model", name="kept")
        assert answer.success and "training goes on from it" in answer.message, answer.message
        answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **asked)
        assert answer.joint_names == list(turned) and answer.model_version == 1
        np.testing.assert_allclose(answer.effort, expected)
        ros.stream(motion(real, 6.0, 250.0, noise=0.002))
        wait_until(lambda: int(status(diagnostics)["model_version"]) >= 3)
        first = [message for message in estimates if message.model_version == 1]
        assert first and first[0].joint_names == list(turned)
        measured, told = (
            np.array([getattr(message, f"effort_{name}") for message in first])
            for name in ("measured", "estimate")
        )
        assert np.all((measured - told).std(axis=0) < 0.1 * measured.std(axis=0))
        answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **asked)
        np.testing.assert_allclose(answer.effort, expected, rtol=0.03, atol=0.03)
        assert ros.call(SaveModel, f"{NODE}/save_model", name="learned").success
    assert load_model(tmp_path / "models" / "learned").joints == turned


@pytest.mark.parametrize("window", [1e-9, 0.5, 0.99 * SHORTEST])
def test_a_window_that_is_too_short_is_refused_before_anybody_is_asked(window):
    asked = Services._diagnose(None, Diagnose.Request(window=window), Diagnose.Response())
    with pytest.raises(
        UsageError, match=r"A window of .* s is too short for a diagnosis\. Ask for 10 s at least"
    ):
        asked.send(None)


@pytest.mark.slow
def test_pausing_and_diagnosing(tmp_path):
    save_model(tmp_path / "described", nominal(ARM))
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": tmp_path, "diagnosis_period": 0.0}
    with node_process(tmp_path, 113, **parameters), Robotics(113) as ros:
        diagnostics = ros.keep(DiagnosticArray, "/diagnostics")
        findings = ros.keep(Findings, f"{NODE}/findings", latched=True)
        assert ros.call(SetBool, f"{NODE}/set_training", data=False).success
        recording = motion(REAL, 12.0, 100.0, noise=0.002)
        ros.stream(recording, speed=4.0)
        wait_until(lambda: diagnostics and status(diagnostics)["samples_received"] == "1200")
        told = status(diagnostics)
        assert told["model_version"] == "0" and told["training"] == "false"
        short = ros.call(Diagnose, f"{NODE}/diagnose", window=2.0)
        assert short.success is False and "short" in short.message
        # a model that is loaded takes nothing from what came before
        assert ros.call(LoadModel, f"{NODE}/load_model", name="described").success
        whole = ros.call(Diagnose, f"{NODE}/diagnose", timeout=60.0, window=0.0)
        assert whole.success, whole.message
        assert whole.findings.verdict != "nothing_wrong" and whole.findings.gain > 0.0
        assert whole.findings.findings
        for finding in whole.findings.findings:
            assert finding.sentence and len(finding.values) == len(finding.parameter_names) == len(
                finding.units
            )
        wait_until(lambda: findings)
        assert findings[-1].verdict == whole.findings.verdict
        assert ros.call(SetBool, f"{NODE}/set_training", data=True).success
        ros.stream(recording, speed=4.0, start=2_000_000_000_000)
        wait_until(lambda: int(status(diagnostics)["model_version"]) > 0)


@pytest.mark.slow
def test_a_payload_gripped_on_the_way_is_named(tmp_path):
    """On ~/findings, with its mass, within five seconds of motion."""
    mass, moment = 1.0, 10.0
    inertials = REAL.inertials.copy()
    inertials[-1, 0] += mass
    before = motion(REAL, 16.0, 100.0, noise=0.002)
    after = motion(REAL.with_inertials(inertials), 16.0, 100.0, noise=0.002)
    effort = np.where((before.time < moment)[:, None], before.effort, after.effort)
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "diagnosis_period": 0.0}
    with node_process(tmp_path, 114, **parameters), Robotics(114) as ros:
        findings = ros.keep(Findings, f"{NODE}/findings", latched=True)
        ros.stream(replace(before, effort=effort), speed=2.0, start=1000 * 10**9)
        told = wait_until(lambda: findings and findings[-1].findings[0], 20.0)
        assert told.effect == "payload" and told.joint == "" and "gripped" in told.sentence
        value = dict(zip(told.parameter_names, told.values, strict=True))
        assert value["mass"] == pytest.approx(mass, rel=0.1)
        assert value["start"] == pytest.approx(1000 + moment, abs=0.6)


@pytest.mark.slow
def test_no_request_ends_the_node(tmp_path):
    """Numbers that no robot can have, nor an effect's formula hold, and names that say nothing."""
    slip = parse_spec(f"stribeck_friction@{ARM.joints[0]}:coulomb=1,static=2,velocity=0.1", ARM)
    wave = parse_spec(f"cogging@{ARM.joints[1]}:amplitude=1,periods_per_rev=9,phase=0", ARM)
    found = ExtendedModel(
        bare=ARM, effects=(slip, wave), noise=np.zeros(2), stds=({}, {}), lead=0.0, lag=0.0, sticking=()
    )
    kept = tmp_path / "models"
    save_model(kept / "found", found)
    still = {"velocity": [0.0, 0.0], "position": [0.0, 0.0], "acceleration": [0.0, 0.0]}
    parameters = {"urdf_file": urdf_file(tmp_path, ARM), "model_directory": kept, "diagnosis_period": 0.0}
    with node_process(tmp_path, 195, **parameters) as node, Robotics(195) as ros:
        answer = ros.call(LoadModel, f"{NODE}/load_model", name="found")
        assert answer.success and answer.message.startswith("An extended model serves"), answer.message
        for field, joint in (("velocity", 0), ("position", 1)):
            refusal = f"{field} of {ARM.joints[joint]} is 1e+308, as no robot's can be."
            asked = {**still, field: [1e308 * (k == joint) for k in range(2)]}
            answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **asked)
            assert not answer.success and answer.message.startswith(refusal)
            assert not answer.joint_names and not answer.effort
            asked["effort"] = asked.pop("acceleration")
            answer = ros.call(ForwardDynamics, f"{NODE}/forward_dynamics", **asked)
            assert not answer.success and answer.message.startswith(refusal)
        named = {"joint_names": ["", ARM.joints[0]]}
        answer = ros.call(InverseDynamics, f"{NODE}/inverse_dynamics", **named, **still)
        assert answer.message.startswith("Unknown joint ''; the model has")
        assert asked_effort(ros).shape == (2,)
        assert node.end() == 0


def refusal(callback):
    """The answer to a callback of an offer that needs nothing else."""
    logged: list[str] = []
    node = SimpleNamespace(
        context=SimpleNamespace(ok=lambda: True), get_logger=lambda: SimpleNamespace(error=logged.append)
    )
    offer = Services.__new__(Services)
    offer._node = node
    response = InverseDynamics.Response(success=True, effort=[1.0])
    return offer._refusing(callback)(None, response), logged


def test_whatever_a_callback_raises_is_a_refusal():
    def fails(request, response):
        raise error

    error: Exception = PermissionError(13, "Permission denied", "/models/a")
    answer, logged = refusal(fails)
    assert not answer.success and not answer.effort and not logged
    assert answer.message.startswith("/models/a cannot be used (Permission denied).")
    error = RuntimeError("on purpose")
    answer, logged = refusal(fails)
    assert not answer.success and "RuntimeError: on purpose" in answer.message
    assert len(logged) == 1 and "in fails" in logged[0]
