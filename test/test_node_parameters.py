"""What is said of a parameter's value."""

from __future__ import annotations

from bdnn_ros.nodes.parameters import IDENTIFICATION

SETTINGS = {setting.name: setting for setting in IDENTIFICATION}


def test_a_joint_is_named_once():
    joints = SETTINGS["joints"]
    assert joints.objection(["a", "b"]) == joints.objection(["", ""]) == joints.objection(None) == ""
    said = joints.objection(["a", "b", "a", "c", "c"])
    assert said.startswith("joints holds a, c more than once") and said.count(".") == 1
    assert SETTINGS["effort_factors"].objection(["2.0", "2.0"]) == ""
