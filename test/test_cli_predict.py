"""`bdnn predict`: one row for every joint state, with what is known at it."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import (
    EPOCH,
    JOINT_STATE,
    MULTI_ARRAY,
    PENDULUM,
    Message,
    bag_of,
    command,
    joint_state,
    states,
    write_bag,
)
from cli_cases import Pendulum, swing

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.cli.predict import effort_along
from bdnn_ros.errors import RecordingError
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot


@pytest.fixture
def pendulum(monkeypatch: pytest.MonkeyPatch) -> Robot:
    """The true pendulum, as the model."""
    model = Pendulum.from_urdf(PENDULUM)
    monkeypatch.setattr("bdnn_ros.cli.predict.load_model", lambda path: model)
    return model


def rows_of(path: Path) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a CSV file."""
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    return header, rows


def test_predict_writes_a_row_for_every_joint_state(tmp_path: Path, pendulum: Robot) -> None:
    recording = swing(pendulum)
    path = bag_of(tmp_path / "bag", recording)
    assert main(["predict", "model", str(path), "--out", str(tmp_path / "out" / "effort.csv")]) == 0
    header, rows = rows_of(tmp_path / "out" / "effort.csv")
    assert header == ["time", "pivot.effort", "pivot.measured"]
    assert len(rows) == len(recording)
    stamps = [int(seconds) * 10**9 + int(rest) for seconds, rest in (row[0].split(".") for row in rows)]
    np.testing.assert_array_equal(stamps, EPOCH + np.round(recording.time * 1e9).astype(np.int64))
    values = np.array([row[1:] for row in rows], float)
    np.testing.assert_allclose(values[:, 1], recording.require_effort()[:, 0], rtol=1e-8)
    np.testing.assert_allclose(values[20:-20, 0], values[20:-20, 1], atol=0.02)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["effort.csv"]


def test_a_name_with_a_comma_and_quotes_is_one_column(tmp_path: Path, monkeypatch) -> None:
    name = 'left,1 "a"'
    model = Pendulum.from_urdf(PENDULUM.replace("pivot", name.replace('"', "&quot;")))
    monkeypatch.setattr("bdnn_ros.cli.predict.load_model", lambda path: model)
    bag = bags.write(replace(swing(model, 1.0), urdf=None), tmp_path / "bag")
    assert main(["predict", "model", str(bag), "--out", str(tmp_path / "effort.csv")]) == 0
    header, rows = rows_of(tmp_path / "effort.csv")
    assert header == ["time", f"{name}.effort", f"{name}.measured"] and {len(row) for row in rows} == {3}


def test_predict_prints_without_a_file(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = replace(swing(pendulum), effort=None)
    assert main(["predict", "model", str(bag_of(tmp_path / "bag", recording))]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(recording) + 1
    assert lines[1].startswith("1700000000.000000123,")
    assert lines[1].endswith(",")


def test_effort_along_reaches_every_sample(pendulum: Pendulum) -> None:
    whole = swing(pendulum, 10.0)
    truth = whole.require_effort()
    along = effort_along(pendulum, whole)
    np.testing.assert_allclose(along[30:-30], truth[30:-30], atol=0.02)
    assert np.abs(along - truth).max() < 0.05 * np.ptp(truth)


def test_effort_along_pieces_of_any_length(pendulum: Pendulum) -> None:
    whole = swing(pendulum, 10.0)
    truth = whole.require_effort()
    keep = np.ones(len(whole), bool)
    for start, stop in ((300, 340), (341, 400), (402, 450), (500, 600), (640, 700)):
        keep[start:stop] = False
    pieces = whole.part(keep)
    assert min(rows.stop - rows.start for rows in pieces.segments()) < 3
    told: list[tuple[int, int]] = []
    along = effort_along(pendulum, pieces, progress=lambda done, total: told.append((done, total)))
    assert np.isfinite(along).all()
    inside = np.concatenate([np.arange(30, 270), np.arange(1000, 1500)])
    np.testing.assert_allclose(along[inside], truth[keep][inside], atol=0.02)
    assert np.abs(along - truth[keep]).max() < 0.35 * np.ptp(truth)
    assert told[-1] == (len(pieces), len(pieces))


def test_effort_along_a_joint_within_one_turn_is_that_along_its_turns(pendulum: Pendulum) -> None:
    """Though it leaves its turn shortly before a gap and the end: there the motion is continued."""
    time = np.arange(0.0, 10.0, 0.005)
    position = np.pi - 2.0 * (9.9 - time)  # leaves the turn at 9.9, 6.76, 3.62 and 0.48 s
    kept = (time < 3.68) | (time > 4.2)
    turning = Recording(time[kept], pendulum.joints, position[kept, None])
    cut = replace(
        turning, position=turning.position - 2.0 * np.pi * np.round(turning.position / (2.0 * np.pi))
    )
    along = effort_along(pendulum, turning)
    np.testing.assert_allclose(along, pendulum.gravity(turning.position), atol=0.02)
    np.testing.assert_allclose(effort_along(pendulum, cut), along, atol=1e-6)


def table(path: Path, messages: list[Message], *words: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps [ns], predicted and measured effort (N,) [N·m] of the pendulum's rows, NaN where a cell is empty."""
    bag = write_bag(path / "bag", messages)
    assert main(["predict", "model", str(bag), "--out", str(path / "effort.csv"), *words]) == 0
    header, rows = rows_of(path / "effort.csv")
    assert header == ["time", "pivot.effort", "pivot.measured"]
    stamps = [int(second) * 10**9 + int(rest) for second, rest in (row[0].split(".") for row in rows)]
    values = np.array([[float(cell or "nan") for cell in row[1:]] for row in rows])
    return np.array(stamps), values[:, 0], values[:, 1]


def state(message: Message, q: float, u: float, stamp: int | None = None) -> Message:
    """The same message with another position and effort, and stamp [ns]."""
    topic, kind, log, _ = message
    return topic, kind, log, joint_state(("pivot",), (q,), (0.0,), (u,), log if stamp is None else stamp)


def test_states_that_repeat_come_late_or_lack_a_value_have_their_rows(
    tmp_path: Path, pendulum: Robot
) -> None:
    recording = swing(pendulum)
    truth = recording.require_effort()[:, 0]
    messages = states(recording)
    stamps = np.array([message[2] for message in messages])
    messages[300] = state(messages[300], np.nan, 7.0)
    messages[400] = state(messages[400], recording.position[400, 0], np.nan)
    messages[500], messages[501] = messages[501], messages[500]
    messages.insert(700, messages[699])
    told, predicted, measured = table(tmp_path, messages)
    np.testing.assert_array_equal(told, np.insert(stamps, 700, stamps[699]))
    expected = np.insert(truth, 700, truth[699])
    known = np.arange(len(told)) != 300
    assert np.isnan(predicted[300]) and measured[300] == 7.0
    assert np.isnan(measured[400]) and np.isfinite(predicted[400])
    np.testing.assert_allclose(predicted[known][20:-20], expected[known][20:-20], atol=0.02)
    seen = known & (np.arange(len(told)) != 400)
    np.testing.assert_allclose(measured[seen], expected[seen], rtol=1e-8)


def test_what_cannot_be_decoded_or_holds_other_joints_has_no_row_and_is_told(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = states(swing(pendulum))
    stamp = messages[0][2]
    other = ("/joint_states", JOINT_STATE, stamp, joint_state(("wheel",), (1.0,), (), (), stamp))
    torn = ("/joint_states", JOINT_STATE, stamp, messages[0][3][:40])
    told, _, _ = table(tmp_path, [other, torn, *messages])
    assert len(told) == len(messages)
    errors = capsys.readouterr().err
    assert "1 of 1602 joint states cannot be decoded" in errors
    assert "1 of 1602 joint states hold other joints" in errors


def test_a_state_without_a_stamp_has_a_row_at_zero(tmp_path: Path, pendulum: Robot) -> None:
    recording = swing(pendulum)
    messages = states(recording)
    messages[40] = state(messages[40], recording.position[40, 0], 5.0, stamp=0)
    told, predicted, measured = table(tmp_path, messages)
    assert len(told) == len(messages) and told[0] == 0 and told[1] == EPOCH
    assert np.isnan(predicted[0]) and measured[0] == 5.0
    assert np.isfinite(predicted[1:]).all()


def test_a_joint_whose_position_is_never_a_number_is_named(tmp_path: Path) -> None:
    nowhere = joint_state(("pivot", "wheel"), (0.1, np.nan), (), (1.0, 0.0), EPOCH)
    bag = write_bag(tmp_path / "bag", [("/joint_states", JOINT_STATE, EPOCH, nowhere)] * 3)
    with pytest.raises(RecordingError, match=r"in most what wheel reported is not finite.*--joints pivot"):
        bags.read_every(bag)


def test_states_without_a_command_have_rows(tmp_path: Path, pendulum: Robot) -> None:
    recording = swing(pendulum)
    messages = states(recording)
    sent = [("/u", MULTI_ARRAY, messages[600][2] - 1, command([3.0]))]
    told, predicted, measured = table(
        tmp_path, [*messages[:600], *sent, *messages[600:]], "--effort", "command"
    )
    assert len(told) == len(messages)
    assert np.isnan(measured[:600]).all() and (measured[600:700] == 3.0).all()
    assert np.isnan(measured[700:]).all()  # half a second later
    np.testing.assert_allclose(predicted[20:-20], recording.require_effort()[20:-20, 0], atol=0.02)


def test_a_clock_that_is_set_back_is_joined_on_demand(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = swing(pendulum)
    truth = recording.require_effort()[:, 0]
    back = [(topic, kind, log + 10**10, data) for topic, kind, log, data in states(recording)[:600]]
    messages = [*states(recording), *back]
    assert main(["predict", "model", str(write_bag(tmp_path / "refused", messages))]) == 1
    assert "the clock is set back (sample 1600 of 2200)" in capsys.readouterr().err
    told, predicted, measured = table(tmp_path, messages, "--drop-invalid")
    assert len(told) == len(messages) and (np.diff(told) > 0).all()
    assert told[1600] - told[1599] == 2 * 10**9
    np.testing.assert_allclose(measured, np.concatenate([truth, truth[:600]]), rtol=1e-8)
    np.testing.assert_allclose(predicted[1620:-20], truth[20:580], atol=0.02)


def test_joints_of_messages_of_their_own_are_known_where_both_are(tmp_path: Path) -> None:
    recording = swing(Pendulum.from_urdf(PENDULUM))
    wheel = [
        ("/joint_states", JOINT_STATE, m[2] + 1, joint_state(("wheel",), (float(k),), (), (1.0,), m[2]))
        for k, m in enumerate(states(recording)[:1000])
    ]
    path = write_bag(tmp_path / "bag", sorted([*states(recording), *wheel], key=lambda message: message[2]))
    every = bags.read_every(path, bags.Selection(joints=["pivot", "wheel"]))
    assert len(every) == len(recording) and len(every.motion) == 1000
    np.testing.assert_array_equal(every.row, np.append(np.arange(1000), np.full(600, -1)))
    np.testing.assert_array_equal(np.isfinite(every.effort), np.column_stack([np.ones(1600), every.row >= 0]))
    assert every.select(["wheel", "pivot"]).position[3].tolist() == [3.0, recording.position[3, 0]]
    assert any("600 of 1600 joint states show no motion" in note for note in every.motion.notes)


def test_one_state_is_enough(tmp_path: Path, pendulum: Robot) -> None:
    recording = swing(pendulum)
    told, predicted, _ = table(tmp_path, states(recording)[:1])
    assert len(told) == 1
    assert predicted[0] == pytest.approx(pendulum.gravity(recording.position[:1])[0, 0])


def test_efforts_of_other_units_are_turned_in_every_row(tmp_path: Path, pendulum: Robot) -> None:
    recording = swing(pendulum)
    messages = states(recording)
    messages[300] = state(messages[300], np.nan, 7.0)
    _, _, measured = table(tmp_path, messages, "--effort-factor", "2")
    assert measured[300] == 14.0
    np.testing.assert_allclose(measured[301:], 2.0 * recording.require_effort()[301:, 0], rtol=1e-8)


def test_joints_that_the_model_needs_are_named(
    tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_of(tmp_path / "bag", swing(pendulum))
    assert main(["predict", "model", str(bag), "--joints", "wheel"]) == 2
    assert "The model does not have wheel; it has pivot." in capsys.readouterr().err
    assert main(["predict", "model", str(bag), "--joints", "pivot,wheel"]) == 2
    assert "The model does not have wheel; it has pivot." in capsys.readouterr().err
    assert main(["predict", "model", str(bag), "--joints", "pivot,pivot"]) == 2
    assert "names a joint twice" in capsys.readouterr().err


@pytest.mark.parametrize("verb", [["info"], ["predict", "model"]])
def test_a_topic_of_commands_that_is_not_read_is_told(
    verb: list[str], tmp_path: Path, pendulum: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    """Scripts that always name their topics were refused, or took measured efforts for commands."""
    path = bag_of(tmp_path / "bag", swing(pendulum))
    printed = []
    for more in ([], ["--effort-commands", "/u"]):
        assert main([*verb, str(path), *more]) == 0
        printed.append(capsys.readouterr())
    assert printed[0].out == printed[1].out
    assert not printed[0].err
    assert printed[1].err == (
        "bdnn: note: --effort-commands /u is not read: the efforts are the measured ones. "
        "Pass --effort command to take the commanded ones.\n"
    )
