"""Samples that never came, counted by one thread while another asks."""

from __future__ import annotations

import sys
import threading

from bdnn_ros.online.gaps import Gaps

PERIOD = 1_000_000


def test_what_asks_meanwhile_is_told_no_more_than_there_are_and_never_less_than_before() -> None:
    """The executor tells once a second what the stream's thread counts; either may be held up anywhere."""
    gaps, done, told = Gaps(), threading.Event(), []
    steps = [PERIOD, 4 * PERIOD, PERIOD, PERIOD, PERIOD] * 12_000  # three samples of eight are missing

    def stream() -> None:
        for step in steps:
            gaps.add(step)
        done.set()

    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        thread = threading.Thread(target=stream)
        thread.start()
        while not done.is_set():
            told.append(gaps.missing)
        thread.join()
    finally:
        sys.setswitchinterval(usual)
    assert len(set(told)) > 20
    assert told == sorted(told)
    assert max(told) <= gaps.missing <= 3 * 12_000
    assert gaps.missing >= 3 * 12_000 - 8  # the last gap may still be made up for
