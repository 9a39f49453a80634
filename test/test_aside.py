"""Work in two processes gives what one gives, whatever becomes of the second."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import pytest

from bdnn_ros import aside
from bdnn_ros.aside import first_in_two, in_two, spare

MANY = range(20_011)
"""More than a pipe holds tickets for."""


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1})
    monkeypatch.setattr(os, "nice", lambda by: 0)
    yield
    with pytest.raises(ChildProcessError):  # nobody is left behind
        os.waitpid(-1, os.WNOHANG)


def slowly(item: int) -> tuple[int, int]:
    time.sleep(0.02)
    return item * item, os.getpid()


def test_two_processes_share_the_work_and_keep_its_order() -> None:
    found = in_two(slowly, range(40))
    assert [square for square, _ in found] == [item * item for item in range(40)]
    assert len({process for _, process in found}) == 2


def test_any_number_of_items_is_shared() -> None:
    """Who hands them out waited for ever for somebody to take one."""
    assert in_two(lambda item: item + 1, MANY) == [item + 1 for item in MANY]
    assert first_in_two(lambda item: item if item >= 15_000 else None, MANY) == (15_000, 15_000)


@pytest.mark.parametrize("items", [(), (3,)])
def test_few_items_are_done_here(items: tuple[int, ...]) -> None:
    assert in_two(slowly, items) == [(item * item, os.getpid()) for item in items]


def test_one_core_or_a_process_that_yields_has_no_second_one(monkeypatch: pytest.MonkeyPatch) -> None:
    assert spare()
    monkeypatch.setattr(os, "nice", lambda by: 19)
    assert not spare()
    monkeypatch.setattr(os, "nice", lambda by: 0)
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0})
    assert {process for _, process in in_two(slowly, range(4))} == {os.getpid()}


def test_work_in_work_is_not_shared_once_more() -> None:
    found = in_two(lambda item: {process for _, process in in_two(slowly, range(3))}, range(6))
    assert all(len(processes) == 1 for processes in found)
    assert spare()


def test_the_first_is_found_even_where_a_later_one_is_quicker() -> None:
    def sought(item: int) -> int | None:
        time.sleep(0.2 if item == 4 else 0.01)
        return item if item in (4, 5, 9) else None

    assert first_in_two(sought, range(20)) == (4, 4)
    assert first_in_two(lambda item: None, range(20)) is None
    assert first_in_two(lambda item: item or None, range(2)) == (1, 1)


def test_after_the_first_nothing_more_is_done() -> None:
    began = time.monotonic()
    assert first_in_two(slowly, range(2000)) is not None
    assert time.monotonic() - began < 5.0


def test_what_the_second_process_leaves_is_done_here() -> None:
    here = os.getpid()

    def killed(item: int) -> int:
        time.sleep(0.01)
        if os.getpid() != here:
            os._exit(1)
        return item

    assert in_two(killed, range(10)) == list(range(10))


def test_an_error_is_raised_wherever_it_came_up(capfd: pytest.CaptureFixture[str]) -> None:
    def wrong(item: int) -> int:
        time.sleep(0.01)
        if item == 7:
            raise ValueError("seven")
        return item

    with pytest.raises(ValueError, match="seven"):
        in_two(wrong, range(10))
    assert capfd.readouterr().err == ""
    assert spare()


def test_where_no_process_can_be_made_one_does_it_all(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> int:
        raise BlockingIOError

    monkeypatch.setattr(aside.os, "fork", refused)
    assert in_two(slowly, range(3)) == [(item * item, os.getpid()) for item in range(3)]
    assert spare()


def test_children_that_nobody_waits_for_are_no_trouble() -> None:
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        found = in_two(slowly, range(6))
    finally:
        signal.signal(signal.SIGCHLD, before)
    assert [square for square, _ in found] == [item * item for item in range(6)]
