"""The model in model_directory: gone on from, saved, and never in place of another robot's."""

from __future__ import annotations

import shutil
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bdnn_cases import black_box, scales
from live_support import real_robot

from bdnn_ros.errors import ModelFileError, UsageError
from bdnn_ros.models import load_model, save_model
from bdnn_ros.nodes.keeping import Kept
from bdnn_ros.online.serving import LEARNED_HERE, Settings, nominal
from bdnn_ros.online.session import Session
from bdnn_ros.online.supervisor import PATIENCE
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
REAL = real_robot(ARM)
OTHER = Robot.bundled("arm6")
LONGER = Robot.from_urdf(ARM.urdf.replace('xyz="0 0 -0.26"', 'xyz="0 0 -0.52"'))
"""With joints of the same names."""


class Log(list):
    """What was logged, whatever the level."""

    def __call__(self) -> Log:
        return self

    info = warning = error = list.append


@pytest.fixture
def session():
    session = Session(Settings(capacity=1000))
    session.set_robot(ARM)
    session.begin(ARM.joints)
    yield session
    session.stop()


@pytest.mark.parametrize("directory, patience", [("kept", PATIENCE), ("", 0.0)])
def test_a_trainer_that_learns_for_nobody_is_not_waited_for(
    tmp_path, session, monkeypatch, directory, patience
):
    """Five seconds at the end of a node were too long for what launched it."""
    log, waited = Log(), []
    monkeypatch.setattr(session.supervisor, "stop", lambda patience: bool(waited.append(patience)))
    kept = Kept(directory and str(tmp_path), session, log)
    for k in range(5):
        session.intake.take(list(ARM.joints), [0.0, 0.0], (), [1.0, 1.0], 10**18 + k, 0)
    session._course.trained = 2
    kept.leave()
    assert waited == [patience] and PATIENCE < 5.0
    told = f"the trainer was still at work after {PATIENCE:g} s and was ended: the last 3 samples are not learned"
    assert log == ([told] if directory else [])


def test_a_model_is_kept_where_it_was(tmp_path, session):
    log = Log()
    kept = Kept(str(tmp_path), session, log)
    kept.resume()
    assert log == [] and session.served.number == 0
    kept.save()
    assert log == [f"model saved to {tmp_path / 'model.bdnn'}"]
    kept.resume()
    kept.save()
    assert log[1:] == [f"going on from {tmp_path / 'model.bdnn'}", log[0]]
    assert [path.name for path in tmp_path.iterdir()] == ["model.bdnn"]


def test_a_file_whose_reading_fails_in_any_way_does_not_end_the_node(tmp_path, session, monkeypatch):
    """Nobody has thought of every way in which a file can be damaged."""
    path, log = save_model(tmp_path, nominal(ARM)), Log()
    monkeypatch.setattr("bdnn_ros.models.modelfile.load", lambda *_, **__: {}["arrays"])
    kept = Kept(str(tmp_path), session, log)
    kept.resume()
    assert log == [
        f"not going on from {path}, which is left as it is: 'arrays'",
        f"what is learned will be saved to {tmp_path / 'model_2.bdnn'}",
    ]
    assert kept.place() == tmp_path / "model_2.bdnn"


@pytest.mark.parametrize("first", ["other joints", "longer", "damaged"])
def test_a_file_that_was_refused_is_kept(tmp_path, session, first):
    """What is learned goes to the next free name, is gone on from there, and the log says both."""
    longer, damaged = first == "longer", first == "damaged"
    first, second = tmp_path / "model.bdnn", tmp_path / "model_2.bdnn"
    save_model(first, nominal(LONGER if longer else OTHER))
    if damaged:
        first.write_bytes(first.read_bytes()[:100])
    before = first.read_bytes()
    log = Log()
    kept = Kept(str(tmp_path), session, log)
    kept.resume()
    assert log[0].startswith(f"not going on from {first}, which is left as it is: ")
    assert log[1:] == [f"what is learned will be saved to {second}"]
    kept.save()
    assert log[2:] == [f"model saved to {second}"] and first.read_bytes() == before
    kept.resume()
    kept.save()
    assert log[-2:] == [f"going on from {second}", f"model saved to {second}"]
    assert sorted(path.name for path in tmp_path.iterdir()) == [first.name, second.name]
    assert load_model(second).joints == ARM.joints
    shutil.copy(second, first)  # somebody puts a model of this robot in its place
    assert kept.place() == first


def test_a_model_that_learning_cannot_go_on_from_serves(tmp_path, session):
    path = save_model(tmp_path, black_box(ARM.joints, scales(2), hidden=4))
    log = Log()
    Kept(str(tmp_path), session, log).resume()
    assert log == [f"a bdnn model serves, {path}; training is paused, it cannot go on from this kind"]
    assert session.served.model.kind == "bdnn" and not session.learning


def test_what_was_learned_is_not_lost_to_another_kind_that_serves_at_the_end(tmp_path, session):
    learned = save_model(tmp_path, nominal(ARM))
    other = save_model(tmp_path / "other", black_box(ARM.joints, scales(2), hidden=4))
    kept = Kept(str(tmp_path), session, Log())
    kept.resume()
    session.load_now(other)
    kept.save()
    assert load_model(learned).kind == "physical" and load_model(other).kind == "bdnn"


def learn(session: Session, path: Path) -> None:
    """As if the model of a file had been learned from the stream."""
    session.load_now(path)
    session.served = replace(session.served, origin=LEARNED_HERE)


@pytest.mark.parametrize("training", [True, False])
def test_a_trial_that_was_loaded_does_not_take_the_place_of_what_is_kept(tmp_path, session, training):
    path, trial = save_model(tmp_path, nominal(ARM)), save_model(tmp_path / "trial", nominal(REAL))
    before = path.read_bytes()
    session.set_training(training)
    log = Log()
    kept = Kept(str(tmp_path), session, log)
    kept.resume()
    session.load_now(trial)
    kept.save_meanwhile()
    session._files.submit(int).result()
    kept.save()
    assert path.read_bytes() == before and log[1:] == []
    learn(session, trial)
    kept.save_meanwhile()
    session._files.submit(int).result()
    assert path.read_bytes() != before


def test_what_was_learned_meanwhile_is_kept_once(tmp_path, session):
    log = Log()
    kept = Kept(str(tmp_path), session, log)
    path = tmp_path / "model.bdnn"

    def kept_meanwhile() -> bool:
        kept.save_meanwhile()
        session.save(lambda: tmp_path / "after.bdnn").result()  # one file after the other
        written = path.exists()
        path.unlink(missing_ok=True)
        return written

    assert not kept_meanwhile()  # the description serves: nothing was learned
    learn(session, save_model(tmp_path / "other", nominal(ARM)))
    assert kept_meanwhile() and not kept_meanwhile() and log == []
    learn(session, tmp_path / "other")
    (tmp_path / "blocked").write_text("a file")
    Kept(str(tmp_path / "blocked"), session, log).save_meanwhile()
    session.save(lambda: tmp_path / "after.bdnn").result()
    assert len(log) == 1 and "cannot be written" in log[0]


def networks(place: Path) -> Path:
    return save_model(place, black_box(ARM.joints, scales(2), hidden=4))


def test_what_is_learned_after_a_reset_does_not_take_the_place_of_networks(tmp_path, session):
    first, second = networks(tmp_path), tmp_path / "model_2.bdnn"
    before = first.read_bytes()
    kept = Kept(str(tmp_path), session, Log())
    kept.resume()
    assert kept.place() == first  # networks that are saved do
    session.reset()
    kept.save()
    assert first.read_bytes() == before and load_model(second).kind == "physical"
    assert kept.place() == second
    session.load_now(first)
    kept.save()
    assert kept.place() == first and load_model(second).kind == "physical"


def test_what_cannot_be_saved_meanwhile_is_tried_again(tmp_path, session):
    (tmp_path / "models").write_text("a file, as where a disk is not there yet")
    log = Log()
    kept = Kept(str(tmp_path / "models"), session, log)
    learn(session, save_model(tmp_path / "other", nominal(ARM)))
    for _ in range(2):
        kept.save_meanwhile()
        session._files.submit(int).result()
    assert len(log) == 2 and all("cannot be written" in line for line in log)
    (tmp_path / "models").unlink()
    kept.save_meanwhile()
    session._files.submit(int).result()
    assert len(log) == 2 and load_model(tmp_path / "models").kind == "physical"


def test_networks_that_are_loaded_while_a_save_waits_are_not_saved_in_its_place(tmp_path, session):
    path = tmp_path / "model.bdnn"
    learn(session, save_model(tmp_path / "other", nominal(ARM)))
    wait = threading.Event()
    session._files.submit(wait.wait)  # a slow disk
    Kept(str(tmp_path), session, Log()).save_meanwhile()
    session.load_now(networks(tmp_path / "good"))
    wait.set()
    session._files.submit(int).result()
    assert load_model(path).kind == "physical"


def test_a_model_is_found_where_the_one_before_was_deleted(tmp_path, session):
    """And it stays where it is; names that only look alike are nobody's."""
    for name in ("model_3.bdnn", "model_12.bdnn"):
        save_model(tmp_path / name, nominal(ARM))
    for name in ("model_good_2.bdnn", "model_old.bdnn", "model_03.bdnn", "model_1.bdnn"):
        save_model(tmp_path / name, nominal(OTHER))
    log = Log()
    kept = Kept(str(tmp_path), session, log)
    kept.resume()
    assert log == [f"going on from {tmp_path / 'model_3.bdnn'}"] and kept.place() == tmp_path / "model_3.bdnn"
    for name in ("model_3.bdnn", "model_12.bdnn"):
        save_model(tmp_path / name, nominal(OTHER))
    kept.resume()
    assert log[-1] == f"what is learned will be saved to {tmp_path / 'model.bdnn'}" and len(log) == 4
    assert kept.place() == tmp_path / "model.bdnn"


def test_nothing_is_kept_without_a_directory(session):
    log = Log()
    kept = Kept("", session, log)
    kept.resume()
    kept.save()
    kept.save_meanwhile()
    assert log == []
    with pytest.raises(UsageError, match="not set"):
        kept.place()


def test_what_cannot_be_written_is_said(tmp_path, session):
    blocked = tmp_path / "blocked"
    blocked.write_text("a file")
    log = Log()
    Kept(str(blocked), session, log).save()
    assert len(log) == 1 and "cannot be written" in log[0]
    assert Path(blocked).read_text() == "a file"


def test_a_directory_that_cannot_be_looked_at_is_said(tmp_path, session):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    log = Log()
    kept = Kept(str(loop), session, log)
    kept.resume()
    kept.save()
    assert len(log) == 2 and all("cannot be looked at (Symlink loop)" in line for line in log)
    assert session.served.number == 0


def test_a_model_of_joints_that_the_parameter_leaves_out_says_what_to_set(tmp_path):
    path = save_model(tmp_path, nominal(ARM))
    session = Session(Settings(capacity=1000))
    try:
        session.set_robot(Robot.from_urdf(ARM.urdf, ARM.joints[:1]))
        session.begin(ARM.joints[:1])
        with pytest.raises(ModelFileError, match=r"joints set to \[arm2_joint1, arm2_joint2\]"):
            session.load_now(path)
    finally:
        session.stop()


@pytest.fixture
def waiting():
    """A session that knows no robot yet."""
    session = Session(Settings(capacity=1000))
    yield session
    session.stop()


def answer(session: Session) -> list[float]:
    at = np.array([0.3, 0.2])
    return session.served.parts(at, at, at).effort.tolist()


def test_a_model_that_is_kept_serves_before_the_robot_moves(tmp_path, waiting):
    """The description served until joint states came, and saving without a name put it in the place of the model."""
    path = save_model(tmp_path, nominal(REAL))
    log = Log()
    kept = Kept(str(tmp_path), waiting, log)
    kept.serve(ARM)
    assert log == [f"going on from {path}"]
    learned = answer(waiting)
    assert learned == pytest.approx(REAL.inverse_dynamics(*np.array([[0.3, 0.2]] * 3)))
    waiting.save_now(kept.place())
    kept.begin(ARM.joints)
    assert answer(waiting) == learned and len(log) == 1 and waiting._course.resumed is not None


def test_another_model_that_was_loaded_is_gone_on_from(tmp_path, waiting):
    """The first joint state replaced it by the model that is kept."""
    save_model(tmp_path, nominal(ARM))
    other = save_model(tmp_path / "good", nominal(REAL))
    kept = Kept(str(tmp_path), waiting, Log())
    kept.serve(ARM)
    waiting.load_now(other)
    kept.begin(ARM.joints)
    assert waiting.served.origin == str(other)


def test_a_reset_before_the_robot_moves_holds(tmp_path, waiting):
    save_model(tmp_path, nominal(REAL))
    kept = Kept(str(tmp_path), waiting, Log())
    kept.serve(ARM)
    waiting.reset()
    kept.begin(ARM.joints)
    assert waiting.served.number == 0 and waiting._course.resumed is None


@pytest.mark.parametrize("joints", [ARM.joints[:1], ARM.joints])
@pytest.mark.parametrize("early", [False, True])
def test_after_a_reset_no_model_that_is_kept_comes_back(tmp_path, waiting, joints, early):
    """Not where it is of joints that only come later, nor where the file was only written since."""
    log = Log()
    kept = Kept(str(tmp_path), waiting, log)
    if early:
        save_model(tmp_path, nominal(Robot.from_urdf(REAL.urdf, joints)))
    kept.serve(ARM)
    kept.reset()
    save_model(tmp_path, nominal(Robot.from_urdf(REAL.urdf, joints)))
    said = len(log)
    kept.begin(ARM.joints[:1])
    kept.begin(ARM.joints)
    assert waiting.served.number == 0 and waiting._course.resumed is None and len(log) == said


def test_a_model_of_the_joints_that_come_waits_for_them(tmp_path, waiting):
    """Nothing is said of it before, and what is saved meanwhile has a file of its own."""
    one = ARM.joints[:1]
    path = save_model(tmp_path, nominal(Robot.from_urdf(REAL.urdf, one)))
    log = Log()
    kept = Kept(str(tmp_path), waiting, log)
    kept.serve(ARM)
    assert log == [] and waiting.served.number == 0 and kept.place() == tmp_path / "model_2.bdnn"
    kept.begin(one)
    assert log == [f"going on from {path}"] and waiting.served.origin == str(path)
