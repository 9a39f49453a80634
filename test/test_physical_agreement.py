"""Several recordings of one robot: where they agree, where they differ more than their errors allow."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.checks.data import Remark
from bdnn_ros.errors import UsageError
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical import parameters_report
from bdnn_ros.physical.agreement import Agreement, agreement
from bdnn_ros.physical.combinations import combinations
from bdnn_ros.physical.dictionary import FEATURES, Scales
from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import fourier

RATE = 200.0
CHANGED = 1
MORE = 1.5
"""What the changed joint's Coulomb friction gains [N·m]."""


def recorded(robot, seed, more=0.0, duration=15.0):
    """A motion of a worn robot, one joint of which has more friction."""
    generator = np.random.default_rng(seed)
    plan = fourier(robot, np.arange(0.0, duration, 1.0 / RATE), generator)
    n = robot.width
    coulomb = np.full(n, 2.0)
    coulomb[CHANGED] += more
    real = robot.with_joint_parameters(np.full(n, 0.1), np.full(n, 2.0), coulomb)
    effort = real.inverse_dynamics(plan.position, plan.velocity, plan.acceleration)
    effort = effort + 0.005 * np.ptp(effort, axis=0) * generator.normal(size=effort.shape)
    return Recording(plan.time, robot.joints, plan.position, None, effort, name=f"motion {seed}")


@pytest.fixture(scope="module")
def robot():
    return Robot.bundled("arm6")


@pytest.fixture(scope="module")
def models(robot):
    return [Identifier(robot).fit([recorded(robot, seed)]) for seed in range(3)]


@pytest.fixture(scope="module")
def changed(robot):
    return Identifier(robot).fit([recorded(robot, 3, MORE)])


def named(found, words):
    return next(one for one in found if one.words == words)


def test_recordings_of_an_unchanged_robot_agree(models):
    found = agreement(models)
    assert [one.words for one in found if one.differs] == []
    assert len(found) == len(combinations(models[0].robot))


def test_friction_that_changed_in_between_is_the_one_that_differs(robot, models, changed):
    found = agreement([*models, changed])
    words = f"Coulomb friction of {robot.joints[CHANGED]}"
    assert [one.words for one in found if one.differs] == [words]
    one = named(found, words)
    np.testing.assert_allclose(one.values, [2.0, 2.0, 2.0, 2.0 + MORE], atol=0.1)
    assert "disagree" in one.sentence()
    assert words in one.sentence()
    assert "N*m" in one.sentence()


def test_mean_and_spread_are_those_of_the_values(models):
    one = named(agreement(models), f"viscous friction of {models[0].joints[0]}")
    weights = 1.0 / one.stds**2
    assert one.mean == pytest.approx(weights @ one.values / weights.sum())
    assert one.spread == pytest.approx(np.std(one.values, ddof=1))
    assert one.values.min() <= one.mean <= one.values.max()
    assert "agree" in one.sentence()


def test_doubt_excuses_a_difference(models, changed):
    """The same values with wide errors are no disagreement."""
    doubtful = [replace(model, covariance=model.covariance * 1e4) for model in (models[0], changed)]
    assert not any(one.differs for one in agreement(doubtful))
    assert any(one.differs for one in agreement([models[0], changed]))


def test_friction_beside_learned_terms_may_differ_by_motion(robot, models, changed):
    n = robot.width
    scales = Scales(np.ones(n), np.ones(n))
    groups = tuple(("curve",) if joint == CHANGED else () for joint in range(n))
    learned = LocalResiduals(groups, np.zeros((n, FEATURES)), np.zeros((n, 3)), scales)
    plain = [replace(model, learned=None) for model in (models[0], changed)]
    found = agreement([plain[0], replace(plain[1], learned=learned)])
    assert {one.words for one in found if one.by_motion} == {
        f"{word} of {robot.joints[CHANGED]}"
        for word in ("viscous friction", "Coulomb friction", "effort offset")
    }
    one = named(found, f"Coulomb friction of {robot.joints[CHANGED]}")
    assert one.differs
    assert "not Coulomb and viscous alone" in one.sentence()
    assert not any(one.by_motion for one in agreement(plain))


@pytest.mark.slow
def test_bases_that_lean_otherwise_are_told_apart(robot):
    level, *turned = (
        Identifier(robot).fit([recorded(robot.tilted(*np.radians(angles)), seed)])
        for seed, angles in enumerate([(0.0, 0.0), (3.0, -2.0), (3.0, -2.5)])
    )
    found = agreement([level, *turned])
    roll, pitch = (named(found, f"{name} of the base") for name in ("roll", "pitch"))
    np.testing.assert_allclose(roll.values, 3.0, atol=0.05)
    np.testing.assert_allclose(pitch.values, [-2.0, -2.5], atol=0.05)
    assert pitch.differs and not roll.differs
    assert "deg" in pitch.sentence()
    assert not any("of the base" in one.words for one in agreement([level, turned[0]]))


@pytest.mark.slow
def test_zeros_are_compared_where_two_recordings_show_them(robot):
    models = [
        Identifier(robot).fit([recorded(replace(robot, zeros=np.eye(robot.width)[1] * zero), seed)])
        for seed, zero in enumerate([0.0, 0.05, 0.08])
    ]
    (found,) = (one for one in agreement(models) if one.words.startswith("zero of"))
    assert found.words == f"zero of {robot.joints[1]}" and found.differs
    np.testing.assert_allclose(found.values, [0.05, 0.08], atol=5e-3)
    assert not any("zero of" in one.words for one in agreement(models[:2]))


def test_one_recording_or_another_robot_is_refused(models):
    with pytest.raises(UsageError, match="two or more"):
        agreement(models[:1])
    other = Identifier(Robot.bundled("arm2")).fit([recorded(Robot.bundled("arm2"), 0)])
    with pytest.raises(UsageError, match="one robot"):
        agreement([models[0], other])


def test_the_report_holds_values_errors_and_what_differs(models):
    model = models[0]
    remark = Remark("a joint", "It is odd.", "Mend it.")
    one = Agreement("mass", "kg", np.array([1.0, 2.0]), np.array([0.1, 0.1]), 1.5, 0.7, True)
    report = json.loads(json.dumps(parameters_report.as_json(model, [remark], [one]), allow_nan=False))
    assert (report["format"], report["version"]) == ("bdnn_ros/parameters", 1)
    assert report["joints"] == list(model.joints)
    values = {row["name"]: row for row in report["parameters"]}
    assert len(values) == len(report["parameters"]) == 14 * model.robot.width
    row = values[f"{model.joints[2]}.coulomb"]
    assert row == {
        "name": f"{model.joints[2]}.coulomb",
        "value": model.robot.coulomb[2],
        "std": model.std.coulomb[2],
        "unit": "N*m",
    }
    assert all(row["std"] >= 0.0 for row in report["parameters"])
    assert [c["words"] for c in report["combinations"]] == [c.words for c in combinations(model.robot)]
    assert report["remarks"] == [{"about": "a joint", "problem": "It is odd.", "remedy": "Mend it."}]
    assert report["agreement"][0]["values"] == [1.0, 2.0]
    assert report["agreement"][0]["differs"] is True
    assert [term["joint"] for term in report["terms"]] == list(model.joints)


def test_a_combination_is_known_better_than_its_parts(models):
    """Of a body's inertias only combinations act, so a sum is certain where its parts are not."""
    model = models[0]
    report = parameters_report.as_json(model)
    single = {row["name"]: row["std"] for row in report["parameters"]}
    joint = model.joints[1]
    words = f"mass times centre along x of {model.robot.moving_link(joint)}"
    combined = next(c["std"] for c in report["combinations"] if c["words"].startswith(words))
    assert combined < 0.2 * single[f"{joint}.mass_x"]
