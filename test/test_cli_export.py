"""`bdnn export`: every kind of model, every format, and a sentence where one makes no sense."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from bdnn_cases import black_box

from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.dynamics import BDNNOnPrior
from bdnn_ros.bdnn.field import Scales
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.cli.main import main
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.extension.effects_file import EffectsFile
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.files import write_model_files
from bdnn_ros.models import Model, save_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

ALL = ["effects.yaml", "inverse_dynamics.onnx", "model.mjcf.xml", "model.urdf", "parameters.yaml"]


def models() -> dict[str, Model]:
    robot = Robot.bundled("arm2").with_joint_parameters(
        np.array([0.1, 0.2]), np.full(2, 0.5), np.full(2, 0.3)
    )
    effects = tuple(
        parse_spec(spec, robot)
        for spec in ("payload@arm2_tool:mass=0.5", "hysteresis@arm2_joint1:force=0.5,breakaway=0.02")
    )
    scales = Scales(np.ones(2), np.full(2, 5.0), np.full(2, 10.0), np.full(2, 0.1))
    local = LocalNetworks.silent(np.ones(2), np.ones(2)).with_offset(np.array([0.3, 0.2]))
    return {
        "physical": PhysicalModel(
            robot.tilted(0.05, -0.03),
            np.array([0.3, -0.1]),
            0.01 * np.eye(28),
            np.zeros(2),
            tilt_std=(0.001, 0.002),
        ),
        "extended": ExtendedModel(robot, effects, np.full(2, 0.1), ({"mass": 0.1}, {})),
        "bdnn": black_box(("a", "b"), scales),
        "bdnn_on_prior": BDNNOnPrior(PriorCore(robot, local, None, np.full(2, 0.05))),
    }


@pytest.fixture(params=["physical", "extended", "bdnn", "bdnn_on_prior"])
def saved(request, tmp_path: Path) -> tuple[Model, Path]:
    model = models()[request.param]
    save_model(tmp_path / "model", model)
    return model, tmp_path / "model"


def test_all_formats(saved: tuple[Model, Path], tmp_path: Path, capsys) -> None:
    onnxruntime = pytest.importorskip("onnxruntime")
    model, path = saved
    out = tmp_path / "out"
    assert main(["export", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr()
    written = sorted(p.name for p in out.iterdir())
    if model.kind == "bdnn":
        assert written == ["inverse_dynamics.onnx", "parameters.yaml"]
        assert "no links or joints" in said.err
    else:
        assert written == ALL
    assert all(name in said.out for name in written)
    state = [np.random.default_rng(k).uniform(-1, 1, (20, 2)) for k in range(3)]
    session = onnxruntime.InferenceSession(str(out / "inverse_dynamics.onnx"))
    got = session.run(None, dict(zip(("position", "velocity", "acceleration"), state, strict=True)))[0]
    wanted = model.inverse_dynamics(*state)
    assert np.abs(got - wanted).max() < 1e-6 * np.abs(wanted).max()
    described = yaml.safe_load((out / "parameters.yaml").read_text())
    assert described["kind"] == model.kind and described["joints"] == list(model.joints)


def test_a_physical_model_as_urdf_and_effects(tmp_path: Path) -> None:
    model = models()["physical"]
    save_model(tmp_path / "model.bdnn", model)
    assert main(["export", str(tmp_path / "model.bdnn"), "--out", str(tmp_path)]) == 0
    robot = Robot.from_file(tmp_path / "model.urdf")
    again = ExtendedModel(
        robot, tuple(EffectsFile.read(tmp_path / "effects.yaml").effects(robot)), np.zeros(2)
    )
    state = [np.random.default_rng(k).uniform(-1, 1, (20, 2)) for k in range(3)]
    np.testing.assert_allclose(again.inverse_dynamics(*state), model.inverse_dynamics(*state), atol=1e-9)
    assert "model.mjcf.xml" in (tmp_path / "effects.yaml").read_text()
    described = yaml.safe_load((tmp_path / "parameters.yaml").read_text())
    assert described["parameters"]["arm2_joint1.offset"] == {"value": 0.3, "std": pytest.approx(0.1)}
    pitch = {
        "value": pytest.approx(np.degrees(-0.03)),
        "std": pytest.approx(np.degrees(0.002)),
        "unit": "deg",
    }
    assert described["tilt"]["pitch"] == pitch


def test_what_an_instant_cannot_know_is_said(tmp_path: Path, capsys) -> None:
    save_model(tmp_path, models()["extended"])
    assert main(["export", str(tmp_path), "--out", str(tmp_path / "out")]) == 0
    assert "leaves out hysteresis" in capsys.readouterr().err
    entry = yaml.safe_load((tmp_path / "out" / "parameters.yaml").read_text())["effects"][0]
    assert entry["parameters"]["mass"] == 0.5 and entry["std"] == {"mass": 0.1}


def test_chosen_formats_only(tmp_path: Path) -> None:
    save_model(tmp_path, models()["physical"])
    for formats, names in (
        ("urdf", ["effects.yaml", "model.urdf"]),
        ("mjcf", ["effects.yaml", "model.mjcf.xml"]),
    ):
        out = tmp_path / formats
        assert main(["export", str(tmp_path), "--out", str(out), "--formats", formats]) == 0
        assert sorted(p.name for p in out.iterdir()) == names
        beside = (out / "effects.yaml").read_text()  # speaks of no file that is not there
        assert names[1] in beside and ("urdf" in beside) == (formats == "urdf") and "also_in" not in beside
        held = {one["effect"] for one in yaml.safe_load(beside)["effects"]}
        assert held == ({"armature", "effort_offset"} if formats == "urdf" else set())  # MuJoCo's has them
    assert main(["export", str(tmp_path), "--out", str(tmp_path / "y"), "--formats", "yaml"]) == 0
    assert [p.name for p in (tmp_path / "y").iterdir()] == ["parameters.yaml"]


@pytest.mark.parametrize(("first", "then"), [("urdf", "mjcf"), ("mjcf", "urdf"), ("urdf,mjcf", "mjcf")])
def test_no_robot_is_left_with_the_effects_of_another(first: str, then: str, tmp_path: Path, capsys) -> None:
    """What is beside a URDF is more than what is beside a MuJoCo model: neither takes the other's place."""
    save_model(tmp_path, models()["physical"])

    def export(formats: str, model: Path = tmp_path) -> int:
        return main(["export", str(model), "--out", str(tmp_path / "out"), "--formats", formats])

    assert export(first) == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    assert export(then) == 2
    error = capsys.readouterr().err
    stays = "model.mjcf.xml" if first == "mjcf" else "model.urdf"
    assert f"effects.yaml has the effects of {stays} there, and would no longer fit" in error
    assert "or write both with --formats urdf,mjcf." in error
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
    assert export("urdf,mjcf") == 0 and export("yaml,onnx") == 0
    save_model(tmp_path / "other", models()["extended"])
    assert export("urdf,mjcf", tmp_path / "other") == 0  # all of them give way together


def test_a_model_goes_into_the_directory_of_its_diagnosis(tmp_path: Path, capsys) -> None:
    robot = Robot.bundled("arm2")
    model = ExtendedModel(robot, (parse_spec("armature@arm2_joint1:armature=0.1", robot),), np.zeros(2))
    save_model(tmp_path, model)
    write_model_files(model, tmp_path)
    words = ["export", str(tmp_path), "--out", str(tmp_path), "--formats"]
    assert main([*words, "mjcf"]) == 2 and "extended.urdf" in capsys.readouterr().err
    assert main([*words, "urdf,mjcf"]) == 0
    said = EffectsFile.read(tmp_path / "effects.yaml").effects(Robot.from_file(tmp_path / "extended.urdf"))
    assert [one.effect.name for one in said] == ["armature"]
    save_model(tmp_path / "other", ExtendedModel(robot, (), np.zeros(2)))
    assert main(["export", str(tmp_path / "other"), *words[2:], "urdf,mjcf"]) == 2
    assert capsys.readouterr().err.rstrip().endswith("Name another --out.")
    (tmp_path / "effects.yaml").write_text("no effects")
    assert main([*words, "mjcf"]) == 0


def test_a_format_that_cannot_be_is_status_one(tmp_path: Path, capsys) -> None:
    save_model(tmp_path, models()["bdnn"])
    assert main(["export", str(tmp_path), "--out", str(tmp_path / "out"), "--formats", "urdf"]) == 1
    note, error = capsys.readouterr().err.splitlines()
    assert "black box" in note
    assert error.startswith("bdnn: error: ") and "cannot be written as urdf" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nowhere", "--out", "x"], "no model"),
        (["m", "--out", "x", "--formats", "pdf"], "pdf"),
        (["m", "--out", "x", "--formats", ",,"], "no format. There are urdf"),
    ],
)
def test_wrong_usage(words: list[str], says: str, capsys) -> None:
    assert main(["export", *words]) == 2
    assert says in capsys.readouterr().err


def test_learned_friction_is_said_to_be_left_out(tmp_path: Path, capsys) -> None:
    from bdnn_ros.physical.dictionary import FEATURES, GROUPS
    from bdnn_ros.physical.dictionary import Scales as FeatureScales
    from bdnn_ros.physical.local import LocalResiduals

    size = FeatureScales(np.ones(2), np.ones(2))
    learned = LocalResiduals((tuple(GROUPS),) * 2, np.ones((2, FEATURES)), np.zeros((2, 3)), size)
    save_model(tmp_path, replace(models()["physical"], learned=learned))  # type: ignore[type-var]
    assert main(["export", str(tmp_path), "--out", str(tmp_path / "out"), "--formats", "urdf"]) == 0
    assert "networks learned" in capsys.readouterr().err
