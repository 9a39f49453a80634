"""Messages that a slow driver's publisher sends several times: the first of each stays."""

import json
from dataclasses import replace

import numpy as np
import pytest
from bag_cases import PENDULUM, bag_of
from cli_cases import swing

from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis import diagnose
from bdnn_ros.errors import RecordingError
from bdnn_ros.online.chunks import Chunks
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import mended, prepare, without_copies

NOISE = 5e-5


def driver(rate=250.0, duration=8.0, resolution=0.0, speed=1.0):
    """What a driver reads, each time anew."""
    time = np.arange(round(duration * rate)) / rate
    at = speed * time
    noise = NOISE * np.random.default_rng(0).standard_normal((2, len(time), 2))
    position = np.stack([np.sin(at), 0.5 * np.cos(1.3 * at)], axis=1) + noise[0]
    if resolution:
        position = resolution * np.round(position / resolution)
    effort = np.stack([np.cos(2.0 * at), np.sin(at)], axis=1) + noise[1]
    return Recording(time, ("a", "b"), position, np.gradient(position, time, axis=0), effort)


def published(read, times):
    """What its publisher sends, so many times as often, by an even clock of its own."""
    stamps = np.arange(round(times * len(read))) / (times * read.rate)
    rows = np.minimum(((np.arange(len(stamps)) + 1e-6) / times).astype(int), len(read) - 1)
    return Recording(stamps, read.joints, read.position[rows], read.velocity[rows], read.effort[rows])


@pytest.mark.parametrize("fresh", [False, True], ids=["effort copied", "effort fresh"])
@pytest.mark.parametrize("velocity", [False, True], ids=["no velocity", "velocity"])
@pytest.mark.parametrize(("rate", "times"), [(250.0, 2), (250.0, 4), (125.0, 8)])
def test_the_first_of_each_message_stays_and_the_user_is_told(rate, times, velocity, fresh):
    read = driver(rate)
    sent = published(read, times)
    sent = replace(sent, velocity=sent.velocity if velocity else None)
    if fresh:
        sent = replace(sent, effort=driver(rate * times).effort)
    signals = prepare(sent)
    assert signals.raw_rate == pytest.approx(rate)
    np.testing.assert_allclose(signals.position_noise, NOISE, rtol=0.2)
    once = mended(sent)
    np.testing.assert_allclose(once.time, sent.time[::times])
    np.testing.assert_array_equal(once.position, read.position)
    (note,) = once.notes
    assert f"{(times - 1) * len(read)} of {times * len(read)} messages are copies" in note


@pytest.mark.parametrize("times", [1.6, 2.5, 3.3])
def test_the_period_of_a_driver_need_be_no_whole_number_of_its_publishers(times):
    signals = prepare(published(driver(), times))
    assert signals.raw_rate == pytest.approx(250.0, rel=0.01)
    np.testing.assert_allclose(signals.position_noise, NOISE, rtol=0.2)


@pytest.mark.parametrize("joints", [("a", "b"), ("b",)])
@pytest.mark.parametrize("speed", [0.02, 0.2, 1.0])
def test_what_a_coarse_encoder_shows_for_long_is_no_copy(speed, joints):
    coarse = driver(resolution=0.005, speed=speed).select(joints)
    assert without_copies(coarse) is coarse
    bare = replace(coarse, velocity=None, effort=None)
    assert without_copies(bare) is bare
    assert len(without_copies(published(coarse, 4))) == len(coarse)


def test_a_robot_that_rests_and_single_repeats_lose_nothing():
    read = driver()
    resting = replace(read, position=read.position.copy(), velocity=None)
    resting.position[500:1500] = resting.position[500]
    assert without_copies(resting) is resting
    one_rests = replace(read, position=read.position * [1.0, 0.0])
    assert without_copies(one_rests) is one_rests
    repeating = replace(read, position=read.position.copy(), velocity=None)
    for row in range(50, 1950, 50):
        repeating.position[row], repeating.effort[row] = (
            repeating.position[row - 1],
            repeating.effort[row - 1],
        )
    assert without_copies(repeating) is repeating


def test_where_the_robot_of_a_slow_driver_rests_its_rate_stays_what_it_is():
    read = driver()
    read.position[500:1500], read.velocity[500:1500], read.effort[500:1500] = 0.1, 0.0, 0.2
    np.testing.assert_allclose(np.diff(without_copies(published(read, 4)).time), 1.0 / 250.0)


def test_a_message_that_a_slow_driver_lost_is_a_repeat_as_any_other():
    read = driver()
    read.position[700], read.velocity[700], read.effort[700] = (
        read.position[699],
        read.velocity[699],
        read.effort[699],
    )
    once = mended(published(read, 4))
    np.testing.assert_allclose(once.time, np.delete(read.time, 700))
    assert "1 messages repeat the one before in motion" in once.notes[-1]


def test_a_stream_is_filtered_as_its_driver_allows():
    read = driver(rate=30.0)
    sent = published(read, 4)
    chunks = Chunks(sent.joints)
    found = [chunk for chunk in chunks.add(sent.time, sent.position, sent.effort) if chunk is not None]
    assert found and chunks.cutoff == pytest.approx(5.0)
    np.testing.assert_allclose([signals.raw_rate for signals, _ in found], 30.0)


def test_a_diagnosis_looks_at_what_the_driver_read(monkeypatch):
    def looked_at(recordings, robot):
        raise RecordingError(f"{recordings[0].rate:.0f} Hz", "")

    monkeypatch.setattr(diagnose, "quiet_cutoff", looked_at)
    robot = Robot.bundled("arm2")
    sent = replace(published(driver(duration=12.0), 4), joints=robot.joints)
    with pytest.raises(RecordingError, match="250 Hz"):
        diagnose.diagnose([sent], robot)


def test_commands_take_the_rate_of_the_driver_but_predict_for_every_message(tmp_path, capsys):
    """At the publisher's rate the low-pass would be one that 15 Hz do not allow."""
    pendulum = Robot.from_urdf(PENDULUM)
    read = swing(pendulum, 30.0, rate=15.0)
    sent = published(replace(read, velocity=read.position), 8)
    bag = str(bag_of(tmp_path / "bag", sent, urdf=PENDULUM))
    assert main(["info", bag, "--json"]) == 0
    told = capsys.readouterr()
    report = json.loads(told.out)
    assert (report["samples"], report["rate"]) == (len(read), pytest.approx(15.0))
    assert "3150 of 3600 messages are copies of the one before" in told.err
    assert main(["identify", bag, "--out", str(tmp_path / "model")]) == 0
    csv = tmp_path / "effort.csv"
    assert main(["predict", str(tmp_path / "model"), bag, "--out", str(csv)]) == 0
    effort = np.genfromtxt(csv, delimiter=",", names=True)["pivoteffort"]
    assert len(effort) == len(sent)
    np.testing.assert_allclose(effort[400:-400:8], read.effort[50:-50, 0], atol=0.1)
