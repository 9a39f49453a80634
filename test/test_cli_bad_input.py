"""Bad input to the real command: one sentence with its remedy, the right status, never a traceback."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import (
    EPOCH,
    JOINT_STATE,
    PENDULUM,
    STRING,
    bag_of,
    joint_state,
    model_of_pendulum,
    motion,
    states,
    text,
    write_bag,
)

from bdnn_ros import bags
from bdnn_ros.cli.main import main

Case = Callable[[Path], list[str]]
ARM2 = PENDULUM.replace('"pivot"', '"shoulder"')


def empty_file(path: Path) -> list[str]:
    (path / "a.mcap").touch()
    return [str(path / "a.mcap")]


def no_messages(path: Path) -> list[str]:
    return [str(write_bag(path / "bag", [], topics=[("/joint_states", JOINT_STATE)]))]


def truncated(path: Path) -> list[str]:
    plain = bags.write(motion(urdf=PENDULUM), path / "a.mcap")
    plain.write_bytes(plain.read_bytes()[: plain.stat().st_size // 2])
    return [str(plain)]


def not_a_bag(path: Path) -> list[str]:
    (path / "a.db3").write_text("position,velocity\n1,2\n" * 99)
    return [str(path / "a.db3")]


def other_file(path: Path) -> list[str]:
    (path / "a.csv").write_text("position,velocity\n1,2\n")
    return [str(path / "a.csv")]


def folder_without_a_bag(path: Path) -> list[str]:
    (path / "folder").mkdir()
    return [str(path / "folder")]


def no_joint_state(path: Path) -> list[str]:
    return [str(write_bag(path / "bag", [("/chatter", STRING, EPOCH, text("hello"))]))]


def other_topic(path: Path) -> list[str]:
    return [str(write_bag(path / "bag", states(motion(), topic="/arm/joint_states")))]


def no_effort(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", replace(motion(urdf=PENDULUM), effort=None)))]


def no_joint_named(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(urdf=PENDULUM))), "--joints", ""]


def nameless_joint(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(urdf=PENDULUM))), "--joints", "pivot,,elbow"]


def nameless_robot(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(urdf=PENDULUM))), "--robot", ""]


def unknown_joint(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(urdf=PENDULUM))), "--joints", "pivot,elbow"]


def wrong_urdf(path: Path) -> list[str]:
    (path / "other.urdf").write_text(ARM2)
    return [str(bag_of(path / "bag", motion())), "--urdf", str(path / "other.urdf")]


def no_urdf(path: Path) -> list[str]:
    (path / "other.urdf").write_text("<launch><node/></launch>")
    return [str(bag_of(path / "bag", motion())), "--urdf", str(path / "other.urdf")]


def nan_samples(path: Path) -> list[str]:
    messages = states(motion(urdf=PENDULUM))
    spoilt = joint_state(("pivot",), (np.nan,), (0.0,), (0.0,), messages[50][2])
    messages[50] = (*messages[50][:3], spoilt)
    return [str(write_bag(path / "bag", messages))]


def incredible_sample(path: Path) -> list[str]:
    messages = states(motion(urdf=PENDULUM))
    spoilt = joint_state(("pivot",), (7e299,), (0.0,), (0.0,), messages[50][2])
    messages[50] = (*messages[50][:3], spoilt)
    return [str(write_bag(path / "bag", messages))]


def incredible_positions(path: Path) -> list[str]:
    recording = motion(urdf=PENDULUM)
    return [str(bag_of(path / "bag", replace(recording, position=1e300 * recording.position)))]


def heavy_urdf(path: Path) -> list[str]:
    (path / "heavy.urdf").write_text(PENDULUM.replace('value="2"', 'value="1e300"'))
    return [str(bag_of(path / "bag", motion())), "--urdf", str(path / "heavy.urdf")]


def wrong_lengths(path: Path) -> list[str]:
    recording = motion(joints=("a", "b"))
    messages = [
        (topic, kind, stamp, joint_state(("a", "b"), q, v, (1.0,), stamp))
        for (topic, kind, stamp, _), q, v in zip(
            states(recording), recording.position, recording.velocity, strict=True
        )
    ]
    return [str(write_bag(path / "bag", messages))]


def named_twice(path: Path) -> list[str]:
    messages = [
        (topic, kind, stamp, joint_state(("a", "a"), (1.0, 2.0), (), (3.0, 4.0), stamp))
        for topic, kind, stamp, _ in states(motion())
    ]
    return [str(write_bag(path / "bag", messages))]


def backwards(path: Path) -> list[str]:
    messages = states(motion())
    turned = [(t, k, EPOCH + n, data) for n, (t, k, _, data) in enumerate([*messages[300:], *messages[:300]])]
    return [str(write_bag(path / "bag", turned))]


def two_samples(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(samples=2, urdf=PENDULUM)))]


def constant_position(path: Path) -> list[str]:
    still = np.full((600, 1), 0.3)
    return [str(bag_of(path / "bag", replace(motion(urdf=PENDULUM), position=still, velocity=0.0 * still)))]


def nothing_there(path: Path) -> list[str]:
    return [str(path / "nothing.mcap")]


def bad_rename(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(urdf=PENDULUM))), "--rename", "s/fer_/panda_/"]


def bad_cutoff(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(urdf=PENDULUM))), "--cutoff", "9000"]


def no_such_robot(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(urdf=PENDULUM))), "--robot", "nobody"]


def no_commands(path: Path) -> list[str]:
    return [str(bag_of(path / "bag", motion(urdf=PENDULUM))), "--effort", "command"]


CASES: list[tuple[Case, int, str]] = [
    (empty_file, 1, "is empty"),
    (no_messages, 1, "without messages"),
    (truncated, 1, "truncated or damaged"),
    (not_a_bag, 1, "not a bag"),
    (other_file, 2, "not a bag"),
    (folder_without_a_bag, 2, "a directory without a bag"),
    (no_joint_state, 1, "holds no sensor_msgs/JointState; its topics are /chatter"),
    (other_topic, 2, "on /arm/joint_states. Choose it with --joint-states /arm/joint_states"),
    (no_effort, 1, "carry no effort"),
    (nan_samples, 1, "position of pivot is not finite at 0.500 s"),
    (
        incredible_sample,
        1,
        "position of pivot is 7e+299 at 0.500 s, as no robot's can be (1 of 600 samples). Fix",
    ),
    (
        incredible_positions,
        1,
        "as no robot's can be (600 of 600 samples). Check its unit, and fix the driver.",
    ),
    (heavy_urdf, 2, 'The <mass> of link rod has value="1e300", as no robot has. Correct the URDF'),
    (
        wrong_lengths,
        1,
        "(A JointState has 2 names and 1 values of effort). Let the driver send one value of effort for",
    ),
    (named_twice, 1, "(A JointState names a twice). Let the driver name each joint once."),
    (backwards, 1, "do not increase"),
    (two_samples, 1, "2 samples are too few"),
    (constant_position, 1, "no joint moves"),
    (unknown_joint, 2, "joint elbow is not in the recording, which has pivot"),
    (wrong_urdf, 2, "joints (pivot) are none of the URDF's (shoulder). Map the names with --rename"),
    (no_urdf, 2, "the root element is <launch>"),
    (nothing_there, 2, "There is no bag"),
    (bad_rename, 2, "matches none of pivot"),
    (bad_cutoff, 2, "cut-off of 9000 Hz does not fit"),
    (no_such_robot, 2, "No bundled robot 'nobody'"),
    (no_joint_named, 2, "--joints names no joint. Name at least one, or leave the option out"),
    (nameless_joint, 2, "--joints pivot,,elbow has a name that is empty"),
    (nameless_robot, 2, "No bundled robot ''"),
    (no_commands, 2, "the bag has no effort commands (std_msgs/Float64MultiArray). Use --effort measured"),
]
IDS = [case.__name__ for case, _, _ in CASES]


def assert_one_sentence(stderr: str, sentence: str) -> None:
    """One line is the error, and it says this; the others are notes."""
    lines = stderr.splitlines()
    errors = [line for line in lines if line.startswith("bdnn: error: ")]
    assert len(errors) == 1, stderr
    assert all(line.startswith("bdnn: note: ") for line in lines if line not in errors), stderr
    assert sentence in errors[0]
    assert errors[0].endswith((".", "`")), errors[0]


@pytest.mark.parametrize(("case", "status", "sentence"), CASES, ids=IDS)
def test_info(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], case: Case, status: int, sentence: str
) -> None:
    assert main(["info", *case(tmp_path)]) == status
    assert_one_sentence(capfd.readouterr().err, sentence)


@pytest.mark.parametrize(("case", "status", "sentence"), CASES[::6], ids=IDS[::6])
def test_info_as_a_process(tmp_path: Path, case: Case, status: int, sentence: str) -> None:
    command = [sys.executable, "-m", "bdnn_ros.cli.main", "info", *case(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert_one_sentence(done.stderr, sentence)
    assert done.returncode == status
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.parametrize(("case", "status", "sentence"), CASES, ids=IDS)
def test_identify(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], case: Case, status: int, sentence: str
) -> None:
    assert main(["identify", *case(tmp_path), "--out", str(tmp_path / "model")]) == status
    assert_one_sentence(capfd.readouterr().err, sentence)
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("verb", ["info", "identify", "replay", "diagnose"])
def test_half_a_second_is_too_short_and_nothing_else(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], verb: str
) -> None:
    bag = str(bag_of(tmp_path / "bag", motion(samples=50, urdf=PENDULUM)))
    out = ["--out", str(tmp_path / "out")] if verb in ("identify", "diagnose") else []
    assert main([verb, bag, *out]) == 1
    captured = capfd.readouterr()
    assert_one_sentence(captured.err, "s of motion are too short")
    assert "Fit for identification" not in captured.out
    assert "- pivot" not in captured.out


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the pendulum."""
    return model_of_pendulum(tmp_path_factory.mktemp("pendulum"))


PREDICTED_ALL_THE_SAME = {"no_effort", "nan_samples", "incredible_sample", "two_samples", "constant_position"}


@pytest.mark.parametrize(("case", "status", "sentence"), CASES, ids=IDS)
def test_evaluate_and_predict(
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    model: Path,
    case: Case,
    status: int,
    sentence: str,
) -> None:
    arguments = case(tmp_path)
    capfd.readouterr()
    assert main(["evaluate", str(model), *arguments]) == status
    assert capfd.readouterr().err.count("bdnn: error: ") == 1
    out = tmp_path / "effort.csv"
    predicted = main(["predict", str(model), *arguments, "--out", str(out)])
    if case.__name__ in PREDICTED_ALL_THE_SAME:
        assert predicted == 0
        assert out.exists()
    else:
        assert predicted == status
        assert not out.exists()
        assert capfd.readouterr().err.count("bdnn: error: ") == 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], None),
        (["paint"], "There is no verb 'paint'; there are demo, simulate, info"),
        (["info"], "The following arguments are required: BAG. See bdnn info --help."),
        (["info", "a", "b"], "Unrecognized arguments: b"),
        (["info", "a", "--colour"], "Unrecognized arguments: --colour"),
        (["info", "a", "--cutoff", "slow"], "invalid float value: 'slow'"),
        (["info", "a", "--effort", "felt"], "invalid choice: 'felt'"),
        (["evaluate", "no_model", "a"], "no_model"),
        (["identify", "a.mcap"], "required: --out"),
    ],
)
def test_wrong_words(words: list[str], sentence: str | None, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    captured = capfd.readouterr()
    if sentence is None:
        assert "usage: bdnn VERB" in captured.err
    else:
        assert_one_sentence(captured.err, sentence)
        assert captured.out == ""


def test_numbers_that_no_method_survives_get_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And other errors of ours stay visible."""

    def failing(error: Exception) -> Callable[..., None]:
        def run(args: object) -> None:
            raise error

        return run

    bag = str(bag_of(tmp_path / "bag", motion()))
    monkeypatch.setattr("bdnn_ros.cli.info.run", failing(np.linalg.LinAlgError("Singular matrix")))
    assert main(["info", bag]) == 1
    assert "broke down on these numbers" in capsys.readouterr().err
    monkeypatch.setattr("bdnn_ros.cli.info.run", failing(ValueError("a bug")))
    with pytest.raises(ValueError, match="a bug"):
        main(["info", bag])
