"""Recordings that cannot answer: every verb says so alike, with the reason that fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import (
    EPOCH,
    MULTI_ARRAY,
    PENDULUM,
    STRING,
    bag_of,
    command,
    model_of_pendulum,
    motion,
    states,
    text,
    write_bag,
)

from bdnn_ros.cli import fitness
from bdnn_ros.cli.main import main
from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import Scores
from bdnn_ros.signals import prepare

VERBS = ("info", "identify", "replay", "evaluate", "diagnose")


def slow(rate: float, seconds: float = 20.0) -> Recording:
    """A motion that is recorded rarely."""
    return motion(samples=int(rate * seconds), rate=rate, urdf=PENDULUM)


def constant() -> Recording:
    """A robot that moves, with a driver that says one effort all the time."""
    recording = motion(urdf=PENDULUM)
    return replace(recording, effort=np.full_like(recording.position, 3.0))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the pendulum."""
    return model_of_pendulum(tmp_path_factory.mktemp("pendulum"))


def said(verb: str, bag: Path, model: Path, capfd: pytest.CaptureFixture[str]) -> str:
    """The error of a verb that refuses a bag."""
    out = ["--out", str(bag.parent / "out")] if verb in ("identify", "diagnose") else []
    capfd.readouterr()
    assert main([verb, *([str(model)] if verb == "evaluate" else []), str(bag), *out]) == 1
    assert not (bag.parent / "out").exists()
    captured = capfd.readouterr()
    assert "Fit for" not in captured.out
    (error,) = (line for line in captured.err.splitlines() if not line.startswith("bdnn: note: "))
    return error.removeprefix("bdnn: error: ")


@pytest.mark.parametrize("verb", VERBS)
def test_efforts_that_never_change_say_nothing_of_a_motion(verb, tmp_path, model, capfd):
    bag = bag_of(tmp_path / "bag", constant())
    assert "the effort of no joint that moves ever changes. Check that" in said(verb, bag, model, capfd)


@pytest.mark.parametrize(
    ("verb", "topics"), [("info", ()), ("info", ("/u", "/w")), *((verb, ("/u",)) for verb in VERBS)]
)
def test_commands_are_advised_where_the_bag_holds_some(verb, topics, tmp_path, model, capfd):
    sent = [(topic, MULTI_ARRAY, EPOCH, command((1.0,))) for topic in topics]
    silent = states(replace(motion(samples=300), effort=None))
    described = ("/robot_description", STRING, EPOCH, text(PENDULUM))
    error = said(verb, write_bag(tmp_path / "bag", [described, *silent, *sent]), model, capfd)
    assert "the joint states carry no effort" in error
    advised = {
        0: "or the commands as well, for --effort command.",
        1: "or pass --effort command to use what is commanded on /u.",
        2: "or pass --effort command with --effort-commands /u to use what is commanded on /u.",
    }
    assert error.endswith(advised[len(topics)])


def test_advice_of_info_names_whose_option_it_is(tmp_path, model, capfd):
    bag = bag_of(tmp_path / "bag", slow(4.5, 10.0))
    assert "(--holdout of `bdnn identify` and `bdnn evaluate`)" in said("info", bag, model, capfd)


def test_the_effort_of_a_joint_that_stands_does_not_count():
    both = motion(joints=("a", "b"))
    position, effort = both.position.copy(), both.require_effort().copy()
    position[:, 0], effort[:, 1] = 0.3, 1.0
    one = replace(both, position=position, effort=effort, velocity=None)
    with pytest.raises(RecordingError, match="no joint that moves"):
        fitness.require_measured(one)
    assert fitness.require_measured(replace(both, effort=effort)) is effort


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("rate", [1.0, 3.0])
def test_too_low_a_rate_is_said_and_not_taken_for_no_motion(verb, rate, tmp_path, model, capfd):
    bag = bag_of(tmp_path / "bag", slow(rate))
    assert f"joint states at {rate:g} Hz are too rare to tell a motion. Record" in said(
        verb, bag, model, capfd
    )


@pytest.mark.parametrize("verb", ["info", "identify"])
def test_a_part_that_is_too_short_is_not_taken_for_the_bag(verb, tmp_path, model, capfd):
    bag = bag_of(tmp_path / "bag", slow(5.0, 9.0))
    error = said(verb, bag, model, capfd)
    assert "its last 20 %, which is kept out to be scored, has 9 samples in 1.6 s, too few" in error


def test_what_is_slow_but_long_will_do(tmp_path, capsys):
    bag = bag_of(tmp_path / "bag", slow(5.0, 30.0))
    assert main(["info", str(bag)]) == 0
    assert main(["identify", str(bag), "--out", str(tmp_path / "out")]) == 0


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
def test_one_recording_does_not_count_twice(verb, tmp_path, capfd):
    """Six seconds given twice passed for the twelve that a diagnosis needs, and two like parts for agreement."""
    bag = bag_of(tmp_path / "bag", motion(urdf=PENDULUM))
    (file,) = bag.glob("*.mcap")
    for again in (bag, file):
        assert main([verb, str(bag), str(again), "--out", str(tmp_path / "out")]) == 2
        said = capfd.readouterr().err
        assert f"{bag} and {again} hold the same 5.99 s of one recording" in said and "Traceback" not in said
    assert not (tmp_path / "out").exists()


def test_a_piece_of_another_recording_is_told_by_what_it_measured():
    whole = motion()
    piece = replace(whole.between(2.0, 4.0), time=np.arange(200) / 100.0, epoch=whole.epoch + 2 * 10**9)
    later = replace(piece, epoch=whole.epoch + 6 * 10**9)
    other = replace(piece, effort=piece.effort + 0.01)
    fitness.require_distinct([whole, later, motion(seed=2)])  # simulations begin at one time
    fitness.require_distinct([whole, other])  # the same motion, commanded instead of measured
    fitness.require_distinct(
        [whole.between(0.0, 3.0), whole.between(2.9, 6.0)]
    )  # cut with a few samples in both
    at_rest = replace(piece, position=np.zeros_like(piece.position), effort=np.zeros_like(piece.effort))
    fitness.require_distinct([at_rest, at_rest])
    with pytest.raises(UsageError, match=r"hold the same 1\.99 s of one recording"):
        fitness.require_distinct([whole, later, piece])
    bare = replace(whole, effort=None)
    with pytest.raises(UsageError, match="count twice"):
        fitness.require_distinct([bare, bare])


def resting(seconds: float, joints: int = 1, held: bool = False) -> Recording:
    """Ten seconds of motion, after which all joints but the last stand so long, the effort read or held."""
    recording = motion(samples=round(100 * (10.0 + seconds)), joints=("a", "b")[:joints], urdf=PENDULUM)
    rng, still = np.random.default_rng(0), recording.time >= 10.0
    position, effort = recording.position.copy(), recording.require_effort().copy()
    stands = slice(None) if joints == 1 else slice(joints - 1)
    position[still, stands] = position[~still, stands][-1]
    effort[still, stands] = effort[~still, stands][-1]
    position += 1e-5 * rng.standard_normal(position.shape)
    effort += 0.1 * rng.standard_normal(effort.shape)
    if held:
        effort[still] = 0.0
    return replace(recording, position=position, velocity=None, effort=effort)


@pytest.mark.parametrize("held", [False, True])
def test_a_robot_that_stands_at_the_end_is_scored_on_its_motion(held):
    """A noisy rest, or efforts that are held there, were all that was kept out: the scores were large, or null."""
    recording = resting(20.0, held=held)
    ((first, last),) = fitness.parted([recording], 0.2, None)
    assert first.duration == pytest.approx(8.0, abs=0.2) and len(first) + len(last) == len(recording)
    turned = replace(
        recording, position=recording.position[::-1].copy(), effort=recording.require_effort()[::-1].copy()
    )
    ((first, last),) = fitness.parted([turned], 0.2, None)
    assert last.duration == pytest.approx(2.0, abs=0.2)


def test_a_share_of_steady_motion_is_a_share_of_its_time():
    for recording in (motion(), motion(joints=("a", "b")), slow(5.0)):
        for share in (0.2, 0.4):
            ((first, last),) = fitness.parted([recording], share, None)
            assert [len(first), len(last)] == [len(part) for part in recording.split(share)]


def test_a_joint_that_cannot_be_scored_is_named():
    recording = resting(20.0, joints=2)
    ((_, last),) = fitness.parted([recording], 0.2, None)
    tested = fitness.prepared_last(last, recording, None, 0.2)
    (sentence,) = fitness.unscored([recording], [last], [tested])
    assert sentence.startswith("a does not move with an effort measured in the last part")
    assert fitness.unscored([recording, recording], [last, recording], [tested, prepare(recording)]) == []
    still = replace(recording, position=recording.position * [0.0, 1.0])  # said of all of it already
    assert fitness.unscored([still], [last], [tested]) == []


def test_what_cannot_be_scored_is_told_by_identify_and_info(tmp_path, capfd):
    robot, time = Robot.bundled("arm2"), np.arange(800) / 50.0
    position = np.stack([np.sin(2.0 * np.minimum(time, 9.0)), 0.8 * np.sin(3.0 * time)], axis=1)
    velocity = np.gradient(position, 0.02, axis=0)
    effort = robot.inverse_dynamics(position, velocity, np.gradient(velocity, 0.02, axis=0))
    bag = bag_of(tmp_path / "bag", Recording(time, robot.joints, position, None, effort, urdf=robot.urdf))
    for verb in (["info"], ["identify", "--out", str(tmp_path / "out")]):
        capfd.readouterr()
        assert main([*verb, str(bag)]) == 0
        assert "arm2_joint1 does not move with an effort measured in the last part" in "".join(
            capfd.readouterr()
        )


def test_joints_whose_error_exceeds_the_descriptions_by_a_fifth_are_named():
    def scores(*errors: float) -> Scores:
        error = np.array(errors)
        return Scores(("a", "b", "c", "d", "e"), error, error, error**2, 0.0)

    model, described = scores(0.13, 0.11, np.nan, 0.2, 0.01), scores(0.1, 0.1, 0.1, 0.1, 0.001)
    (sentence,) = fitness.worse(model, described, from_nothing=True)
    assert sentence.startswith("a, d: ") and sentence.endswith(
        "of them, or start from the description (--prior urdf)."
    )
    assert fitness.worse(described, model, from_nothing=True) == []


def test_joints_that_the_model_predicts_no_better_than_the_description_are_named():
    """A chattering turntable had 1.16 and 1.04: it learned nothing, but is not worse by a fifth."""
    names = ("a", "b", "c", "d", "e", "still")

    def scores(*errors: float) -> Scores:
        error = np.array(errors)
        return Scores(names, error, error, error**2, 0.0)

    model, described = (
        scores(1.16, 0.3, np.nan, 0.9, 0.1, 0.9),
        scores(1.04, 0.9, 0.1, 0.3, 0.1, 0.9),
    )
    time = np.arange(400) / 100.0
    position = np.sin(time)[:, None] * np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])
    recording = Recording(time, names, position, None, position)
    (sentence,) = fitness.hardly_better(model, described, [recording])
    assert sentence.startswith("a: of what is kept out") and sentence.endswith("wider motion of it.")
    (worse,) = fitness.worse(model, described, from_nothing=False)
    assert worse.startswith("d: ")
    assert fitness.hardly_better(model, None, [recording]) == []
