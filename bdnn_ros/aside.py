"""Work in two processes: the second is forked off, knows all that this one does, and is gone once it has answered."""

from __future__ import annotations

import os
import select
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")
_busy = False
"""Whether two processes are at work already."""
TICKET = 4
"""Bytes that stand for an item, or for some in a row where there are many."""
MOST_TICKETS = select.PIPE_BUF // TICKET
"""So many a pipe holds for certain: all are in it before anybody draws one."""


def in_two(work: Callable[[T], R], items: Sequence[T]) -> list[R]:
    """What comes of each of some items, by two processes, each of which takes the next item once it is done with one.

    What the second one has learned on its way is lost: answers have to be plain values, and alike whoever gives them. What it
    leaves unanswered is done here, so that whatever is wrong is raised here.
    """
    done = _shared(work, items, lambda found: False)
    return [done[one] if one in done else work(item) for one, item in enumerate(items)]


def first_in_two(work: Callable[[T], R | None], items: Sequence[T]) -> tuple[int, R] | None:
    """Which is the first item that something comes of, and what, sought as by `in_two`; None where nothing comes of any."""
    done = _shared(work, items, lambda found: found is not None)
    for one, item in enumerate(items):
        found = done[one] if one in done else work(item)
        if found is not None:
            return one, found
    return None


def _shared(work: Callable[[T], R], items: Sequence[T], enough: Callable[[R], bool]) -> dict[int, R]:
    """What comes of items by their number: of all up to one that is enough, or of none where there is no second process."""
    if len(items) < 2 or not spare():
        return {}
    row = -(-len(items) // MOST_TICKETS)
    tickets, office = os.pipe()
    os.write(office, b"".join(first.to_bytes(TICKET, "big") for first in range(0, len(items), row)))
    os.close(office)

    def drawn() -> dict[int, R]:
        done = {}
        while ticket := os.read(tickets, TICKET):
            first = int.from_bytes(ticket, "big")
            for one in range(first, min(first + row, len(items))):
                done[one] = work(items[one])
                if enough(done[one]):
                    os.read(tickets, TICKET * MOST_TICKETS)  # all that are left: nobody goes on
                    break
        return done

    try:
        with aside(drawn) as answer:
            return drawn() | (answer() or {})
    finally:
        os.close(tickets)


@contextmanager
def aside(work: Callable[[], R]) -> Iterator[Callable[[], R | None]]:
    """Have something done by a second process meanwhile: what waits for its answer, None where there is none."""
    global _busy
    ours, theirs = Pipe(duplex=False)
    _busy = True
    try:
        child = os.fork()
    except OSError:  # no room for another
        _busy = False
        for end in (ours, theirs):
            end.close()
        yield lambda: None
        return
    if child == 0:
        _answer(work, theirs)
    theirs.close()

    def answer() -> R | None:
        try:
            found: R = ours.recv()
        except (EOFError, OSError):  # it has ended before, or in the midst of it
            return None
        return found

    try:
        yield answer
    finally:
        _busy = False
        ours.close()
        with suppress(ProcessLookupError, ChildProcessError):  # gone already, where nobody waits for such
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def _answer(work: Callable[[], R], to: Connection) -> None:
    """What a second process does."""
    try:
        to.send(work())
    finally:
        os._exit(0)  # nothing of what the first one has still to do is done twice


def spare() -> bool:
    """Whether there is a core for a second process: what yields to others, as beside a robot, takes no other's."""
    return not _busy and sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1 and os.nice(0) <= 0
