"""Damaged models: what is missing or makes no sense is named, and nothing is said in Python."""

from __future__ import annotations

import re

import numpy as np
import pytest
from bdnn_cases import black_box

from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.dynamics import BDNNOnPrior
from bdnn_ros.bdnn.field import Scales
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.errors import ModelFileError, UsageError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.models import Model, build_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot
from bdnn_ros.robot.entries import reading


def models() -> dict[str, Model]:
    """One of every kind."""
    robot = Robot.bundled("arm2")
    physical = PhysicalModel(robot, np.zeros(2), np.eye(28), np.zeros(2))
    core = PriorCore(robot, LocalNetworks.silent(np.ones(2), np.ones(2)), None, np.full(2, 0.05))
    scales = Scales(np.ones(2), np.full(2, 5.0), np.full(2, 10.0), np.full(2, 0.1))
    return {
        "physical": physical,
        "extended": ExtendedModel(robot, (), np.zeros(2), beyond=physical),
        "bdnn": black_box(("a", "b"), scales),
        "bdnn_on_prior": BDNNOnPrior(core),
    }


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        ("physical", "lead", None),
        ("physical", "version", "ten"),
        ("physical", "version", np.inf),
        ("physical", "breakaway", [99]),
        ("physical", "motors", [1, 2]),
        ("physical", "held", [1]),
        ("extended", "lead", None),
        ("extended", "stds", 7),
        ("extended", "sticking", ["much"]),
        ("extended", "recorded", ["long ago"]),
        ("extended", "effects", 7),
        ("bdnn", "joints", 7),
        ("bdnn", "h", 7),
        ("bdnn_on_prior", "harmonics", [1]),
        ("bdnn_on_prior", "prior", 7),
    ],
)
def test_an_entry_that_makes_no_sense_is_named(kind: str, key: str, value: object) -> None:
    arrays, info = models()[kind].to_state()
    info[key] = value
    with pytest.raises(ModelFileError, match=f"^The .* is damaged at or near its entry {key}\\. ") as refused:
        build_model(kind, arrays, info)
    assert not re.search(r"Error|[()\[\]]", str(refused.value))


@pytest.mark.parametrize("kind", list(models()))
def test_what_is_missing_is_named(kind: str) -> None:
    arrays, info = models()[kind].to_state()
    optional = {"held", "lead_std", "lag", "tilt_std", "zeros_std", "sticking", "creep", "lead", "core"}
    optional |= {"networks", "velocity_lags"}
    for key in [
        *(name for name in arrays if not name.endswith("zeros")),
        *(name for name in info if name not in optional),
    ]:
        rest, told = dict(arrays), dict(info)
        rest.pop(key, None)
        told.pop(key, None)
        with pytest.raises(ModelFileError) as refused:
            build_model(kind, rest, told)
        assert key.split(".")[-1] in refused.value.problem
        assert not re.search(r"Error|[()'\[\]]", refused.value.problem)


@pytest.mark.parametrize("kind", list(models()))
def test_an_array_of_another_shape_is_named(kind: str) -> None:
    arrays, info = models()[kind].to_state()
    for key, array in arrays.items():
        if not array.size:
            continue
        for other in (array[:-1], array[..., None], np.zeros(0)):
            with pytest.raises(ModelFileError) as refused:
                build_model(kind, {**arrays, key: other}, info)
            # a network's size is told by one of its arrays: another may then seem the wrong one
            there = key.split(".")[-1].split("_")[0] if key[:2] not in ("h.", "r.") else ""
            assert there in refused.value.problem
            assert re.search(r"damaged at or near its entry \S+\.$", refused.value.problem)


@pytest.mark.parametrize("kind", ["physical", "extended", "bdnn_on_prior"])
def test_a_robot_of_what_is_no_number_is_refused(kind: str) -> None:
    arrays, info = models()[kind].to_state()
    key = next(name for name in arrays if name.endswith("armature"))
    with pytest.raises(ModelFileError, match="armature"):
        build_model(kind, {**arrays, key: np.full(2, np.nan)}, info)


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        ("physical", "breakaway", [0]),
        ("extended", "sticking", [0.1]),
        ("extended", "creep", [[0.1, 0.1], [0.1, 0.1]]),
        ("bdnn", "h", {"activation": "none of these", "bound": 1.0}),
    ],
)
def test_an_entry_that_does_not_fit_the_joints_is_named(kind: str, key: str, value: object) -> None:
    arrays, info = models()[kind].to_state()
    with pytest.raises(ModelFileError, match=f"at or near its entry {key}\\. "):
        build_model(kind, arrays, {**info, key: value})


def test_the_kind_of_the_refusal_is_the_readers() -> None:
    with (
        pytest.raises(UsageError, match=r"x.json is incomplete: it lacks b. Write it again."),
        reading("x.json", "Write it again.", {"a": 1}, error=UsageError) as (content,),
    ):
        content["b"]
