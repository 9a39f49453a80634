"""What is said where a diagnosis fails, without a trainer's process."""

from __future__ import annotations

import queue
import threading
from typing import Any

import numpy as np
import pytest

from bdnn_ros.diagnosis.result import Diagnosis, Finding, Quantity
from bdnn_ros.effects.environment import ExternalTorque
from bdnn_ros.errors import RecordingError
from bdnn_ros.online.analysis import Analyst
from bdnn_ros.online.channel import Message
from bdnn_ros.online.noticed import Noticed
from bdnn_ros.online.stamping import diagnosis_with_stamps, with_stamps
from bdnn_ros.online.stream.buffer import Chunk, Ring
from bdnn_ros.online.stream.feed import Feed
from bdnn_ros.online.stream.intake import Intake
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")
BEGUN = {"epoch": 3, "diagnosis_period": 0.0, "diagnosis_window": 0.0, "kept": 0, "start": 0}


def change(effect: str, where: str, *times: str) -> dict[str, Any]:
    """A change as a finding, with parameters of these names."""
    place = {"joint": where, "link": None} if effect == "drift" else {"joint": None, "link": where}
    parameters = {name: {"value": 1.0} for name in times}
    return {
        "effect": effect,
        **place,
        "parameters": parameters,
        "share": 0.5,
        "sentence": f"{effect} {where}",
    }


class Broken:
    """A stream whose recording fails in one way after the other."""

    def __init__(self, *errors: Exception) -> None:
        self.errors = list(errors)

    def latest_time(self) -> float:
        return 1.0

    def recording(self, seconds: float) -> Any:
        raise self.errors.pop(0)


def test_every_question_is_answered_whatever_fails(capfd):
    said: queue.Queue[Message] = queue.Queue()
    analyst = Analyst(said.put)
    analyst.begin(ARM, Broken(ValueError("on purpose"), MemoryError(), RecordingError("No motion.")), BEGUN)
    for number in (1, 2, 3):
        analyst.ask(0.0, number)
    told = [said.get(timeout=5.0).info for _ in range(3)]
    assert [info["request"] for info in told] == [1, 2, 3] and all(info["epoch"] == 3 for info in told)
    errors = [info["error"] for info in told]
    assert errors == [
        "The diagnosis failed (ValueError).",
        "The diagnosis failed (MemoryError).",
        "No motion.",
    ]
    assert "on purpose" in capfd.readouterr().err


def test_times_of_a_diagnosis_are_the_publisher_s_stamps(monkeypatch):
    """As those of a change are: both stand in one message."""
    begun, said = 1_700_000_000_000_000_000, queue.Queue[Message]()
    ring = Ring.create(1000, 6)
    intake = Intake(ARM.joints, ring)
    for row in range(900):
        stamp = begun + row * 10_000_000
        intake.take(list(ARM.joints), [0.1 * row, 0.0], [0.0, 0.0], [0.0, 0.0], stamp, stamp)
    times = {"start": {"value": 1.5}, "end": {"value": 3.0}, "force_x": {"value": 7.0}}
    found = {"sentence": "", "effect": "external_wrench", "share": 0.5, "parameters": times}
    diagnosis = {
        "verdict": "explained",
        "findings": [found],
        "gain": {"value": 0.5},
        "advice": [],
        "notes": [],
    }
    monkeypatch.setattr(Analyst, "_answer", lambda self, asked: {"diagnosis": diagnosis})
    analyst = Analyst(said.put)
    analyst.begin(ARM, Feed(ARM.joints, ring), BEGUN)
    analyst.ask(0.0, 1)
    (told,) = said.get(timeout=5.0).info["diagnosis"]["findings"]
    values = {name: parameter["value"] for name, parameter in told["parameters"].items()}
    np.testing.assert_allclose(
        [values["start"], values["end"]], begun * 1e-9 + np.array([1.5, 3.0]), rtol=0, atol=0.011
    )
    assert values["force_x"] == 7.0
    merged = analyst.with_changes([Noticed(10.0, told)])["findings"]
    assert merged == [told, told]  # on one clock


def test_the_latched_message_holds_all_that_changed_since_the_last_diagnosis(monkeypatch):
    """Two joints that warm up together were two messages of one change each, and who came late saw the last."""
    said, ring = queue.Queue[Message](), Ring.create(1000, 6)
    intake = Intake(ARM.joints, ring)
    for row in range(900):  # until 8.99 s
        intake.take(list(ARM.joints), [0.1 * row, 0.0], [], [0.0, 0.0], row * 10_000_000 + 1, 0)
    old = {"sentence": "old", "share": 0.5, "parameters": {}}
    plain = {"verdict": "explained", "gain": {"value": 0.5}, "advice": [], "notes": []}
    monkeypatch.setattr(Analyst, "_answer", lambda self, asked: {"diagnosis": {**plain, "findings": [old]}})
    analyst = Analyst(said.put)
    analyst.begin(ARM, Feed(ARM.joints, ring), BEGUN)
    one, two, three = (
        {**change("drift", name), "share": share} for name, share in zip("abc", (0.1, 0.7, 0.3), strict=True)
    )
    analyst.with_changes([Noticed(3.0, one), Noticed(3.0, two)])
    assert analyst.with_changes([Noticed(10.0, three)])["findings"] == [two, three, one]
    analyst.ask(0.0, 1)
    told = said.get(timeout=5.0).info["diagnosis"]
    assert told["findings"] == [old, three]  # it has seen the first two happen, the third it could not


def test_a_robot_that_grips_all_day_is_told_what_it_holds():
    """Where every diagnosis refused, each message held all changes of the day."""
    analyst = Analyst(lambda message: None)
    grips, lets_go = change("payload", "hand", "mass", "start"), change("payload", "hand", "mass", "end")
    elsewhere, drifts = change("payload", "tool", "mass", "start"), change("drift", "elbow", "start")
    analyst.with_changes(
        [Noticed(0.0, elsewhere), Noticed(1.0, drifts), Noticed(1.0, change("drift", "wrist"))]
    )
    for k in range(50):
        held = analyst.with_changes([Noticed(5.0 * k + 2.0, grips)])["findings"]
        freed = analyst.with_changes([Noticed(5.0 * k + 4.0, lets_go), Noticed(5.0 * k + 4.0, drifts)])
        analyst._take({"error": "too short"}, 5.0 * k + 4.0, analyst._epoch)
        others = [elsewhere, change("drift", "wrist")]
        assert [one for one in held if one not in (*others, drifts)] == [lets_go] * (k > 0) + [grips]
        assert freed["findings"] == [*others, lets_go, drifts] and "notes" not in freed


def weighing(mass: float, *times: str) -> dict[str, Any]:
    found = change("payload", "hand", "mass", *times)
    return {**found, "parameters": {**found["parameters"], "mass": {"value": mass}}}


@pytest.mark.parametrize(
    ("grips", "let_go", "held"),
    [
        ((1.0, 2.0), 2.1, (1.0,)),
        ((1.0, 2.0), 0.9, (2.0,)),
        ((1.0, 2.0), 3.1, ()),
        ((1.0, 1.0), 1.0, (1.0,)),
        ((0.5, 1.0, 2.0), 3.0, (0.5,)),
        ((2.0,), 0.4, (2.0,)),  # most of it is still there
    ],
)
def test_a_release_takes_back_what_was_let_go(grips, let_go, held):
    """After two grips and one release nothing was told of the first load."""
    analyst = Analyst(lambda message: None)
    for k, mass in enumerate(grips):
        analyst.with_changes([Noticed(float(k), weighing(mass, "start"))])
    released = weighing(let_go, "end")
    told = analyst.with_changes([Noticed(5.0, released)])["findings"]
    expected = [weighing(mass, "start") for mass in held]
    assert told == [*expected, released]
    drift = change("drift", "elbow", "start")
    assert analyst.with_changes([Noticed(6.0, drift)])["findings"] == [*expected, released, drift]


def test_a_window_too_short_for_a_diagnosis_starts_no_process(monkeypatch):
    said, ring = queue.Queue[Message](), Ring.create(1000, 6)
    intake = Intake(ARM.joints, ring)
    for row in range(500):
        intake.take(list(ARM.joints), [0.1 * row, 0.0], [], [0.0, 0.0], row * 10_000_000 + 1, 0)
    monkeypatch.setattr(Analyst, "_answer", lambda self, asked: pytest.fail("a process was started"))
    analyst = Analyst(said.put)
    analyst.begin(ARM, Feed(ARM.joints, ring), BEGUN)
    analyst.ask(2.0, 0)
    assert "2.0 s of motion are too short for a diagnosis" in said.get(timeout=5.0).info["error"]


def test_changes_that_nobody_looks_at_are_told_for_a_while_and_counted_then():
    analyst, push = Analyst(lambda message: None), change("external_wrench", "hand", "start", "end")
    analyst._last = {
        "verdict": "explained",
        "findings": [],
        "gain": {"value": 0.5},
        "advice": [],
        "notes": ["n"],
    }
    told = [analyst.with_changes([Noticed(float(k), {**push, "share": 1.0 - 0.01 * k})]) for k in range(20)]
    assert len(told[15]["findings"]) == 16 and told[15]["notes"] == ["n"]
    assert told[19]["findings"] == [{**push, "share": 1.0 - 0.01 * k} for k in range(4, 20)]
    note, *more = [note for note in told[19]["notes"] if note != "n"]
    assert note.startswith("4 older changes") and not more
    late = analyst.with_changes([Noticed(615.0, push)])  # ten minutes after the one at 15 s
    assert [one["share"] for one in late["findings"]] == pytest.approx([0.85, 0.84, 0.83, 0.82, 0.81, 0.5])
    assert late["notes"][-1].startswith("15 older changes")
    analyst._take(
        {"diagnosis": {"verdict": "explained", "findings": [], "gain": {}, "notes": []}},
        615.0,
        analyst._epoch,
    )
    assert analyst.with_changes([Noticed(616.0, push)])["notes"] == []  # it has looked at all of them


class Overtaken(Ring):
    """A ring whose oldest samples are overwritten just before they are read."""

    def read(self, start: int, most: int | None = None) -> Chunk:
        write(self, self.written, 2)
        return super().read(start, most)


BEGUN_AT = 1_700_000_000_000_000_000


def write(ring: Ring, first: int, count: int) -> None:
    """Samples every 10 ms; the stream began at 5 s of its own time."""
    for number in range(first, first + count):
        ring.slot()[:] = 0.0
        stamp = BEGUN_AT + number * 10_000_000
        ring.commit(stamp, stamp, stamp - BEGUN_AT + 5_000_000_000)


@pytest.mark.parametrize("kind", [Ring, Overtaken])
def test_a_time_whose_sample_is_no_longer_kept_is_told_as_it_was(kind):
    """It was told as that of the oldest sample, and where that was just being overwritten the trainer ended."""
    ring = kind.create(100, 1)
    write(ring, 0, 1000)
    oldest = 0.01 * ring.oldest
    times = {"start": {"value": 1.0, "std": 0.1}, "end": {"value": oldest, "std": 0.1}}
    told = with_stamps({"effect": "payload", "parameters": times, "sentence": ""}, ring)["parameters"]
    assert told["start"]["value"] == pytest.approx(BEGUN_AT * 1e-9 + 1.0, rel=0, abs=1e-5)
    assert told["end"]["value"] == pytest.approx(BEGUN_AT * 1e-9 + oldest, rel=0, abs=1e-5)
    ring.close()


def test_sentences_tell_the_same_times_as_the_values():
    """An operator who looked for 8.2 s in a bag of wall-clock stamps found nothing there."""
    ring = Ring.create(2000, 1)
    write(ring, 0, 1000)
    push = {"start": {"value": 8.2, "std": 0.1}, "end": {"value": 9.41, "std": 0.1}}
    sentence = "Something pushed l from 8.2 s to 9.4 s with (1.0, 2.0, 3.0) N for 8.2 s."
    load = "Or l carries 1.2 kg from 8.2 s on: move it for 10.0 s, at 8.3 s or at 5.0 s."
    diagnosis = {"findings": [{"parameters": push, "sentence": sentence}], "advice": [load], "notes": [load]}
    told = diagnosis_with_stamps(diagnosis, ring)
    start = BEGUN_AT * 1e-9 + 8.2
    assert told["findings"][0]["parameters"]["start"]["value"] == pytest.approx(start, rel=0, abs=1e-5)
    assert told["findings"][0]["sentence"] == (
        "Something pushed l from 1700000008.2 s to 1700000009.4 s with (1.0, 2.0, 3.0) N for 8.2 s."
    )
    assert (
        told["notes"]
        == told["advice"]
        == ["Or l carries 1.2 kg from 1700000008.2 s on: move it for 10.0 s, at 8.3 s or at 5.0 s."]
    )
    ring.close()


@pytest.mark.parametrize("gone", [0.0, 2e4, 2e5])
def test_times_are_as_exact_after_hours_of_stream(gone):
    """After 2.8 h a push was told up to 50 ms off, after 28 h up to half a second, and its sentence in stream time."""
    ring = Ring.create(2000, 1)
    for row in range(-1, 1000):  # the first sample ever, and those that are still kept
        time = BEGUN_AT + (round(gone * 1e9) + row * 10_000_000 if row >= 0 else 0)
        ring.slot()[:] = 0.0
        ring.commit(time, time, time)
    values = {"start": gone + 3.4564, "end": gone + 5.1236, "torque": 3.0}
    told = {name: Quantity(value, 0.01, "s") for name, value in values.items()}
    sentence = ExternalTorque().sentence("j", values)
    push = Finding("external_wrench", "j", None, told, 0.5, 0.99, (), sentence, "joint")
    note = f"j carries something from {values['start']:.1f} s on, for {values['end']:.1f} s."
    diagnosis = Diagnosis({}, "explained", (push,), {}, 0.5, (0.4, 0.6), 0.0, (), "", (), (note,))
    stamped = diagnosis_with_stamps(diagnosis.as_json(), ring)
    (found,), begun = stamped["findings"], BEGUN_AT * 1e-9 + gone
    starts, ends = (found["parameters"][edge]["value"] - begun for edge in ("start", "end"))
    assert (starts, ends) == (pytest.approx(3.456, abs=1e-5), pytest.approx(5.124, abs=1e-5))
    assert f"from {begun + 3.46:.2f} s to {begun + 5.12:.2f} s with" in found["sentence"]
    assert stamped["notes"] == [
        f"j carries something from {begun + 3.5:.1f} s on, for {values['end']:.1f} s."
    ]
    ring.close()


def test_of_two_times_that_are_near_a_sentence_tells_the_nearer():
    """Told to a tenth, the end of a short push was taken for its start."""
    ring = Ring.create(2000, 1)
    write(ring, 0, 1000)
    push = {"start": {"value": 8.24, "std": 0.1}, "end": {"value": 8.31, "std": 0.1}}
    told = with_stamps({"parameters": push, "sentence": "Something pushed l from 8.2 s to 8.3 s."}, ring)
    assert told["sentence"] == "Something pushed l from 1700000008.2 s to 1700000008.3 s."
    ring.close()


def test_nothing_of_a_stream_that_was_given_up_is_remembered():
    """Nor is anything while another begins: half of each would be."""
    analyst = Analyst(lambda message: None)
    analyst.begin(ARM, Broken(), BEGUN)
    told = {"unlike": True, "diagnosis": {"verdict": "explained", "findings": [], "gain": {}, "notes": []}}
    taken = threading.Thread(target=analyst._take, args=(told, 5.0, BEGUN["epoch"]))
    with analyst._merging:
        taken.start()
        analyst._epoch += 1  # as `begin` does
    taken.join()
    assert not analyst.unlike and analyst._last == {}
    begun = threading.Thread(target=analyst.begin, args=(ARM, Broken(), BEGUN))
    with analyst._merging:
        begun.start()
        begun.join(0.1)
        assert begun.is_alive() and analyst._epoch != BEGUN["epoch"]
    begun.join()
    assert analyst._epoch == BEGUN["epoch"]
