"""A BDNN answers both ways, falls into mechanical parts, and survives its file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bdnn_cases import black_box, random_field, scales, signals, worn

from bdnn_ros.bdnn import modelfile
from bdnn_ros.bdnn.cores import NetworkCore, PriorCore
from bdnn_ros.bdnn.dynamics import BDNN, BDNNOnPrior
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.networks import Network, vector_size
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import ModelFileError
from bdnn_ros.models import load_model, save_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot


class Opaque:
    """A prior that is any dynamics but a robot."""

    kind = "opaque"

    def __init__(self, robot: Robot) -> None:
        self.robot, self.joints = robot, robot.joints

    def __getattr__(self, name: str) -> object:
        return getattr(self.__dict__["robot"], name)

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, object]]:
        return {"mark": np.arange(3.0)}, {"name": "arm2"}


def prior_core(prior: Dynamics, n: int, with_h: bool = True, seed: int = 0) -> PriorCore:
    rng = np.random.default_rng(seed)
    local = LocalNetworks.silent(np.ones(n), np.full(n, 5.0))
    local = replace(local, output_weights=0.3 * rng.normal(size=local.output_weights.shape))
    h = Network.random(2 * n, 6, vector_size(n), rng)
    h = replace(h, output_weights=4.0 * h.output_weights)
    return PriorCore(prior, local, h if with_h else None, np.full(n, 0.05))


MODELS = {
    "networks": lambda: BDNN(NetworkCore(("a", "b", "c"), random_field(3))),
    "chain": lambda: BDNN(prior_core(worn("arm2"), 2, with_h=False)),
    "on a robot": lambda: BDNNOnPrior(prior_core(worn("arm6"), 6)),
    "on any dynamics": lambda: BDNNOnPrior(prior_core(Opaque(worn("arm2")), 2)),
}


@pytest.fixture(params=sorted(MODELS))
def model(request):
    return MODELS[request.param]()


def motion(model: BDNN, *shape: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return tuple(rng.normal(size=(*shape, len(model.joints))) for _ in range(3))


def test_both_directions_are_each_others_inverse(model):
    q, v, a = motion(model, 5)
    effort = model.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(model.forward_dynamics(q, v, effort), a, rtol=1e-7, atol=1e-8)


def test_the_parts_add_up(model):
    q, v, a = motion(model, 5)
    inertial = (model.mass_matrix(q) @ a[..., None])[..., 0]
    whole = inertial + model.coriolis(q, v) + model.gravity(q) + model.friction(q, v)
    np.testing.assert_allclose(whole, model.inverse_dynamics(q, v, a), rtol=1e-9, atol=1e-9)


def test_the_mass_matrix_is_symmetric_and_positive_definite(model):
    mass = model.mass_matrix(motion(model, 50)[0])
    np.testing.assert_allclose(mass, np.swapaxes(mass, 1, 2), rtol=1e-9, atol=1e-12)
    assert (np.linalg.eigvalsh(mass) > 0.0).all()


def test_the_derivative_of_the_mass_matrix_is_its_slope(model):
    q = motion(model, 3)[0]
    slope, step = model.mass_matrix_derivative(q), 1e-5
    for k in range(len(model.joints)):
        change = step * np.eye(len(model.joints))[k]
        difference = (model.mass_matrix(q + change) - model.mass_matrix(q - change)) / (2.0 * step)
        np.testing.assert_allclose(slope[..., k], difference, atol=1e-6 * np.abs(difference).max() + 1e-7)


@pytest.mark.parametrize("shape", [(), (4,), (2, 3)])
def test_any_leading_shape_is_answered_alike(model, shape):
    q, v, a = motion(model, *shape)
    n = len(model.joints)
    assert model.inverse_dynamics(q, v, a).shape == q.shape
    assert model.forward_dynamics(q, v, a).shape == q.shape
    assert model.mass_matrix(q).shape == (*q.shape, n)
    assert model.coriolis(q, v).shape == model.gravity(q).shape == model.friction(q, v).shape == q.shape
    flat = model.inverse_dynamics(*(x.reshape(-1, n) for x in (q, v, a))).reshape(q.shape)
    np.testing.assert_allclose(model.inverse_dynamics(q, v, a), flat)


def opaque_builder(kind: str, arrays: dict[str, np.ndarray], info: dict[str, object]) -> Dynamics:
    assert kind == "opaque"
    assert info == {"name": "arm2"}
    np.testing.assert_array_equal(arrays["mark"], np.arange(3.0))
    return Opaque(worn("arm2"))


def test_a_model_survives_its_file(model, tmp_path):
    arrays, info = model.to_state()
    kind, arrays, info = modelfile.load(modelfile.save(tmp_path, model.kind, arrays, info))
    assert kind == model.kind
    again = (
        BDNN.from_state(arrays, info)
        if kind == "bdnn"
        else BDNNOnPrior.from_state(arrays, info, opaque_builder)
    )
    q, v, a = motion(model, 4)
    assert again.joints == model.joints
    np.testing.assert_array_equal(again.inverse_dynamics(q, v, a), model.inverse_dynamics(q, v, a))
    np.testing.assert_array_equal(again.mass_matrix(q), model.mass_matrix(q))


def test_an_incomplete_state_is_refused(model):
    arrays, info = model.to_state()
    arrays.pop(sorted(arrays)[0])
    with pytest.raises(ModelFileError):
        BDNN.from_state(arrays, info) if model.kind == "bdnn" else BDNNOnPrior.from_state(
            arrays, info, opaque_builder
        )


def test_a_prior_of_another_kind_needs_its_builder():
    arrays, info = MODELS["on any dynamics"]().to_state()
    with pytest.raises(ModelFileError, match="opaque"):
        BDNNOnPrior.from_state(arrays, info)


@pytest.mark.parametrize("cls", [BDNN, BDNNOnPrior])
def test_a_model_on_an_identified_one_survives_its_file(cls, tmp_path):
    physical = PhysicalModel(worn("arm2"), np.array([0.3, -0.1]), 0.01 * np.eye(28), np.zeros(2))
    model = cls(prior_core(physical, 2))
    again = load_model(save_model(tmp_path, model))
    q, v, a = motion(model, 4)
    assert isinstance(again, cls) and isinstance(again.core.prior, PhysicalModel)
    np.testing.assert_array_equal(again.inverse_dynamics(q, v, a), model.inverse_dynamics(q, v, a))
    np.testing.assert_array_equal(again.forward_dynamics(q, v, a), model.forward_dynamics(q, v, a))
    save_model(tmp_path, cls(prior_core(Opaque(worn("arm2")), 2)))
    with pytest.raises(ModelFileError, match="kind 'opaque'"):
        load_model(tmp_path)


def test_silent_networks_leave_the_prior_as_it_is():
    robot = worn("arm6")
    core = PriorCore(robot, LocalNetworks.silent(np.ones(6), np.ones(6)), None, np.full(6, 1e-9))
    model = BDNNOnPrior(core)
    q, v, a = motion(model, 5)
    np.testing.assert_allclose(model.inverse_dynamics(q, v, a), robot.inverse_dynamics(q, v, a), rtol=1e-9)
    np.testing.assert_allclose(model.coriolis(q, v), robot.coriolis(q, v), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(model.gravity(q), robot.gravity(q), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(model.friction(q, v), robot.friction(q, v), rtol=1e-6, atol=1e-9)


def test_prediction_follows_the_signals_direction():
    robot = worn("arm2")
    model = BDNNOnPrior(
        PriorCore(robot, LocalNetworks.silent(np.ones(2), np.ones(2)), None, np.full(2, 0.05))
    )
    motion = signals(robot, 4.0, 0)
    soft = replace(robot, coulomb=np.zeros(2)).inverse_dynamics(
        motion.position, motion.velocity, motion.acceleration
    )
    np.testing.assert_allclose(model.predict(motion), soft + robot.coulomb * motion.sign, atol=1e-9)


def test_an_untrained_black_box_is_already_a_machine():
    model = black_box(("a", "b"), scales(2), hidden=8)
    assert model.kind == "bdnn"
    assert (np.linalg.eigvalsh(model.mass_matrix(np.zeros((1, 2)))) > 0.0).all()
