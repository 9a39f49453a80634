"""What the library does not hold is learned by networks, and what they gain is told apart from the named causes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import check_contract

from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.onnx_export import inverse_dynamics_graph
from bdnn_ros.extension.unwritten import NETWORKS, unwritten
from bdnn_ros.models import load_model, save_model
from bdnn_ros.online.estimate import parts
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.simulate import simulate

ARM = Robot.bundled("arm2")
J1, J2 = ARM.joints
COULOMB = parse_spec(f"coulomb_friction@{J1}:coulomb=1", ARM)
Law = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def by_neighbour(q: np.ndarray, v: np.ndarray, t: np.ndarray) -> np.ndarray:
    return 0.5 * np.cos(3.0 * q[:, 0])


def recorded(law: Law, seed: int = 1, seconds: float = 30.0) -> Recording:
    """An arm with Coulomb friction at its first joint, and at its second an effort that no effect says."""
    made = simulate(ARM, [COULOMB], duration=seconds, rate=250.0, seed=seed)
    effort = made.recording.require_effort().copy()
    effort[:, 1] += law(made.position, made.velocity, made.recording.time)
    return replace(made.recording, effort=effort)


def error(model: ExtendedModel, recording: Recording) -> np.ndarray:
    """Root mean square of what a model leaves, (n,) [N·m]."""
    signals = prepare(recording)
    left = signals.smooth(signals.effort - model.predict(signals))[signals.interior]
    return np.sqrt(np.mean(left**2, axis=0))


@pytest.fixture(scope="module")
def examined():
    return examine([recorded(by_neighbour)], ARM)


@pytest.fixture(scope="module")
def model(examined) -> ExtendedModel:
    return extend(examined)


def test_it_is_learned_and_its_gain_is_told_apart(examined):
    diagnosis = examined.diagnosis
    assert [(one.effect, one.joint) for one in diagnosis.findings] == [("coulomb_friction", J1)]
    assert diagnosis.verdict == "partly_explained"  # no name is found for it all the same
    gain, low, high = diagnosis.learned
    assert low <= gain <= high and low > 0.9
    # neither the named part's gain nor its error counts it
    assert diagnosis.gain < 0.8 and diagnosis.effort_rmse["extended"][1] > 0.2
    told = diagnosis.as_json()
    check_contract(told)
    assert told["unexplained"]["learned"]["value"] == pytest.approx(gain, abs=1e-5)
    assert f"Networks learn it at {J2} from {J1}.position" in told["unexplained"]["sentence"]


def test_the_extended_model_predicts_it_along_another_motion(model):
    other = recorded(by_neighbour, seed=2)
    bare = replace(model, networks=())
    (network,) = model.networks
    inside = ~network.beyond(other.position, other.velocity, other.position)
    assert inside.mean() > 0.5
    with_them, without = error(model, other), error(bare, other)
    assert with_them[0] == without[0] and with_them[1] < 0.2 * without[1]


def test_its_answers_go_together_and_it_comes_back_from_its_file(model, tmp_path):
    rng = np.random.default_rng(0)
    q, v, a = (rng.uniform(-1.0, 1.0, (20, 2)) for _ in range(3))
    effort = model.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(model.forward_dynamics(q, v, effort), a, atol=1e-9)
    one = parts(model, q[0], v[0], a[0])
    np.testing.assert_allclose(one.effort, effort[0])
    np.testing.assert_allclose(
        one.learned, effort[0] - replace(model, networks=()).inverse_dynamics(q, v, a)[0]
    )
    assert one.learned[0] == 0.0 != one.learned[1]
    together = model.coriolis(q, v) + model.gravity(q) + model.friction(q, v)
    np.testing.assert_allclose(together, model.inverse_dynamics(q, v, 0.0 * a))
    back = load_model(save_model(tmp_path, model))
    np.testing.assert_array_equal(back.inverse_dynamics(q, v, a), effort)
    assert inverse_dynamics_graph(model).graph.node  # it has agreed with the model
    assert NETWORKS in unwritten(model) and NETWORKS not in unwritten(replace(model, networks=()))


def test_another_day_it_is_no_change_and_beyond_what_was_seen_nobody_knows(model):
    other = recorded(by_neighbour, seed=2)
    found = examine([other], model.robot, model=model)
    assert found.diagnosis.verdict == "nothing_wrong" and not found.diagnosis.findings
    assert any(
        "beyond what the earlier model's networks learned from" in note for note in found.diagnosis.notes
    )
    again = extend(found)
    assert again.networks == model.networks


@pytest.mark.parametrize(
    "law",
    [lambda q, v, t: 0.0 * t, lambda q, v, t: 0.5 * np.sin(2.0 * np.pi * 1.3 * t)],
    ids=["nothing", "time alone"],
)
def test_what_motion_does_not_predict_is_not_learned(law):
    examined = examine([recorded(law, seconds=20.0)], ARM)
    assert examined.diagnosis.learned is None and examined.networks == ()
    assert "learned" not in examined.diagnosis.as_json()["unexplained"]
    assert extend(examined).networks == ()
