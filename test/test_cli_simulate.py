"""`bdnn simulate`: a bag and its truth, nothing told too early, and honest refusals."""

from __future__ import annotations

import errno
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_cases import PENDULUM

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.effects.registry import EFFECTS, parse_spec
from bdnn_ros.extension.effects_file import EffectsFile, effects_text
from bdnn_ros.robot import Robot

SHORT = ("--duration", "2", "--rate", "100")


def simulated(tmp_path: Path, *arguments: str, robot: str = "arm2") -> tuple[Path, int]:
    """Output directory and exit status of a short simulation."""
    out = tmp_path / "out"
    return out, main(["simulate", "--robot", robot, *SHORT, *arguments, "--out", str(out)])


def test_it_writes_a_bag_with_the_description_and_the_truth_beside_it(tmp_path, capsys):
    spec = "coulomb_friction@arm2_joint1:coulomb=0.5"
    out, status = simulated(tmp_path, "--effect", spec, "--effect", "effort_delay:delay=0.01")
    assert status == 0
    recording = bags.read(out / "bag")
    assert (len(recording), recording.joints) == (200, ("arm2_joint1", "arm2_joint2"))
    assert recording.urdf == Robot.bundled("arm2").urdf
    assert recording.velocity is not None and recording.effort is not None
    truth = yaml.safe_load((out / "truth.yaml").read_text())
    assert (truth["format"], truth["version"], truth["robot"]) == ("bdnn_ros/truth", 1, "arm2")
    assert truth["effects"] == [
        {"effect": "coulomb_friction", "joint": "arm2_joint1", "link": None, "parameters": {"coulomb": 0.5}},
        {"effect": "effort_delay", "joint": None, "link": None, "parameters": {"delay": 0.01}},
    ]
    printed = capsys.readouterr().out
    assert "arm2_joint1 has Coulomb friction" in printed
    assert "10 ms" in printed
    assert sorted(path.name for path in out.iterdir()) == ["bag", "truth.yaml"]


def test_one_joint_is_no_joints(tmp_path, capsys):
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    words = ["--urdf", str(tmp_path / "pendulum.urdf"), *SHORT, "--out", str(tmp_path / "out")]
    assert main(["simulate", *words]) == 0
    assert capsys.readouterr().out.endswith(": 200 samples of 1 joint.\n")


def test_the_output_directory_reads_like_the_bag_in_it(tmp_path):
    out, _ = simulated(tmp_path)
    assert (bags.read(out).position == bags.read(out / "bag").position).all()


def test_what_is_hidden_is_not_printed(tmp_path, capsys):
    out, status = simulated(tmp_path, "--hide", "2", "--seed", "3", "--worn", "--wrong", "0.05", "--coloured")
    assert status == 0
    printed = capsys.readouterr()
    truth = yaml.safe_load((out / "truth.yaml").read_text())
    assert len(truth["effects"]) == 2
    assert truth["worn"] and truth["links"] and truth["noise"]["coloured"]
    for word in (*EFFECTS, *(EFFECTS[entry["effect"]].title for entry in truth["effects"])):
        assert word not in printed.out + printed.err


def test_a_recording_that_comes_meanwhile_is_left_as_it_is(tmp_path, capsys, monkeypatch):
    write = bags.write

    def overtaken(recording, path):
        write(recording.part(slice(0, 50)), tmp_path / "out" / "bag")
        return write(recording, path)

    monkeypatch.setattr(bags, "write", overtaken)
    out, status = simulated(tmp_path)
    assert status == 2
    assert f"{out / 'bag'} is there already. Choose another --out" in capsys.readouterr().err
    assert len(bags.read(out)) == 50 and [path.name for path in out.iterdir()] == ["bag"]


def test_the_same_seed_gives_the_same_bag_and_truth(tmp_path):
    first, _ = simulated(tmp_path / "a", "--hide", "1", "--seed", "9")
    second, _ = simulated(tmp_path / "b", "--hide", "1", "--seed", "9")
    other, _ = simulated(tmp_path / "c", "--hide", "1", "--seed", "10")
    assert (first / "bag" / "bag.mcap").read_bytes() == (second / "bag" / "bag.mcap").read_bytes()
    assert (first / "truth.yaml").read_text() == (second / "truth.yaml").read_text()
    assert (first / "truth.yaml").read_text() != (other / "truth.yaml").read_text()


def test_noise_can_be_left_out(tmp_path):
    quiet, _ = simulated(tmp_path / "a", "--noise", "0")
    noisy, _ = simulated(tmp_path / "b", "--noise", "0.02")
    difference = bags.read(noisy).effort - bags.read(quiet).effort
    assert np.std(difference, axis=0) == pytest.approx(
        0.02 * np.ptp(bags.read(quiet).effort, axis=0), rel=0.2
    )


def test_encoders_round_and_velocities_may_be_missing(tmp_path):
    out, _ = simulated(tmp_path, "--noise", "0", "--resolution", "0.01", "--velocity", "none")
    recording = bags.read(out)
    assert recording.velocity is None
    steps = recording.position / 0.01
    assert steps == pytest.approx(np.round(steps), abs=1e-6)


def test_a_robot_of_ones_own_is_simulated_from_its_urdf(tmp_path):
    urdf = tmp_path / "mine.urdf"
    urdf.write_text(Robot.bundled("arm2").urdf.replace("arm2", "mine"))
    out = tmp_path / "out"
    assert main(["simulate", "--urdf", str(urdf), *SHORT, "--poor", "--out", str(out)]) == 0
    recording = bags.read(out)
    assert recording.joints == ("mine_joint1", "mine_joint2")
    assert np.count_nonzero(np.ptp(recording.position, axis=0) > 0.01) == 1
    assert yaml.safe_load((out / "truth.yaml").read_text())["robot"] == "mine"


def test_a_recording_that_is_there_is_kept_unless_told_otherwise(tmp_path, capsys):
    out, _ = simulated(tmp_path, "--seed", "1")
    before = (out / "bag" / "bag.mcap").read_bytes()
    _, status = simulated(tmp_path, "--seed", "2")
    assert (status, (out / "bag" / "bag.mcap").read_bytes()) == (2, before)
    assert "--overwrite" in capsys.readouterr().err
    _, status = simulated(tmp_path, "--seed", "2", "--overwrite")
    assert status == 0
    assert (out / "bag" / "bag.mcap").read_bytes() != before


def test_a_recording_that_cannot_be_written_leaves_the_one_that_is_there(tmp_path, capsys, monkeypatch):
    out, _ = simulated(tmp_path, "--seed", "1")
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("bdnn_ros.cli.simulate.yaml.safe_dump", full)
    _, status = simulated(tmp_path, "--seed", "2", "--overwrite")
    assert status == 2
    assert f"{out} cannot be written (No space left on device). Make room" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        (("--robot", "arm9"), 2, "arm2, arm6, arm7"),
        ((), 2, "no robot to simulate"),
        (("--robot", "arm2", "--urdf", "x.urdf"), 2, "Give one of them"),
        (("--urdf", "missing.urdf"), 2, "missing.urdf"),
        (("--robot", "arm2", "--effect", "rust"), 2, "No effect 'rust'"),
        (("--robot", "arm2", "--effect", "armature@elbow:armature=1"), 2, "cannot act on 'elbow'"),
        (("--robot", "arm2", "--rate", "7"), 2, "7 Hz cannot be simulated"),
        (("--robot", "arm2", "--duration", "1e9"), 2, "cannot be simulated"),
        (("--robot", "arm2", "--noise", "2"), 2, "makes no sense"),
        (("--robot", "arm2", "--seed", "-1"), 2, "negative"),
        (("--robot", "arm2", "--hide", "-1"), 2, "cannot be hidden"),
        (("--robot", "arm2", "--wrong", "5"), 2, "cannot be off"),
        (("--robot", "arm2", "--resolution", "3"), 2, "encoder step"),
        (("--robot", "arm2", "--effect", "payload@arm2_tool:mass=50"), 1, "too strong"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_sentence(arguments, status, says, tmp_path, capsys):
    assert main(["simulate", *arguments, "--out", str(tmp_path / "out")]) == status
    complaint = capsys.readouterr().err.strip().splitlines()[-1]
    assert complaint.startswith("bdnn: error: ")
    assert says in complaint
    assert not (tmp_path / "out").exists()


FRICTION, PUSH = "coulomb_friction@arm2_joint1", "external_wrench@arm2_joint1:torque=3"


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        (f"{FRICTION}:coulomb=inf", "coulomb_friction at arm2_joint1: coulomb=inf is beyond any robot's"),
        (f"{FRICTION}:coulomb=1e300", "coulomb=1e+300 is beyond any robot's"),
        (f"{PUSH},start=4,end=2", "ends at 2 s, not after its start at 4 s. Let it end after"),
        (f"{PUSH},start=40,end=50", "acts from 40 s to 50 s, the simulation from 0 s to 30 s. Change"),
        (f"{PUSH},start=-9,end=0", "acts from -9 s to 0 s, the simulation from 0 s to 30 s. Change"),
    ],
)
def test_effects_that_cannot_be_or_never_act_are_refused(spec, says, tmp_path, capsys):
    assert main(["simulate", "--robot", "arm2", "--effect", spec, "--out", str(tmp_path / "out")]) == 2
    (complaint,) = capsys.readouterr().err.strip().splitlines()
    assert says in complaint
    assert not (tmp_path / "out").exists()


def test_what_a_truth_holds_beside_effects_is_said_to_be_left_out_unless_it_is_asked_for(tmp_path, capsys):
    real = ("--worn", "--wrong", "0.2", "--seed", "3")
    first, _ = simulated(tmp_path / "first", "--effect", "effort_offset@arm2_joint1:offset=1", *real)
    again = ("--effects", str(first / "truth.yaml"))
    capsys.readouterr()
    for number, (given, says) in enumerate(
        (
            ((), "Pass --worn --wrong 0.2 --seed 3 as well for the same robot."),
            (real[:3], "Pass --seed 3 as well"),
            (real[1:], "Pass --worn as well"),
            (real, ""),
        )
    ):
        out, status = simulated(tmp_path / str(number), *again, *given)
        notes = capsys.readouterr().err
        assert status == 0 and (says in notes if says else notes == "")
    truths = [yaml.safe_load((one / "truth.yaml").read_text()) for one in (first, out)]
    assert truths[0] == truths[1]


def test_a_push_may_last_beyond_the_recording(tmp_path):
    for spec in (f"{PUSH},start=-1,end=9", f"{PUSH},start=1,end=inf"):
        assert simulated(tmp_path, "--effect", spec, "--overwrite")[1] == 0


def test_a_push_of_an_earlier_recording_may_be_over_and_is_said_to(tmp_path, capsys):
    """effects.yaml of a diagnosis holds pushes at that recording's times."""
    earlier, _ = simulated(tmp_path / "long", "--duration", "9", "--effect", f"{PUSH},start=6,end=7")
    capsys.readouterr()
    _, status = simulated(tmp_path, "--effects", str(earlier / "truth.yaml"))
    assert status == 0
    assert "acts from 6 s to 7 s, the simulation from 0 s to 2 s: it never acts." in capsys.readouterr().err


def test_a_model_of_a_real_robot_moves_as_that_did(tmp_path, capsys):
    """Its controller coped with what was identified; that of a simulation knew nothing of what was hidden."""
    spec = "coulomb_friction@arm6_joint6:coulomb=3"
    hidden, status = simulated(tmp_path / "hidden", "--effect", spec, robot="arm6")
    note = "arm6_joint6 moves 0 % of what is planned: the effects are too strong for its position loop."
    assert status == 0 and note in capsys.readouterr().err
    robot, effects = Robot.bundled("arm6"), tmp_path / "effects.yaml"
    effects.write_text(effects_text([parse_spec(spec, robot)], robot))
    again, status = simulated(tmp_path / "again", "--effects", str(effects), robot="arm6")
    assert status == 0 and capsys.readouterr().err == ""
    held, moved = (np.ptp(bags.read(one / "bag").position[:, 5]) for one in (hidden, again))
    assert moved > 0.3 and held < 0.01
    assert EffectsFile.read(effects).identified and not EffectsFile.read(hidden / "truth.yaml").identified
