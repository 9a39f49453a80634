"""Two publishers of the same joints: the messages of one become samples, live and from a bag."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from bag_cases import JOINT_STATE, joint_state, write_bag

from bdnn_ros import bags
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.intake import SECOND, Intake
from bdnn_ros.online.stream.watch import Watch

MS = 1_000_000
START = 1_700_000_000_000_000_000
PERIOD = 2 * MS
JOINTS = ("a", "b")


class Said(NamedTuple):
    """A joint state; the stamp counts from the start [ns]."""

    stamp: int
    names: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


def driver(begin: int = 0, end: int = 1000, fills: str = "velocity effort", every: int = 1) -> list[Said]:
    """Joint states that move, each so many periods."""
    told = []
    for k in range(begin, end, every):
        position = (1.0 + math.sin(0.01 * k), 2.0)
        fields = [(0.1, 0.2) if name in fills else () for name in ("velocity", "effort")]
        told.append(Said(k * PERIOD, JOINTS, position, *fields))
    return told


def idle(
    names: tuple[str, ...] = JOINTS, filled: bool = False, step: int = 100, late: int = MS, end: int = 2000
) -> list[Said]:
    """All joints at zero, as of a joint_state_publisher that was left running; step [ms]."""
    zeros = (0.0,) * len(names)
    fields = (zeros, zeros) if filled else ((), ())
    return [Said(k * MS + late, names, zeros, *fields) for k in range(step, end, step)]


@pytest.fixture
def intake():
    made = Intake(JOINTS, Ring.create(8192, 6))
    yield made
    made.ring.close()


def send(intake: Intake, said: list[Said]) -> np.ndarray:
    """Have these come in the order of their stamps; the positions of the samples, (N, 2)."""
    for stamp, names, *fields in sorted(said):
        intake.take(list(names), *fields, START + stamp, START + stamp)
    return intake.ring.read(0).values[:, :2]


@pytest.mark.parametrize("late", [0.05, 0.3, 0.5, 0.9])
@pytest.mark.parametrize(
    ("fills", "other", "told"),
    [
        ("velocity effort", idle(), "without effort"),
        ("velocity", idle(), "without velocity"),
        ("velocity effort", idle((*JOINTS, "gripper"), filled=True), "that hold gripper, too,"),
        ("velocity effort", idle(step=2), "without effort"),
    ],
    ids=["no effort", "no velocity", "one more joint", "as often"],
)
def test_of_two_publishers_that_which_moves_is_taken(intake, fills, other, told, late):
    watch = Watch()
    moved = driver(fills=fills)
    zeros = [said._replace(stamp=said.stamp - MS + round(late * PERIOD)) for said in other]
    taken = send(intake, moved + zeros)
    wrong = int((taken[:, 0] == 0.0).sum())
    assert wrong <= 1 and len(taken) - wrong == len(moved)
    assert intake.rejected[SECOND] == len(zeros) - wrong and intake.clock.lost == 0
    assert watch.look(intake, JOINTS) == ()
    assert watch.complaint.startswith(f"Two publishers send the same joints: joint states {told} are left")
    later = driver(1000, 1100, fills=fills)
    send(intake, later)
    assert watch.look(intake, JOINTS) == () and watch.complaint == ""


def test_one_that_came_first_gives_way_to_a_driver(intake):
    moved = driver(300, 1000)
    taken = send(intake, idle() + moved)
    assert (taken[:, 0] == 0.0).sum() <= 8 and (taken[:, 0] != 0.0).sum() >= len(moved) - 60


@pytest.mark.parametrize("fills", ["", "effort", "velocity"])
@pytest.mark.parametrize("jitter", [0.0, 0.2])
def test_a_field_that_is_left_out_now_and_then_makes_no_second_publisher(intake, fills, jitter):
    rng = np.random.default_rng(0)
    said = [
        one._replace(stamp=one.stamp + round(jitter * PERIOD * rng.uniform(-0.5, 0.5)))
        for one in (
            driver(k, k + 1, fills=fills if rng.random() < 0.3 else "velocity effort")[0] for k in range(1000)
        )
    ]
    assert len(send(intake, said)) == 1000 and intake.rejected[SECOND] == 0


def test_a_field_that_is_left_out_in_turns_makes_no_second_publisher(intake):
    said = driver(0, 100) + driver(100, 800, every=2) + driver(101, 800, "velocity", every=2)
    assert len(send(intake, said)) == 800 and intake.rejected[SECOND] == 0


def test_what_a_driver_fills_from_some_moment_on_is_taken_at_once(intake):
    said = driver(0, 400, "velocity") + driver(400, 800) + driver(800, 1200, "velocity")
    assert len(send(intake, said)) == 1200 and intake.rejected[SECOND] == 0


def test_where_a_driver_falls_silent_the_other_is_taken_until_it_comes_again(intake):
    rest = 3000
    moved = driver(0, 1000) + driver(1000 + rest // 2, 2000 + rest // 2)
    taken = send(intake, moved + idle(end=4000 + rest))
    zeros = (taken[:, 0] == 0.0).sum()
    assert len(taken) - zeros >= len(moved) - 1
    assert abs(zeros - (rest - 1000) // 100) <= 2


def test_two_halves_that_are_put_together_are_one_publisher(intake):
    halves = [
        Said(one.stamp, (name,), *(field[k : k + 1] for field in one[2:]))
        for one in driver()
        for k, name in enumerate(JOINTS)
    ]
    taken = send(intake, halves + idle())
    assert len(taken) == 1000 and taken.all() and intake.rejected == {SECOND: 19}


def test_a_bag_gives_the_same_samples(intake, tmp_path: Path):
    said = sorted(driver() + idle())
    taken = send(intake, said)
    messages = [
        ("/joint_states", JOINT_STATE, START + one.stamp, joint_state(*one[1:], START + one.stamp))
        for one in said
    ]
    recording = bags.read(write_bag(tmp_path / "bag", messages))
    np.testing.assert_array_equal(recording.position, taken)
    assert "19 of 1019 joint states hold other joints or come from another publisher" in recording.notes[0]
