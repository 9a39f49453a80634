"""The trainer's process and what keeps it alive, without ROS."""

from __future__ import annotations

import errno
import os
import signal
import socket
import time
from pathlib import Path

import numpy as np
import pytest
from live_support import children, motion, real_robot, wait_until
from reading_cases import repeating

from bdnn_ros.efforts import COMMAND_AGE
from bdnn_ros.errors import DataError, ModelFileError, RecordingError, UsageError
from bdnn_ros.models import save_model
from bdnn_ros.online.analysis import Analyst
from bdnn_ros.online.channel import Channel, Message
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.online.learning import Learning, check, squared_error
from bdnn_ros.online.noticed import Noticed
from bdnn_ros.online.places import make_directory, model_place, model_to_load
from bdnn_ros.online.serving import Settings, nominal
from bdnn_ros.online.session import Session
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.feed import Feed
from bdnn_ros.online.stream.intake import CommandIntake, Intake
from bdnn_ros.online.trainer import Trainer
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import prepare

ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)
START = 1_000_000_000_000
MS = 1_000_000


def send(session: Session, recording: Recording, start: int = START) -> None:
    """All samples of a recording at once."""
    assert session.intake is not None
    for row, moment in enumerate(recording.time):
        stamp = start + round(moment * 1e9)
        fields = (recording.position[row], recording.velocity[row], recording.effort[row])
        assert session.intake.take(list(recording.joints), *fields, stamp, stamp)


@pytest.fixture
def session():
    session = Session(Settings(diagnosis_period=0.0, niceness=0))
    session.set_robot(ARM)
    session.start()
    session.begin(ARM.joints)
    yield session
    session.stop()
    assert session.supervisor.pid == 0


@pytest.mark.slow
def test_a_session_learns_restarts_and_resets(session):
    assert session.served.number == 0
    first, second = motion(REAL, 7.0, 250.0).split(0.5)
    send(session, first)
    wait_until(lambda: session.served.number >= 2, 30.0)
    q = np.array([0.3, -0.5])
    expected = REAL.inverse_dynamics(q, q, q)
    np.testing.assert_allclose(session.served.model.inverse_dynamics(q, q, q), expected, rtol=0.03, atol=0.03)
    before, number = session.supervisor.pid, session.served.number
    os.kill(before, signal.SIGKILL)
    send(session, second)
    wait_until(lambda: session.supervisor.restarts == 1 and session.supervisor.alive, 30.0)
    wait_until(lambda: session.served.number >= number + 2, 30.0)
    assert not Path(f"/proc/{before}").exists() and session.counts.overrun == 0
    session.reset()
    assert session.served.number == 0
    np.testing.assert_allclose(session.served.model.inverse_dynamics(q, q, q), ARM.inverse_dynamics(q, q, q))
    instant = session.instant()
    assert instant is not None and np.isfinite(instant.acceleration).all()


def test_a_drive_that_repeats_itself_is_counted_by_the_session(session):
    recording = repeating(motion(REAL, 9.0, 250.0), 1, [(1000, 1500)])
    send(session, recording)
    wait_until(lambda: session.counts.repeated.get(ARM.joints[1], 0) >= 250, 30.0)
    assert session.counts.repeated.keys() == {ARM.joints[1]} and session.counts.repeated[ARM.joints[1]] < 500
    session.reset()
    assert not session.counts.repeated


def test_a_stream_of_more_joints_begins_anew(session):
    """Nothing of the earlier stream is served any more, and its rings are closed as soon as nobody reads them."""
    earlier = [session.intake.ring]
    session.begin(ARM.joints[:1])
    earlier.append(session.intake.ring)
    recording = motion(REAL, 5.0, 250.0)
    send(session, recording.select(ARM.joints[:1]))
    wait_until(lambda: session.served.number >= 1, 30.0)
    assert session.served.model.joints == session.robot.joints == ARM.joints[:1]
    session.begin(ARM.joints)
    assert session.served.number == 0 and session.served.model.joints == session.robot.joints == ARM.joints
    assert session.intake.received == 0
    wait_until(lambda: all(ring.descriptor < 0 for ring in earlier))
    send(session, recording)
    wait_until(lambda: session.served.number >= 3, 30.0)
    assert session.served.model.joints == ARM.joints and session.supervisor.restarts == 0
    q = np.array([0.3, -0.5])
    expected = REAL.inverse_dynamics(q, q, q)
    np.testing.assert_allclose(session.served.model.inverse_dynamics(q, q, q), expected, rtol=0.03, atol=0.03)


def test_a_question_that_dies_with_the_trainer_is_answered(session):
    wait_until(lambda: session.supervisor.alive, 30.0)
    answer = session.diagnose(0.0).result(30.0)
    assert "No joint state" in answer.info["error"]
    os.kill(session.supervisor.pid, signal.SIGSTOP)
    pid = session.supervisor.pid
    later = session.diagnose(0.0)
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(DataError, match="ended"):
        later.result(30.0)


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["killed", "trainer killed", "stopped"])
def test_a_diagnosis_that_is_broken_off_leaves_no_process(session, ending):
    send(session, motion(REAL, 20.0, 250.0, noise=0.002))
    wait_until(lambda: session.served.number >= 5, 30.0)
    trainer, asked = session.supervisor.pid, session.diagnose(0.0)
    (diagnosis,) = wait_until(lambda: children(trainer), 10.0)
    if ending == "killed":
        os.kill(diagnosis, signal.SIGKILL)
        assert "was ended" in asked.result(10.0).info["error"]
        assert session.supervisor.pid == trainer and session.supervisor.restarts == 0
        assert session.diagnose(0.0).result(60.0).info["diagnosis"]["findings"]
    elif ending == "trainer killed":
        os.kill(trainer, signal.SIGKILL)
    else:
        session.stop()
    wait_until(lambda: not Path(f"/proc/{diagnosis}").exists())


@pytest.mark.slow
def test_a_signal_that_every_process_gets_does_not_end_what_the_node_ends(session):
    """As systemd stops a service: what the trainer learned last is handed over all the same."""
    send(session, motion(REAL, 20.0, 250.0, noise=0.002))
    wait_until(lambda: session.served.number >= 5, 30.0)
    trainer, asked = session.supervisor.pid, session.diagnose(0.0)
    (diagnosis,) = wait_until(lambda: children(trainer), 10.0)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        for pid in (trainer, diagnosis):
            wait_until(lambda pid=pid, number=number: _ignores(pid, number), 10.0)
            os.kill(pid, number)
    assert asked.result(60.0).info["diagnosis"]["findings"]
    assert session.supervisor.pid == trainer and session.supervisor.restarts == 0


def _ignores(pid: int, number: int) -> bool:
    told = Path(f"/proc/{pid}/status").read_text().partition("SigIgn:")[2].split()[0]
    return bool(int(told, 16) >> (number - 1) & 1)


@pytest.mark.parametrize(
    ("before", "verdict"),
    [
        (None, "partly_explained"),
        ("nothing_wrong", "explained"),
        ("explained", "explained"),
        ("partly_explained", "partly_explained"),
        ("cannot_tell", "partly_explained"),
    ],
)
def test_a_change_explains_no_more_than_itself(before, verdict):
    analyst = Analyst(lambda message: None)
    if before is not None:
        gain = {"value": 0.2, "interval": [0.1, 0.3]}
        analyst._last = {"verdict": before, "findings": [], "gain": gain, "advice": []}
    told = analyst.with_changes([Noticed(1.0, {"share": 0.75})])
    assert told["verdict"] == verdict and len(told["findings"]) == 1
    assert told["gain"]["value"] == pytest.approx(0.5 if before is None else 0.2)
    assert bool(told["advice"]) == (before is None)


def test_models_of_others_are_not_loaded(session, tmp_path):
    save_model(tmp_path / "other", nominal(Robot.bundled("arm6")))
    with pytest.raises(ModelFileError, match="arm6_joint1"):
        session.load(tmp_path / "other").result(10.0)
    save_model(tmp_path / "same", nominal(REAL))
    session.load(tmp_path / "same").result(10.0)
    q = np.array([0.3, -0.5])
    np.testing.assert_allclose(session.served.model.inverse_dynamics(q, q, q), REAL.inverse_dynamics(q, q, q))
    with pytest.raises(UsageError, match="lacks joints"):
        session.set_robot(Robot.bundled("arm6"))


# -- learning --------------------------------------------------------------------------------------


def test_the_size_of_the_pieces_makes_no_difference():
    recording = motion(REAL, 6.3, 200.0, noise=0.002)
    results = []
    for sizes in (7, 113, 1000):
        learning = Learning(ARM)
        versions = []
        for first in range(0, len(recording), sizes):
            rows = slice(first, first + sizes)
            versions += learning.take(recording.time[rows], recording.position[rows], recording.effort[rows])
        versions += learning.finish()
        results.append([v.model.parameters.vector() for v in versions])
    assert len(results[0]) == len(results[1]) == len(results[2]) >= 4
    np.testing.assert_allclose(results[0], results[1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(results[0], results[2], rtol=1e-9, atol=1e-12)


def test_a_pause_is_not_learned_across():
    recording = motion(REAL, 4.0, 200.0)
    time = recording.time + np.where(recording.time < 2.0, 0.0, 100.0)
    learning = Learning(ARM)
    list(learning.take(time, recording.position, recording.effort))
    list(learning.finish())
    q = np.array([0.3, -0.5])
    got = learning.served.model.inverse_dynamics(q, q, q)
    np.testing.assert_allclose(got, REAL.inverse_dynamics(q, q, q), rtol=0.03, atol=0.03)


@pytest.mark.parametrize("fault", ["worse", "nan", "indefinite"])
def test_a_bad_update_is_refused(fault):
    signals = prepare(motion(REAL, 4.0, 200.0))
    rows = np.flatnonzero(signals.interior)
    measured = signals.smooth(signals.effort)[rows]
    good = nominal(REAL)
    before = squared_error(good, signals, rows, measured)
    check(good, signals, rows, measured, before, measured.var(axis=0))
    inertials = REAL.inertials.copy()
    if fault == "worse":
        bad = nominal(ARM)
    elif fault == "nan":
        inertials[0, 0] = np.nan
        bad = nominal(REAL)
        bad = type(bad)(REAL, np.full(2, np.nan), bad.covariance, bad.noise)
    else:
        bad = nominal(REAL.with_joint_parameters(armature=np.full(2, -50.0)))
    with pytest.raises(DataError):
        check(bad, signals, rows, measured, before, measured.var(axis=0))


# -- the parts between -------------------------------------------------------------------------------


def test_a_joint_without_a_sensor_for_its_effort_holds_up_nothing():
    """Its effort is zero throughout; what a model says of it is not held against the model."""
    recording, learning = motion(REAL, 12.0, 200.0), Learning(ARM)
    effort = recording.require_effort() * [1.0, 0.0]
    versions = list(learning.take(recording.time, recording.position, effort))
    assert len(versions) > 8 and not learning.rejected


def test_a_channel_carries_arrays_and_descriptors():
    here, there = Channel.pair()
    other = Channel(there)
    ring = Ring.create(8, 2)
    arrays = {"a": np.arange(6.0).reshape(2, 3), "b": np.zeros(0)}
    here.send(Message("begin", {"x": [1, None, "é"]}, arrays, (ring.descriptor,)))
    message = other.receive()
    assert message.kind == "begin" and message.info == {"x": [1, None, "é"]}
    np.testing.assert_array_equal(message.arrays["a"], arrays["a"])
    again = Ring(message.descriptors[0])
    ring.slot()[:] = 4.0
    ring.commit(1, 1, 1)
    assert again.latest(1).values.tolist() == [[4.0, 4.0]]
    here.close()
    with pytest.raises(ConnectionError):
        other.receive()
    with pytest.raises(ConnectionError):
        for _ in range(3):
            other.send(Message("x"))
    again.close()
    ring.close()


def test_half_a_message_is_no_message():
    here, there = socket.socketpair()
    channel = Channel(there)
    here.sendall(b"\x05\x00\x00")
    here.close()
    with pytest.raises(ConnectionError):
        channel.receive()


def test_commands_belong_to_the_states_sent_after_them():
    states, commands = Ring.create(256, 6), Ring.create(256, 2)
    intake, orders = Intake(ARM.joints, states, needs_effort=False), CommandIntake(ARM.joints, commands)
    feed = Feed(ARM.joints, states, commands)
    for k in range(40):
        if k % 10 == 5:  # a command every 10 ms, between two states
            orders.take([float(k), -float(k)], START + k * MS - MS // 2)
        # the robot's own clock is an hour late: only the times of sending count
        intake.take(list(ARM.joints), [0.0, 0.0], [], [], START - 3600_000 * MS + k * MS, START + k * MS)
    samples = feed.read(1000)
    assert len(samples) == 35  # up to the last command: for later ones it may still be on its way
    effort = samples.effort[:, 0]
    assert np.isnan(effort[:5]).all() and len(samples.with_effort()) == 30
    assert effort[5:15].tolist() == [5.0] * 10 and effort[25:35].tolist() == [25.0] * 10
    orders.take([99.0, 0.0], START + 40 * MS)
    assert feed.read(1000).effort[:, 0].tolist() == [35.0] * 5
    late = START + 41 * MS + int(COMMAND_AGE * 1e9)
    for k in range(3):
        stamp = late + k * int(COMMAND_AGE * 1e9)
        intake.take(list(ARM.joints), [0.0, 0.0], [], [], stamp, stamp)
    assert np.isnan(feed.read(1000).effort).all()
    states.close()
    commands.close()


@pytest.mark.parametrize("pace", [0.02, 0.3, 1.0, 20.0])
def test_a_command_lasts_as_long_in_a_simulation_at_any_pace(pace):
    """Commands come every 0.1 s of simulated time, and after two seconds no more."""
    states, commands = Ring.create(512, 6), Ring.create(512, 2)
    intake, orders = Intake(ARM.joints, states, needs_effort=False), CommandIntake(ARM.joints, commands)
    feed, read = Feed(ARM.joints, states, commands), []
    for k in range(400):
        sent = START + round(10 * k * MS / pace)
        if k % 10 == 0 and k <= 200:
            orders.take([float(k), 0.0], sent - 1000)
        intake.take(list(ARM.joints), [0.0, 0.0], [], [], (k + 1) * 10 * MS, sent)
        read += feed.read(1 + k % 7).effort[:, 0].tolist()
    expected = np.minimum(np.arange(400) // 10 * 10.0, 200.0)
    expected[200 + round(COMMAND_AGE * 100) :] = np.nan
    assert len(read) >= 200
    np.testing.assert_array_equal(read, expected[: len(read)])
    for count in (400, 180):
        np.testing.assert_array_equal(feed.latest(count)[0].effort[:, 0], expected[-count:])
    states.close()
    commands.close()


@pytest.mark.parametrize("back", [0.3, 2.0, 60.0])
@pytest.mark.parametrize("stamped", [False, True])
def test_a_clock_that_is_set_back_stops_no_learning(back, stamped):
    """States of before waited for a command that is sent later by the new time, and got the last one for ever."""
    states, commands = Ring.create(8192, 6), Ring.create(8192, 2)
    intake, orders = Intake(ARM.joints, states, needs_effort=False), CommandIntake(ARM.joints, commands)
    feed, read = Feed(ARM.joints, states, commands), 0
    start, step, change = 10**18, 2_000_000, 2000
    for k in range(4000):
        true = start + k * step
        wall = true - round(back * 1e9) * (k >= change)
        orders.take([float(k), 0.0], wall - step // 2)
        intake.take(list(ARM.joints), [1e-3 * k, 0.0], [], [], true if stamped else wall, wall)
        if k % 10 == 0:
            got = feed.read(500)
            known = np.isfinite(got.effort[:, 0])
            assert np.count_nonzero(~known) <= 20 or (change <= k <= change + 200 and back < 0.5)
            np.testing.assert_allclose(got.effort[known, 0], 1e3 * got.position[known, 0], atol=1.01)
            read += len(got)
            assert k - read < 50 or (change <= k <= change + 200 and back < 0.5)
        if k in (change + 300, 3999):
            whole = feed.recording(0.0)
            assert k - change - 100 <= len(whole) <= k - change + 1
            np.testing.assert_allclose(whole.effort[:, 0], 1e3 * whole.position[:, 0], atol=1.01)
    states.close()
    commands.close()


@pytest.mark.parametrize("pause", [0, 7200_000], ids=["even", "after a pause"])
def test_commands_that_are_far_more_frequent_than_the_states_have_all_their_efforts(pause):
    """The first of the latest states had none, and where one has none nothing is told of any."""
    states, commands = Ring.create(512, 6), Ring.create(4096, 2)
    intake, orders = Intake(ARM.joints, states, needs_effort=False), CommandIntake(ARM.joints, commands)
    feed = Feed(ARM.joints, states, commands)
    assert len(feed.latest(60)[0]) == 0
    for k in range(300):
        now = START + (10 * k + pause * (k >= 100)) * MS  # a pause of an hour is the longest in stream time
        for part in range(10):
            orders.take([float(10 * k + part), 0.0], now - (10 - part) * MS + MS // 2)
        intake.take(list(ARM.joints), [0.0, 0.0], [], [], now, now)
    latest, _ = feed.latest(60)
    assert latest.effort[:, 0].tolist() == [10.0 * k + 9.0 for k in range(240, 300)]
    assert np.isfinite(feed.recording(0.0).effort).all() and len(feed.recording(0.0)) == 300
    assert len(feed.recording(1.0)) == 100
    states.close()
    commands.close()


@pytest.mark.parametrize("every", [1200, 1800, 7200_000], ids=lambda every: f"{every} ms")
def test_pauses_of_commands_cost_a_recording_none_of_those_before_them(every):
    """Commands come for 0.6 s, and then no more up to the next such turn; the joint states come all the time but in an hour."""
    states, commands = Ring.create(4096, 6), Ring.create(4096, 2)
    intake, orders = Intake(ARM.joints, states, needs_effort=False), CommandIntake(ARM.joints, commands)
    feed = Feed(ARM.joints, states, commands)
    for turn in range(10):
        for k in range(min(every // 10, 180)):
            now = START + (every * turn + 10 * k) * MS
            if k < 60:
                orders.take([float(k), 0.0], now - 1)
            intake.take(list(ARM.joints), [0.1, 0.2], [], [], now, now)
    expected = [*map(float, range(60)), *[59.0] * (round(100 * COMMAND_AGE) - 1)] * 10
    assert feed.recording(0.0).effort[:, 0].tolist() == expected
    states.close()
    commands.close()


def test_the_kept_stream_becomes_a_recording():
    states = Ring.create(1000, 6)
    intake = Intake(ARM.joints, states)
    feed = Feed(ARM.joints, states)
    with pytest.raises(RecordingError, match="No joint state"):
        feed.recording(0.0)
    for k in range(500):
        effort = [] if k < 100 else [1.0, 2.0]
        intake.take(list(ARM.joints), [0.1, 0.2], [], effort, START + 10 * k * MS, START + 10 * k * MS)
    whole, last = feed.recording(0.0), feed.recording(1.0)
    assert len(whole) == 400 and len(last) == 100
    assert whole.velocity is None and last.duration == pytest.approx(0.99)
    states.close()


@pytest.mark.parametrize(
    "name",
    [
        *("..", ".", "../x", "/etc/x", "a/../../x", "a//b", "a/", "a\0b", "a\nb", "x" * 300, "ü" * 150),
        *(" ", "a/ ", " .bdnn", "~", "~x", "~/x"),
    ],
)
def test_names_stay_inside(tmp_path, name):
    for place in model_place, model_to_load:
        with pytest.raises(UsageError, match="model_directory"):
            place(str(tmp_path), name)


def test_places_of_models(tmp_path):
    assert model_place(str(tmp_path), "") == tmp_path / "model.bdnn"
    assert model_place(str(tmp_path), "arm") == tmp_path / "arm" / "model.bdnn"
    assert model_place(str(tmp_path), "cell 1/arm") == tmp_path / "cell 1" / "arm" / "model.bdnn"
    assert model_place(str(tmp_path), "arm.bdnn") == tmp_path / "arm.bdnn"
    (tmp_path / "cell.bdnn").mkdir()
    assert model_place(str(tmp_path), "cell.bdnn") == tmp_path / "cell.bdnn" / "model.bdnn"
    with pytest.raises(UsageError, match="not set"):
        model_place("", "arm")


def test_a_model_is_found_as_a_file_and_in_a_directory(tmp_path):
    file, inside = tmp_path / "arm.bdnn", tmp_path / "arm" / "model.bdnn"
    assert model_to_load(str(tmp_path), "arm") == inside  # for the message: neither is there
    file.write_text("a model")
    assert model_to_load(str(tmp_path), "arm") == model_to_load(str(tmp_path), "arm.bdnn") == file
    inside.parent.mkdir()
    assert model_to_load(str(tmp_path), "arm") == file
    inside.write_text("another")
    assert model_to_load(str(tmp_path), "arm") == inside  # as it is saved under this name
    assert model_to_load(str(tmp_path), "arm.bdnn") == file
    assert model_to_load(str(tmp_path), "") == tmp_path / "model.bdnn"
    assert model_to_load(str(tmp_path), "x" * 200) == tmp_path / ("x" * 200) / "model.bdnn"
    (tmp_path / "out.bdnn").symlink_to("/etc/passwd")
    for name in "out", "out.bdnn":
        with pytest.raises(UsageError, match="leads out of model_directory"):
            model_to_load(str(tmp_path), name)


def test_links_that_go_round_and_closed_directories_are_refused(tmp_path, monkeypatch):
    (tmp_path / "round").symlink_to(tmp_path / "round")
    for name in "round", "round/x", "round/x.bdnn":
        for place in model_place, model_to_load:
            with pytest.raises(UsageError, match=r"cannot be looked at \(Symlink loop\)\. Check permissions"):
                place(str(tmp_path), name)
    with pytest.raises(UsageError, match="cannot be looked at"):
        model_place(str(tmp_path / "round"), "")

    def closed(path):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "exists", closed)  # whoever runs this may be root, to whom nothing is closed
    for name in "", "x", "x.bdnn":
        with pytest.raises(UsageError, match=r"cannot be looked at \(Permission denied\)"):
            model_to_load(str(tmp_path), name)
    monkeypatch.setattr(Path, "is_dir", closed)
    with pytest.raises(UsageError, match=r"cannot be looked at \(Permission denied\)"):
        model_place(str(tmp_path), "x.bdnn")


@pytest.mark.parametrize("directory", ["file", "file/below", "/proc/nothing", "~nobody-here/models"])
def test_a_directory_that_cannot_hold_models(tmp_path, monkeypatch, directory):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("a file")
    make_directory("new/deep")
    assert list(Path("new/deep").iterdir()) == []
    with pytest.raises(UsageError, match="cannot be written to model_directory") as refused:
        make_directory(directory)
    assert directory in str(refused.value)


def test_a_trainer_that_is_to_end_chooses_no_terms_any_more(monkeypatch):
    """It takes seconds, and whoever asked it to end does not wait for many."""
    here, there = Channel.pair()
    trainer = Trainer(Channel(there))
    trainer.learning = Learning(ARM)
    trainer.learning.identifier = Identifier(ARM, settle_at=2)
    monkeypatch.setattr(Identifier, "settle", lambda _: pytest.fail("terms were chosen"))
    recording = motion(REAL, 6.0, 100.0)
    pieces = iter(np.split(np.arange(len(recording)), 6))

    def learn() -> bool:
        piece = recording.part(next(pieces, slice(0, 0)))
        list(trainer.learning.take(piece.time, piece.position, piece.effort))
        return len(piece) > 0

    monkeypatch.setattr(trainer, "_learn", learn)
    monkeypatch.setattr(trainer, "_finish", lambda: None)
    trainer._stop()
    assert trainer.learning.identifier.chunks > 2
    here.close()


def test_a_trainer_that_is_far_behind_ends_all_the_same(monkeypatch):
    """What it has not learned by then is lost, but not what it has."""
    here, there = Channel.pair()
    trainer = Trainer(Channel(there))
    done = []
    monkeypatch.setattr(trainer, "_learn", lambda: time.sleep(0.02) or True)
    monkeypatch.setattr(trainer, "_finish", lambda: done.append("finished"))
    begun = time.monotonic()
    trainer._stop()
    assert time.monotonic() - begun < 2.0 and done == ["finished"]
    assert here.receive().kind == "stopped"
    here.close()
