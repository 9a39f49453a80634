"""How the naming benchmark judges: right, physically the same, false, and the truth of worn robots."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bdnn_ros.effects.registry import EFFECTS
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from _naming_draws import Choices, done
from _naming_judging import judge
from _naming_readings import WAYS, table
from _naming_recordings import in_words, tables
from _naming_tables import Totals, confusion
from _naming_text import text

J1, J2 = "arm2_joint1", "arm2_joint2"


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.bundled("arm2")


def truth(*effects: dict[str, Any], worn: bool = False) -> dict[str, Any]:
    """The truth of a 2-axis robot with some effects."""
    wear = {joint: {"coulomb": 0.5, "viscous": 0.2, "armature": 0.1} for joint in (J1, J2)}
    return {"effects": list(effects), "worn": wear if worn else None, "links": {}}


def hidden(effect: str, joint: str | None = None, link: str | None = None, **values: float) -> dict[str, Any]:
    """An entry of truth.yaml."""
    return {"effect": effect, "joint": joint, "link": link, "parameters": values}


def finding(
    effect: str,
    joint: str | None = None,
    link: str | None = None,
    rivals: tuple[dict[str, Any], ...] = (),
    std: float = 0.01,
    **values: float,
) -> dict[str, Any]:
    """An entry of diagnosis.json."""
    parameters = {name: {"value": value, "std": std, "unit": ""} for name, value in values.items()}
    return {
        "effect": effect,
        "joint": joint,
        "link": link,
        "parameters": parameters,
        "rivals": [{"joint": None, "link": None, "probability": 0.1, **rival} for rival in rivals],
    }


def test_right_effect_at_the_right_joint_with_its_parameter(robot):
    found = [finding("coulomb_friction", J1, coulomb=1.05, std=0.03)]
    outcome = judge(truth(hidden("coulomb_friction", J1, coulomb=1.0)), found, robot)
    one = outcome["hidden"][0]
    assert one["named"] and one["first"] and not one["abstained"] and outcome["false"] == []
    assert one["parameters"]["coulomb"]["error"] == pytest.approx(0.05)
    assert one["parameters"]["coulomb"]["covered"]  # 0.05 < 1.96 * 0.03


def test_another_joint_is_false_and_silence_is_not(robot):
    entry = truth(hidden("coulomb_friction", J1, coulomb=1.0))
    elsewhere = judge(entry, [finding("coulomb_friction", J2, coulomb=1.0)], robot)
    assert elsewhere["false"] == ["coulomb_friction"]
    assert elsewhere["hidden"][0]["as"] == "coulomb_friction elsewhere"
    assert not elsewhere["hidden"][0]["abstained"]
    silent = judge(entry, [], robot)
    assert silent["hidden"][0]["abstained"] and silent["hidden"][0]["as"] == "nothing"


@pytest.mark.parametrize("listed", [True, False])
def test_the_same_physics_counts_only_where_it_is_listed(robot, listed):
    link = robot.moving_link(J2)
    rivals = ({"effect": "payload", "link": link},) if listed else ()
    found = [finding("link_inertia", link=link, rivals=rivals, mass=2.0, nominal_mass=1.0, scale=2.0)]
    payload = hidden("payload", link=link, mass=1.0, com_x=0.0, com_y=0.0, com_z=0.1)
    outcome = judge(truth(payload), found, robot)
    assert outcome["hidden"][0]["named"] is listed
    assert outcome["false"] == ([] if listed else ["link_inertia"])


def test_a_rival_of_other_physics_is_not_right(robot):
    rivals = ({"effect": "coulomb_friction", "joint": J1},)
    found = [finding("viscous_friction", J1, rivals=rivals, viscous=1.0)]
    outcome = judge(truth(hidden("coulomb_friction", J1, coulomb=1.0)), found, robot)
    assert not outcome["hidden"][0]["named"] and outcome["false"] == ["viscous_friction"]


@pytest.mark.parametrize(
    ("offset", "listed", "right"),
    [(0.009, True, True), (-0.011, True, True), (0.009, False, False), (0.02, True, False)],
)
def test_a_gap_that_is_never_crossed_is_a_wrong_zero_of_half_of_it(robot, offset, listed, right):
    rivals = ({"effect": "backlash", "joint": J1},) if listed else ()
    found = [finding("position_offset", J1, rivals=rivals, offset=offset)]
    outcome = judge(truth(hidden("backlash", J1, gap=0.02, crossing=0.02)), found, robot)
    assert outcome["hidden"][0]["named"] is right
    assert outcome["false"] == ([] if right else ["position_offset"])


def test_asymmetric_friction_in_two_halves(robot):
    rivals = ({"effect": "asymmetric_friction", "joint": J1},)
    halves = [
        finding("coulomb_friction", J1, rivals=rivals, coulomb=0.75),
        finding("effort_offset", J1, rivals=rivals, offset=-0.25),
    ]
    entry = truth(hidden("asymmetric_friction", J1, positive=1.0, negative=0.5))
    assert judge(entry, halves, robot)["hidden"][0]["named"]
    assert not judge(entry, halves[:1], robot)["hidden"][0]["named"]


def test_one_half_may_list_for_both(robot):
    rivals = ({"effect": "asymmetric_friction", "joint": J1},)
    halves = [
        finding("coulomb_friction", J1, coulomb=0.75),
        finding("effort_offset", J1, rivals=rivals, offset=-0.25),
    ]
    outcome = judge(truth(hidden("asymmetric_friction", J1, positive=1.0, negative=0.5)), halves, robot)
    assert outcome["hidden"][0]["named"] and outcome["false"] == []


@pytest.mark.parametrize("falls", [True, False])
def test_uneven_friction_that_falls_as_well_is_an_offset_beside_it(robot, falls):
    rivals = ({"effect": "asymmetric_friction", "joint": J1},)
    halves = [
        finding("stribeck_friction", J1, coulomb=1.0, static=1.3, velocity=0.1),
        finding("effort_offset", J1, rivals=rivals, offset=-0.25),
    ]
    falling = [hidden("stribeck_friction", J1, coulomb=0.25, static=0.55, velocity=0.1)] if falls else []
    outcome = judge(
        truth(hidden("asymmetric_friction", J1, positive=1.0, negative=0.5), *falling), halves, robot
    )
    assert all(one["named"] for one in outcome["hidden"]) is falls
    assert outcome["false"] == ([] if falls else ["stribeck_friction", "effort_offset"])


@pytest.mark.parametrize("listed", [True, False])
def test_two_halves_as_asymmetric_friction(robot, listed):
    rivals = ({"effect": "effort_offset", "joint": J1},) if listed else ()
    found = [finding("asymmetric_friction", J1, rivals=rivals, positive=0.5, negative=1.0)]
    entry = truth(hidden("coulomb_friction", J1, coulomb=0.75), hidden("effort_offset", J1, offset=-0.25))
    assert [one["named"] for one in judge(entry, found, robot)["hidden"]] == [listed, listed]


@pytest.mark.parametrize("name, right", [("arm2", True), ("arm6", False)])
def test_a_tilt_is_the_zero_of_a_first_joint_that_is_not_vertical(name, right):
    robot = Robot.bundled(name)
    entry = truth(hidden("base_tilt", roll_deg=0.0, pitch_deg=5.0))
    rivals = ({"effect": "base_tilt"},)
    found = [finding("position_offset", robot.joints[0], rivals=rivals, offset=0.09)]
    assert judge(entry, found, robot)["hidden"][0]["named"] is right


@pytest.mark.parametrize(
    "point, listed, right",
    [((0.0, 0.0, 0.1), True, True), ((0.0, 0.0, 0.1), False, False), ((0.03, 0.0, 0.1), True, False)],
)
def test_a_force_on_a_joints_axis_pushes_the_link_before_as_well(point, listed, right):
    arm, at = Robot.bundled("arm6"), dict(zip(("point_x", "point_y", "point_z"), point, strict=True))
    entry = truth(hidden("external_wrench", link="arm6_link6", start=1.0, end=2.0, force_x=5.0, **at))
    entry["effects"][0]["variant"] = "link"
    rivals = ({"effect": "external_wrench", "link": "arm6_link6"},) if listed else ()
    found = [finding("external_wrench", link="arm6_link5", rivals=rivals, start=1.0, end=2.0, force_x=5.0)]
    outcome = judge(entry, found, arm)
    assert outcome["hidden"][0]["named"] is right
    assert outcome["false"] == ([] if right else ["external_wrench"])


def test_wear_is_true_and_adds_to_what_is_hidden(robot):
    found = [
        finding("viscous_friction", J2, viscous=0.2),
        finding("stribeck_friction", J1, coulomb=0.9, static=1.5, velocity=0.1),
        finding("coulomb_friction", J2, coulomb=0.5),
    ]
    stribeck = hidden("stribeck_friction", J1, coulomb=0.4, static=1.0, velocity=0.1)
    outcome = judge(truth(stribeck, worn=True), found, robot)
    assert outcome["false"] == [] and len(outcome["hidden"]) == 1
    one = outcome["hidden"][0]
    assert one["first"]  # wear may stand before it
    assert {name: p["truth"] for name, p in one["parameters"].items()} == pytest.approx(
        {"coulomb": 0.9, "static": 1.5, "velocity": 0.1}
    )


def test_wear_is_false_on_a_new_robot(robot):
    outcome = judge(truth(), [finding("armature", J1, armature=0.1)], robot)
    assert outcome["false"] == ["armature"] and outcome["hidden"] == []


def test_a_link_that_is_really_off_is_no_false_name(robot):
    link = robot.moving_link(J1)
    described = float(robot.inertials[0][0])
    entry = truth() | {"links": {J1: {"described": [described], "real": [1.2 * described]}}}

    def named(mass: float) -> dict[str, Any]:
        values = {"mass": mass, "nominal_mass": described, "scale": mass / described}
        return judge(entry, [finding("link_inertia", link=link, **values)], robot)

    assert named(1.15 * described)["links"] == ["link_inertia"]
    assert named(0.9 * described)["false"] == ["link_inertia"]


def test_draws_follow_from_their_seed_and_singles_take_turns():
    choices = Choices(hidden=1, worn=False)
    draws = [choices.draw(seed) for seed in range(10000, 10000 + len(EFFECTS))]
    assert draws == [choices.draw(draw.seed) for draw in draws]
    assert {draw.effects for draw in draws} == {(name,) for name in EFFECTS}
    assert not any(draw.worn for draw in draws) and len({draw.key for draw in draws}) == len(draws)


def test_a_draw_is_simulated_diagnosed_and_judged():
    """What a right diagnosis leaves is the noise; how much of the evidence is there is known by then."""
    choices = Choices(
        ("arm2",), ("viscous_friction",), hidden=1, wrong=0.05, worn=False, duration=20.0, poor=False
    )
    record = done(choices.draw(60000))
    (one,) = record["outcome"]["hidden"]
    assert record["status"] == "diagnosed" and one["first"] and one["evidence"] > 100.0
    assert record["over_floor"] == pytest.approx(1.0, abs=0.2) and not record["outcome"]["false"]


def test_a_refused_diagnosis_counts_as_unnamed(robot):
    draw = {"hidden": 1}
    named = judge(
        truth(hidden("effort_offset", J1, offset=1.0)), [finding("effort_offset", J1, offset=1.0)], robot
    )
    records = [
        {"status": "diagnosed", "draw": draw, "outcome": named, "over_floor": 1.0, "cpu_seconds": 1.0},
        {"status": "refused", "draw": draw, "truth": [hidden("effort_offset", J1, offset=1.0)]},
    ]
    totals = Totals(records)
    assert (totals.named(), totals.all_named(), totals.false_findings()) == (0.5, 0.5, 0.0)
    assert "refused" in text(confusion(records)).splitlines()[0]


def test_halves_of_a_recording_agree_differ_or_list_a_rival():
    def report(*findings: dict[str, Any]) -> dict[str, Any]:
        return {"findings": findings, "gain": {"value": 0.5}, "unexplained": {"share": 0.01}}

    dry = finding("coulomb_friction", J1, coulomb=1.0, std=0.02)
    instead = finding("hysteresis", J1, rivals=({"effect": "coulomb_friction", "joint": J1},), force=1.0)
    spring = finding("joint_spring", J2, stiffness=2.0)
    drag = finding("quadratic_drag", J2, drag=1.0, std=0.01)
    other = finding("quadratic_drag", J2, drag=3.0, std=0.01)
    parts = {
        "whole": report(dry, spring, drag),
        "first half": report(dry, spring, drag),
        "second half": report(instead, other),
    }
    told = in_words({"arm": parts, "short": {"whole": report(dry)}})
    assert told.startswith(
        "Of 3 causes that a whole recording names, both halves name 1, 0 of them in the same size; 1 more"
    )
    _, rows = tables({"arm": parts})[0]
    assert [row[-1] for row in rows[1:4]] == ["one", "one", "differ"] and rows[1][3] == "a rival"


def test_every_way_to_spoil_a_recording_leaves_one_that_differs():
    time = np.arange(5000) / 500.0
    position = np.stack([np.sin(2.0 * time), np.cos(time)], axis=1)
    rng = np.random.default_rng(0)
    effort = position + 0.01 * rng.standard_normal(position.shape)
    recording = Recording(time, ("a", "b"), position, np.gradient(position, time, axis=0), effort)
    for way, misread in WAYS.items():
        spoiled = misread(recording, np.random.default_rng(1))
        same = len(spoiled) == len(recording) and all(
            np.array_equal(getattr(spoiled, field), getattr(recording, field))
            for field in ("time", "position", "velocity", "effort")
            if getattr(spoiled, field) is not None
        )
        assert (same and spoiled.velocity is not None) == (way == "as recorded"), way


def test_ways_are_told_apart_in_their_order():
    outcome = {"hidden": [], "false": ["x"], "true": []}
    records = [
        {"way": way, "status": "diagnosed", "truth": [], "outcome": outcome, "cpu_seconds": 1.0}
        for way in reversed(WAYS)
    ]
    head, *rows = table(records)
    assert [row[0] for row in rows] == list(WAYS)
    assert {row[head.index("false findings")] for row in rows} == {"1"}
