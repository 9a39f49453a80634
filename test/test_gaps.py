"""Samples that never came, counted by one thread while another asks."""

from __future__ import annotations

import sys
import threading
import time

from bdnn_ros.online.stream.gaps import Gaps

PERIOD = 1_000_000


def test_what_asks_meanwhile_is_told_no_more_than_there_are_and_never_less_than_before() -> None:
    """The executor tells once a second what the stream's thread counts; either may be held up anywhere."""
    gaps, enough, told, rounds = Gaps(), threading.Event(), [0], []

    def stream() -> None:
        while not enough.is_set():
            for step in (PERIOD, 4 * PERIOD, PERIOD, PERIOD, PERIOD):  # three samples of eight are missing
                gaps.add(step)
            rounds.append(step)

    usual, end = sys.getswitchinterval(), time.monotonic() + 60.0
    sys.setswitchinterval(1e-6)
    thread, changes = threading.Thread(target=stream), 0
    thread.start()
    try:
        while changes < 60 and time.monotonic() < end:
            told.append(gaps.missing)
            changes += told[-1] != told[-2]
    finally:
        enough.set()
        thread.join()
        sys.setswitchinterval(usual)
    assert changes == 60
    assert told == sorted(told)
    assert max(told) <= gaps.missing <= 3 * len(rounds)
    assert gaps.missing >= 3 * len(rounds) - 8  # the last gap may still be made up for
