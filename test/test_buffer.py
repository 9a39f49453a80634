"""The ring between the process that receives and the one that learns."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros.errors import UsageError
from bdnn_ros.online.stream import buffer
from bdnn_ros.online.stream.buffer import Ring


@pytest.fixture
def ring():
    ring = Ring.create(capacity=16, width=3)
    yield ring
    ring.close()


def write(ring: Ring, count: int, start: int = 0) -> None:
    for k in range(start, start + count):
        ring.slot()[:] = (k, 2 * k, 3 * k)
        assert ring.commit(stamp=1000 + k, sent=1500 + k, stream_time=2000 + k) == k


def test_what_is_written_is_read_in_order(ring):
    write(ring, 5)
    chunk = ring.read(0)
    assert chunk.first == 0 and chunk.end == 5 and chunk.missed == 0
    assert chunk.stamp.tolist() == [1000, 1001, 1002, 1003, 1004]
    assert chunk.sent.tolist() == [1500, 1501, 1502, 1503, 1504]
    assert chunk.time.tolist() == [2000, 2001, 2002, 2003, 2004]
    np.testing.assert_array_equal(chunk.values, np.outer(np.arange(5), [1, 2, 3]))
    assert ring.origin == 2000


def test_a_sample_is_not_there_before_it_is_committed(ring):
    ring.slot()[:] = 7.0
    assert len(ring.read(0)) == 0 and ring.written == 0


def test_reading_goes_on_where_it_stopped(ring):
    write(ring, 4)
    first = ring.read(0, most=3)
    write(ring, 3, start=4)
    second = ring.read(first.end)
    assert first.end == 3 and second.first == 3
    assert second.values[:, 0].tolist() == [3, 4, 5, 6]
    assert len(ring.read(second.end)) == 0


def test_a_slow_reader_is_told_what_it_missed(ring):
    write(ring, 40)
    chunk = ring.read(5)
    # the slot that is written next is never trusted: 15 of 16 are whole
    assert chunk.first == 25 and chunk.missed == 20
    assert chunk.values[:, 0].tolist() == list(range(25, 40))


def test_the_latest_samples(ring):
    assert len(ring.latest(3)) == 0
    write(ring, 20)
    assert ring.latest(3).values[:, 0].tolist() == [17, 18, 19]
    assert len(ring.latest(100)) == 15


@pytest.mark.parametrize(("time", "number"), [(1999, 5), (2019, 20), (2010, 11), (3000, 20)])
def test_a_sample_is_found_by_its_time(ring, time, number):
    write(ring, 20)
    assert ring.first_after(time) == number


def test_another_mapping_sees_the_same(ring):
    other = Ring(os.dup(ring.descriptor))
    write(ring, 3)
    assert other.written == 3 and other.capacity == 16 and other.width == 3
    assert other.read(0).values[:, 0].tolist() == [0, 1, 2]
    other.consumed = 2
    assert ring.consumed == 2
    assert ring.silence == float("inf")
    other.beat()
    assert ring.silence < 1.0
    other.close()


def test_the_order_of_samples_and_their_number_holds_on_any_machine(ring, monkeypatch):
    """Only x86-64 keeps it unasked: elsewhere a number could be seen before its sample."""
    write(ring, 20)
    seen, row = [], 20 % ring.capacity

    def look() -> None:
        seen.append((int(ring._header[buffer._WRITTEN]), int(ring._stamp[row]), ring._values[row].tolist()))

    monkeypatch.setattr(buffer, "fence", look)
    write(ring, 1, start=20)
    sample = (1020, [20.0, 40.0, 60.0])
    assert seen == [(20, *sample), (21, *sample)]


def test_the_number_is_read_after_what_is_read_before_and_before_what_is_read_after(ring, monkeypatch):
    order: list[str] = []

    class Header:
        def __getitem__(self, key: int) -> int:
            order.append("number")
            return 0

    monkeypatch.setattr(buffer, "fence", lambda: order.append("fence"))
    with monkeypatch.context() as patch:
        patch.setattr(ring, "_header", Header())
        assert ring.written == 0
    assert order == ["fence", "number", "fence"]


def test_another_process_reads_while_it_is_written():
    """Every sample a fast writer commits reaches a reader in another process whole, or is reported missed."""
    ring = Ring.create(capacity=512, width=4)
    script = """
import sys
from bdnn_ros.online.stream.buffer import Ring
ring = Ring(int(sys.argv[1]))
total, seen, missed, following = 60000, 0, 0, 0
ring.beat()
while following < total:
    chunk = ring.read(following)
    missed += chunk.missed
    for k, (stamp, values) in enumerate(zip(chunk.stamp, chunk.values)):
        number = chunk.first + k
        assert stamp == number + 1, (stamp, number)
        assert (values == number).all(), (values, number)
    seen += len(chunk)
    following = chunk.end
assert seen + missed == total, (seen, missed)
print(seen)
"""
    reader = subprocess.Popen(
        [sys.executable, "-c", script, str(ring.descriptor)],
        pass_fds=[ring.descriptor],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    while ring.silence == float("inf") and reader.poll() is None:
        pass
    for number in range(60000):
        ring.slot()[:] = number
        ring.commit(number + 1, number + 1, number + 1)
    output, errors = reader.communicate(timeout=60)
    assert reader.returncode == 0, errors
    assert int(output) > 0
    ring.close()


def test_nothing_is_left_in_shared_memory():
    folder = Path("/dev/shm")  # noqa: S108
    before = set(folder.iterdir())
    ring = Ring.create(1000, 21)
    assert set(folder.iterdir()) == before
    descriptor = ring.descriptor
    ring.close()
    ring.close()
    with pytest.raises(OSError):
        os.fstat(descriptor)


def test_what_is_not_a_ring_is_refused():
    descriptor = os.memfd_create("other")
    try:
        with pytest.raises(UsageError, match="no ring"):
            Ring(descriptor)
        os.ftruncate(descriptor, 8192)
        with pytest.raises(UsageError, match="no ring"):
            Ring(descriptor)
    finally:
        os.close(descriptor)
    with pytest.raises(UsageError):
        Ring.create(1, 3)


def test_samples_are_found_by_when_they_were_sent():
    ring = Ring.create(2000, 1)
    assert ring.first_sent_after(5) == 0
    for k in range(3000):
        ring.commit(0, 10 * k, k + 1)
    assert [ring.first_sent_after(sent) for sent in (29_990, 29_989, 29_800, 20_000, 0)] == [
        3000,
        2999,
        2981,
        2001,
        1001,
    ]
    for k in range(400):  # a clock that went back
        ring.commit(0, 5000 + 10 * k, 3001 + k)
    assert [ring.first_sent_after(sent) for sent in (8985, 5005, 0)] == [3399, 3001, 3000]
    ring.close()
