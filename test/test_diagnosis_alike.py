"""All links off by one factor: efforts in another unit do the same."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_cases import equations_of, white

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.result import Finding, Quantity, Rival
from bdnn_ros.diagnosis.sentences import Kind
from bdnn_ros.diagnosis.telling.alike import Common, common, tied, untold
from bdnn_ros.effects.registry import get
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm6")
STD = 0.05
LINKS = [Term(get("link_inertia"), k, f"arm6_link{k + 1}") for k in range(1, 4)]


def found(masses: np.ndarray, own: float = 0.03) -> Common | None:
    """What a recording tells of links whose masses are off by so much, and all else of them by a few per cent."""
    errors = own * np.random.default_rng(1).standard_normal(6 * PER_LINK)
    errors[::PER_LINK] += masses
    equations = equations_of((), "arm6", errors)
    error, noise = white(equations, STD)
    equations = equations.with_target(equations.rows.target + error)
    motion = equations.motion
    terms = [term.shaped(term.shapes(motion)[0]) for term in LINKS]
    return common(equations, Pool(equations, noise, terms, 0.05))


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_one_factor_of_all_links_is_told_as_that_of_the_efforts(factor):
    alike = found(np.full(6, factor - 1.0))
    assert alike is not None and abs(alike.factor - factor) < 3.0 * alike.std < 0.1


@pytest.mark.parametrize(
    "masses",
    [np.zeros(6), np.array([0.0, 0.25, 0.25, 0.25, 0.0, 0.0]), np.array([0.2, -0.3, 0.3, 0, -0.2, 0.2])],
)
def test_links_that_are_off_each_by_itself_are_not(masses):
    assert found(masses) is None


def test_hardly_any_noise_does_not_lose_the_factor_in_rounding():
    errors = np.zeros(6 * PER_LINK)
    errors[::PER_LINK] = 0.25
    equations = equations_of((), "arm6", errors)
    _, noise = white(equations, 1e-6)
    alike = common(equations, Pool(equations, noise, [], 0.05))
    assert alike is not None and alike.factor == pytest.approx(1.25, abs=0.06)


def of_link(scale: float, std: float = 0.05) -> Finding:
    parameters = {"scale": Quantity(scale, std, "-")}
    rival = Rival("payload", None, "l", 0.02)
    return Finding("link_inertia", None, "l", parameters, 0.1, 0.96, (rival,), "")


def test_links_that_agree_on_a_factor_are_a_tie_with_the_unit_of_the_efforts():
    """Even odds: no motion tells them apart. A link of its own factor is none, and two may agree by chance."""
    alike, agree, other = Common(1.25, 0.02), of_link(1.2), of_link(0.7)
    told = tied([agree, other, agree, agree], alike)
    assert [one.probability for one in told] == [0.48, 0.96, 0.48, 0.48]
    assert told[0].rivals == (Rival("effort_scale", None, None, 0.48), *agree.rivals)
    assert told[0].rivals[0].where == "all joints" and untold(told)
    for findings, factor in (
        ([agree, other, agree], alike),
        ([agree] * 3, None),
        ([agree] * 3, Common(1.5, 0.02)),
    ):
        assert tied(findings, factor) == findings and not untold(findings)
    assert tied([], alike) == []
    assert "an effort_scale of 0.80 at all joints" in alike.note(Kind.ALIKE).sentence(False)


def of_joint(effect: str, **parameters: tuple[float, float, str]) -> Finding:
    numbers = {name: Quantity(*one) for name, one in parameters.items()}
    return Finding(effect, "j", None, numbers, 0.1, 1.0, (), "")


def test_where_efforts_of_several_joints_are_scaled_those_of_the_others_may_be_too():
    """All that is measured in efforts is then off by the common factor; angles, places and ratios are not."""
    scale = of_joint("effort_scale", scale=(1.5, 0.01, "-"))
    payload = of_joint("payload", mass=(2.0, 0.03, "kg"), com_x=(0.1, 0.01, "m"))
    friction = of_joint("stribeck_friction", coulomb=(1.0, 0.01, "N*m"), velocity=(0.05, 0.01, "rad/s"))
    body = of_joint("link_inertia", scale=(1.1, 0.02, "-"), nominal_mass=(2.0, 1e-9, "kg"))
    findings, alike = [scale, payload, friction, body, scale], Common(1.25, 0.02)
    told = [one.parameters for one in tied(findings, alike)]
    assert [one["scale"].std for one in (told[0], told[4])] == [pytest.approx(np.hypot(0.3, 0.01))] * 2
    assert told[1]["mass"].std == pytest.approx(np.hypot(0.4, 0.03)) and told[1]["com_x"].std == 0.01
    assert told[2]["coulomb"].std == pytest.approx(0.2, rel=0.01) and told[2]["velocity"].std == 0.01
    assert told[3] == body.parameters
    assert untold(findings)
    for few, factor in ((findings[:4], alike), (findings, None)):
        assert tied(few, factor) == few and untold(few) == (few is findings)


@pytest.mark.parametrize(("joints", "ratio", "others"), [((1, 2, 3), 0.8, 1.0), ((2, 3), 1.55, 0.87)])
def test_a_motor_type_with_a_wrong_constant_may_not_be_the_only_one(joints, ratio, others):
    """Efforts of some joints that act so many times as much as those of the others tell the ratio, not both.

    No single one of them helps: links that are all off make up for most of it.
    """
    scales = [ratio * others if k in joints else others for k in range(1, 7)]
    hidden = [f"effort_scale@arm6_joint{k}:scale={one}" for k, one in enumerate(scales, 1) if one != 1.0]
    made, _ = Scenario(ARM, hidden, seed=3, duration=20.0, rate=200.0).run()
    diagnosis = diagnose([made.recording], ARM)
    told = {one.joint: one.parameters["scale"] for one in diagnosis.findings if one.effect == "effort_scale"}
    assert set(told) == {f"arm6_joint{k}" for k in joints}
    for k in joints:
        one = told[f"arm6_joint{k}"]
        assert one.value == pytest.approx(scales[k - 1], abs=2.5 * one.std)
    assert (Kind.ALIKE in diagnosis.kinds) == (others != 1.0)
    assert (Kind.SCALED in diagnosis.kinds) == (others == 1.0)
    assert any("hang a known mass" in advice for advice in diagnosis.advice) == (others != 1.0)
