"""diagnosis.json: the contract's keys and types, whole or not at all."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosis_cases import check_contract

from bdnn_ros.diagnosis.result import Diagnosis, Finding, Quantity, Rival
from bdnn_ros.effects.environment import ExternalTorque


@pytest.fixture
def diagnosis() -> Diagnosis:
    friction = Finding(
        effect="coulomb_friction",
        joint="panda_joint4",
        link=None,
        parameters={"coulomb": Quantity(1.2912345678, 0.03, "N*m")},
        share=0.81,
        probability=0.99,
        rivals=(Rival("viscous_friction", "panda_joint4", None, 0.01),),
        sentence="panda_joint4 has 1.29 N·m of Coulomb friction that the URDF leaves out.",
    )
    tilt = Finding(
        effect="base_tilt",
        joint=None,
        link=None,
        parameters={"roll_deg": Quantity(1.0, 0.1, "deg"), "pitch_deg": Quantity(-2.0, 0.1, "deg")},
        share=0.1,
        probability=0.7,
        rivals=(Rival("payload", None, "panda_link7", 0.3),),
        sentence="The base is tilted.",
    )
    return Diagnosis(
        source={
            "bags": ["one", "two"],
            "duration": 40.0,
            "samples": 20000,
            "rate": 500.0,
            "urdf": "panda.urdf",
            "joints": ["panda_joint4", "panda_joint5"],
        },
        verdict="explained",
        findings=(friction, tilt),
        effort_rmse={
            "simulation": np.array([1.0, 2.0]),
            "extended": np.array([0.1, 0.2]),
            "noise_floor": np.array([0.1, 0.19]),
        },
        gain=0.83,
        gain_interval=(0.81, 0.85),
        unexplained_share=0.05,
        unexplained_depends_on=("panda_joint4.position",),
        unexplained_sentence="5 % is left.",
        advice=("Record more.",),
    )


def test_it_has_the_contracts_form(diagnosis):
    report = diagnosis.as_json()
    check_contract(report)
    assert list(report)[:9] == [
        *("format", "version", "source", "verdict", "findings"),
        *("effort_rmse", "gain", "unexplained", "advice"),
    ]
    assert report["findings"][0] == {
        "effect": "coulomb_friction",
        "joint": "panda_joint4",
        "link": None,
        "parameters": {"coulomb": {"value": 1.29123, "std": 0.03, "unit": "N*m"}},
        "share": 0.81,
        "probability": 0.99,
        "rivals": [
            {"effect": "viscous_friction", "joint": "panda_joint4", "link": None, "probability": 0.01}
        ],
        "sentence": "panda_joint4 has 1.29 N·m of Coulomb friction that the URDF leaves out.",
    }
    assert report["gain"] == {"value": 0.83, "interval": [0.81, 0.85]}
    assert report["unexplained"] == {
        "share": 0.05,
        "depends_on": ["panda_joint4.position"],
        "sentence": "5 % is left.",
    }


@pytest.mark.parametrize("begun", [0.0, 2e4, 2e5])
def test_a_moment_is_told_to_the_millisecond_however_long_the_recording(diagnosis, begun):
    """Above 10 000 s the file told another time than the sentence."""
    push, values = ExternalTorque(), {"start": begun + 1.2344, "end": begun + 3.5678, "torque": 3.0}
    parameters = {name: Quantity(value, 0.01, "s") for name, value in values.items()}
    parameters["torque"] = Quantity(3.00000049, 0.01, "N*m")
    sentence = push.sentence("panda_joint4", values)
    finding = Finding(push.name, "panda_joint4", None, parameters, 0.5, 0.99, (), sentence, "joint")
    (told,) = replace(diagnosis, findings=(finding,)).as_json()["findings"]
    start, end, torque = (quantity["value"] for quantity in told["parameters"].values())
    assert start == round(begun + 1.234, 3) and end == round(begun + 3.568, 3) and torque == 3.0
    assert f"from {start:.2f} s to {end:.2f} s" in told["sentence"]


def test_the_file_says_the_same(diagnosis, tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text("older")
    diagnosis.save(path)
    assert json.loads(path.read_text(encoding="utf-8")) == json.loads(json.dumps(diagnosis.as_json()))
    assert [file.name for file in tmp_path.iterdir()] == ["diagnosis.json"]


def test_an_interrupted_write_leaves_the_old_file(diagnosis, tmp_path, monkeypatch):
    path = tmp_path / "diagnosis.json"
    path.write_text("older")
    full = OSError("no space left")

    def fail(*_: object, **__: object) -> None:
        raise full

    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(OSError, match="no space"):
        diagnosis.save(path)
    assert path.read_text() == "older"


def test_where_it_sits(diagnosis):
    friction, tilt = diagnosis.findings
    assert (friction.where, tilt.where) == ("panda_joint4", "base")
    assert replace(friction, effect="effort_delay", joint=None).where == "all joints"
    assert Rival("effort_delay", None, None, 0.4).where == "all joints"


@pytest.mark.parametrize(
    "damage",
    [
        lambda r: r.update(verdict="fine"),
        lambda r: r["findings"].reverse(),
        lambda r: r["findings"][0].pop("rivals"),
        lambda r: r["findings"][0].update(effect="ghosts"),
        lambda r: r["findings"][0].update(link="panda_link4"),
        lambda r: r["effort_rmse"].pop("extended"),
        lambda r: r["gain"].update(interval=[0.9, 0.95]),
    ],
)
def test_the_check_itself_can_fail(diagnosis, damage):
    report = diagnosis.as_json()
    damage(report)
    with pytest.raises((AssertionError, KeyError)):
        check_contract(report)
