"""The command: quick help, honest exit statuses, and what info and evaluate print."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import PENDULUM, bag_of, motion
from cli_cases import Pendulum, swing

from bdnn_ros import bags, cli
from bdnn_ros.cli import info, loading, options, outputs
from bdnn_ros.cli.main import BROKEN_PIPE_STATUS, ENDING, INTERRUPTED_STATUS, VERBS, main
from bdnn_ros.errors import DataError, UsageError
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import score
from bdnn_ros.signals import prepare

MODULES = sorted(
    p.stem
    for p in Path(cli.__file__).parent.glob("*.py")
    if p.stem
    not in (
        "__init__",
        "main",
        "describing",
        "fitness",
        "info_text",
        "learning",
        "loading",
        "options",
        "outputs",
        "tables",
    )
)


@pytest.fixture
def pendulum(monkeypatch: pytest.MonkeyPatch) -> Robot:
    """The true pendulum, which every verb finds where it looks for a model."""
    model = Pendulum.from_urdf(PENDULUM)
    for verb in ("evaluate", "predict"):
        monkeypatch.setattr(f"bdnn_ros.cli.{verb}.load_model", lambda path: model)
    return model


def test_help_is_quick_and_lists_every_verb() -> None:
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "bdnn_ros.cli.main", "--help"], capture_output=True, text=True
    )
    assert time.perf_counter() - start < 3.0
    assert (done.returncode, done.stderr) == (0, "")
    for verb, text in VERBS.items():
        assert f"{verb} " in done.stdout
        assert text in done.stdout


def test_no_verb_at_all_is_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.startswith("usage: bdnn VERB")
    assert printed.err.splitlines()[-1].startswith("bdnn: error: No verb is given.")


def test_every_status_is_in_the_documentation() -> None:
    table = (Path(__file__).parent.parent / "docs" / "commands.md").read_text(encoding="utf-8")
    for status in (0, DataError.exit_status, UsageError.exit_status, INTERRUPTED_STATUS, BROKEN_PIPE_STATUS):
        assert f"\n| {status} | " in table


def test_the_table_of_verbs_is_what_is_there() -> None:
    assert sorted(VERBS) == MODULES


@pytest.mark.parametrize("verb", MODULES)
def test_every_verb_helps(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([verb, "--help"]) == 0
    printed = capsys.readouterr().out
    assert f"usage: bdnn {verb}" in printed


def test_interruptions_and_full_pipes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def interrupt(args: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(info, "run", interrupt)
    assert main(["info", "bag"]) == 130
    path = bags.write(motion(samples=20000, urdf=PENDULUM), tmp_path / "bag")
    command = f"{sys.executable} -m bdnn_ros.cli.main info {path} --json"
    done = subprocess.run(
        ["bash", "-c", f"{command} | head -c 1 >/dev/null; echo ${{PIPESTATUS[0]}}"],
        capture_output=True,
        text=True,
    )
    assert done.stderr == ""
    assert int(done.stdout) in (0, 141)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("closed", "prints", "complains"),
    [(">&-", False, True), ("2>&-", True, False), ("<&- >&- 2>&-", False, False)],
)
def test_streams_that_are_closed_take_nothing(
    closed: str, prints: bool, complains: bool, tmp_path: Path
) -> None:
    """The work was done, and ended in a traceback."""
    path = bag_of(tmp_path / "bag", motion(urdf=PENDULUM))
    done, refused = (
        subprocess.run(
            ["bash", "-c", f"{sys.executable} -m bdnn_ros.cli.main {words} {closed}"],
            capture_output=True,
            text=True,
        )
        for words in (f"info {path}", f"info {path}x")
    )
    assert (done.returncode, bool(done.stdout), done.stderr) == (0, prints, "")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr.startswith("bdnn: error: There is no bag") if complains else not refused.stderr


def test_a_stream_that_is_closed_takes_nothing_of_a_child_either(tmp_path: Path) -> None:
    """The first file that a child opened took the stream's place, and got what the child complained of."""
    child = f"import os; open({str(tmp_path / 'a.txt')!r}, 'w').flush(); os.write(2, b'complaint')"
    parent = (
        "import subprocess, sys; from bdnn_ros.cli.main import main; main(['--help']); "
        f"sys.exit(subprocess.run([sys.executable, '-c', {child!r}]).returncode)"
    )
    done = subprocess.run(
        ["bash", "-c", f"{sys.executable} -c {shlex.quote(parent)} 2>&-"], stdout=subprocess.PIPE
    )
    assert done.returncode == 0
    assert (tmp_path / "a.txt").read_text() == ""


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_leaves_nothing_half_written(
    number: int, status: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """One that is ignored, as by nohup, stays so."""

    def interrupt(args: object) -> int:
        with outputs.written_together(tmp_path / "out") as place:
            (place / "a.txt").write_text("half")
            os.kill(os.getpid(), number)
            time.sleep(1.0)
        return 0

    before = signal.signal(number, signal.SIG_DFL)
    try:
        monkeypatch.setattr(info, "run", interrupt)
        assert main(["info", "bag"]) == status
        assert signal.getsignal(number) == signal.SIG_DFL and list(tmp_path.iterdir()) == []
        monkeypatch.setattr(info, "run", lambda args: os.kill(os.getpid(), number) or 0)
        signal.signal(number, signal.SIG_IGN)
        assert main(["info", "bag"]) == 0
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("second", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("hung", [False, True])
def test_a_second_signal_ends_only_what_hangs(
    second: int, hung: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two Ctrl-C in a row left directories of half a result; one that comes late ends what would never end."""
    cleared = []

    def interrupt(args: object) -> int:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5.0)
        finally:
            time.sleep(0.1 if hung else 0.0)
            os.kill(os.getpid(), second)
            cleared.append(True)
        return 0

    monkeypatch.setattr(info, "run", interrupt)
    monkeypatch.setattr("bdnn_ros.cli.main.PATIENCE", 0.05 if hung else 5.0)
    before = [(number, signal.signal(number, signal.default_int_handler)) for number in ENDING]
    try:
        assert main(["info", "bag"]) == INTERRUPTED_STATUS
        assert bool(cleared) != (hung and second == signal.SIGINT)
        assert {signal.getsignal(number) for number in ENDING} == {signal.default_int_handler}
    finally:
        for number, handler in before:
            signal.signal(number, handler)


def test_a_full_standard_output_is_said_to_be(pendulum: Robot, tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "bdnn_ros.cli.main",
        "info",
        str(bag_of(tmp_path / "bag", swing(pendulum))),
    ]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.stderr.splitlines()[0].startswith("bdnn: error: No space left on device: the standard output")
    assert done.returncode == 2


@pytest.mark.parametrize("words", [["info"], ["info", "--urdf", "motör·.urdf"]])
def test_an_output_without_the_letters_gets_their_codes(
    words: list[str], pendulum: Robot, tmp_path: Path
) -> None:
    """What is printed has dots and Greek letters, which an ASCII pipe lacks."""
    command = [
        sys.executable,
        "-m",
        "bdnn_ros.cli.main",
        words[0],
        str(bag_of(tmp_path / "bag", swing(pendulum))),
    ]
    done = subprocess.run(
        [*command, *words[1:]],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": "ascii:strict"},
    )
    assert b"Traceback" not in done.stderr
    assert b"\\x" in done.stdout + done.stderr
    assert (done.stdout + done.stderr).isascii()


def test_files_that_cannot_be_written_are_the_users(
    pendulum: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag_of(tmp_path / "bag", swing(pendulum))
    (tmp_path / "file").touch()
    assert main(["predict", "model", str(path), "--out", str(tmp_path / "file" / "effort.csv")]) == 2
    assert capsys.readouterr().err.startswith("bdnn: error: ")


def test_info_tells_what_is_there(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    original = swing(pendulum, 20.0)
    gap = np.where(original.time > 10.0, 0.5, 0.0)
    late = replace(original, time=original.time + gap, velocity=None)
    path = bag_of(tmp_path / "bag", late)
    assert main(["info", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["usable"] is True
    assert told["problem"] is None
    assert {t["name"]: t["count"] for t in told["topics"]} == {"/joint_states": 4000, "/robot_description": 1}
    assert told["rate"] == pytest.approx(200.0)
    assert told["duration"] == pytest.approx(20.495)
    assert told["gaps"] == {"count": 1, "longest": pytest.approx(0.505), "total": pytest.approx(0.505)}
    assert told["jitter"] < 1e-6
    assert told["missing"] == ["velocity"]
    (joint,) = told["excitation"]
    assert joint["joint"] == "pivot"
    assert (joint["lower"], joint["upper"]) == (pytest.approx(-0.8, abs=1e-3), pytest.approx(0.8, abs=1e-3))
    assert joint["velocity"] == pytest.approx(1.6, rel=0.02)
    assert joint["acceleration"] == pytest.approx(3.2, rel=0.02)
    assert joint["reversals"] == 13
    assert joint["standstill"] < 0.02
    assert joint["saturated"] == 0.0
    assert told["concerns"] == []
    assert main(["info", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "Fit for identification." in printed
    assert "1 gap, longest 0.505 s" in printed
    assert " samples of 1 joint in " in printed and "  1 message\n" in printed
    assert told["recorded"] == pytest.approx(19.99)
    assert "in 19.99 s without gaps" in printed


def test_info_sees_limits_and_plateaus(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    original = swing(pendulum, 20.0)
    assert original.effort is not None
    clipped = np.clip(original.effort, -3.0, 3.0)
    share = np.mean(np.abs(clipped) == 3.0)
    for name, urdf in (("plain", None), ("described", PENDULUM), ("weak", PENDULUM.replace('"50"', '"3.0"'))):
        path = bag_of(tmp_path / name, replace(original, effort=clipped, urdf=urdf))
        assert main(["info", str(path), "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["excitation"][0]["saturated"] == pytest.approx(share, abs=0.02)
        assert any("at its effort limit" in concern for concern in told["concerns"])
    slow = bag_of(
        tmp_path / "slow", replace(original, urdf=PENDULUM.replace('velocity="10"', 'velocity="1.5"'))
    )
    main(["info", str(slow), "--json"])
    assert any("velocity limit" in concern for concern in json.loads(capsys.readouterr().out)["concerns"])


def test_info_tells_no_reading_that_stood_out_alone(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    original = swing(pendulum, 20.0)
    position = original.position.copy()
    position[2000] = 7e9
    assert main(["info", str(bag_of(tmp_path / "bag", replace(original, position=position))), "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["excitation"][0]["upper"] == pytest.approx(0.8, abs=1e-3)
    assert "1 reading of pivot stood out alone" in captured.err


def test_info_doubts_a_description_that_no_robot_can_have(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    flat = replace(swing(pendulum, 20.0), urdf=PENDULUM.replace('izz="0.01"', 'izz="0.9"'))
    assert main(["info", str(bag_of(tmp_path / "bag", flat)), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["concerns"]
    assert told[0].startswith("No body can have the described inertia of rod")


def test_info_says_why_not_and_still_what_is_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = replace(motion(urdf=PENDULUM), effort=None)
    assert main(["info", str(bag_of(tmp_path / "bag", recording)), "--json"]) == 1
    captured = capsys.readouterr()
    told = json.loads(captured.out)
    assert told["usable"] is False
    assert told["missing"] == ["effort"]
    assert told["excitation"][0]["effort"] is None
    assert captured.err == f"bdnn: error: {told['problem']}\n"


def test_evaluate_prints_and_counts(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = swing(pendulum, 20.0)
    path = bag_of(tmp_path / "bag", recording)
    assert main(["evaluate", "model", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert set(told) == {"held_out", "joints_in_mean", "simulation", "rollout", "cutoff"}
    assert told["joints_in_mean"] == 1
    assert set(told["held_out"]) == {"joints", "rmse", "nrmse", "nmse", "nrmse_mean"}
    assert told["held_out"]["joints"] == ["pivot"]
    assert told["held_out"]["nrmse"][0] < 2e-3
    assert told["rollout"]["position"][0] < 1e-3
    heavy = tmp_path / "heavy.urdf"
    heavy.write_text(PENDULUM.replace('<mass value="2"/>', '<mass value="3"/>'))
    assert main(["evaluate", "model", str(path), "--json", "--urdf", str(heavy), "--holdout", "0.5"]) == 0
    told = json.loads(capsys.readouterr().out)
    signals = prepare(recording.split(0.5)[1])
    assert signals.effort is not None
    nominal = Robot.from_file(heavy).inverse_dynamics(
        signals.position, signals.velocity, signals.acceleration
    )
    inside = signals.interior
    expected = score(signals.smooth(signals.effort)[inside], signals.smooth(nominal)[inside], ("pivot",))
    assert told["simulation"] == expected.as_json()
    assert told["simulation"]["nrmse"][0] > 0.4
    assert main(["evaluate", "model", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "URDF's NRMSE" in printed
    assert "pivot" in printed


def test_evaluate_says_why_a_motion_that_is_integrated_for_long_is_infinite(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = bag_of(tmp_path / "bag", swing(pendulum, 20.0))
    assert main(["evaluate", "model", str(path)]) == 0
    assert "runs away" not in capsys.readouterr().err
    monkeypatch.setattr("bdnn_ros.rollout.DIVERGED", 0.5)
    assert main(["evaluate", "model", str(path), "--horizon", "5"]) == 0
    told = capsys.readouterr()
    assert "Integrated over 5 s without a controller, all motions run away" in told.err and " inf" in told.out


def test_a_description_that_does_not_fit_the_model_is_not_needed(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, urdf in (("other", PENDULUM.replace('"pivot"', '"shoulder"')), ("broken", "<robot")):
        path = bag_of(tmp_path / name, swing(pendulum), urdf=urdf)
        assert main(["evaluate", "model", str(path), "--json"]) == 0
        assert "simulation" not in json.loads(capsys.readouterr().out)


def test_load_takes_the_joints_that_bag_and_robot_share(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = bag_of(tmp_path / "first", motion(joints=("wheel", "arm7_joint2", "arm7_joint1")))
    later = replace(motion(joints=("arm7_joint3", "arm7_joint2", "arm7_joint1")), epoch=10**18)
    second = bag_of(tmp_path / "second", later)
    recordings, robot = _load([str(first), str(second), "--robot", "arm7"])
    assert robot is not None
    assert robot.joints == ("arm7_joint1", "arm7_joint2")
    assert [recording.joints for recording in recordings] == [robot.joints] * 2
    assert "arm7_joint3" in capsys.readouterr().err
    recordings, robot = _load([str(first), str(second), "--joints", "arm7_joint2"])
    assert robot is None
    assert recordings[1].joints == ("arm7_joint2",)
    renamed, robot = _load([str(first), "--rename", "s/arm7_joint/pivot/", "--rename", "pivot1=pivot"])
    assert renamed[0].joints == ("wheel", "pivot2", "pivot")


def _load(words: list[str]) -> tuple[list[Recording], Robot | None]:
    from argparse import ArgumentParser

    parser = ArgumentParser()
    options.add_recording_arguments(parser, bags="many")
    return loading.load(parser.parse_args(words))


@pytest.mark.parametrize(
    "words",
    [
        ["diagnose", "BAG", "--out", "FILE"],
        ["diagnose", "BAG", "--out", "FILE/deep/er"],
        ["identify", "BAG", "--out", "FILE"],
        ["replay", "BAG", "--out", "FILE"],
        ["export", "model", "--out", "FILE"],
        ["excite", "--robot", "arm2", "--out", "FILE"],
        ["simulate", "--robot", "arm2", "--out", "FILE"],
        ["predict", "model", "BAG", "--out", "FILE/effort.csv"],
        ["predict", "model", "BAG", "--out", "FOLDER"],
    ],
    ids=" ".join,
)
def test_a_place_that_holds_no_results_is_refused_before_any_work(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is no such bag: nobody looked."""
    places = {"FILE": tmp_path / "file", "FOLDER": tmp_path / "folder", "BAG": tmp_path / "bag"}
    places["FILE"].write_text("kept")
    places["FOLDER"].mkdir()
    for name, place in places.items():
        words = [word.replace(name, str(place)) for word in words]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("bdnn: error: ") and ("is a file" in error or "is a directory" in error)
    assert str(tmp_path) in error and error.count("\n") == 1
    assert places["FILE"].read_text() == "kept"


def test_what_is_left_out_of_a_list_is_said():
    path = Path("out/report.html")
    assert options.shortened(["a", "b"], 2, path) == ["a", "b"]
    assert options.shortened(["a", "b", "c", "d"], 2, path) == ["a", "b", "2 more in out/report.html."]


@pytest.mark.parametrize("verb", ["identify", "replay"])
def test_a_file_that_is_no_model_is_not_written_over(verb, tmp_path, capsys):
    precious = tmp_path / "robot.urdf"
    precious.write_text("precious")
    bag = tmp_path / "bag"
    assert main(["simulate", "--robot", "arm2", "--duration", "3", "--out", str(bag)]) == 0
    assert main([verb, str(bag), "--out", str(precious)]) == 2
    assert "is a file that is no model" in capsys.readouterr().err
    assert precious.read_text() == "precious"


@pytest.mark.parametrize(("seconds", "said"), [(6.0, True), (9.9, True), (10.0, False), (11.0, False)])
def test_what_is_too_short_for_a_diagnosis_is_told(seconds: float, said: bool) -> None:
    time = np.arange(0.0, seconds, 0.01)
    motion = np.sin(time)[:, None]
    told = info.concerns(Recording(time, ("a",), motion, None, motion), [])
    assert any("too short for `bdnn diagnose`, which asks for 10 s" in one for one in told) is said
