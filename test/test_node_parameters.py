"""What is said of a parameter's value."""

from __future__ import annotations

from bdnn_ros.nodes.parameters import IDENTIFICATION

SETTINGS = {setting.name: setting for setting in IDENTIFICATION}


def test_a_joint_is_named_once():
    joints = SETTINGS["joints"]
    assert joints.objection(["a", "b"]) == joints.objection(["", ""]) == joints.objection(None) == ""
    said = joints.objection(["a", "b", "a", "c", "c"])
    assert said.startswith("joints holds a, c more than once") and said.count(".") == 1


def test_effort_factors_are_checked_before_any_robot_is_known():
    factors = SETTINGS["effort_factors"]
    assert (
        factors.objection(["2.0", "a=2.0", "b=2.0"])
        == factors.objection([""])
        == factors.objection(None)
        == ""
    )
    said = factors.objection(["a=abc"])
    assert said.startswith("effort_factors: Effort factor 'a=abc' is not a number") and "JOINT=FACTOR" in said
    assert "Two effort factors" in factors.objection(["2.0", "2.0"])


def test_a_low_pass_is_not_so_low_that_the_stream_is_not_kept_up_with():
    """Zero is none: the rate chooses."""
    cutoff = SETTINGS["cutoff"]
    assert cutoff.objection(0.0) == cutoff.objection(0.1) == cutoff.objection(500.0) == ""
    assert cutoff.objection(0.02) == "cutoff is 0.02; it must be 0, or 0.1 and more."
    assert "between 0 and 500" in cutoff.objection(-0.02)
    assert cutoff.descriptor.floating_point_range[0].from_value == 0.0
