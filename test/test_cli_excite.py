"""`bdnn excite`: files that a controller takes, and clear refusals."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Duration, Time
from excitation_cases import finding, place, write_diagnosis
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from bdnn_ros import bags
from bdnn_ros.cli.excite import _summary, csv_lines, yaml_lines
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import ENOUGH
from bdnn_ros.effects.registry import get
from bdnn_ros.excitation import choice
from bdnn_ros.excitation.rivals import Suspect
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.models import save_model
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import Trajectory
from bdnn_ros.simulation.trajectory_file import read_trajectory

JOINTS = ("arm2_joint1", "arm2_joint2")


@pytest.fixture(autouse=True)
def quick(monkeypatch) -> None:
    monkeypatch.setattr(choice, "DRAWS", 20)
    monkeypatch.setattr(choice, "CHANGES", 5)


@pytest.fixture
def diagnosis(tmp_path: Path) -> Path:
    friction = finding(
        place("coulomb_friction", JOINTS[0]), {"coulomb": 0.3}, place("viscous_friction", JOINTS[0])
    )
    return write_diagnosis(tmp_path / "diagnosis.json", JOINTS, friction, urdf="arm2")


def test_files_agree_and_keep_the_limits(diagnosis: Path, tmp_path: Path, capsys) -> None:
    limits = ["--velocity", "0.5", "--acceleration", "6", "--range", "arm2_joint1=-1:0.5"]
    out = tmp_path / "next"
    words = [
        "excite",
        "--for",
        str(diagnosis),
        "--out",
        str(out),
        "--duration",
        "12",
        "--rate",
        "50",
        *limits,
    ]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "coulomb_friction@arm2_joint1 or viscous_friction@arm2_joint1" in said
    header, *lines = (out / "trajectory.csv").read_text().splitlines()
    assert header.split(",")[:3] == ["time", "arm2_joint1.position", "arm2_joint2.position"]
    table = np.array([[float(x) for x in line.split(",")] for line in lines])
    assert table.shape[1] == 7
    np.testing.assert_allclose(np.diff(table[:, 0]), 0.02, atol=1e-9)
    robot = Robot.bundled("arm2")
    assert table[:, 1].min() >= -1.0 and table[:, 1].max() <= 0.5
    assert (np.abs(table[:, 3:5]) <= 0.501 * robot.limits.velocity).all()
    assert np.abs(table[:, 5:7]).max() <= 6.01

    message = yaml.safe_load((out / "trajectory.yaml").read_text())
    assert set(message) == {"header", "joint_names", "points"}
    assert message["joint_names"] == list(JOINTS)
    points = message["points"]
    assert len(points) == len(table)
    assert set(points[0]) == {"positions", "velocities", "accelerations", "effort", "time_from_start"}
    np.testing.assert_allclose([p["positions"] for p in points], table[:, 1:3], atol=1e-9)
    np.testing.assert_allclose([p["accelerations"] for p in points], table[:, 5:7], atol=1e-9)
    stamps = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points]
    np.testing.assert_allclose(stamps, table[:, 0], atol=1e-9)


def test_the_yaml_is_a_message_with_all_its_fields() -> None:
    """As `set_message_fields` fills it, which the virtual environment lacks."""
    still = np.zeros((2, 2))
    lines = yaml_lines(Trajectory(np.array([0.0, 1.25]), still, still, still), JOINTS)
    content = yaml.safe_load("".join(lines))
    for point in content["points"]:
        point["time_from_start"] = Duration(**point["time_from_start"])
    content["points"] = [JointTrajectoryPoint(**point) for point in content["points"]]
    content["header"] = Header(stamp=Time(**content["header"].pop("stamp")), **content["header"])
    message = JointTrajectory(**content)
    assert [*message.joint_names] == [*JOINTS]
    assert message.points[1].time_from_start == Duration(sec=1, nanosec=250_000_000)


def test_any_name_of_a_joint_is_read_again() -> None:
    names = ('it\'s a "joint"', "back\\slash", "größe 😀")
    still = np.zeros((1, 3))
    lines = yaml_lines(Trajectory(np.zeros(1), still, still, still), names)
    assert tuple(yaml.safe_load("".join(lines))["joint_names"]) == names


def test_joints_with_commas_and_quotes_in_their_names_are_simulated_again(tmp_path: Path) -> None:
    name = 'left,1 "a"'
    robot = Robot.from_urdf(Robot.bundled("arm2").urdf.replace(JOINTS[0], name.replace('"', "&quot;")))
    assert robot.joints == (name, JOINTS[1])
    still, path = np.tile([0.1, 0.2], (3, 1)), tmp_path / "trajectory.csv"
    motion = Trajectory(np.arange(3.0), still, 0.0 * still, 0.0 * still)
    path.write_text("".join(csv_lines(motion, robot.joints)))
    np.testing.assert_allclose(read_trajectory(path, robot, 50.0).position[0], [0.1, 0.2])


def test_the_same_seed_gives_the_same_files(diagnosis: Path, tmp_path: Path) -> None:
    texts = []
    for seed, name in ((1, "a"), (1, "b"), (2, "c")):
        words = ["excite", "--for", str(diagnosis), "--duration", "8", "--seed", str(seed)]
        assert main([*words, "--out", str(tmp_path / name)]) == 0
        texts.append((tmp_path / name / "trajectory.csv").read_text())
    assert texts[0] == texts[1] != texts[2]


@pytest.mark.slow
def test_a_model_or_a_robot_without_a_diagnosis(tmp_path: Path, capsys) -> None:
    model = save_model(tmp_path, ExtendedModel(Robot.bundled("arm2"), (), np.zeros(2)))
    for robot in ([str(model)], ["--robot", "arm2"]):
        assert main(["excite", *robot, "--duration", "8", "--out", str(tmp_path / "out")]) == 0
        assert "shows all parameters" in capsys.readouterr().out


@pytest.mark.slow
def test_the_model_beside_a_diagnosis_is_its_robot(tmp_path: Path, capsys) -> None:
    """As where the bag had the description; a model of other joints is another's."""
    friction = finding(place("coulomb_friction", JOINTS[0]), {"coulomb": 0.3})
    path = write_diagnosis(
        tmp_path / "diagnosis.json", JOINTS, friction, urdf="/robot_description of the bag"
    )
    words = ["excite", "--for", str(path), "--duration", "8", "--out", str(tmp_path / "out")]
    for robot in (None, Robot.bundled("arm6")):
        if robot is not None:
            save_model(tmp_path, ExtendedModel(robot, (), np.zeros(robot.width)))
        assert main(words) == 2
        assert "There is no robot." in capsys.readouterr().err
    save_model(tmp_path, ExtendedModel(Robot.bundled("arm2"), (), np.zeros(2)))
    assert main(words) == 0
    assert (tmp_path / "out" / "trajectory.csv").read_text().startswith(f"time,{JOINTS[0]}.position")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("findings", "says"),
    [
        ([], "the diagnosis names no cause"),
        ([place("viscous_friction", JOINTS[0], p=1e-40)], "no rival is open, since none is 10 % probable"),
        ([place("drift", JOINTS[0])], "what is open, no other motion settles"),
    ],
)
def test_where_no_rival_is_open_it_is_said_and_there_is_a_motion(
    findings: list[dict], says: str, tmp_path: Path, capsys
) -> None:
    own = [finding(place("coulomb_friction", JOINTS[0]), {"coulomb": 0.3}, *findings)] if findings else []
    path = write_diagnosis(tmp_path / "diagnosis.json", JOINTS, *own, urdf="arm2")
    assert main(["excite", "--for", str(path), "--duration", "8", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert f"; {says}: it shows all parameters." in said and "viscous" not in said
    assert (tmp_path / "out" / "trajectory.csv").exists()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "no robot"),
        (["--robot", "arm2", "--urdf", "x.urdf"], "More than one"),
        (["--robot", "arm2", "--duration", "1"], "1 s"),
        (["--robot", "arm2", "--margin", "0.7"], "margin"),
        (["--robot", "arm2", "--range", "arm2_joint1=left"], "--range"),
        (
            ["--robot", "arm2", "--range", "elbow=0:1"],
            "elbow' to narrow. There are arm2_joint1, arm2_joint2.",
        ),
        (["--robot", "arm2", "--range", "arm2_joint1=nan:1"], "range nan to 1 of arm2_joint1"),
        (["--robot", "arm2", "--range", "arm2_joint1=0:nan"], "range 0 to nan of arm2_joint1"),
        (["--robot", "arm2", "--range", "arm2_joint1=1:-1"], "range 1 to -1 of arm2_joint1"),
        (["--robot", "arm2", *2 * ["--range", "arm2_joint1=0:1"]], "twice for arm2_joint1"),
        (["--robot", "arm2", "--seed", "-1"], "negative"),
        (["--robot", "arm2", "--for", "nowhere.json"], "cannot be read"),
        (["nowhere"], "no model"),
    ],
)
def test_wrong_usage(words: list[str], says: str, capsys) -> None:
    assert main(["excite", *words]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("bdnn_ros/diagnosis", "other"), "not a diagnosis"),
        (("noise_floor", "nothing"), "incomplete"),
        (("coulomb_friction", "gremlins"), "gremlins"),
        (("arm2_joint1", "elbow"), "elbow"),
        (("{", "["), "cannot be read"),
        (("{", "[" * 100_000), "cannot be read"),
    ],
)
def test_damaged_diagnoses(diagnosis: Path, change: tuple[str, str], says: str, capsys) -> None:
    diagnosis.write_text(diagnosis.read_text().replace(*change))
    assert main(["excite", "--robot", "arm2", "--for", str(diagnosis)]) == 2
    error = capsys.readouterr().err
    assert says in error and "Traceback" not in error


@pytest.mark.slow
def test_limits_that_stand_for_missing_ones_are_said(tmp_path: Path, capsys) -> None:
    urdf = Robot.bundled("arm2").urdf
    open_ = re.sub(r"<limit[^>]*/>", "", urdf).replace('type="revolute"', 'type="continuous"')
    (tmp_path / "open.urdf").write_text(open_)
    words = [
        "excite",
        "--urdf",
        str(tmp_path / "open.urdf"),
        "--out",
        str(tmp_path / "out"),
        "--duration",
        "6",
    ]
    assert main(words) == 0
    said = capsys.readouterr().err
    assert "gives arm2_joint1, arm2_joint2 no position limits" in said
    assert "no velocity limit: 2 rad/s (or m/s) is taken" in said
    assert "gives arm2_joint1, arm2_joint2 no effort limit: none is kept" in said
    (tmp_path / "shut.urdf").write_text(urdf)
    capsys.readouterr()
    assert main([*words[:2], str(tmp_path / "shut.urdf"), *words[3:]]) == 0
    assert "limit" not in capsys.readouterr().err


@pytest.mark.slow
def test_an_effort_limit_of_zero_is_none_and_said(tmp_path: Path, capsys) -> None:
    """As drafts of a description have it: the motion keeps none, in silence."""
    urdf = re.sub(r'effort="4[^"]*"', 'effort="0"', Robot.bundled("arm2").urdf)
    (tmp_path / "weak.urdf").write_text(urdf)
    words = ["--urdf", str(tmp_path / "weak.urdf"), "--duration", "5", "--out", str(tmp_path)]
    assert main(["excite", *words]) == 0
    said = capsys.readouterr().err
    assert "the description gives arm2_joint2 no effort limit: none is kept." in said
    assert f"a recording of 5 s is mostly too short for `bdnn diagnose`, which asks for {ENOUGH:g} s" in said


@pytest.mark.slow
def test_joints_that_are_not_named_stand_still(tmp_path: Path, capsys) -> None:
    """As wheels and fingers beside an arm; the motion of the others is simulated and ordered as asked for."""
    picked = ("arm6_joint3", "arm6_joint2")
    words = ["--robot", "arm6", "--joints", ",".join(picked)]
    assert main(["excite", *words, "--duration", "5", "--out", str(tmp_path)]) == 0
    header = (tmp_path / "trajectory.csv").read_text().splitlines()[0].split(",")
    assert [name.removesuffix(".position") for name in header if name.endswith(".position")] == [*picked]
    assert yaml.safe_load((tmp_path / "trajectory.yaml").read_text())["joint_names"] == [*picked]
    motion = ["--trajectory", str(tmp_path / "trajectory.csv"), "--rate", "100"]
    assert main(["simulate", *words, *motion, "--out", str(tmp_path)]) == 0
    assert {*bags.read(tmp_path / "bag").joints} == {*picked}
    truth = ["--effects", str(tmp_path / "truth.yaml")]
    assert main(["simulate", *words[:2], "--joints", "arm6_joint1", *truth, "--out", str(tmp_path)]) == 2
    assert "truth.yaml is of the joints arm6_joint3, arm6_joint2" in capsys.readouterr().err


@pytest.mark.slow
def test_joints_of_a_model_or_a_diagnosis_are_put_in_order_but_not_left_out(
    diagnosis: Path, tmp_path: Path, capsys
) -> None:
    model = str(save_model(tmp_path, ExtendedModel(Robot.bundled("arm2"), (), np.zeros(2))))
    seen = []
    for name, given in (("a", ()), ("b", JOINTS[::-1])):
        words = ["excite", model, "--duration", "5", "--out", str(tmp_path / name)]
        assert main([*words, *(("--joints", ",".join(given)) if given else ())]) == 0
        table = np.genfromtxt(tmp_path / name / "trajectory.csv", delimiter=",", names=True, deletechars="")
        seen.append([table[f"{joint}.velocity"] for joint in JOINTS])
        assert table.dtype.names[1] == f"{(given or JOINTS)[0]}.position"
    np.testing.assert_array_equal(*seen)
    for words, says in (
        ([model, "--joints", JOINTS[0]], f"The model needs joint {JOINTS[1]}"),
        ([model, "--joints", f"{JOINTS[0]},{JOINTS[1]},elbow"], "does not have elbow"),
        (["--for", str(diagnosis), "--joints", JOINTS[1]], f"The diagnosis needs joint {JOINTS[0]}"),
    ):
        assert main(["excite", *words]) == 2
        assert says in capsys.readouterr().err


@pytest.mark.slow
def test_joints_that_hardly_move_are_named(tmp_path: Path, capsys) -> None:
    words = ["excite", "--robot", "arm2", "--duration", "6", "--out", str(tmp_path / "next")]
    assert main([*words, "--range", f"{JOINTS[1]}=0.1:0.10001"]) == 0
    said = capsys.readouterr().out
    assert "it shows the parameters of the joints that move." in said
    assert f"\n{JOINTS[1]}: travels less than 0.0005 rad" in said and JOINTS[0] not in said
    assert main([*words, "--velocity", "1e-9"]) == 1
    said = capsys.readouterr().err
    assert "\nbdnn: error: Inside these limits every joint travels less than 0.0005 rad" in said


@pytest.mark.parametrize(
    ("evidence", "said"), [(1e-6, "hardly any motion"), (2.0, "may stay open"), (20.0, "")]
)
def test_more_motion_is_promised_only_where_some_may_help(evidence: float, said: str) -> None:
    robot, none = Robot.bundled("arm2"), np.zeros((1, 2))
    offset, uneven = (
        Suspect(get(name), 0, None, None, 0.5) for name in ("effort_offset", "asymmetric_friction")
    )
    motion = Trajectory(np.zeros(1), none, none, none)
    found = choice.Excitation(motion, (choice.Separation(offset, uneven, evidence),), ())
    line = _summary(found, robot, None)[1]
    assert said in line and ("(" in line) == bool(said)
