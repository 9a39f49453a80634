"""What becomes a sample, and what is counted instead."""

from __future__ import annotations

import array

import numpy as np
import pytest

from bdnn_ros.online.stream.assembly import BARE_LIMIT
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.clock import PAUSE, Clock
from bdnn_ros.online.stream.gaps import BLOCK
from bdnn_ros.online.stream.intake import CommandIntake, Intake
from bdnn_ros.online.stream.silent import PATIENCE

MS = 1_000_000
START = 1_700_000_000_000_000_000


@pytest.fixture
def intake():
    ring = Ring.create(4096, 6)
    yield Intake(("a", "b"), ring)
    ring.close()


def send(
    intake: Intake, k: int, names=("a", "b"), position=(1.0, 2.0), velocity=(), effort=(3.0, 4.0)
) -> bool:
    return intake.take(list(names), position, velocity, effort, START + k * MS, START + k * MS + 5)


def test_a_message_becomes_a_sample(intake):
    fields = [array.array("d", values) for values in ((1.0, 2.0), (0.1, 0.2), (3.0, 4.0))]
    assert intake.take(["a", "b"], *fields, START, START + 7)
    chunk = intake.ring.read(0)
    assert chunk.values.tolist() == [[1.0, 2.0, 0.1, 0.2, 3.0, 4.0]]
    assert chunk.stamp.tolist() == [START] and chunk.sent.tolist() == [START + 7]


def test_joints_may_come_in_any_order_with_others_between_and_change_it(intake):
    send(intake, 0, ("b", "gripper", "a"), (2.0, 9.0, 1.0), (), (4.0, 9.0, 3.0))
    send(intake, 1, ("a", "b"), (1.0, 2.0), (), (3.0, 4.0))
    send(intake, 2, ("b", "a"), (2.0, 1.0), (), (4.0, 3.0))
    values = intake.ring.read(0).values
    assert values[:, [0, 1, 4, 5]].tolist() == [[1.0, 2.0, 3.0, 4.0]] * 3
    assert intake.ring.written == 3 and not intake.rejected


def test_missing_joints_are_named_and_others_are_ignored(intake):
    assert not send(intake, 0, ("a", "c"))
    assert not send(intake, 1, ("gripper",), (1.0,), (), (1.0,))
    assert send(intake, 2)
    assert intake.rejected == {"joints_missing": 1}
    assert intake.received == 2  # what has none of our joints is another publisher's


def test_missing_velocity_and_effort_are_kept_as_missing(intake):
    nan = float("nan")
    assert send(intake, 0, velocity=(), effort=())
    assert send(intake, 1, velocity=(nan, nan), effort=(nan, nan))
    assert np.isnan(intake.ring.read(0).values[:, 2:]).all()
    assert intake.rejected == {"effort_missing": 2}


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"position": (1.0, float("nan"))}, "not_finite"),
        ({"position": (1.0, float("inf"))}, "not_finite"),
        ({"position": (float("inf"), float("-inf"))}, "not_finite"),
        ({"velocity": (float("inf"), 1.0)}, "not_finite"),
        ({"effort": (1.0, float("nan"))}, "not_finite"),
        ({"effort": (1.0, float("-inf"))}, "not_finite"),
        ({"position": (1.0, 1e13)}, "out_of_range"),
        ({"position": (-1e308, 1.0)}, "out_of_range"),
        ({"velocity": (1e13, 1.0)}, "out_of_range"),
        ({"effort": (1.0, -1e200)}, "out_of_range"),
        ({"velocity": (float("nan"), float("nan")), "effort": (1e13, 1.0)}, "out_of_range"),
        ({"position": (1e13, float("nan"))}, "not_finite"),
        ({"position": (1.0,)}, "wrong_length"),
        ({"position": ()}, "wrong_length"),
        ({"effort": (1.0, 2.0, 3.0)}, "wrong_length"),
    ],
)
def test_what_cannot_be_used_is_counted_by_reason(intake, fields, reason):
    assert send(intake, 0)
    assert not send(intake, 1, **fields)
    assert send(intake, 2)
    assert intake.rejected == {reason: 1} and intake.ring.written == 2


@pytest.mark.parametrize(
    ("fields", "culprit"),
    [
        ({"effort": (1.0, float("nan"))}, "effort of b"),
        ({"velocity": (float("nan"), float("nan")), "effort": (float("inf"), 1.0)}, "effort of a"),
        ({"names": ("b", "other", "a"), "position": (1.0, 0.0, 1e13), "effort": ()}, "position of a"),
    ],
)
def test_whose_number_cannot_be_used_is_known(intake, fields, culprit):
    assert not send(intake, 0, **fields)
    assert intake.culprit == culprit


def test_a_velocity_that_one_joint_lacks_is_not_measured_there(intake):
    assert send(intake, 0, velocity=(0.1, float("nan")))
    assert np.isnan(intake.ring.read(0).values[0]).tolist() == [False] * 3 + [True] + [False] * 2


def test_a_joint_without_a_sensor_for_its_effort_spoils_nothing(intake):
    """ros2_control's broadcaster says NaN for what a joint has no interface for."""
    lacks = {"effort": (3.0, float("nan"))}
    step, count = 100, PATIENCE // (100 * MS)
    for k in range(count):
        assert not send(intake, step * k, **lacks)  # its driver may only start late
    for k in range(count, 2 * count):
        assert send(intake, step * k, **lacks)
    assert intake.rejected == {"not_finite": count} and intake.silent.joints.tolist() == [False, True]
    efforts = intake.ring.read(0).values[:, 4:]
    assert (efforts[:, 0] == 3.0).all() and np.isnan(efforts[:, 1]).all() and len(efforts) == count
    assert not send(intake, 2 * step * count, effort=(float("inf"), float("nan")))
    assert intake.culprit == "effort of a"
    assert send(intake, 2 * step * count + 1) and not intake.silent.joints.any()
    assert not send(intake, 2 * step * count + 2, **lacks)


def test_a_joint_whose_effort_never_changes_has_no_sensor(intake):
    """Drivers fill in zero, too. A robot at rest tells nothing of that, and a sensor may start late."""
    count = 2 * PATIENCE // (100 * MS)
    for k in range(count):
        send(intake, 100 * k, effort=(3.0, 0.0))
    assert not intake.silent.still.any()
    for k in range(count, 2 * count):
        send(intake, 100 * k, position=(0.1 * k, 2.0), effort=(3.0 + k, 0.0))
        assert not intake.silent.still.any() or k > 1.5 * count - 2
    assert intake.silent.still.tolist() == [False, True] and not intake.silent.joints.any()
    assert intake.ring.written == 2 * count and not intake.rejected
    send(intake, 200 * count, effort=(3.0, 0.1))
    assert not intake.silent.still.any()


def test_a_pause_is_no_time_in_which_an_effort_was_lacking(intake):
    for k in range(20):
        assert not send(intake, 2 * k * PAUSE // MS, effort=(3.0, float("nan")))
    assert not intake.silent.joints.any()


def test_of_two_controllers_one_may_have_a_joint_without_a_sensor():
    intake, count = Intake(("a", "b", "c"), Ring.create(512, 9)), PATIENCE // (100 * MS)
    for k in range(2 * count):
        send(intake, 100 * k, ("a",), (1.0,), (), (3.0,))
        send(intake, 100 * k, ("b", "c"), (2.0, 0.0), (), (float("nan"), 1.0))
    efforts = intake.ring.read(0).values[:, 6:]
    assert (
        len(efforts) >= count and (efforts[:, [0, 2]] == [3.0, 1.0]).all() and np.isnan(efforts[:, 1]).all()
    )
    send(intake, 200 * count, ("a",), (1.0,), (), ())
    send(intake, 200 * count, ("b", "c"), (2.0, 0.0), (), (float("nan"), 1.0))
    assert np.isnan(
        intake.ring.latest(1).values[0, 6:]
    ).all()  # what one does not measure, the robot does not
    intake.ring.close()


def test_where_commands_are_the_effort_no_measured_one_is_missed():
    intake = Intake(("a", "b"), Ring.create(16, 6), needs_effort=False)
    assert send(intake, 0, effort=(3.0, float("nan"))) and not intake.rejected
    intake.ring.close()


def test_large_but_finite_numbers_are_taken(intake):
    assert send(intake, 0, position=(1e12, -1e12), velocity=(1e12, 1e12), effort=(1e12, 1e12))


def test_without_a_stamp_the_time_of_sending_stands(intake):
    assert intake.take(["a", "b"], (1.0, 2.0), (), (3.0, 4.0), 0, START)
    assert intake.ring.read(0).stamp.tolist() == [START]
    assert intake.unstamped == 1


@pytest.mark.parametrize("behind", [50 * MS, 600 * MS, 5000 * MS])
def test_a_message_without_a_stamp_among_stamped_ones_is_left_out(intake, behind):
    """The sender's clock is behind the middleware's: the time of sending would be none of the stream."""
    for k in range(600):
        stamp = 0 if k in (200, 400, 401) else START + k * MS
        intake.take(["a", "b"], (1.0, 2.0), (), (3.0, 4.0), stamp, START + k * MS + behind)
    assert intake.rejected == {"stamp_missing": 3} and intake.ring.written == 597
    assert intake.clock.lost == intake.clock.pauses == intake.clock.restarts == intake.unstamped == 0


def test_a_driver_that_stamps_no_longer_goes_on(intake):
    for k in range(200):
        stamp = 0 if k >= 100 else START + k * MS
        intake.take(["a", "b"], (1.0, 2.0), (), (3.0, 4.0), stamp, START + k * MS)
    assert intake.rejected == {"stamp_missing": BARE_LIMIT - 1} and intake.unstamped == 101 - BARE_LIMIT
    assert intake.ring.read(0).stamp[-1] == START + 199 * MS


def test_of_two_drivers_one_may_give_no_stamps(intake):
    for k in range(200):
        part(intake, "a", k * MS)
        intake.take(["b"], (1.0,), (), (3.0,), 0, START + k * MS)
    assert intake.ring.written == 200 and not intake.rejected


@pytest.mark.parametrize("first", [0, 10 * MS])
def test_a_simulation_that_begins_at_zero_is_one_stretch(intake, first):
    """The first sample had the wall clock's time, and the second counted as a clock that was set back."""
    for k in range(30):
        stamp = first + 10 * k * MS
        assert intake.take(["a", "b"], (1.0, 2.0), (), (3.0, 4.0), stamp, START + stamp)
    chunk = intake.ring.read(0)
    assert chunk.stamp.tolist() == [first + 10 * k * MS for k in range(30)]
    assert np.diff(chunk.time).tolist() == [10 * MS] * 29
    assert intake.unstamped == intake.clock.restarts == intake.clock.pauses == 0 and not intake.rejected


def test_stamps_that_come_late_in_a_stream_make_no_simulation_of_it(intake):
    """Messages without a stamp, then some with one."""
    for k in range(10):
        intake.take(["a", "b"], (1.0, 2.0), (), (3.0, 4.0), 0, START + k * MS)
    for k in range(10, 20):
        intake.take(["a", "b"], (1.0, 2.0), (), (3.0, 4.0), START + k * MS, START + k * MS)
    assert intake.unstamped == 10 and intake.ring.read(0).stamp.tolist() == [
        START + k * MS for k in range(20)
    ]


def test_a_simulation_that_begins_again_at_zero_goes_on(intake):
    for run in range(50):
        for k in range(20):
            stamp = k * 100 * MS
            intake.take(["a", "b"], (1.0, 2.0), (), (3.0, 4.0), stamp, START + 3 * run * PAUSE + stamp)
    times = intake.ring.read(0).time
    assert len(times) >= 50 * 19 and (np.diff(times) > 0).all()
    assert intake.unstamped == 0 and intake.clock.restarts == 49
    assert times[-1] - times[0] < 50 * 5 * PAUSE


@pytest.mark.parametrize("pattern", ["ab", "aabb", "abbb"])
def test_two_clocks_by_turns_do_not_carry_stream_time_away(intake, pattern):
    clocks = {"a": START, "b": 50 * PAUSE}
    for k in range(20_000):
        stamp = clocks[pattern[k % len(pattern)]] + k * MS
        intake.take(["a", "b"], (1.0, 2.0), (), (3.0, 4.0), stamp, START + k * MS)
    times = intake.ring.read(0).time
    assert len(times) > 1000 and (np.diff(times) > 0).all()
    assert intake.clock._time < START + 20_000 * 2 * PAUSE + 3600 * PAUSE


@pytest.mark.parametrize("effort", [(), (float("nan"),)])
@pytest.mark.parametrize("late", [0, 20])
def test_of_two_controllers_one_may_have_no_sensor_at_all(intake, effort, late):
    count = PATIENCE // (100 * MS)

    def both(k: int, last: tuple[float, ...] = effort) -> np.ndarray:
        send(intake, 100 * k, ("a",), (1.0,), (), (3.0,))
        assert send(intake, 100 * k + late, ("b",), (2.0,), (), last) or k == 0
        return np.isfinite(intake.ring.latest(1).values[0, 4:])

    send(intake, 0, effort=())
    told = np.array([both(k) for k in range(2 * count)])
    assert not told[: count - 1].any() and told[count + 1 :, 0].all() and not told[:, 1].any()
    assert intake.silent.joints.tolist() == [False, True]
    assert both(2 * count, (4.0,)).all() and not intake.silent.joints.any()
    assert not both(2 * count + 1).any()


def part(intake: Intake, joint: str, stamp: int, value: float = 1.0, effort: float = 3.0) -> bool:
    """A message of one joint, stamped [ns] after the start."""
    return intake.take([joint], (value,), (), (effort,), START + stamp, START + stamp + 5)


def test_parts_with_one_stamp_are_one_sample(intake):
    for k in range(5):
        assert not part(intake, "b", k * MS, 10.0 + k, 4.0)
        assert part(intake, "a", k * MS, 1.0 + k, 3.0)
    chunk = intake.ring.read(0)
    assert chunk.values[:, [0, 1, 4, 5]].tolist() == [[1.0 + k, 10.0 + k, 3.0, 4.0] for k in range(5)]
    assert chunk.stamp.tolist() == [START + k * MS for k in range(5)]
    assert intake.received == 5 and not intake.rejected


@pytest.mark.parametrize("late", [MS // 10, 4 * MS // 10, 6 * MS // 10, 9 * MS // 10])
def test_parts_go_with_the_nearest(intake, late):
    """Two controllers at one rate; where one is late by more than half a period, it is early for the next."""
    for k in range(100):
        part(intake, "a", k * MS, float(k))
        part(intake, "b", k * MS + late, float(k))
    values = intake.ring.read(0).values
    assert len(values) >= 98 and intake.rejected["joints_missing"] <= 3
    assert set(values[3:, 0] - values[3:, 1]) == {0.0 if late < MS // 2 else 1.0}


def test_what_is_published_more_often_waits_for_the_rest(intake):
    for k in range(1000):
        part(intake, "a", k * MS)
        if k % 4 == 3:
            part(intake, "b", k * MS)
    assert intake.ring.written == 250 and intake.rejected == {"joints_missing": 750}
    assert set(np.diff(intake.ring.read(0).stamp)) == {4 * MS}


def test_a_part_does_not_wait_across_a_pause(intake):
    for k in range(20):
        part(intake, "a", k * MS)
        part(intake, "b", k * MS)
    part(intake, "a", 20 * MS)
    assert not part(intake, "b", 5020 * MS)
    assert not part(intake, "a", 5024 * MS)  # four periods, however long the pause was
    assert part(intake, "b", 5024 * MS)
    assert intake.rejected == {"joints_missing": 2} and intake.received == 23


def test_a_bad_part_spoils_nothing_and_what_one_does_not_measure_is_missing(intake):
    part(intake, "a", 0, 1.0)
    assert not part(intake, "a", 0, float("nan"))
    assert part(intake, "b", 0)
    assert intake.ring.read(0).values[0, :2].tolist() == [1.0, 1.0]
    part(intake, "a", MS, effort=float("nan"))
    assert part(intake, "b", MS)
    assert np.isnan(intake.ring.read(1).values[0, 2:]).all()
    assert intake.rejected == {"not_finite": 1, "effort_missing": 1}


def test_a_part_never_outlives_a_whole_message(intake):
    part(intake, "a", 0)
    assert send(intake, 1)
    assert not part(intake, "b", MS)
    assert intake.rejected == {"joints_missing": 1} and intake.ring.written == 1


def test_names_without_end_are_forgotten(intake):
    for k in range(1000):
        assert not send(intake, k, ("a", f"joint{k}"))
    assert len(intake.kinds.groups) <= 64
    assert send(intake, 1000)


def advance(clock: Clock, stamps) -> list[int]:
    return [clock.advance(int(stamp)) for stamp in stamps]


def test_an_even_stream_loses_nothing():
    clock = Clock()
    stamps = START + MS * np.arange(10 * BLOCK)
    assert advance(clock, stamps) == stamps.tolist()
    assert clock.lost == 0 and clock.period == MS


def test_gaps_are_counted():
    clock = Clock()
    kept = np.delete(np.arange(10 * BLOCK), [100, 200, 201, 202])
    advance(clock, START + MS * kept)
    advance(clock, START + MS * (10 * BLOCK + np.arange(BLOCK)))
    assert clock.lost == 4


def test_jitter_and_catching_up_are_no_loss():
    clock = Clock()
    generator = np.random.default_rng(0)
    stamps = START + MS * np.arange(20 * BLOCK) + generator.integers(-MS // 5, MS // 5, 20 * BLOCK)
    stamps[300:305] += (np.arange(5, 0, -1) * 0.9 * MS).astype(
        int
    )  # late by up to 4.5 ms, then on time again
    for stamp in stamps.tolist():  # one of those that are late comes after the next
        if clock.advance(stamp) < 0:
            clock.refuse(stamp)
    assert clock.lost == 0


@pytest.mark.parametrize(("scatter", "wrong"), [(0.1, 2), (0.2, 12)])
def test_stamps_that_scatter_are_no_loss(scatter, wrong):
    """Of what never came, each is counted but for a few; what came was counted by the hundred."""
    for seed in range(2):
        generator = np.random.default_rng(seed)
        off = np.clip(scatter * generator.standard_normal(4500), -0.45, 0.45)
        stamps = START + (MS * (np.arange(4500) + off)).astype(np.int64)
        whole, holed = Clock(), Clock()
        advance(whole, stamps)
        advance(holed, np.delete(stamps, np.arange(100, 4400, 100)))
        assert whole.lost <= wrong and abs(holed.lost - 43) <= wrong


def test_another_rate_is_no_loss():
    clock = Clock()
    advance(clock, START + MS * np.arange(4 * BLOCK + 1))
    advance(clock, START + MS * (4 * BLOCK + 10 * np.arange(1, 4 * BLOCK + 1)))
    assert clock.lost == 0 and clock.period == 10 * MS


def test_a_pause_is_no_loss():
    clock = Clock()
    advance(clock, START + MS * np.arange(500))
    advance(clock, START + 7 * PAUSE + MS * np.arange(500))
    assert clock.lost == 0 and clock.pauses == 1


def test_a_pause_moves_stream_time_by_an_hour_at_most():
    clock = Clock()
    before, after = clock.advance(START), clock.advance(START + 86400 * PAUSE)
    assert after - before == 3600 * PAUSE and clock.pauses == 1


@pytest.mark.parametrize("block", [0, 3])
def test_what_is_missing_is_told_before_a_block_is_full(block):
    clock = Clock()
    advance(clock, START + MS * np.delete(np.arange(block * BLOCK + 40), [block * BLOCK + 30]))
    assert clock.lost == 1
    clock.advance(START + MS * (block * BLOCK + 42))  # two late, or lost: the next ones will tell
    assert clock.lost == 1
    clock.advance(START + MS * (block * BLOCK + 43))
    assert clock.lost == 3


@pytest.mark.parametrize("row", [20, BLOCK, 3 * BLOCK, 3 * BLOCK + 7])
def test_what_comes_too_late_is_refused_but_not_lost(row):
    """At every place of a block, its end and the next one's beginning too."""
    clock = Clock()
    order = np.arange(5 * BLOCK)
    order[[row, row + 1]] = row + 1, row
    for k in order.tolist():
        if clock.advance(START + k * MS) < 0:
            clock.refuse(START + k * MS)
    assert clock.lost == 0


@pytest.mark.parametrize(
    "fields",
    [
        {"position": (1.0, float("nan"))},
        {"effort": (1.0, 2.0, 3.0)},
        {"names": ("a", "c")},
        {"names": ("a", "a")},
        {"names": ()},
    ],
    ids=["not finite", "too long", "a joint missing", "a name twice", "no names"],
)
@pytest.mark.parametrize("count", [1, 30])
def test_what_was_refused_is_not_lost(intake, fields, count):
    for k in range(4 * BLOCK):
        if k == 150:
            continue
        send(intake, k, **(fields if 100 <= k < 100 + count else {}))
    assert sum(intake.rejected.values()) == count
    assert intake.received == 4 * BLOCK - 1 and intake.clock.lost == 1


def test_a_stamp_of_another_time_is_refused_in_its_place(intake):
    for k in range(4 * BLOCK):
        send(intake, k - 25 if k in (100, 101) else k)
    assert intake.rejected == {"stamp_backwards": 2} and intake.clock.lost == 0


def test_of_two_parts_the_one_that_never_came_is_lost(intake):
    for k in range(4 * BLOCK):
        part(intake, "a", k * MS)
        if k not in (100, 110, 111):
            part(intake, "b", k * MS)
    assert intake.rejected == {"joints_missing": 3} and intake.clock.lost == 3


def test_a_stamp_that_repeats_or_goes_back_a_little_is_refused():
    clock = Clock()
    advance(clock, [START, START + MS])
    assert clock.advance(START + MS) == -1
    assert clock.advance(START) == -1
    assert clock.advance(START + 2 * MS) == START + 2 * MS


def test_a_clock_that_stands_still_is_not_set_back():
    """As of a simulation that is paused while its driver goes on: every twentieth message became a sample 2 s later."""
    clock = Clock()
    before = advance(clock, START + MS * np.arange(100))
    assert advance(clock, [START + 99 * MS] * 500) == [-1] * 500
    assert clock.advance(START + 100 * MS) - before[-1] == MS and clock.restarts == 0


def test_messages_that_all_come_twice_are_taken_once():
    clock = Clock()
    times = advance(clock, START + MS * np.repeat(np.arange(200), 2))
    assert times[::2] == (START + MS * np.arange(200)).tolist() and times[1::2] == [-1] * 200


def test_a_clock_that_jumps_back_goes_on_in_a_new_stretch():
    clock = Clock()
    before = advance(clock, START + MS * np.arange(100))
    after = advance(clock, START - 3600 * PAUSE + MS * np.arange(100))
    assert clock.restarts == 1
    assert after[0] == -1, "it may be one message that was held up; the second tells"
    assert after[1] - before[-1] > PAUSE
    assert np.diff(after[1:]).tolist() == [MS] * 98


@pytest.mark.parametrize("late", [1500, 20_000])
def test_one_message_that_is_late_by_seconds_is_left_out(intake, late):
    """As in a recording: so many in a row are a clock that starts anew, one is not."""
    order = np.arange(40_000, 40_400)
    order[[200, 300]] -= late
    for k in order.tolist():
        send(intake, k)
    assert intake.rejected == {"stamp_backwards": 2} and intake.ring.written == 398
    assert intake.clock.restarts == intake.clock.pauses == 0


def test_stamps_that_are_stuck_in_the_past_are_no_clock():
    clock = Clock()
    advance(clock, START + MS * np.arange(100))
    assert advance(clock, [START - PAUSE] * 10) == [-1] * 10 and clock.restarts == 0


def test_a_clock_that_stays_back_by_little_is_taken_up():
    clock = Clock()
    advance(clock, START + MS * np.arange(1000))
    times = advance(clock, START + 500 * MS + MS * np.arange(100))
    assert clock.restarts == 1
    assert times.count(-1) < 25
    taken = [time for time in times if time > 0]
    assert (np.diff(taken) > 0).all()


def test_one_stamp_far_ahead_does_not_end_the_stream():
    clock = Clock()
    stamps = START + MS * np.arange(300)
    stamps[150] += 86400 * PAUSE
    times = advance(clock, stamps)
    assert times.count(-1) == 1
    assert (np.diff([time for time in times if time > 0]) > 0).all()


def test_commands_are_checked_alike():
    ring = Ring.create(64, 2)
    intake = CommandIntake(("a", "b"), ring)
    assert intake.take(array.array("d", (1.0, 2.0)), START)
    for values, sent, complaint in (
        ((1.0,), START + MS, "has 1 numbers, not 2. Send 2, in the order of the parameter joints: a, b."),
        ((), START + MS, "has 0 numbers"),
        ((1.0, float("nan")), START + MS, "command of b is not finite. Send a finite number"),
        ((float("-inf"), 1.0), START + MS, "command of a is not finite"),
        ((1.0, -1e200), START + MS, "command of b is out of range. Send efforts up to 1e+12"),
        ((1.0, 2.0), START, "was sent before the last one. Let one controller"),
    ):
        assert not intake.take(values, sent) and complaint in intake.complaint
    assert intake.received == 7
    assert intake.rejected == {"wrong_length": 2, "not_finite": 2, "out_of_range": 1, "stamp_backwards": 1}
    assert ring.read(0).values.tolist() == [[1.0, 2.0]]
    ring.close()
