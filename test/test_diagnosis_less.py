"""What became less since an earlier diagnosis, of effects that its robot cannot hold: named with how much less there is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.effects.registry import get, parse_spec
from bdnn_ros.extension.effects_file import EffectsFile, effects_text
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.merging import merged
from bdnn_ros.extension.urdf import beside_urdf, extended_urdf
from bdnn_ros.models import load_model, save_model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mounting import tilt_of
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm2")
FIRST, SECOND = ARM.joints


def model_of(*effects: str) -> ExtendedModel:
    return ExtendedModel(ARM, tuple(parse_spec(spec, ARM) for spec in effects), np.full(2, 0.01))


@cache
def recorded(*now: str) -> Recording:
    """A recording of a robot with some effects."""
    return Scenario(ARM, now, seed=3, duration=24.0, rate=200.0).run()[0].recording


def compared(earlier: ExtendedModel, *now: str) -> Examination:
    """A recording of a robot with some effects, diagnosed against a model of it with others."""
    return examine([recorded(*now)], earlier.robot, model=earlier)


def error(model: ExtendedModel, *now: str) -> np.ndarray:
    """Of a model's effort along a recording, root mean square behind the low-pass, (n,) [N·m]."""
    signals = prepare(recorded(*now))
    left = signals.smooth(model.predict(signals) - signals.effort)[signals.interior]
    return np.asarray(np.sqrt(np.mean(left**2, axis=0)))


@pytest.mark.parametrize(
    ("before", "now", "told", "less", "left"),
    [
        ("coulomb_friction:coulomb=1.0", "coulomb_friction:coulomb=0.4", "coulomb_friction", {"coulomb": -0.6}, 0.4),
        ("quadratic_drag:drag=0.4", "", "quadratic_drag", {"drag": -0.4}, None),
        (
            "hysteresis:force=1.5,breakaway=0.04",
            "hysteresis:force=0.5,breakaway=0.04",
            "hysteresis",
            {"force": -1.0, "breakaway": 0.04},
            0.5,
        ),
        (
            "stribeck_friction:coulomb=0.6,static=1.5,velocity=0.1",
            "",
            "stribeck_friction",
            {"coulomb": -0.6, "static": -1.5, "velocity": 0.1},
            None,
        ),
        (
            "stribeck_friction:coulomb=0.6,static=1.5,velocity=0.1",
            "stribeck_friction:coulomb=0.3,static=1.2,velocity=0.1",
            "coulomb_friction",
            {"coulomb": -0.3},
            0.3,
        ),
        (
            "joint_spring:stiffness=2,rest=0.3",
            "joint_spring:stiffness=1.4,rest=0.3",
            "joint_spring",
            {"stiffness": -0.6, "rest": 0.3},
            1.4,
        ),
        ("joint_elasticity:stiffness=300", "joint_elasticity:stiffness=900", "joint_elasticity", {"stiffness": -450.0}, 900.0),
        ("effort_delay:delay=0.02", "", "effort_delay", {"delay": -0.02}, None),
    ],
)  # fmt: skip
def test_what_became_less_is_told_alone_and_taken_from_what_there_was(
    before: str, now: str, told: str, less: dict[str, float], left: float | None, tmp_path: Path
) -> None:
    earlier, specs = model_of(at(before)), [at(now)] if now else []
    examination = compared(earlier, *specs)
    (finding,) = examination.diagnosis.findings
    assert (finding.effect, finding.joint) == (told, FIRST)
    assert {name: q.value for name, q in finding.parameters.items()} == pytest.approx(
        less, rel=0.05, abs=0.01
    )
    assert " less " in finding.sentence
    assert all(
        (q.std == 0.0) == (name in ("breakaway", "velocity")) for name, q in finding.parameters.items()
    )
    model = extend(examination)
    assert (error(model, *specs) < 1.1 * error(model_of(*specs), *specs) + 1e-3).all()
    kept = [effect for effect in model.effects if effect.effect.name == before.split(":")[0]]
    assert [next(iter(effect.values.values())) for effect in kept] == (
        [] if left is None else [pytest.approx(left, rel=0.05)]
    )
    # what is handed over is read again, and no joint rubs by less than nothing
    path = tmp_path / "effects.yaml"
    path.write_text(effects_text(beside_urdf(model), model.robot))
    described = Robot.from_urdf(extended_urdf(model), ARM.joints)
    assert len(EffectsFile.read(path).effects(described)) == len(beside_urdf(model))
    assert (described.coulomb >= 0.0).all()


@pytest.mark.slow
def test_dry_friction_that_is_as_it_was_may_hold_a_joint_that_rests():
    same = f"coulomb_friction@{SECOND}:coulomb=1.0"
    diagnosis = compared(model_of(same), same).diagnosis
    assert (diagnosis.verdict, diagnosis.findings) == ("nothing_wrong", ())


def test_what_two_diagnoses_found_together_is_read_again(tmp_path):
    """A scale of a scale, a delay on top of a delay: more than either may be."""
    specs = (f"effort_scale@{FIRST}:scale=0.3", f"effort_delay@{SECOND}:delay=0.15")
    known = [(one, {}) for one in model_of(*specs).effects]
    both = merged(ARM, [*known, *known])
    model = ExtendedModel(ARM, tuple(one for one, _ in both), np.full(2, 0.01))
    save_model(tmp_path, model)
    read = load_model(tmp_path)
    assert isinstance(read, ExtendedModel)
    assert [one.values for one in read.effects] == [
        {"scale": pytest.approx(0.09)},
        {"delay": pytest.approx(0.3)},
    ]


def at(spec: str) -> str:
    """A specification at the first joint."""
    name, _, values = spec.partition(":")
    return f"{name}@{FIRST}:{values}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("now", "told", "values"),
    [
        ("payload@arm2_link2:mass=0.8,com_x=0.1", "payload", {"mass": 0.8, "com_x": 0.1}),
        (f"viscous_friction@{SECOND}:viscous=0.5", "viscous_friction", {"viscous": 0.5}),
        (None, "load_dependent_friction", {"ratio": -0.1}),
    ],
)
def test_friction_of_an_earlier_model_grows_with_the_load_that_is_found(now, told, values):
    loaded = f"load_dependent_friction@{SECOND}:ratio="
    specs = [f"{loaded}0.2", now] if now else [f"{loaded}0.1"]
    examination = compared(model_of(f"{loaded}0.2"), *specs)
    (finding,) = examination.diagnosis.findings
    assert finding.effect == told
    found = {name: finding.parameters[name].value for name in values}
    assert found == pytest.approx(values, rel=0.02)
    assert (error(extend(examination), *specs) < 1.1 * error(model_of(*specs), *specs)).all()


@pytest.mark.slow
def test_a_base_that_was_tilted_far_is_told_to_be_tilted_a_little_further():
    robot = Robot.bundled("arm6")
    earlier = ExtendedModel(robot, (parse_spec("base_tilt:pitch_deg=40", robot),), np.full(6, 0.01))
    scenario = Scenario(robot, ["base_tilt:roll_deg=2,pitch_deg=45"], seed=3, duration=15.0, rate=200.0)
    examination = examine([scenario.run()[0].recording], earlier.robot, model=earlier)
    (finding,) = examination.diagnosis.findings
    values = {name: quantity.value for name, quantity in finding.parameters.items()}
    assert values == pytest.approx({"roll_deg": 2.0, "pitch_deg": 5.0}, abs=0.1)
    stands = np.degrees(tilt_of(extend(examination).robot.gravity_vector))
    assert stands == pytest.approx([2.0, 45.0], abs=0.1)


def test_there_is_only_as_much_less_as_an_earlier_model_had():
    held = {
        "coulomb_friction": [{"coulomb": 0.5}],
        "stribeck_friction": [{"coulomb": 0.3, "static": 0.7, "velocity": 0.1}],
        "asymmetric_friction": [{"positive": 0.2, "negative": 0.1}],
    }
    robot = ARM.with_joint_parameters(coulomb=np.array([1.0, 0.0]))

    def lowest(name: str) -> list[float]:
        return [bounds[0] for bounds in get(name).since(robot, 0, None, held).coefficient_bounds]

    assert lowest("coulomb_friction") == pytest.approx([-1.9])
    assert lowest("asymmetric_friction") == pytest.approx([-2.0, -1.9])
    assert lowest("stribeck_friction") == pytest.approx([-1.9, -0.4])
    assert get("stribeck_friction").since(robot, 0, None, held).kept == {"velocity": 0.1}
    assert lowest("hysteresis") == lowest("quadratic_drag") == lowest("joint_elasticity") == [0.0]
    assert get("coulomb_friction").coefficient_bounds == ((0.0, np.inf),)


def test_found_effects_are_one_with_the_earlier_ones_where_that_says_the_same():
    spring, offset = (f"joint_spring@{FIRST}:stiffness=2,rest={rest}" for rest in (0.3, 0.5))
    before = model_of(spring, f"quadratic_drag@{SECOND}:drag=0.5").effects
    known = list(zip(before, ({}, {"drag": 0.03}), strict=True))
    gone = parse_spec(spring, ARM), parse_spec(offset, ARM)
    less = [replace(one, values={**one.values, "stiffness": -2.0}) for one in gone]
    more = parse_spec(f"quadratic_drag@{SECOND}:drag=0.25", ARM)
    ((drag, std),) = merged(ARM, [*known, (less[0], {}), (more, {"drag": 0.04})])
    assert (drag.effect.name, drag.values) == ("quadratic_drag", {"drag": 0.75})
    assert std == {"drag": pytest.approx(0.05)}
    # a spring that is gone where it did not rest leaves a constant
    (constant, _), _ = merged(ARM, [*known, (less[1], {})])
    assert (constant.effect.name, constant.target) == ("effort_offset", 0)
    assert constant.values["offset"] == pytest.approx(-0.4)
