"""Effort commands that are no commands: counted, told, and the node goes on."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from live_support import Robotics, motion, node_process, real_robot, status, urdf_file, wait_until
from std_msgs.msg import Float64MultiArray

from bdnn_ros.nodes import diagnostics
from bdnn_ros.robot import Robot

pytestmark = pytest.mark.ros

ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)


@pytest.mark.slow
def test_bad_commands_are_counted_told_and_logged(tmp_path):
    """Some of the wrong size, then some that are not finite: reasons, a warning, one line in the log, no harm."""
    parameters = {
        "urdf_file": urdf_file(tmp_path, ARM),
        "joints": f"[{', '.join(ARM.joints)}]",
        "effort_source": "command",
        "diagnosis_period": 0.0,
    }
    recording = motion(REAL, 12.0, 250.0)
    efforts = recording.require_effort()
    with node_process(tmp_path, 161, **parameters) as node, Robotics(161) as ros:
        kept = ros.keep(DiagnosticArray, "/diagnostics")
        commander = ros.publisher(Float64MultiArray, "effort_commands")

        def command(row, message):
            values = efforts[row].tolist()
            if row in (250, 260, 270):
                values = values[:1]
            elif row in (750, 760):
                values[1] = float("nan")
            commander.publish(Float64MultiArray(data=values))
            message.effort = []
            return message

        ros.stream(recording, change=command)
        wait_until(lambda: kept and status(kept)["commands_received"] == "3000")
        told = status(kept)
        assert told["rejected_command_wrong_length"] == "3"
        assert told["rejected_command_not_finite"] == "2"
        assert told["samples_rejected"] == "5" and told["samples_lost"] == "0"
        messages = {message.status[0].message: message.status[0].level for message in kept}
        size = f"An effort command has 1 numbers, not 2. Send 2, in the order of the parameter joints: {', '.join(ARM.joints)}."
        assert messages[size] == b"\1"
        assert any(f"effort command of {ARM.joints[1]} is not finite" in message for message in messages)
        assert node.output.count("effort_commands: ") == 1 and f"effort_commands: {size}" in node.output
        wait_until(lambda: int(status(kept)["model_version"]) >= 4)
        told = [message.status[0].message for message in kept]
        assert "training" in told[told.index(size) :]  # it is told for a while only


def test_the_log_repeats_a_warning_only_once_in_a_while(monkeypatch):
    now, said = [100.0], []
    monkeypatch.setattr(diagnostics.time, "monotonic", lambda: now[0])
    warnings = diagnostics.Warnings(said.append)
    for seconds, sentence, again, count in (
        (0.0, "", True, 0),
        (1.0, "a", True, 1),
        (2.0, "b", True, 1),
        (12.0, "b", True, 2),
        (30.0, "b", False, 2),
        (31.0, "c", False, 3),
    ):
        now[0] = 100.0 + seconds
        warnings.say("subject", sentence, again)
        assert len(said) == count, seconds
    warnings.say("another", "c")
    assert len(said) == 4
