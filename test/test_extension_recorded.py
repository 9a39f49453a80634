"""To which recordings the times of an extended model belong, and what it predicts of others."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from bag_cases import bag_of, states, write_bag
from rosbags.rosbag2 import StoragePlugin

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.recorded.lateness import Lateness, without_lateness
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.errors import ModelFileError
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.recorded import Recorded, on_one_clock
from bdnn_ros.models import load_model, load_to_serve, save_model
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import score_model
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.simulate import simulate

ARM2 = Robot.bundled("arm2")
PUSH = "external_wrench@arm2_joint2:torque=2,start=4,end=7"
DRIFT = "drift@arm2_joint1:of=offset,start_value=0.5,end_value=2,start=0,end=10"


@cache
def moved(*specs: str, seed: int = 2, duration: float = 10.0) -> Recording:
    """A motion of the two-axis arm."""
    hidden = [parse_spec(spec, ARM2) for spec in specs]
    return simulate(ARM2, hidden, seed=seed, duration=duration, rate=200.0).recording


def model_of(*specs: str, recordings: tuple[Recording, ...] = ()) -> ExtendedModel:
    """The arm with effects whose times are those of recordings."""
    effects = tuple(parse_spec(spec, ARM2) for spec in specs)
    known = on_one_clock(recordings) if recordings else ()
    return ExtendedModel(ARM2, effects, np.zeros(2), recorded=known)


def test_a_recording_is_known_again_however_it_is_stored_or_cut(tmp_path: Path) -> None:
    (known,) = on_one_clock([recording := moved()])
    assert known.holds(recording) and known.holds(recording.between(3.0, 5.0))
    assert Recorded.of(recording.between(3.0, 5.0), 3.0).holds(recording)
    for storage in StoragePlugin:
        bag = write_bag(tmp_path / storage.name, states(recording), storage)
        assert known.holds(bags.read(bag)) and known.holds(bags.read_every(bag).motion)
    first = recording.part(slice(100, None))  # another clock, the same stamps
    late = replace(first, time=first.time - first.time[0], epoch=recording.epoch + 500_000_000)
    assert known.holds(late) and known.since(late) == pytest.approx(0.5)


def test_no_other_recording_is_taken_for_it() -> None:
    """Simulations begin at one time, and two with one seed are of one motion."""
    (known,) = on_one_clock([moved()])
    assert not known.holds(moved(seed=3))
    assert not known.holds(moved(PUSH))
    assert not known.holds(replace(moved(), epoch=moved().epoch + 10**9))
    assert not known.holds(moved().part(slice(0, 3)))


def test_what_pushes_does_so_in_its_own_recording_at_its_time_there() -> None:
    first, second = moved(seed=1), moved(PUSH)
    begin = on_one_clock([first, second])[1].begin
    assert begin > 10.0
    model = model_of(
        f"external_wrench@arm2_joint2:torque=2,start={begin + 4},end={begin + 7}",
        recordings=(first, second),
    )
    there, said = model.along(second)
    assert not said
    assert there.effects[0].values == pytest.approx({"torque": 2.0, "start": 4.0, "end": 7.0})
    elsewhere, said = model.along(first)
    assert (elsewhere.effects, said) == ((), "")
    assert score_model(there, [prepare(second)]).nrmse_mean < 0.05
    assert score_model(model, [prepare(second)]).nrmse_mean > 0.2


def test_elsewhere_what_pushed_is_over_and_what_drifted_stays() -> None:
    model = model_of(PUSH, DRIFT, "coulomb_friction@arm2_joint1:coulomb=0.3", recordings=(moved(),))
    there, said = model.along(other := moved(seed=3))
    assert [(one.effect.name, one.values) for one in there.effects] == [
        ("effort_offset", {"offset": 2.0}),
        ("coulomb_friction", {"coulomb": 0.3}),
    ]
    assert said == (
        f"{other.name} is none of the recordings that the model was diagnosed from: what pushed arm2_joint2 there is "
        "over, and what drifted there at arm2_joint1 stays where it ended."
    )
    lasting = model_of("coulomb_friction@arm2_joint1:coulomb=0.3", recordings=(moved(),))
    assert lasting.along(other) == (lasting, "")


def test_files_say_it_and_those_of_before_take_times_as_they_are(tmp_path: Path) -> None:
    model, other = model_of(PUSH, recordings=(moved(),)), moved(seed=3)
    again = load_model(save_model(tmp_path / "model", model))
    assert isinstance(again, ExtendedModel)
    assert again.along(moved())[0].effects == model.effects
    assert again.along(other)[0].effects == ()
    arrays, info = model.to_state()
    del info["recorded"]
    before = ExtendedModel.from_state(arrays, info)
    assert before.along(other) == (before, "")
    info["recorded"] = [0.0]
    for damaged in (arrays["recorded.0.stamps"].astype(float), arrays["recorded.0.stamps"][1:]):
        with pytest.raises(ModelFileError, match="recorded"):
            ExtendedModel.from_state({**arrays, "recorded.0.stamps": damaged}, info)
    with pytest.raises(ModelFileError, match=r"lacks recorded\.1\.stamps"):
        ExtendedModel.from_state(arrays, {**info, "recorded": [0.0, 11.0]})


@pytest.mark.slow
def test_a_diagnosis_keeps_what_its_times_belong_to() -> None:
    first, second = moved(seed=1, duration=12.0), moved(PUSH, duration=12.0)
    model = extend(examine([first, second], ARM2))
    assert [one.holds(recording) for one in model.recorded for recording in (first, second)] == [
        True,
        False,
        False,
        True,
    ]
    (push,) = [one for one in model.along(second)[0].effects if one.effect.timed]
    assert (push.values["start"], push.values["end"]) == pytest.approx((4.0, 7.0), abs=0.1)
    assert not extend(examine([first], ARM2)).recorded


def test_another_bag_is_evaluated_and_predicted_without_the_push(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = str(save_model(tmp_path / "model", model_of(PUSH, recordings=(moved(PUSH),))))
    own, other = (
        str(bag_of(tmp_path / name, one)) for name, one in (("own", moved(PUSH)), ("other", moved()))
    )
    for bag, says in ((own, False), (other, True)):
        assert main(["evaluate", model, bag, "--json"]) == 0
        printed = capsys.readouterr()
        assert ("is none of the recordings" in printed.err) == says
        assert json.loads(printed.out)["held_out"]["nrmse_mean"] < 0.05
        assert main(["predict", model, bag, "--out", str(tmp_path / "effort.csv")]) == 0
        assert ("is none of the recordings" in capsys.readouterr().err) == says
        predicted, measured = np.genfromtxt(tmp_path / "effort.csv", delimiter=",", skip_header=1).T[3:5]
        assert np.std((predicted - measured)[50:-50]) < 0.1


def test_in_a_stream_what_its_recordings_had_is_over(tmp_path: Path) -> None:
    """The services say what drifted there as it was at the end, and nothing pushes at the stream's own times."""
    recording = moved(PUSH, DRIFT)
    save_model(tmp_path, model_of(PUSH, DRIFT, recordings=(recording,)))
    served = load_to_serve(tmp_path)
    assert isinstance(served, ExtendedModel)
    assert [one.effect.name for one in served.effects] == ["effort_offset"]
    still = np.zeros(2)
    there = load_model(tmp_path).inverse_dynamics(still, still, still)
    np.testing.assert_allclose(served.inverse_dynamics(still, still, still) - there, [-2.0, 0.0], atol=1e-12)


def test_a_model_of_efforts_that_had_passed_a_low_pass_knows_its_recording_as_it_was_read() -> None:
    """It was made of stamps that were evened."""
    recording = moved(PUSH)
    uneven = np.random.default_rng(0).uniform(-1.0, 1.0, len(recording)) * 2e-3
    read = replace(recording, time=recording.time + uneven)
    model = model_of(PUSH, recordings=tuple(without_lateness([read], Lateness(lag=0.03))[0]))
    there, left_out = model.along(read)
    assert len(there.effects) == 1 and not left_out
    assert model.along(moved(seed=3))[0].effects == ()
