"""What a new trainer goes on from where others died, without a trainer."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from bdnn_ros.online.course import MOST_DEATHS, Course
from bdnn_ros.online.serving import Served, nominal
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.robot import Robot

MODEL = nominal(Robot.bundled("arm2"))


@pytest.fixture
def ring() -> Iterator[Ring]:
    ring = Ring.create(10_000, 6)
    for k in range(5000):
        ring.commit(k, k, k)
    yield ring
    ring.close()


@pytest.fixture
def course() -> Course:
    """One that has come to sample 4000 with version 18."""
    course = Course()
    course.begin(0, 0)
    assert version(course, 4000)
    return course


def version(course: Course, end: int) -> bool:
    return course.advance({"epoch": course.epoch, "end": end})


def introduced(course: Course, ring: Ring, number: int = 18) -> dict[str, Any]:
    return course.introduction(ring, Served(MODEL, number, 0.0), training=True)[0]


def test_samples_that_every_trainer_dies_of_are_left_out(course, ring):
    """Each hands over again what the first knew before it comes to them; what was learned so far is gone on from."""
    for death in range(MOST_DEATHS):
        assert introduced(course, ring)["start"] == 0, f"after {death} deaths"
        assert not version(course, 500) and not version(course, 4000)
        course.died()
    told = introduced(course, ring)
    assert told["start"] == told["kept"] == 5000
    assert told["number"] == 18 and "resume" in told
    assert not version(course, 5000) and version(course, 5001)


def test_a_trainer_that_gets_over_them_begins_the_count_anew(course, ring):
    for _ in range(2 * MOST_DEATHS):
        course.died()
        assert introduced(course, ring)["start"] == 0
        assert version(course, course.trained + 1)


def test_the_count_begins_anew_after_what_was_left_out(course, ring):
    for _ in range(MOST_DEATHS):
        course.died()
    assert introduced(course, ring)["start"] == 5000
    ring.commit(5000, 5000, 5000)
    course.died()
    assert introduced(course, ring)["start"] == 5000


def test_where_nothing_was_learned_the_robot_description_is_gone_on_from(ring):
    course = Course()
    course.begin(0, 0)
    for _ in range(MOST_DEATHS):
        course.died()
    told = introduced(course, ring, number=0)
    assert told["start"] == 5000 and told["number"] == 0 and "resume" not in told


def change(course: Course, end: int) -> bool:
    return course.tells({"epoch": course.epoch, "end": end, "diagnosis": {}})


def test_a_change_is_told_once_however_often_trainers_catch_up(course):
    """Of several at once each is; one that was told right before a trainer died is not new either."""
    assert change(course, 4100) and change(course, 4100)
    for _ in range(2):
        course.died()
        assert not change(course, 3000) and not change(course, 4100)
        assert course.tells({"epoch": course.epoch, "diagnosis": {}}), "a diagnosis is new"
    assert change(course, 4101)
    course.begin(500, 0)
    assert change(course, 600) and not course.tells({"epoch": course.epoch - 1, "end": 9000})


def test_a_change_in_what_was_not_seen_is_told_by_the_next_trainer(course):
    course.died()
    assert not change(course, 4000) and change(course, 4001)
