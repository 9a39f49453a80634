"""The registry: the contract's vocabulary, complete metadata, specifications."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from effect_cases import SPECS, robot

from bdnn_ros.effects.document import document
from bdnn_ros.effects.registry import ALL, EFFECTS, get, parse_spec, variants
from bdnn_ros.errors import UsageError

VOCABULARY = {
    "coulomb_friction": {"coulomb": "N*m"},
    "viscous_friction": {"viscous": "N*m*s/rad"},
    "stribeck_friction": {"coulomb": "N*m", "static": "N*m", "velocity": "rad/s"},
    "asymmetric_friction": {"positive": "N*m", "negative": "N*m"},
    "load_dependent_friction": {"ratio": "-"},
    "quadratic_drag": {"drag": "N*m*s^2/rad^2"},
    "hysteresis": {"force": "N*m", "breakaway": "rad"},
    "armature": {"armature": "kg*m^2"},
    "payload": {"mass": "kg", "com_x": "m", "com_y": "m", "com_z": "m"},
    "link_inertia": {"mass": "kg", "nominal_mass": "kg", "scale": "-"},
    "base_tilt": {"roll_deg": "deg", "pitch_deg": "deg"},
    "joint_spring": {"stiffness": "N*m/rad", "rest": "rad"},
    "effort_offset": {"offset": "N*m"},
    "effort_scale": {"scale": "-"},
    "effort_delay": {"delay": "s"},
    "cogging": {"amplitude": "N*m", "periods_per_rev": "-", "phase": "rad"},
    "backlash": {"gap": "rad"},
    "joint_elasticity": {"stiffness": "N*m/rad"},
    "position_offset": {"offset": "rad"},
    "velocity_filter": {"cutoff": "Hz"},
    "external_wrench": {"start": "s", "end": "s", "force_x": "N", "torque_z": "N*m"},
    "drift": {"start_value": "N*m", "end_value": "N*m"},
}
PLACES = {"base_tilt": {"base"}, "payload": {"link"}, "link_inertia": {"link"}}
PLACES |= {"effort_delay": {"all", "joint"}, "external_wrench": {"link", "joint"}}


def test_the_registry_is_the_contracts_vocabulary():
    assert list(EFFECTS) == list(VOCABULARY)


@pytest.mark.parametrize("name", VOCABULARY)
def test_parameters_and_places_are_the_contracts(name):
    units = {parameter.name: parameter.unit for parameter in EFFECTS[name].parameters}
    assert VOCABULARY[name].items() <= units.items()
    where = {place for effect in variants(name) for place in (effect.on, *effect.also_on)}
    assert where == PLACES.get(name, {"joint"})


@pytest.mark.parametrize("effect", ALL, ids=lambda effect: f"{effect.name}-{effect.variant}")
def test_every_effect_says_all_of_itself(effect):
    assert effect.title and effect.equation and effect.shown_by and effect.__doc__
    assert re.search(r"(19|20)\d\d|ch\. \d", effect.source)
    assert effect.confused_with and set(effect.confused_with) <= set(EFFECTS) - {effect.name}
    assert set(effect.contains) <= set(EFFECTS)
    for parameter in effect.parameters:
        assert parameter.lower < parameter.upper
        low, high = parameter.plausible
        assert parameter.of_effort or parameter.lower <= low <= high <= parameter.upper


@pytest.mark.parametrize("spec", SPECS)
def test_a_specification_names_effect_place_and_numbers(spec):
    arm = robot()
    one = parse_spec(spec, arm)
    head, _, tail = spec.partition(":")
    name, _, place = head.partition("@")
    assert one.effect.name == name
    assert one.place(arm) == (place or {"base_tilt": "base"}.get(name, "all joints"))
    for item in filter(None, tail.split(",")):
        key, _, text = item.partition("=")
        if key != "of":
            assert one.values[key] == float(text)
    truth = one.as_truth(arm)
    assert truth["effect"] == name
    assert place in (truth["joint"] or "", truth["link"] or "")
    sentence = one.effect.sentence(one.place(arm), one.values)
    assert sentence.endswith(".") and (place in sentence or not place)


@pytest.mark.parametrize("spec", SPECS)
def test_places_hold_where_the_specification_puts_it(spec):
    arm = robot()
    one = parse_spec(spec, arm)
    link = arm.moving_link(arm.joints[one.target]) if one.link else None
    assert (one.target, link) in one.effect.places(arm)


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ("rust@arm7_joint1:amount=1", "There are coulomb_friction"),
        ("coulomb_friction:coulomb=1", "does not say where"),
        ("coulomb_friction@elbow:coulomb=1", "arm7_joint1"),
        ("coulomb_friction@arm7_joint1", "leaves out coulomb"),
        ("coulomb_friction@arm7_joint1:coulomb=-1", "out of bounds. It is 0 N·m or more."),
        ("effort_scale@arm7_joint1:scale=9e9", "out of bounds. It lies between"),
        ("effort_offset@arm7_joint1:offset=nan", "It is a number."),
        ("coulomb_friction@arm7_joint1:coulomb=nan", "out of bounds"),
        ("joint_elasticity@arm7_joint1:stiffness=0", "out of bounds"),
        ("coulomb_friction@arm7_joint1:coulomb=much", "not a number"),
        ("coulomb_friction@arm7_joint1:coulomb", "not key=value"),
        ("coulomb_friction@arm7_joint1:coulomb=1,coulomb=2", "given twice"),
        ("coulomb_friction@arm7_joint1:friction=1", "It has coulomb"),
        ("stribeck_friction@arm7_joint1:coulomb=2,static=1,velocity=0.1", "static >= coulomb"),
        ("payload@arm7_link0:mass=1", "does not move"),
        ("link_inertia@arm7_link4", "leaves out"),
        ("link_inertia@arm7_link4:mass=5,scale=1.2", "contradicts itself"),
        (
            "link_inertia@arm7_link4:mass=0.01",
            "mass=0.01 in 'link_inertia@arm7_link4:mass=0.01' makes scale 0.00278715, which is out of bounds. "
            "It lies between 0.05 and 10.",
        ),
        ("drift@arm7_joint1:of=mood,start_value=1,end_value=2", "no variant"),
        ("effort_delay@arm7_link1:delay=0.01", "acts on all or a joint"),
    ],
)
def test_a_wrong_specification_is_refused_with_a_remedy(spec, says):
    with pytest.raises(UsageError, match=re.escape(says)):
        parse_spec(spec, robot())


def test_a_joint_stands_for_the_link_it_moves():
    one = parse_spec("payload@arm7_joint7:mass=1", robot())
    assert (one.link, one.target) == ("arm7_link7", 6)


def test_a_scaled_link_knows_its_masses():
    one = parse_spec("link_inertia@arm7_link4:mass=7.17579", robot())
    assert one.values == pytest.approx({"mass": 7.17579, "nominal_mass": 3.587895, "scale": 2.0})


@pytest.mark.parametrize(
    ("spec", "variant", "link"),
    [
        ("drift@arm7_joint1:start_value=1,end_value=2", "coulomb", None),
        ("drift@arm7_joint1:of=offset,start_value=-1,end_value=2", "offset", None),
        ("external_wrench@arm7_joint4:start=1,end=2,torque=3", "joint", None),
        ("external_wrench@arm7_joint4:start=1,end=2,torque_z=3", "link", "arm7_link4"),
        ("external_wrench@arm7_link4:start=1,end=2,force_x=3", "link", "arm7_link4"),
    ],
)
def test_of_several_variants_the_parameters_tell_which(spec, variant, link):
    one = parse_spec(spec, robot())
    assert (one.effect.variant, one.link) == (variant, link)


def test_a_drift_ends_with_the_recording():
    one = parse_spec("drift@arm7_joint1:of=offset,start_value=0,end_value=1", robot())
    assert math.isinf(one.values["end"])
    assert one.within(12.0).values["end"] == 12.0
    assert one.within(12.0).within(20.0).values["end"] == 12.0


def test_variants_are_found_by_name():
    assert [effect.variant for effect in variants("drift")] == ["coulomb", "viscous", "offset"]
    assert get("drift", "offset").coefficient_bounds[0][0] == -np.inf
    with pytest.raises(UsageError, match="no variant"):
        get("drift", "mood")


def test_the_documentation_is_up_to_date():
    path = Path(__file__).parent.parent / "docs" / "effects.md"
    assert path.read_text(encoding="utf-8") == document(), "run python -m bdnn_ros.effects.document"


def test_a_gear_of_a_desk_robot_may_be_soft():
    """Its joints bear thousandths of a newton metre."""
    assert parse_spec("joint_elasticity@arm7_joint7:stiffness=0.05", robot()).values["stiffness"] == 0.05
