"""`bdnn identify`: one bag and several, what it writes, what it says of the data."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_cases import sliding_arm

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.models import load_model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import score_model
from bdnn_ros.simulation.excitation import fourier

RATE = 200.0


def recorded(seed: int, coulomb: float = 2.0, robot: Robot | None = None) -> Recording:
    """A motion of a worn arm."""
    robot = robot or Robot.bundled("arm2")
    generator = np.random.default_rng(seed)
    plan = fourier(robot, np.arange(0.0, 12.0, 1.0 / RATE), generator)
    real = robot.with_joint_parameters(np.full(2, 0.1), np.full(2, 1.0), np.array([2.0, coulomb]))
    effort = real.inverse_dynamics(plan.position, plan.velocity, plan.acceleration)
    effort = effort + 0.005 * np.ptp(effort, axis=0) * generator.normal(size=effort.shape)
    return Recording(plan.time, robot.joints, plan.position, plan.velocity, effort, urdf=robot.urdf)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Bags by name."""
    folder = tmp_path_factory.mktemp("bags")
    made = {"first": recorded(1), "second": recorded(2), "worn": recorded(3, coulomb=4.0)}
    silent = replace(made["first"], effort=None)
    still = replace(
        made["first"],
        position=np.tile(made["first"].position[:1], (len(made["first"]), 1)),
        velocity=np.zeros_like(made["first"].position),
    )
    made |= {"silent": silent, "still": still}
    return {name: str(bags.write(recording, folder / name)) for name, recording in made.items()}


@pytest.mark.parametrize("slides", [True, False])
def test_tables_have_units_that_are_true_of_every_row(tmp_path, capsys, slides):
    recording = recorded(1, 0.2, sliding_arm()) if slides else recorded(1)
    made, out = str(bags.write(recording, tmp_path / "bag")), str(tmp_path / "out")
    for command, *units in (
        (["identify", made, "--out", out], "[N·m]", "[N]"),
        (["evaluate", out, made], "[N·m, rad]", "[N, m]"),
        (["info", made], "[rad, N·m]", "[m, N]"),
    ):
        assert main(command) == 0
        lines = capsys.readouterr().out.splitlines()
        first = next(k for k, line in enumerate(lines) if line.startswith("arm2_joint1"))
        for line, joint, unit in zip(lines[first:], ("arm2_joint1", "arm2_joint2"), units, strict=False):
            assert line.startswith(f"{joint} {unit} ") == slides and line.startswith(joint)
        head = "".join(lines[max(first - 2, 0) : first])
        assert ("N·m" in head) != slides and not (slides and "rad" in head)


def contents(folder: Path) -> tuple[dict, dict]:
    """metrics.json and parameters.json."""
    return tuple(json.loads((folder / f"{name}.json").read_text()) for name in ("metrics", "parameters"))


def test_one_bag_gives_model_metrics_and_parameters(bag, tmp_path, capsys):
    assert main(["identify", bag["first"], "--out", str(tmp_path)]) == 0
    metrics, parameters = contents(tmp_path)
    assert set(metrics) == {"held_out", "training", "simulation"}
    assert metrics["held_out"]["nrmse_mean"] < 0.05 < metrics["simulation"]["nrmse_mean"]
    model = load_model(tmp_path)
    listed = {row["name"]: row for row in parameters["parameters"]}
    for joint, value in zip(model.joints, model.robot.coulomb, strict=True):
        row = listed[f"{joint}.coulomb"]
        assert row["value"] == value
        assert abs(row["value"] - 2.0) < max(4.0 * row["std"], 0.1)
    assert parameters["agreement"] == []
    printed = capsys.readouterr()
    assert "held out" in printed.out
    assert "URDF's NRMSE" in printed.out
    assert "agree" not in printed.err


def test_several_bags_are_one_model_and_their_agreement_is_told(bag, tmp_path, capsys):
    assert main(["identify", bag["first"], bag["second"], "--out", str(tmp_path)]) == 0
    metrics, parameters = contents(tmp_path)
    assert metrics["held_out"]["nrmse_mean"] < 0.05
    count = len(parameters["agreement"])
    assert count == len(parameters["combinations"]) > 0
    assert all(len(one["values"]) == len(one["stds"]) == 2 for one in parameters["agreement"])
    assert not any(one["differs"] for one in parameters["agreement"])
    assert f"The recordings agree on {count} of {count} parameters." in capsys.readouterr().err


def test_bags_of_different_rates_are_scored_behind_one_low_pass(bag, tmp_path, monkeypatch, capsys):
    """Each had its own, and that of the first was said of all."""
    slow = str(bags.write(recorded(2).part(slice(None, None, 10)), tmp_path / "slow"))
    scored = []
    monkeypatch.setattr(
        "bdnn_ros.cli.identify.score_model",
        lambda model, parts: scored.append([part.cutoff for part in parts]) or score_model(model, parts),
    )
    assert main(["identify", bag["first"], slow, "--out", str(tmp_path / "out")]) == 0
    np.testing.assert_allclose(scored, 20.0 / 6.0)
    assert "low-passed alike at 3.33 Hz." in capsys.readouterr().out


@pytest.mark.slow
def test_recordings_that_differ_are_never_joined_unseen(bag, tmp_path, capsys):
    assert main(["identify", bag["first"], bag["second"], bag["worn"], "--out", str(tmp_path)]) == 0
    _, parameters = contents(tmp_path)
    words = "Coulomb friction of arm2_joint2"
    differing = [one for one in parameters["agreement"] if one["differs"]]
    assert words in [one["words"] for one in differing]
    (one,) = (one for one in differing if one["words"] == words)
    np.testing.assert_allclose(one["values"], [2.0, 2.0, 4.0], atol=0.2)
    said = capsys.readouterr().err
    assert words in said
    assert "the recordings disagree" in said


def test_a_narrow_spread_keeps_to_the_urdf(bag, tmp_path):
    """Friction believed to be next to none stays there; the same bag tells it under the usual spread."""
    narrow = ["--spread", "friction=1e-5", "--spread", "inertial=1e-5"]
    assert main(["identify", bag["first"], "--out", str(tmp_path), *narrow]) == 0
    model, robot = load_model(tmp_path), Robot.bundled("arm2")
    assert (model.robot.coulomb < 0.2).all()
    np.testing.assert_allclose(model.robot.inertials[:, 0], robot.inertials[:, 0], rtol=0.1)


def test_odd_data_is_remarked_on_in_words_and_in_the_file(tmp_path, capsys):
    odd = recorded(1)
    path = bags.write(replace(odd, velocity=np.degrees(odd.velocity)), tmp_path / "degrees")
    assert main(["identify", str(path), "--out", str(tmp_path / "out")]) == 0
    _, parameters = contents(tmp_path / "out")
    assert [remark["about"] for remark in parameters["remarks"]] == [", ".join(odd.joints)]
    said = capsys.readouterr().err
    for remark in parameters["remarks"]:
        assert remark["problem"] in said
        assert remark["remedy"] in said


def test_good_data_is_not_remarked_on(bag, tmp_path, capsys):
    assert main(["identify", bag["first"], "--out", str(tmp_path)]) == 0
    assert contents(tmp_path)[1]["remarks"] == []
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("which", "options", "status", "words"),
    [
        ("silent", [], 1, "no effort"),
        ("still", [], 1, "no joint moves"),
        ("first", ["--holdout", "1.5"], 2, "between 0 and 1"),
        ("first", ["--holdout", "0.99"], 2, "Give a smaller share"),
        ("first", ["--budget", "0"], 2, "not a time"),
        ("first", ["--prior", "none", "--seed", "-1"], 2, "--seed -1 is negative"),
        ("first", ["--cutoff", "500"], 2, "does not fit"),
        ("first", ["--spread", "mass=0.1"], 2, "--spread mass=0.1 is no spread"),
        ("first", ["--spread", "inertial"], 2, "--spread inertial is no spread"),
        ("first", ["--spread", "inertial=-1"], 2, "above 0"),
        ("first", ["--spread", "inertial=0.1", "--prior", "none"], 2, "Leave one of them out"),
    ],
)
def test_what_cannot_be_answered_is_said_in_one_sentence(
    bag, tmp_path, capsys, which, options, status, words
):
    assert main(["identify", bag[which], "--out", str(tmp_path / "out"), *options]) == status
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()


def test_a_description_without_mass_is_nothing_to_start_from(tmp_path, capsys):
    seen = recorded(1)
    bare = re.sub("<inertial>.*?</inertial>", "", seen.urdf, flags=re.DOTALL)
    path = str(bags.write(replace(seen, urdf=bare), tmp_path / "bag"))
    assert main(["identify", path, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "none of the moving links a mass" in said and "or pass --prior none." in said
    assert not (tmp_path / "out").exists()


def test_a_joint_that_the_description_says_more_of_is_named(tmp_path, capsys):
    """Of a worn joint that moves throughout, and one as described that moves in what is held out alone."""
    robot = Robot.bundled("arm2")
    time = np.arange(0.0, 10.0, 1.0 / RATE)
    late = 0.01 + np.clip((time - 7.9) / 0.5, 0.0, 1.0)
    q = np.stack([np.sin(2.0 * time), late * np.sin(7.0 * time)], axis=1)
    v = np.gradient(q, time, axis=0)
    worn = robot.with_joint_parameters(np.array([0.5, 0.0]), np.array([5.0, 0.0]), np.array([8.0, 0.0]))
    effort = worn.inverse_dynamics(q, v, np.gradient(v, time, axis=0))
    noise = np.random.default_rng(3).normal(size=q.shape)
    effort += np.array([0.01, 0.05]) * np.ptp(effort, axis=0) * noise
    path = str(bags.write(Recording(time, robot.joints, q, v, effort, urdf=robot.urdf), tmp_path / "bag"))
    assert main(["identify", path, "--out", str(tmp_path / "out")]) == 0
    metrics, _ = contents(tmp_path / "out")
    worse = np.array(metrics["held_out"]["nrmse"]) / metrics["simulation"]["nrmse"]
    assert worse[0] < 1.0 and worse[1] > 1.2
    told = "note: arm2_joint2: of what is kept out to be scored, the description says more than the model."
    assert told + " Record more and wider motion of it.\n" in capsys.readouterr().err


def test_a_bag_of_another_robot_among_several_is_named(bag, tmp_path, capsys):
    robot = Robot.bundled("arm6")
    other = recorded(1)
    other = Recording(other.time, robot.joints[:2], other.position, None, other.effort)
    strange = str(bags.write(other, tmp_path / "strange"))
    assert main(["identify", bag["first"], strange, "--out", str(tmp_path / "model")]) == 2
    message = capsys.readouterr().err
    assert f"{Path(strange).name}: its joints ({robot.joints[0]}, {robot.joints[1]}) are none" in message


def test_parameters_are_written_where_there_is_a_prior(bag, tmp_path):
    """As its help says: those of a model that was there before are not left beside another's."""
    out = tmp_path / "model"
    for prior, further in (("urdf", ["parameters.json"]), ("none", [])):
        assert main(["identify", bag["first"], "--prior", prior, "--budget", "2", "--out", str(out)]) == 0
        assert sorted(path.name for path in out.iterdir()) == sorted(
            ["model.bdnn", "metrics.json", "effort.png", *further]
        )


@pytest.mark.slow
def test_parameters_of_another_model_beside_stay(bag, tmp_path):
    """Whether or not the file that is replaced had any; its own go with it."""
    words = ["identify", bag["first"], "--budget", "0.5", "--prior"]
    beside, parameters = tmp_path / "b.bdnn", tmp_path / "parameters.json"
    assert main([*words, "urdf", "--out", str(tmp_path / "a.bdnn")]) == 0
    told = parameters.read_text()
    for _ in range(2):
        assert main([*words, "none", "--out", str(beside)]) == 0
        assert parameters.read_text() == told
    assert main([*words, "none", "--out", str(tmp_path / "a.bdnn")]) == 0
    assert not parameters.exists() and beside.exists()
    somebodys = "[" * 100_000
    parameters.write_text(somebodys)
    assert main([*words, "none", "--out", str(tmp_path / "a.bdnn")]) == 0
    assert parameters.read_text() == somebodys


def test_a_directory_may_have_dots_in_its_name(bag, tmp_path, monkeypatch):
    """And what is beside it is nobody's business, whatever it is called."""
    monkeypatch.chdir(tmp_path)
    for name in ("metrics.json", "parameters.json", "effort.png"):
        (tmp_path / name).write_text("mine")
    assert main(["identify", bag["first"], "--out", "run_2026.11.26"]) == 0
    made = ["effort.png", "metrics.json", "model.bdnn", "parameters.json"]
    assert sorted(path.name for path in (tmp_path / "run_2026.11.26").iterdir()) == made
    words = ["identify", bag["first"], "--prior", "none", "--budget", "0.5", "--out"]
    assert main([*words, "new.d"]) == 0
    assert all((tmp_path / name).read_text() == "mine" for name in made if name != "model.bdnn")
    (tmp_path / "beside").mkdir()
    (tmp_path / "beside" / "parameters.json").write_text("[1, 2]")
    assert main([*words, "beside/arm.bdnn"]) == 0
    assert (tmp_path / "beside" / "parameters.json").read_text() == "[1, 2]"
