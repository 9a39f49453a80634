"""Which joints are used where messages hold different ones, and what is said of the others."""

from __future__ import annotations

import pytest

from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.intake import Intake
from bdnn_ros.online.stream.watch import Coming, Watch, wider

MS = 1_000_000
START = 1_700_000_000_000_000_000
ARM = ("a", "b", "c", "d")


def coming(joints: str, period: float, measured: bool = True) -> Coming:
    return Coming(frozenset(joints), period * MS, measured)


@pytest.mark.parametrize(
    ("groups", "used", "chosen"),
    [
        ([coming("g", 10), coming("abcd", 2)], "g", "abcd"),  # a gripper that came first
        ([coming("g", 1), coming("abcd", 10)], "g", "abcd"),
        ([coming("abcd", 2), coming("g", 10)], "abcd", ""),  # would slow down the arm
        ([coming("abcd", 2), coming("g", 2, measured=False)], "abcd", ""),
        ([coming("abcd", 2), coming("g", 2)], "abcd", "abcdg"),
        ([coming("ab", 2.001), coming("cd", 1.999)], "ab", "abcd"),  # two controllers
        ([coming("ab", 2), coming("cd", 4)], "ab", "abcd"),
        ([coming("ab", 2, measured=False), coming("cd", 2, measured=False)], "cd", "abcd"),
        ([coming("abc", 2), coming("bcd", 2)], "abc", "abcd"),
        ([coming("abcd", 2), coming("abcdg", 100)], "abcd", ""),  # somebody repeats all, slowly
        ([coming("abcd", 2)], "g", "abcd"),
        ([coming("g", 2)], "abcd", ""),  # never fewer
        ([coming("gh", 2)], "ab", ""),  # nor as many others
    ],
)
def test_the_most_joints_that_come_together_are_used(groups, used, chosen):
    assert wider(groups, tuple(used), needs_effort=True) == frozenset(chosen)
    if chosen:
        assert not wider(groups, tuple(chosen), needs_effort=True)


def test_a_joint_without_a_sensor_keeps_nobody_from_the_efforts_of_the_others():
    """An arm, of which one joint says NaN, joins a gripper that came first."""
    intake, watch = Intake(("g",), Ring.create(4096, 3)), Watch()
    for k in range(20):
        stamp = START + 2 * k * MS
        intake.take(["g"], [1.0], (), [1.0], stamp, stamp)
        intake.take(list(ARM), [1.0] * 4, (), [1.0, 1.0, 1.0, float("nan")], stamp, stamp)
    assert watch.look(intake, (*ARM, "g")) == (*ARM, "g")
    intake.ring.close()


class Stream:
    """An intake of some joints, its watch, and the time."""

    def __init__(self, used: tuple[str, ...]) -> None:
        self.intake = Intake(used, Ring.create(4096, 3 * len(used)))
        self.watch = Watch()
        self.now = START

    def send(self, joints: str, delay: int = 0) -> None:
        values = [1.0] * len(joints)
        self.intake.take(list(joints), values, (), values, self.now + delay, self.now + delay)

    def look(self) -> tuple[tuple[str, ...], str]:
        return self.watch.look(self.intake, (*ARM, "g", "h")), self.watch.complaint


@pytest.fixture
def stream(request):
    made = Stream(tuple(request.param))
    yield made
    made.intake.ring.close()


@pytest.mark.parametrize("stream", ["ab"], indirect=True)
def test_other_joints_that_come_instead_of_those_in_use_are_named(stream):
    """A driver that came back with a prefix was silent, and nobody said why."""

    def came(*messages: list[str]) -> str:
        for k, names in enumerate(10 * messages):
            stamp = stream.now + 2 * k * MS
            stream.intake.take(names, [1.0] * len(names), (), (), stamp, stamp)
        stream.now += 100 * MS
        stream.look()
        return stream.watch.strange

    prefixed = ["arm_a", "arm_b"]
    assert came(["a", "b"], prefixed) == came() == ""
    assert came(prefixed).startswith("joint_states has arm_a, arm_b; in use are a, b. Let the driver")
    assert came(["g"]).startswith("joint_states has g; in use are a, b.")
    assert came(["b", "a"]) == came([]) == ""


@pytest.mark.parametrize("stream", ["ab"], indirect=True)
def test_two_halves_are_put_together_in_the_robots_order(stream):
    assert stream.look() == ((), "")
    for _ in range(20):
        stream.now += 2 * MS
        stream.send("dc")
        stream.send("ba")
    assert stream.look() == (ARM, "")


@pytest.mark.parametrize("stream", ["abcd"], indirect=True)
def test_one_message_changes_nothing(stream):
    for _ in range(20):
        stream.now += 2 * MS
        stream.send("abcd")
    stream.send("abcdgh")
    assert stream.look() == ((), "")


@pytest.mark.parametrize("stream", ["abcd"], indirect=True)
def test_what_is_left_out_is_named(stream):
    for k in range(100):
        stream.now += 2 * MS
        stream.send("abcd")
        if k % 5 == 0:
            stream.send("gx")
    joints, complaint = stream.look()
    assert joints == () and "messages hold g, " in complaint and "set the parameter joints" in complaint
    for _ in range(100):
        stream.now += 2 * MS
        stream.send("abcd")
    assert stream.look() == ((), "")


@pytest.mark.parametrize("stream", ["abcd"], indirect=True)
def test_joints_that_never_come_are_named_after_a_while(stream):
    """And one that comes seldom; where they are none of those that may be used, there is nothing to tell."""

    def second() -> None:
        for k in range(100):
            stream.now += 2 * MS
            stream.send("abcd")
            if k == 50:
                stream.send("h")
        stream.look()

    for _ in range(2):
        second()
        assert stream.watch.absent == ""
    second()
    assert stream.watch.complaint == ""
    told = stream.watch.absent
    assert told.startswith("No message holds g of the robot description: left out. h came only now and then")
    assert "stand still at zero, or at the nearest limit. Publish it with the rest" in told
    assert "set the parameter joints to [a, b, c, d]" in told
    for _ in range(6):
        stream.now += 2 * MS
        stream.send("abcd")
    assert stream.watch.look(stream.intake, ARM) == () and stream.watch.absent == ""


@pytest.mark.parametrize("stream", ["abcd"], indirect=True)
def test_what_does_not_come_any_more_is_named(stream):
    for _ in range(100):
        stream.now += 2 * MS
        stream.send("ab")
        stream.send("cd")
    assert stream.look() == ((), "")
    for _ in range(100):
        stream.now += 2 * MS
        stream.send("ab")
    assert stream.look()[1].startswith("No message holds c, d.")
    assert stream.intake.rejected["joints_missing"] == 99


@pytest.mark.parametrize("stream", ["abcd"], indirect=True)
def test_stamps_that_never_fit_are_told(stream):
    for _ in range(100):
        stream.now += 2 * MS
        stream.send("ab")
        stream.send("cd", delay=700 * MS)  # another clock
    assert "hold c, d, with stamps that do not fit" in stream.look()[1]
    assert stream.intake.ring.written == 0 and stream.intake.rejected["joints_missing"] > 190
