"""What a diagnosis does not know of what acts at joints is no change in the next one."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import Examination, examine
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.known import Known
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.regression.unsure import ERROR_FACTOR, Unsure
from bdnn_ros.effects.registry import get, parse_spec
from bdnn_ros.errors import ModelFileError
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.unsure import joints_moved
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import score_model
from bdnn_ros.signals import flattened, prepare
from bdnn_ros.simulation.excitation import Trajectory, fourier
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm2")
FIRST, SECOND = ARM.joints
RUBS = (
    f"coulomb_friction@{FIRST}:coulomb=0.6",
    f"coulomb_friction@{SECOND}:coulomb=0.3",
    f"viscous_friction@{FIRST}:viscous=0.06",
    f"viscous_friction@{SECOND}:viscous=0.04",
)


@cache
def rubbing(seconds: float, pace: float, *effects: str) -> Recording:
    """A recording of a robot that rubs and takes its path so many times as fast as it could."""
    time = np.arange(round(200.0 * seconds)) / 200.0
    path = fourier(ARM, pace * time, np.random.default_rng(700001 + round(seconds)))
    plan = Trajectory(time, path.position, pace * path.velocity, pace**2 * path.acceleration)
    scenario = Scenario(ARM, (*RUBS, *effects), seed=700001, wrong=0.05, noise=0.03, plan=plan)
    return scenario.run()[0].recording


@pytest.fixture(scope="module")
def first() -> Examination:
    """A short diagnosis of slow motion, which calls a drag what is viscous friction."""
    return examine([rubbing(12.0, 0.5)], ARM)


@pytest.fixture(scope="module")
def model(first) -> ExtendedModel:
    return extend(first)


def test_a_model_knows_of_the_commonest_effects_how_well_they_are_known(model):
    """Also of what was not named; what is large without a name is as open as it is large."""
    own = {
        (term.effect.name, term.target): slot
        for term, slot in zip(model.unsure.terms, model.unsure.slots, strict=True)
    }
    stds = np.sqrt(np.diag(model.unsure.covariance))
    assert {
        (name, joint) for name in ("armature", "viscous_friction", "effort_offset") for joint in (0, 1)
    } < own.keys()
    for name, joint, true in (("coulomb_friction", 1, 0.3), ("coulomb_friction", 0, 0.6)):
        (told,) = (e.values["coulomb"] for e in model.effects if (e.effect.name, e.target) == (name, joint))
        assert abs(told - true) < 2.0 * ERROR_FACTOR * float(stds[own[name, joint]][0])
    assert stds[own["viscous_friction", 0]] > 0.03  # 0.06 is there


@pytest.mark.slow
@pytest.mark.parametrize(
    ("now", "told"),
    [
        ((), {}),
        ((f"coulomb_friction@{SECOND}:coulomb=0.09",), {("coulomb_friction", SECOND): 0.09}),
        (("payload@arm2_link2:mass=0.3,com_x=0.1",), {("payload", "arm2_link2"): 0.3}),
    ],
)
def test_a_wrong_split_of_friction_is_no_change_and_changes_are_told(model, now, told):
    recording = rubbing(40.0, 1.0, *now)
    examination = examine([recording], model.robot, model=model)
    found = {(f.effect, f.where): next(iter(f.parameters.values())) for f in examination.diagnosis.findings}
    assert found.keys() == told.keys()
    for place, value in told.items():
        assert found[place].value == pytest.approx(value, abs=2.0 * found[place].std)
    later = extend(examination)
    signals = [prepare(rubbing(15.0, 1.0, *now))]
    assert score_model(later, signals).nrmse_mean <= score_model(model, signals).nrmse_mean
    known = np.sqrt(np.diag(later.unsure.covariance))[: len(model.unsure.covariance)]
    assert (known <= 1.01 * np.sqrt(np.diag(model.unsure.covariance))).all()


def test_a_file_keeps_what_is_unsure_and_old_ones_are_read(model):
    arrays, info = model.to_state()
    again = ExtendedModel.from_state(arrays, info).unsure
    assert again.terms == model.unsure.terms
    np.testing.assert_array_equal(again.covariance, model.unsure.covariance)
    old = {key: value for key, value in info.items() if key != "unsure"}
    assert ExtendedModel.from_state(arrays, old).unsure is None
    for damaged in (
        [{**info["unsure"][0], "joint": "none"}, *info["unsure"][1:]],
        [{**info["unsure"][0], "effect": "magic"}, *info["unsure"][1:]],
        info["unsure"][1:],
    ):
        with pytest.raises(ModelFileError):
            ExtendedModel.from_state(arrays, {**info, "unsure": damaged})


VISCOUS, COULOMB = Term(get("viscous_friction"), 0), Term(get("coulomb_friction"), 1)
KNOWN = Unsure((VISCOUS, COULOMB), np.array([[0.04, 0.01], [0.01, 0.09]]))


def test_errors_of_effects_are_those_of_their_coefficients():
    signals = flattened(prepare(rubbing(12.0, 0.5)), 5.0)
    equations, plain = (build(signals, ARM, known=Known(unsure=each)) for each in (KNOWN, None))
    np.testing.assert_allclose(KNOWN.errors @ KNOWN.errors.T, ERROR_FACTOR**2 * KNOWN.covariance, atol=1e-12)
    units = np.array([0.3, -0.7])
    more = KNOWN.moved(np.concatenate([np.zeros(equations.rigid.shape[2] - 2), units]))
    wanted = sum(equations.columns.of(term) @ c for term, c in zip(KNOWN.terms, more, strict=True))
    np.testing.assert_allclose(equations.rigid[:, :, -2:] @ units, wanted, atol=1e-9)
    np.testing.assert_array_equal(equations.rigid[:, :, :-2], plain.rigid)
    spread = equations.errors.spread(0.1)
    assert spread[-2:].tolist() == [1.0, 1.0] and spread[:-2].tolist() == plain.errors.spread(0.1).tolist()


def test_what_is_moved_stays_possible():
    robot = ARM.with_joint_parameters(viscous=np.array([0.1, 0.0]))
    held = [(parse_spec(f"coulomb_friction@{SECOND}:coulomb=0.2", ARM), {})]
    one = replace(KNOWN, covariance=np.eye(2))
    moved, effects = joints_moved(robot, held, one, np.array([-0.3, -0.4]), 1e-6 * np.eye(2))
    assert moved.viscous.tolist() == [0.0, 0.0]
    ((effect, _),) = effects
    assert effect.values == pytest.approx({"coulomb": -0.2})
