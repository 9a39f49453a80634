"""ONNX graphs run by onnxruntime against the models they stand for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bdnn_cases import black_box

from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.dynamics import BDNN, BDNNOnPrior
from bdnn_ros.bdnn.field import Scales
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.networks import Network
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import DataError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.identified import of_physical
from bdnn_ros.physical.couplings import CoupledMotors, Coupling
from bdnn_ros.physical.dictionary import CURVE_FEATURES, FEATURES, GROUPS
from bdnn_ros.physical.dictionary import Scales as FeatureScales
from bdnn_ros.physical.local import LocalResiduals
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")
from bdnn_ros.extension import onnx_export  # noqa: E402
from bdnn_ros.extension.onnx_export import INPUTS, inverse_dynamics_graph  # noqa: E402
from bdnn_ros.extension.symbols import Graph  # noqa: E402


def error(model: Dynamics, count: int = 50) -> float:
    """Largest difference between a model and its graph, relative to the largest effort."""
    graph = inverse_dynamics_graph(model)
    rng = np.random.default_rng(7)
    state = [rng.uniform(-2.5, 2.5, (count, len(model.joints))) for _ in INPUTS]
    session = onnxruntime.InferenceSession(graph.SerializeToString())
    got = session.run(None, dict(zip(INPUTS, state, strict=True)))[0]
    wanted = model.inverse_dynamics(*state)
    return float(np.abs(got - wanted).max() / np.abs(wanted).max())


@pytest.mark.parametrize("name", ["arm2", "arm6", "arm7"])
def test_robots(name: str) -> None:
    robot = Robot.bundled(name)
    width = robot.width
    robot = robot.with_joint_parameters(np.full(width, 0.1), np.full(width, 0.5), np.full(width, 0.3))
    assert error(robot) < 1e-12
    assert error(robot.tilted(0.2, -0.1)) < 1e-12


def test_joints_in_another_order_and_sliding_ones() -> None:
    arm = Robot.from_urdf(Robot.bundled("arm7").urdf, ("arm7_joint6", "arm7_joint2", "arm7_joint4"))
    assert error(arm) < 1e-12
    inertial = '<inertial><origin xyz="0.1 0 0.3"/><mass value="2"/><inertia ixx="0.1" iyy="0.2" izz="0.15"'
    inertial += ' ixy="0.01" ixz="0" iyz="0"/></inertial>'
    slider = f"""<robot name="r"><link name="a"/>
      <link name="b">{inertial}</link><link name="c">{inertial}</link><link name="d">{inertial}</link>
      <joint name="turn" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0.6 0.8"/></joint>
      <joint name="slide" type="prismatic"><parent link="b"/><child link="c"/><axis xyz="1 0 0"/>
        <origin xyz="0.2 0.1 0" rpy="0.5 0 0.3"/>
        <limit lower="-1" upper="1" velocity="1" effort="9"/></joint>
      <joint name="fork" type="continuous"><parent link="b"/><child link="d"/><axis xyz="0 0 1"/></joint>
      </robot>"""
    assert error(Robot.from_urdf(slider)) < 1e-12


def test_extended_models() -> None:
    robot = Robot.bundled("arm7")
    specs = (
        "coulomb_friction@arm7_joint4:coulomb=1.3",
        "stribeck_friction@arm7_joint1:coulomb=1.0,static=1.8,velocity=0.1",
        "asymmetric_friction@arm7_joint3:positive=0.8,negative=0.3",
        "load_dependent_friction@arm7_joint2:ratio=0.4",
        "quadratic_drag@arm7_joint5:drag=0.4",
        "payload@arm7_link7:mass=1.5,com_z=0.1",
        "base_tilt:roll_deg=3,pitch_deg=-4",
        "joint_spring@arm7_joint4:stiffness=3.0,rest=-1.5",
        "effort_offset@arm7_joint5:offset=0.4",
        "effort_scale@arm7_joint2:scale=0.8",
        "cogging@arm7_joint1:amplitude=0.5,periods_per_rev=12,phase=0.4",
        "position_offset@arm7_joint4:offset=0.05",
        "hysteresis@arm7_joint1:force=0.9,breakaway=0.03",
    )
    effects = tuple(parse_spec(spec, robot) for spec in specs)
    model = ExtendedModel(robot.with_inertials(1.1 * robot.inertials), effects, np.zeros(7))
    assert error(model) < 1e-9
    creep = ((0.0, 0.0, 0.01), *((1.0, 2.0, 0.0),) * 5, (0.0, 0.0, 0.0))  # slower than half of the states
    creeping = replace(model, creep=creep)
    assert error(creeping) < 1e-9
    still, slow = np.zeros((1, 7)), np.full((1, 7), 0.5)
    apart = (model.inverse_dynamics(still, slow, still) - creeping.inverse_dynamics(still, slow, still))[0]
    assert apart[[0, 2, 3]] == pytest.approx([0.0, 0.4, 0.65]) and apart[6] == 0.0
    own = model.bare.with_joint_parameters(coulomb=np.full(7, 0.3))  # the robot's own comes on alike
    assert error(replace(creeping, bare=own)) < 1e-9
    assert error(replace(creeping, bare=own, creep=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), *creep[2:]))) < 1e-9


def test_every_pointwise_effect_is_known() -> None:
    from bdnn_ros.effects.registry import EFFECTS
    from bdnn_ros.extension.holding import IN_PLANT, WITH_MEMORY

    known = IN_PLANT | WITH_MEMORY | set(onnx_export.RESISTANCE) | {"load_dependent_friction"}
    assert set(EFFECTS) == known


def test_physical_models() -> None:
    robot = Robot.bundled("arm2").with_joint_parameters(np.array([0.1, 0.2]), np.ones(2), np.ones(2))
    model = PhysicalModel(robot, np.array([0.3, -0.2]), np.eye(28), np.zeros(2))
    assert error(model) < 1e-12
    rng = np.random.default_rng(4)
    motors = CoupledMotors(
        (Coupling(0, -1),), np.array([[0.2, 0.3, 0.4]]), rng.normal(size=(1, CURVE_FEATURES)), np.array([5.0])
    )
    size = FeatureScales(np.array([5.0, 2.0]), np.array([6.0, 9.0]))
    weights, straight = rng.normal(size=(2, FEATURES)), rng.normal(size=(2, 3))
    learned = LocalResiduals((tuple(GROUPS),) * 2, weights, straight, size)
    model = replace(model, motors=motors, learned=learned)
    assert error(model) < 1e-9
    assert error(of_physical(model)) < 1e-9


def test_a_graph_that_differs_is_not_handed_out(monkeypatch) -> None:
    robot = Robot.bundled("arm2")
    wrong = replace(robot, inertials=1.01 * robot.inertials)
    monkeypatch.setattr(
        onnx_export, "_formula", lambda model: lambda q, v, a: onnx_export.robot_effort(wrong, q, v, a)
    )
    with pytest.raises(DataError, match="differs"):
        inverse_dynamics_graph(robot)


def test_an_unknown_model_is_refused() -> None:
    class Odd:
        joints = ("a",)

    with pytest.raises(DataError, match="Odd"):
        inverse_dynamics_graph(Odd())  # type: ignore[arg-type]


def test_symbols_do_what_numpy_does() -> None:
    """Every operation, on a batch of another size than the example's."""
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(4, 5))

    def formula(x):
        y = np.concatenate([np.sin(x), np.cos(x[:, ::-1]), x[:, [1, 3]] ** 2], axis=1)
        z = np.stack([np.tanh(y), np.abs(y), np.sign(y)], axis=-1) / (2.0 - np.exp(-np.abs(y)))[..., None]
        w = np.zeros_like(x)
        w[:, 1:] = x[:, :-1]
        w[:, :2] = np.ones_like(x)[:, :2]
        w += np.maximum(x, 0.1) - np.minimum(0.2, x)
        s = np.einsum("bi,ij->bj", w, weights) @ np.eye(5)
        t = np.swapaxes(z, 1, 2).reshape(-1, z.shape[1] * 3)
        return np.concatenate([np.sum(z, axis=1), s, t, -np.sqrt(np.log(2.0 + x * x)), 1.0 - x], axis=1)

    graph = Graph()
    made = graph.model(formula(graph.input("x", rng.normal(size=(3, 4)))), "y")
    session = onnxruntime.InferenceSession(made.SerializeToString())
    for count in (1, 9):
        x = rng.normal(size=(count, 4))
        np.testing.assert_allclose(session.run(None, {"x": x})[0], formula(x), atol=1e-13)
    x = graph.input("x", rng.normal(size=(3, 4)))
    for wrong in (
        lambda: x[0],
        lambda: x[1:],
        lambda: x.reshape(2, -1),
        lambda: np.cbrt(x),
        lambda: np.linalg.inv(x),
    ):
        with pytest.raises(TypeError):
            wrong()


@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "softplus"])
def test_a_black_box(activation: str) -> None:
    scales = Scales(np.array([1.0, 2.0]), np.array([5.0, 8.0]), np.array([10.0, 3.0]), np.array([0.1, 0.2]))
    model = black_box(("a", "b"), scales, hidden=16, seed=1, activation=activation)
    vector = np.random.default_rng(2).normal(size=model.core.field.vector().size)
    core = replace(model.core, field=model.core.field.with_vector(vector))
    assert error(BDNN(core)) < 1e-9


@pytest.mark.parametrize("with_h", [False, True])
@pytest.mark.parametrize("on", ["robot", "physical"])
def test_networks_on_a_prior(on: str, with_h: bool) -> None:
    rng = np.random.default_rng(3)
    robot = Robot.bundled("arm2").with_joint_parameters(np.array([0.1, 0.2]), np.ones(2), np.ones(2))
    prior = robot if on == "robot" else PhysicalModel(robot, np.array([0.3, 0.1]), np.eye(28), np.zeros(2))
    local = LocalNetworks.silent(np.ones(2), np.full(2, 5.0))
    local = replace(local, output_weights=rng.normal(size=local.output_weights.shape))
    h = Network.random(4, 12, 3, rng) if with_h else None
    core = PriorCore(prior, local, h, np.full(2, 0.05))
    assert error(BDNNOnPrior(core)) < 1e-9
    silent = LocalNetworks.silent(np.ones(2), np.full(2, 5.0))
    assert error(BDNNOnPrior(replace(core, local=silent))) < 1e-9
