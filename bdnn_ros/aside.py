"""Runs work in two processes: the second is a fork that knows all the first one does, and ends once it has answered."""

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
    """Map `work` over items in two processes, each of which takes the next item when it is done with one.

    State that the second process changes is lost, so results must be plain values that do not depend on the process. Items
    that it does not answer are done here, so that exceptions are raised here.
    """
    done = _shared(work, items, lambda found: False)
    return [done[one] if one in done else work(item) for one, item in enumerate(items)]


def first_in_two(work: Callable[[T], R | None], items: Sequence[T]) -> tuple[int, R] | None:
    """The first item for which `work` returns a value, with that value, searched as by `in_two`; None if there is none."""
    done = _shared(work, items, lambda found: found is not None)
    for one, item in enumerate(items):
        found = done[one] if one in done else work(item)
        if found is not None:
            return one, found
    return None


def _shared(work: Callable[[T], R], items: Sequence[T], enough: Callable[[R], bool]) -> dict[int, R]:
    """Results by item number, up to the first one that is enough; empty if no second process can run."""
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
    """Run `work` in a second process meanwhile; yields a function that waits for the result (None if there is none)."""
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
    """Body of the second process."""
    try:
        to.send(work())
    finally:
        os._exit(0)  # nothing of what the first one has still to do is done twice


def spare() -> bool:
    """Whether a core is free for a second process; never for a process that yields to others (nice), as beside a robot."""
    return not _busy and sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1 and os.nice(0) <= 0
