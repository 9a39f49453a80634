"""Recordings: what is refused, what is repaired, and how they are cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.recording import Recording, cleaned, moving, position_noise, renamed

JOINTS = ("a", "b", "c")


def recording(samples: int = 100, rate: float = 100.0) -> Recording:
    """Numbers that tell their row and column."""
    time = np.arange(samples) / rate
    values = np.arange(samples)[:, None] + np.array([0.1, 0.2, 0.3])
    return Recording(time, JOINTS, values, 2.0 * values, 3.0 * values, name="bag")


def test_rate_and_duration() -> None:
    assert recording().rate == pytest.approx(100.0)
    assert recording().duration == pytest.approx(0.99)
    assert (len(recording()), recording().width) == (100, 3)
    assert recording(1).rate == 0.0
    assert recording(1).duration == 0.0


def test_rate_is_that_of_most_samples() -> None:
    original = recording()
    gapped = replace(original, time=original.time + np.where(np.arange(100) > 50, 7.0, 0.0))
    assert gapped.rate == pytest.approx(100.0)


@pytest.mark.parametrize("field", ["position", "velocity", "effort"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_must_be_finite(field: str, value: float) -> None:
    values = getattr(recording(), field).copy()
    values[7, 1] = value
    with pytest.raises(
        RecordingError, match=rf"bag: {field} of b is not finite at 0\.070 s \(1 of 100 samples\)"
    ):
        replace(recording(), **{field: values})


@pytest.mark.parametrize("share", [0.3, 0.5, 0.9])
def test_an_effort_that_some_messages_leave_empty_is_missing_and_may_be_left_out(share: float) -> None:
    whole = recording()
    effort = whole.require_effort().copy()
    effort[: int(100 * share)] = np.nan
    with pytest.raises(RecordingError, match=r"effort of a is missing at 0\.000 s .* or pass --drop-invalid"):
        replace(whole, effort=effort)
    kept, _ = cleaned(whole.time, whole.joints, whole.position, effort=effort, drop_invalid=True)
    assert len(kept) == 100 - int(100 * share)


@pytest.mark.parametrize("change", [-0.005, -0.01])
def test_stamps_must_increase(change: float) -> None:
    time = recording().time.copy()
    time[30] = time[29] + change + 0.005
    with pytest.raises(RecordingError, match="sample 30 of 100"):
        replace(recording(), time=time)


@pytest.mark.parametrize("field", ["position", "velocity", "effort"])
def test_shapes_must_agree(field: str) -> None:
    with pytest.raises(RecordingError, match=f"{field} has shape"):
        replace(recording(), **{field: np.zeros((100, 2))})


def test_effort_is_asked_for() -> None:
    np.testing.assert_array_equal(recording().require_effort(), recording().effort)
    with pytest.raises(RecordingError, match=r"carry no effort.*--effort command"):
        replace(recording(), effort=None).require_effort()


def test_select_reorders_every_column() -> None:
    chosen = recording().select(["c", "a"])
    assert chosen.joints == ("c", "a")
    for field in ("position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(chosen, field), getattr(recording(), field)[:, [2, 0]])
    assert replace(recording(), velocity=None).select(["a"]).velocity is None


def test_select_names_what_is_missing() -> None:
    with pytest.raises(UsageError, match="the recording lacks x, y; it has a, b, c"):
        recording().select(["a", "x", "y"])
    with pytest.raises(UsageError, match="named twice"):
        recording().select(["a", "a"])


@pytest.mark.parametrize(
    "rules, names",
    [
        (["a=b", "b=a"], ("b", "a", "c")),
        (["a=b", "b=c", "c=a"], ("b", "c", "a")),
        (["c=a", "a=c"], ("c", "b", "a")),
        (["a=b", "b=x"], ("b", "x", "c")),
        (["a=x", "x=b", "b=a"], ("b", "a", "c")),
        (["a=b", "b=a", "s/a/z/", "z=b", "b=z"], ("z", "b", "c")),
    ],
)
def test_rules_of_names_map_at_once(rules: list[str], names: tuple[str, ...]) -> None:
    """So that joints that are exchanged are told as anyone would write it."""
    assert renamed(JOINTS, rules) == names


@pytest.mark.parametrize("rules", [["a=b"], ["a=b", "b=c"], ["a=x", "b=x"], ["a=x", "a=y"]])
def test_rules_that_lose_a_joint_are_refused(rules: list[str]) -> None:
    with pytest.raises(UsageError, match=r"equal|matches none"):
        renamed(JOINTS, rules)


def test_a_slash_in_a_name_is_renamed_by_name_and_by_pattern() -> None:
    names = ("fr3/joint1", "fr3/joint2")
    assert renamed(names, [r"s/fr3\///"]) == ("joint1", "joint2")
    assert renamed(names, [r"s/^fr3\/(.*)/arm\/\1/"]) == ("arm/joint1", "arm/joint2")
    assert renamed(names, ["fr3/joint1=joint1"]) == ("joint1", "fr3/joint2")
    with pytest.raises(UsageError, match="is not a rule"):
        renamed(names, ["s/fr3/arm/g"])


def test_rename_by_name_and_by_pattern() -> None:
    names = ("fer_joint1", "fer_joint2", "grip")
    assert renamed(names, ["s/fer_/panda_/", "grip=hand"]) == ("panda_joint1", "panda_joint2", "hand")
    assert renamed(names, [r"s/^fer_joint(\d)$/j\1/"]) == ("j1", "j2", "grip")
    assert renamed(names, ["grip=x", "x=y"]) == ("fer_joint1", "fer_joint2", "y")
    assert renamed(names, []) == names
    assert recording().rename(["a=z"]).joints == ("z", "b", "c")


@pytest.mark.parametrize(
    "rule",
    [
        *("a", "=b", "a=", "a=b=c", "s/a/b", "s/a/b/c/", "nobody=b", "s/zz/y/", "a=b"),
        *("s/(/x/", r"s/a/\g<foo>/", r"s/a/\1/", "s/a{99999999999}/b/", f"s/{'(' * 5000}a{')' * 5000}/b/"),
    ],
    ids=range(14),
)
def test_rules_that_cannot_be_meant(rule: str) -> None:
    with pytest.raises(UsageError, match="--rename"):
        renamed(JOINTS, [rule])


def test_between_and_split_lose_nothing() -> None:
    inside = recording().between(0.2, 0.5)
    np.testing.assert_allclose(inside.time, np.arange(20, 50) / 100)
    first, last = recording().split(0.25)
    assert len(first) + len(last) == 100
    np.testing.assert_array_equal(np.concatenate([first.effort, last.effort]), recording().effort)
    assert last.duration == pytest.approx(0.25 * recording().duration, abs=0.01)
    for share in (0.0, 1.0, -0.1, float("nan")):
        with pytest.raises(UsageError, match="held-out share"):
            recording().split(share)


def test_pauses_are_no_time_recorded_and_held_out_is_a_share_of_that() -> None:
    time = np.where(np.arange(100) < 10, recording().time, recording().time + 100.0)
    paused = replace(recording(), time=time)
    assert paused.recorded == pytest.approx(0.98)
    assert recording().recorded == recording().duration
    assert recording(1).recorded == recording().part(slice(0, 0)).recorded == 0.0
    first, last = paused.split(0.25)
    assert (len(first), len(last)) == (75, 25)


def test_held_out_is_a_share_of_the_samples_that_count() -> None:
    rows = np.arange(100)
    for counted, kept in ((rows < 60, 45), (rows >= 40, 85), ((rows < 20) | (rows >= 60), 85), (True, 75)):
        first, last = recording(101).part(slice(100)).split(0.25, counted)
        assert len(first) == pytest.approx(kept, abs=1) and len(first) + len(last) == 100
    whole, again = (recording().split(0.3, every) for every in (True, np.ones(100, bool)))
    assert len(whole[0]) == len(again[0])


def test_segments_end_at_gaps() -> None:
    time = recording().time.copy()
    time[40:] += 0.2
    time[70:] += 0.03
    gapped = replace(recording(), time=time)
    assert gapped.segments() == [slice(0, 40), slice(40, 100)]
    assert recording().segments() == [slice(0, 100)]
    assert recording(1).segments() == [slice(0, 1)]


def test_slow_recordings_have_longer_gaps() -> None:
    time = np.arange(100) * 0.1
    time[50:] += 0.3
    slow = replace(recording(), time=time)
    assert slow.segments() == [slice(0, 100)]
    time[50:] += 0.2
    assert replace(recording(), time=time).segments() == [slice(0, 50), slice(50, 100)]


def test_a_part_is_cut_from_every_field() -> None:
    part = recording().part(slice(10, 20))
    for field in ("time", "position", "velocity", "effort"):
        np.testing.assert_array_equal(getattr(part, field), getattr(recording(), field)[10:20])


def test_cleaned_leaves_out_repeated_stamps_with_a_note() -> None:
    original = recording()
    twice = np.repeat(np.arange(100), 2)
    fields = [values[twice] for values in (original.position, original.velocity, original.effort)]
    again, _ = cleaned(original.time[twice], JOINTS, *fields, name="bag")
    np.testing.assert_array_equal(again.position, original.position)
    assert "100 of 200 samples repeat" in again.notes[0]


def test_cleaned_drops_invalid_samples_only_when_asked() -> None:
    original = recording()
    position = original.position.copy()
    position[5, 0] = np.nan
    time = original.time.copy()
    time[[20, 21]] = time[[21, 20]]
    with pytest.raises(RecordingError):
        cleaned(time, JOINTS, position)
    again, _ = cleaned(time, JOINTS, position, original.velocity, original.effort, drop_invalid=True)
    kept = np.delete(np.arange(100), [5, 21])
    np.testing.assert_array_equal(again.velocity, original.velocity[kept])
    assert "2 of 100 samples" in again.notes[0]


def test_of_two_samples_of_one_stamp_the_valid_one_stays() -> None:
    original, twice = recording(), np.repeat(np.arange(100), 2)
    effort = original.effort[twice].copy()
    effort[::2] = np.nan
    fields = (original.position[twice], original.velocity[twice], effort)
    again, _ = cleaned(original.time[twice], JOINTS, *fields, name="bag", drop_invalid=True)
    np.testing.assert_array_equal(again.effort, original.effort)
    np.testing.assert_array_equal(again.time, original.time)
    assert len(again.notes) == 1 and again.notes[0].startswith("bag: 100 of 200 samples are not finite")


@pytest.mark.parametrize("value", [np.nan, 1e300])
def test_a_joint_that_is_bad_throughout_is_to_be_left_out(value: float) -> None:
    original = recording()
    position = original.position.copy()
    position[:, 1], position[0, 0] = value, value
    with pytest.raises(RecordingError, match=r"position of b is .*leave b out: --joints a,c\.$"):
        cleaned(original.time, JOINTS, position)
    with pytest.raises(
        RecordingError, match=r"no sample of 100 is left: in most what b reported .*--joints a,c"
    ):
        cleaned(original.time, JOINTS, position, drop_invalid=True)
    with pytest.raises(RecordingError, match=r"no sample of 100 is left: what is reported .*Fix the driver"):
        cleaned(original.time, JOINTS, np.full_like(position, value), drop_invalid=True)


@pytest.mark.parametrize("field", ["position", "velocity", "effort"])
def test_cleaned_refuses_what_no_robot_can_have(field: str) -> None:
    original = recording()
    fields = {name: getattr(original, name).copy() for name in ("position", "velocity", "effort")}
    fields[field][30, 1] = -1e300
    with pytest.raises(
        RecordingError, match=rf"{field} of b is -1e\+300 at 0.\d+ s.* \(1 of 100.*--drop-invalid"
    ):
        cleaned(original.time, JOINTS, **fields)
    assert len(cleaned(original.time, JOINTS, **fields, drop_invalid=True)[0]) == 99
    fields[field][:] = 1e13
    with pytest.raises(RecordingError, match=r"100 of 100 samples\). Check its unit"):
        cleaned(original.time, JOINTS, **fields)


def test_cleaned_joins_the_parts_of_a_clock_that_was_set_back_with_a_pause() -> None:
    original = recording()
    time = np.where(np.arange(100) < 60, original.time, original.time - 0.3)
    fields = (original.position, original.velocity, original.effort)
    with pytest.raises(RecordingError, match=r"sample 60 of 100.*late samples out and to join the parts"):
        cleaned(time, JOINTS, *fields)
    again, _ = cleaned(time, JOINTS, *fields, name="bag", drop_invalid=True)
    np.testing.assert_array_equal(again.effort, original.effort)
    assert again.segments() == [slice(0, 60), slice(60, 100)]
    assert again.notes == ("bag: the clock jumps back once; the parts are joined with a pause between them.",)


def test_cleaned_takes_nan_throughout_as_not_measured() -> None:
    original = recording()
    nothing = np.full((100, 3), np.nan)
    again, _ = cleaned(original.time, JOINTS, original.position, nothing, original.effort)
    assert again.velocity is None
    assert again.effort is not None


def test_noise_of_the_position_is_told_from_its_motion() -> None:
    rng = np.random.default_rng(3)
    time = np.arange(5000) / 500.0
    motion = np.sin(np.outer(time, [1.0, 3.0, 6.0]))
    noisy = Recording(time, JOINTS, motion + rng.normal(0.0, 1e-4, motion.shape))
    np.testing.assert_allclose(position_noise(noisy), 1e-4, rtol=0.1)
    np.testing.assert_array_equal(position_noise(noisy.part(slice(0, 5))), 0.0)


def test_a_joint_that_only_trembles_does_not_move() -> None:
    rng = np.random.default_rng(4)
    time = np.arange(20000) / 500.0
    position = np.stack([np.full(20000, 0.3), rng.normal(0.0, 1e-3, 20000), 0.02 * np.sin(time)], axis=1)
    assert moving(Recording(time, JOINTS, position)).tolist() == [False, False, True]
    assert not moving(Recording(time[:0], JOINTS, position[:0])).any()
