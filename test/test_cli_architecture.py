"""`bdnn identify --architecture`: the paper's networks from a bag to what the other verbs make of them."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros import bags
from bdnn_ros.bdnn import training
from bdnn_ros.cli.excite import _given
from bdnn_ros.cli.main import main
from bdnn_ros.models import load_model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import fourier

NETWORKS = ["--architecture", "networks"]
ALONE = ["--prior", "none", *NETWORKS]


class Clock:
    """A clock that passes some time at every look, so that no test depends on the machine."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        self.now += 0.01
        return self.now


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A motion of a worn arm with its description."""
    robot = Robot.bundled("arm2")
    plan = fourier(robot, np.arange(0.0, 12.0, 0.005), np.random.default_rng(1))
    real = robot.with_joint_parameters(np.full(2, 0.1), np.ones(2), np.full(2, 2.0))
    effort = real.inverse_dynamics(plan.position, plan.velocity, plan.acceleration)
    one = Recording(plan.time, robot.joints, plan.position, plan.velocity, effort, urdf=robot.urdf)
    return str(bags.write(one, tmp_path_factory.mktemp("bags") / "motion"))


@pytest.fixture(autouse=True)
def steady(monkeypatch: pytest.MonkeyPatch) -> None:
    """Training by a clock that no machine hurries."""
    identify = training.identify
    monkeypatch.setattr(
        training, "identify", lambda *given, **named: partial(identify, clock=Clock())(*given, **named)
    )


@pytest.mark.parametrize(
    ("options", "kind", "least", "written"),
    [
        (ALONE, "bdnn", 0.3, {"parameters.yaml", "inverse_dynamics.onnx"}),
        (
            NETWORKS,
            "bdnn_on_prior",
            0.05,
            {"model.urdf", "model.mjcf.xml", "effects.yaml", "parameters.yaml", "inverse_dynamics.onnx"},
        ),
    ],
)
def test_from_a_bag_to_what_the_other_verbs_make_of_it(bag, tmp_path, capsys, options, kind, least, written):
    out = tmp_path / "model"
    assert main(["identify", bag, *options, "--budget", "3", "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"model.bdnn", "metrics.json", "effort.png"}
    model = load_model(out)
    assert model.kind == kind
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["held_out"]["nrmse_mean"] < min(least, metrics["simulation"]["nrmse_mean"])
    eigenvalues = np.linalg.eigvalsh(model.mass_matrix(np.random.default_rng(0).uniform(-3, 3, (50, 2))))
    assert (eigenvalues > 0.0).all()
    capsys.readouterr()
    assert main(["evaluate", str(out), bag, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["held_out"]["nrmse_mean"] < least
    assert main(["predict", str(out), bag, "--out", str(tmp_path / "p.csv")]) == 0
    assert len((tmp_path / "p.csv").read_text().splitlines()) == 2401
    assert main(["export", str(out), "--out", str(tmp_path / "files")]) == 0
    assert {path.name for path in (tmp_path / "files").iterdir()} == written


def test_the_seed_and_the_budget_decide(bag, tmp_path):
    """Of networks alone, as far as time does not."""

    def weights(name: str, *options: str) -> np.ndarray:
        out = tmp_path / name
        assert main(["identify", bag, *ALONE, *options, "--out", str(out)]) == 0
        arrays, _ = load_model(out).to_state()
        return np.concatenate([array.ravel() for _, array in sorted(arrays.items())])

    first = weights("first", "--budget", "1", "--seed", "3")
    np.testing.assert_array_equal(weights("again", "--budget", "1", "--seed", "3"), first)
    assert not np.allclose(weights("other", "--budget", "1", "--seed", "4"), first)
    assert not np.allclose(weights("longer", "--budget", "2", "--seed", "3"), first)


def test_parameters_of_an_earlier_model_go_with_it(bag, tmp_path):
    words = ["identify", bag, "--budget", "1", "--out", str(tmp_path)]
    assert main(words) == 0 and (tmp_path / "parameters.json").exists()
    assert main([*words, *NETWORKS]) == 0 and not (tmp_path / "parameters.json").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--architecture", "chain"], "Add --prior none"),
        ([*NETWORKS, "--spread", "inertial=0.1"], "Leave one of them out"),
        ([*ALONE, "--spread", "inertial=0.1"], "Leave one of them out"),
        ([*NETWORKS, "--budget", "-1"], "--budget -1 is not a time"),
        (["--architecture", "deep"], "invalid choice: 'deep'"),
    ],
)
def test_what_does_not_go_together_is_said_in_one_sentence(bag, tmp_path, capsys, options, words):
    assert main(["identify", bag, "--out", str(tmp_path / "out"), *options]) == 2
    said = capsys.readouterr().err
    assert words in said and "Traceback" not in said
    assert not (tmp_path / "out").exists()


def test_networks_need_a_description_to_stand_on(bag, tmp_path, capsys):
    bare = bags.read(Path(bag))
    bare = Recording(bare.time, bare.joints, bare.position, bare.velocity, bare.effort)
    made = str(bags.write(bare, tmp_path / "bare"))
    assert main(["identify", made, *NETWORKS, "--out", str(tmp_path / "out")]) == 2
    assert "no URDF to start from" in capsys.readouterr().err


def test_what_networks_cannot_answer_is_said(bag, tmp_path, capsys):
    """Changes since need to know how sure the earlier model is; limits are the description's."""
    for name, options in (("alone", ALONE), ("on", NETWORKS)):
        assert main(["identify", bag, *options, "--budget", "0.5", "--out", str(tmp_path / name)]) == 0
        words = ["diagnose", bag, "--model", str(tmp_path / name), "--out", str(tmp_path / "d")]
        assert main(words) == 2
        assert "Identify the earlier recording with --prior urdf and without" in capsys.readouterr().err
    assert main(["excite", str(tmp_path / "alone"), "--out", str(tmp_path / "e")]) == 2
    assert "does not know the robot's limits" in capsys.readouterr().err
    asked = argparse.Namespace(model=tmp_path / "on", urdf=None, robot=None, case=None, joints=())
    assert _given(asked)[0].limits.upper.tolist() == Robot.bundled("arm2").limits.upper.tolist()
