"""The benchmark judges rightly, its peers are what they claim to be, and a run goes on where it was."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from bdnn_cases import scales

from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
import bdnn
from _bdnn_effort import ReadOut, least_squares
from _bdnn_judging import judge
from _bdnn_lagrangian import Lagrangian, LagrangianModel
from _bdnn_layers import Layers
from _bdnn_methods import METHODS
from _bdnn_ode import Acceleration, OdeModel
from _motion import Data, data


class Known:
    """A robot that also predicts along a motion."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def __getattr__(self, name: str) -> object:
        return getattr(self._robot, name)

    def predict(self, signals: Signals) -> np.ndarray:
        robot = self._robot
        rigid = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
        joint = robot.viscous * signals.velocity + robot.coulomb * signals.sign
        return rigid + joint + robot.armature * signals.acceleration


@pytest.fixture(scope="module")
def little() -> Data:
    return data("arm2", 20.0, 0)


@pytest.mark.slow
def test_the_true_robot_is_judged_without_error(little):
    errors = judge(Known(little.truth), little)
    assert errors["nmse"] < 1e-4
    parts = ("mass", "gravity", "coriolis", "friction", "kinetic", "potential")
    assert max(errors[part] for part in parts) < 1e-9
    assert errors["least_eigenvalue"] == errors["passive"] == 1.0
    assert errors["gravity_curl"] < 1e-6
    assert errors["rollout_0.1"] < errors["rollout_1"] < 0.05


def test_a_heavier_robot_is_judged_by_how_much(little):
    rigid = little.truth.with_joint_parameters(np.zeros(2), little.truth.viscous, little.truth.coulomb)
    known = Data(rigid, *(getattr(little, k) for k in ("nominal", "train", "validation", "test", "seconds")))
    errors = judge(Known(rigid.with_inertials(1.1 * rigid.inertials)), known)
    for part in ("mass", "gravity", "coriolis", "kinetic", "potential"):
        assert errors[part] == pytest.approx(0.1, rel=1e-6)
    assert errors["least_eigenvalue"] == pytest.approx(1.1)


def test_the_robot_and_the_judging_do_not_depend_on_the_seconds_learned_from(little):
    longer = data("arm2", 40.0, 0)
    assert longer.seconds == 40.0 and sum(map(len, longer.train)) > 1.5 * sum(map(len, little.train))
    np.testing.assert_array_equal(longer.truth.coulomb, little.truth.coulomb)
    np.testing.assert_array_equal(longer.test[0].effort, little.test[0].effort)


def test_the_lagrangian_peer_obeys_lagranges_equation():
    torch.manual_seed(0)
    module = Lagrangian(scales(3), 8).double()
    q, v, a = (torch.randn(5, 3, dtype=torch.float64, requires_grad=True) for _ in range(3))

    def momentum(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
        return torch.autograd.grad(kinetic(q, v), v, create_graph=True)[0]

    def kinetic(q: torch.Tensor, v: torch.Tensor) -> torch.Tensor:
        inner = module.lower(q)[0].transpose(1, 2) @ (module.gain * v)[..., None]
        return 0.5 * (inner**2).sum()

    rate = torch.autograd.functional.jvp(momentum, (q, v), (v, a))[1]
    expected = rate - torch.autograd.grad(kinetic(q, v), q)[0]
    torch.testing.assert_close(module.inertial(q, v, a), expected, rtol=1e-10, atol=1e-10)
    energy = module.potential(torch.cat([q.sin(), q.cos()], 1)).sum() * module.effort.max()
    torch.testing.assert_close(module.gravity(q), torch.autograd.grad(energy, q)[0])


def test_the_lagrangian_peers_parts_add_up_and_invert():
    torch.manual_seed(1)
    model = LagrangianModel(("a", "b"), Lagrangian(scales(2), 8))
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 20, 2))
    parts = model.coriolis(q, v) + model.gravity(q) + model.friction(q, v)
    effort = (model.mass_matrix(q) @ a[..., None])[..., 0] + parts
    np.testing.assert_allclose(model.inverse_dynamics(q, v, a), effort, atol=1e-10)
    np.testing.assert_allclose(model.forward_dynamics(q, v, effort), a, atol=1e-8)


def test_the_shared_layers_derivatives_are_autograds():
    torch.manual_seed(0)
    layers = Layers(4, 6, 3).double()
    x, change = torch.randn(2, 1, 4, dtype=torch.float64)
    y, moved = torch.autograd.functional.jvp(layers, x, change)
    cotangent = torch.randn_like(y)
    values = layers.hidden(x)
    torch.testing.assert_close(layers.push(values, change), moved)
    pulled = torch.autograd.functional.vjp(layers, x, cotangent)[1]
    torch.testing.assert_close(layers.pull(values, cotangent), pulled)


def test_the_effort_of_a_neural_ode_makes_its_acceleration():
    torch.manual_seed(0)
    module = Acceleration(scales(2), np.full(2, 100.0), 16)
    weight = module.layers.first.weight.data
    weight[:2, 8:] = 0.3 * torch.eye(2)
    model = OdeModel(("a", "b"), module)
    rng = np.random.default_rng(0)
    q, v, u = rng.normal(size=(3, 20, 2)) * 0.3
    reached = model.forward_dynamics(q, v, u)
    again = model.forward_dynamics(q, v, model.inverse_dynamics(q, v, reached))
    assert np.abs(again - reached).max() < 1e-6
    beyond = model.inverse_dynamics(q, v, np.full_like(q, 1e6))
    assert np.abs(beyond).max() == 100.0


def test_parts_are_read_out_of_an_effort():
    robot = Robot.bundled("arm2").with_joint_parameters(np.zeros(2), np.array([0.3, 0.1]), np.zeros(2))

    class Effort(ReadOut):
        def effort(self, q, v, a, direction):
            return robot.inverse_dynamics(q, v, a)

    model = Effort(robot.joints, scales(2))
    rng = np.random.default_rng(0)
    q, v, u = rng.normal(size=(3, 10, 2))
    np.testing.assert_allclose(model.mass_matrix(q), robot.mass_matrix(q), atol=1e-9)
    np.testing.assert_allclose(model.coriolis(q, v), robot.coriolis(q, v), atol=1e-9)
    np.testing.assert_allclose(model.friction(q, v), robot.viscous * v, atol=1e-9)
    np.testing.assert_allclose(model.forward_dynamics(q, v, u), robot.forward_dynamics(q, v, u), rtol=1e-6)


def test_an_effort_without_inertia_lets_the_rollout_run_away():
    class Weightless(ReadOut):
        def effort(self, q, v, a, direction):
            return np.where(q > 0.0, v, a)

    model = Weightless(("a", "b"), scales(2))
    q, still = np.array([[1.0, 1.0], [-1.0, -1.0]]), np.zeros((2, 2))
    np.testing.assert_array_equal(
        model.forward_dynamics(q, still, np.ones((2, 2))), [[np.inf] * 2, [1.0] * 2]
    )


@pytest.mark.slow
def test_least_squares_on_the_true_axes_finds_the_robot(little):
    errors = judge(least_squares(little, 1.0, 0), little)
    assert errors["nmse"] < 1e-3
    assert errors["mass"] < 0.02
    assert errors["friction"] < 0.02


@pytest.mark.slow
def test_a_run_is_saved_and_goes_on(tmp_path, monkeypatch):
    path = tmp_path / "bdnn.json"
    words = ["--robots", "arm2", "--methods", "squares", "--results", str(path)]
    first = bdnn.run(bdnn.arguments(words))
    assert [bdnn.key(cell) for cell in first] == [("arm2", "squares", 0, 0.25)]
    assert bdnn.load(path) == first

    def never(*_: object) -> None:
        raise AssertionError("measured again")

    monkeypatch.setattr(bdnn, "measured", never)
    assert bdnn.run(bdnn.arguments([*words, "--resume"])) == first
    with pytest.raises(AssertionError, match="measured again"):
        bdnn.run(bdnn.arguments([*words, "--resume", "--seeds", "2"]))


def test_the_table_shows_medians_and_ranges():
    cells = [
        {"robot": "arm2", "method": "chain", "seed": seed, "scale": 1.0, "budget": 60.0, "motion": 120.0}
        | {name: value for name in bdnn.COLUMNS if name != "motion"}
        for seed, value in enumerate((0.001, 0.004, None))
    ]
    text = bdnn.table(cells, 1.0)
    assert METHODS["chain"].label in text and "0.4 (0.1–ran away)" in text
    assert METHODS["prior"].label not in text
    assert len(bdnn.table(cells, 0.5).splitlines()) == 1
    assert bdnn.number(0.0512) == "0.051" and bdnn.number(123.4) == "123"
    assert bdnn.number(1e-9) == "<0.001" and bdnn.number(-54321.0) == "-54321"


def test_tables_are_written_between_their_marks():
    first, last = bdnn.MARKS
    text = bdnn.documented(f"before {first} old {last} after", [])
    assert text.startswith(f"before {first}\n\n| robot |") and text.endswith(f"{last} after")
    assert bdnn.documented(text, []) == text and "old" not in text
    assert bdnn.THEORY.read_text().count(first) == bdnn.THEORY.read_text().count(last) == 1


def test_the_documented_tables_are_those_of_the_results():
    theory = bdnn.THEORY.read_text()
    again = bdnn.documented(theory, bdnn.load(bdnn.RESULTS))
    assert again == theory, "write them: python benchmarks/bdnn.py --write-docs"
    assert bdnn.documented(theory, []) != theory


@pytest.mark.parametrize("words", [["--methods", "magic"], ["--robots", "arm9"], ["--budget-scale", "0"]])
def test_nonsense_is_refused(words, capsys):
    with pytest.raises(SystemExit) as refusal:
        bdnn.arguments(words)
    assert refusal.value.code == 2
