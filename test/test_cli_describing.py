"""Whose description of the robot counts: --urdf, else the bag's where it can be used, else --robot."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from bag_cases import PENDULUM, STRING, bag_of, motion, states, text, write_bag

from bdnn_ros import bags
from bdnn_ros.cli import describing
from bdnn_ros.cli.main import main
from bdnn_ros.errors import RobotError
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

ARM2 = Robot.bundled("arm2")
PROBLEM = "The robot description is not a usable URDF (syntax error: line 1, column 0)."


def recording(name: str = "bag", urdf: str | None = "no description", samples: int = 1500) -> Recording:
    """A motion of the bundled two-axis arm's joints."""
    return replace(motion(samples=samples, joints=ARM2.joints, urdf=urdf), name=name)


@pytest.fixture
def bag(tmp_path: Path) -> Iterator[str]:
    """A bag whose description is no URDF."""
    yield str(bag_of(tmp_path / "bag", recording()))


def test_info_says_that_a_description_cannot_be_used(bag: str, capsys: pytest.CaptureFixture[str]) -> None:
    remark = f"{bag}: {PROBLEM} Give another with --urdf FILE or --robot NAME."
    assert main(["info", bag, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["usable"] is True and remark in told["concerns"]
    assert main(["info", bag]) == 0
    printed = capsys.readouterr().out
    assert f"- {remark}" in printed
    assert printed.endswith("with a robot description from --urdf FILE or --robot NAME.\n")
    assert main(["info", bag, "--robot", "arm2"]) == 0
    captured = capsys.readouterr()
    assert captured.out.endswith("Fit for identification.\n") and PROBLEM not in captured.out
    assert "is left out and --robot arm2 taken: the robot description is not a usable URDF" in captured.err


def test_an_empty_description_is_one_that_cannot_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = states(motion(samples=1500, joints=ARM2.joints))
    empty = ("/robot_description", STRING, messages[0][2], text(""))
    path = str(write_bag(tmp_path / "bag", [empty, *messages]))
    assert main(["info", path]) == 0
    printed = capsys.readouterr().out
    assert f"- {path}: The robot description is empty. Give another with --urdf FILE" in printed
    assert "not in the bag: nothing" in printed
    assert main(["identify", path, "--out", str(tmp_path / "out")]) == 2
    assert f"{path}: The robot description is empty. Give another" in capsys.readouterr().err


def test_names_are_mapped_only_where_a_bag_has_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = bag_of(tmp_path / "bag", motion(joints=("pivot", "wheel"))), str(tmp_path / "out")
    urdf, joints = tmp_path / "pendulum.urdf", ["--joints", "pivot,wheel"]
    urdf.write_text(PENDULUM)
    lacks = (
        "The URDF has no movable joint wheel; it has pivot. Use the URDF of this robot, or joints that it has"
    )
    for verb, end in (
        (["identify", str(path), "--out", out], ", or map the bag's names with --rename.\n"),
        (["simulate", "--out", out], ".\n"),
        (["excite", "--out", out], ".\n"),
    ):
        assert main([*verb, "--urdf", str(urdf), *joints]) == 2
        assert capsys.readouterr().err.endswith(lacks + end)


def test_info_says_that_a_joint_is_not_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bag_of(tmp_path / "bag", motion(samples=1500, joints=("pivot", "wheel"), urdf=PENDULUM))
    assert main(["info", str(path), "--joints", "wheel"]) == 0
    assert "- " + str(path) + ": The URDF has no movable joint wheel" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("left", "names", "hint"),
    [
        (
            6,
            ["d"],
            "d of the bag is not in the URDF: if it is arm7_joint7, under another name, pass --rename d=arm7_joint7.",
        ),
        (
            5,
            ["q_joint7"],
            "if it is one of these, as arm7_joint7, under another name, pass --rename q_joint7=arm7_joint7.",
        ),
        (
            6,
            ["lamp", "a_joint7"],
            "lamp, a_joint7 of the bag are not in the URDF: if one of them is arm7_joint7, under another name, "
            "pass --rename a_joint7=arm7_joint7.",
        ),
        (7, ["lamp"], ""),
        (6, [], ""),
    ],
)
def test_a_joint_under_another_name_is_asked_after(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], left: int, names: list[str], hint: str
) -> None:
    """It was left out, and what the others feel of it passed for too little motion."""
    held = (*(f"arm7_joint{k}" for k in range(1, left + 1)), *names)
    path = str(bag_of(tmp_path / "bag", motion(samples=1500, joints=held, urdf=Robot.bundled("arm7").urdf)))
    assert main(["info", path]) == 0
    said = capsys.readouterr()
    assert (hint in said.out) and (hint in said.err)
    assert hint or "--rename" not in said.out + said.err


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (
            ("arm7_joint1", "arm7_joint7"),
            "arm7_joint2, arm7_joint3 of the URDF are in no message that is used",
        ),
        (
            ("arm7_joint1", "arm7_joint2", "arm7_joint7"),
            "arm7_joint3 of the URDF is in no message that is used",
        ),
    ],
)
def test_info_names_the_joints_that_the_bag_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], joints: tuple[str, ...], said: str
) -> None:
    held = (*joints, "arm7_joint4", "arm7_joint5", "arm7_joint6")
    path = str(bag_of(tmp_path / "bag", motion(samples=1500, joints=held, urdf=Robot.bundled("arm7").urdf)))
    absent = [f"joint arm7_joint{k}" for k in (2, 3) if f"arm7_joint{k}" not in held]
    assert main(["info", path, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["missing"] == absent
    assert [text for text in told["concerns"] if text.startswith(f"{said}: the other joints feel")]
    assert main(["info", path]) == 0
    printed = capsys.readouterr().out
    assert f"not in the bag: {', '.join(absent)}\n" in printed and f"- {said}" in printed
    assert main(["info", path, "--joints", joints[0]]) == 0
    printed = capsys.readouterr().out
    assert "not in the bag: nothing" in printed and "no message" not in printed


@pytest.mark.parametrize("verb", ["identify", "diagnose", "replay"])
def test_what_needs_a_description_names_the_bag_and_the_remedy(
    bag: str, tmp_path: Path, verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([verb, bag, "--out", str(tmp_path / "out")]) == 2
    error = f"bdnn: error: {bag}: {PROBLEM} Give another with --urdf FILE or --robot NAME.\n"
    assert capsys.readouterr().err.endswith(error)


@pytest.mark.parametrize("verb", ["identify", "simulate", "excite"])
def test_a_file_that_is_no_urdf_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text("arm")
    bag = [str(bag_of(tmp_path / "bag", recording()))] if verb == "identify" else []
    assert main([verb, *bag, "--urdf", str(urdf), "--out", str(tmp_path / "out")]) == 2
    assert f"error: {urdf}: {PROBLEM}" in capsys.readouterr().err


def test_a_robot_that_may_roam_is_looked_at_where_its_arm_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    roaming = ARM2.urdf.replace(
        "</robot>",
        '<link name="world"/><joint name="wheels" type="planar"><parent link="world"/>'
        f'<child link="{ARM2.links[0]}"/><axis xyz="0 0 1"/></joint></robot>',
    )
    path, out = str(bag_of(tmp_path / "bag", recording(urdf=roaming))), str(tmp_path / "out")
    urdf = tmp_path / "roaming.urdf"
    urdf.write_text(roaming)
    refused = "more than one degree of freedom (wheels), and only where others are named (--joints)"
    assert main(["identify", path, "--urdf", str(urdf), "--out", out]) == 2
    assert refused in capsys.readouterr().err
    assert main(["identify", path, "--out", out]) == 2
    assert refused in capsys.readouterr().err
    assert main(["info", path]) == 0
    assert refused in capsys.readouterr().out
    assert main(["info", path, "--joints", ",".join(ARM2.joints)]) == 0
    captured = capsys.readouterr()
    assert "wheels of the URDF, of more than one degree of freedom, held" in captured.err
    assert captured.out.endswith("Fit for identification.\n")


def test_a_bundled_robot_stands_in(bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "model"
    assert main(["identify", bag, "--robot", "arm2", "--out", str(out)]) == 0
    assert "simulation" in json.loads((out / "metrics.json").read_text())
    assert "--robot arm2 taken" in capsys.readouterr().err


def test_what_needs_none_goes_on_and_says_so(
    bag: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "model"
    assert main(["identify", bag, "--prior", "none", "--budget", "0.5", "--out", str(out)]) == 0
    assert sorted(json.loads((out / "metrics.json").read_text())) == ["held_out", "training"]
    assert PROBLEM in capsys.readouterr().err
    assert main(["evaluate", str(out), bag]) == 0
    assert PROBLEM in capsys.readouterr().err
    assert main(["evaluate", str(out), bag, "--add-gravity"]) == 2
    assert f"{bag}: {PROBLEM}" in capsys.readouterr().err


def test_the_first_description_that_can_be_used_counts(capsys: pytest.CaptureFixture[str]) -> None:
    broken = {"broken": "no description"}
    robot = describing.described_robot({**broken, "whole": ARM2.urdf}, None, needed=True)
    assert robot is not None and robot.urdf == ARM2.urdf
    assert "The description in broken is left out and that of whole taken" in capsys.readouterr().err
    assert describing.described_robot({"bag": None}, None, needed=True) is None
    assert describing.described_robot(broken, None, needed=False) is None
    with pytest.raises(RobotError, match=r"^broken: "):
        describing.described_robot(broken, None, needed=True)


@pytest.mark.slow
def test_a_diagnosis_names_the_description_that_was_used(tmp_path: Path) -> None:
    assert main(["simulate", "--robot", "arm2", "--duration", "12", "--out", str(tmp_path)]) == 0
    spoilt = replace(bags.read(tmp_path / "bag"), urdf="no description")
    path = bag_of(tmp_path / "spoilt", spoilt)
    for name, bag, words in (("own", tmp_path / "bag", []), ("bundled", path, ["--robot", "arm2"])):
        assert main(["diagnose", str(bag), *words, "--out", str(tmp_path / name)]) == 0
    used = [
        json.loads((tmp_path / name / "diagnosis.json").read_text())["source"]["urdf"]
        for name in ("own", "bundled")
    ]
    assert used == ["/robot_description of the bag", "arm2"]


@pytest.mark.slow
def test_a_diagnosis_keeps_that_a_joint_of_the_description_is_in_no_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "--robot", "arm2", "--duration", "12", "--out", str(tmp_path)]) == 0
    whole = bags.read(tmp_path / "bag")
    bag = bag_of(tmp_path / "part", replace(whole.select(["arm2_joint1"]), urdf=whole.urdf))
    for words, told in (([], True), (["--joints", "arm2_joint1"], False)):
        out = tmp_path / f"told_{told}"
        assert main(["diagnose", str(bag), *words, "--out", str(out)]) == 0
        sentence = "arm2_joint2 of the URDF is in no message that is used"
        notes = json.loads((out / "diagnosis.json").read_text())["notes"]
        assert any(sentence in note for note in notes) == told
        assert (sentence in (out / "report.html").read_text()) == told
        assert (f"Data check: {sentence}" in capsys.readouterr().out) == told
