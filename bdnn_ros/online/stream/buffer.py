"""Ring buffer of samples in shared memory between the receiving and the learning process; neither waits for the other.

The memory is an anonymous file (memfd) whose descriptor is passed to the reader. It has no name in /dev/shm, so nothing is left
behind however the processes end.
"""

from __future__ import annotations

import mmap
import os
import threading
import time
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from bdnn_ros.errors import UsageError

MAGIC = 0x62646E6E
HEADER_BYTES = 4096
_MAGIC, _CAPACITY, _WIDTH, _WRITTEN, _ORIGIN, _CONSUMED, _BEAT = range(7)


@dataclass(frozen=True)
class Chunk:
    """Consecutive samples of a ring, oldest first.

    Attributes:
        first: number of the first sample, counted from the first ever written.
        stamp: when it was measured, by the sender's clock [ns], (N,).
        sent: when it was sent, by the clock of the middleware [ns], (N,).
        time: strictly increasing stream time [ns], (N,): the stamp, moved on where the clock jumped back.
        values: (N, width).
        missed: samples asked for that had been overwritten.
    """

    first: int
    stamp: np.ndarray
    sent: np.ndarray
    time: np.ndarray
    values: np.ndarray
    missed: int

    def __len__(self) -> int:
        return len(self.stamp)

    @property
    def end(self) -> int:
        """Number of the sample that comes next."""
        return self.first + len(self.stamp)


class Ring:
    """The last `capacity` samples of a stream: one writer, any number of readers, allocated once.

    A sample is three stamps and `width` numbers. The writer never waits for readers; a reader that is too slow learns how many
    samples it missed.
    """

    def __init__(self, descriptor: int) -> None:
        """Map a ring that `create` made.

        Raises:
            UsageError: the descriptor is not a ring.
        """
        size = os.fstat(descriptor).st_size
        if size < HEADER_BYTES:
            raise UsageError("The shared memory holds no ring.", "Create it with Ring.create.")
        self.descriptor = descriptor
        # all pages are mapped now: neither process faults or grows later
        self._memory = mmap.mmap(descriptor, size, mmap.MAP_SHARED | mmap.MAP_POPULATE)
        self._header = np.frombuffer(self._memory, np.int64, 8)
        if self._header[_MAGIC] != MAGIC:
            raise UsageError("The shared memory holds no ring.", "Create it with Ring.create.")
        self.capacity, self.width = int(self._header[_CAPACITY]), int(self._header[_WIDTH])
        stamps = np.frombuffer(self._memory, np.int64, 3 * self.capacity, HEADER_BYTES)
        self._stamp, self._sent, self._time = stamps.reshape(3, self.capacity)
        start = HEADER_BYTES + 3 * 8 * self.capacity
        values = np.frombuffer(self._memory, np.float64, self.capacity * self.width, start)
        self._values = values.reshape(self.capacity, self.width)
        self._next = self.written

    @classmethod
    def create(cls, capacity: int, width: int) -> Ring:
        """A new ring, all zero."""
        if capacity < 2 or width < 1:
            raise UsageError(f"A ring of {capacity} samples of {width} numbers makes no sense.", "")
        size = HEADER_BYTES + capacity * (24 + 8 * width)
        descriptor = os.memfd_create("bdnn_ring")
        os.ftruncate(descriptor, size)
        with mmap.mmap(descriptor, size) as memory:
            header = np.frombuffer(memory, np.int64, 8)
            header[_CAPACITY], header[_WIDTH] = capacity, width
            header[_MAGIC] = MAGIC
            del header
        return cls(descriptor)

    @classmethod
    def received(cls, descriptor: int) -> Ring:
        """A ring from another process; its memory is freed with the last reference to it.

        Raises:
            UsageError: the descriptor is not a ring.
        """
        ring = cls(descriptor)
        os.close(descriptor)  # the mapping stays
        ring.descriptor = -1
        return ring

    # -- the writer --------------------------------------------------------------------------------

    def slot(self) -> np.ndarray:
        """The row the next sample goes to, (width,): fill it, then `commit`."""
        row: np.ndarray = self._values[self._next % self.capacity]
        return row

    def commit(self, stamp: int, sent: int, stream_time: int) -> int:
        """Make the filled slot a sample with these stamps [ns] and return its number."""
        number = self._next
        row = number % self.capacity
        self._stamp[row] = stamp
        self._sent[row] = sent
        self._time[row] = stream_time
        self._next = number + 1
        if number == 0:
            self._header[_ORIGIN] = stream_time
        fence()  # who sees the number sees the sample,
        self._header[_WRITTEN] = self._next
        fence()  # and who sees the next sample in the slot of an old one, that this is no longer kept
        return number

    def restamp(self, number: int, stamp: int) -> None:
        """Change the stamp [ns] of a sample that is still in the buffer; readers that have read it keep the old one."""
        self._stamp[number % self.capacity] = stamp

    # -- readers -----------------------------------------------------------------------------------

    @property
    def written(self) -> int:
        """Number of samples written so far. Also a memory fence between what is read before and after this access."""
        fence()
        number = int(self._header[_WRITTEN])
        fence()
        return number

    @property
    def origin(self) -> int:
        """Stream time of the first sample ever written [ns]."""
        return int(self._header[_ORIGIN])

    @property
    def most(self) -> int:
        """Number of samples that can be read at once: all but the slot being written."""
        return self.capacity - 1

    @property
    def oldest(self) -> int:
        """Number of the oldest sample that is certainly intact."""
        return max(self.written - self.most, 0)

    def read(self, start: int, most: int | None = None) -> Chunk:
        """Copies of the samples from number `start` on, at most `most` of them."""
        begin = max(start, self.oldest)
        end = self.written
        if most is not None:
            end = min(end, begin + most)
        stamp, sent, stream_time, values = (
            self._copied(column, begin, max(end, begin))
            for column in (self._stamp, self._sent, self._time, self._values)
        )
        # what the writer overtook while we copied is torn
        torn = min(max(self.oldest - begin, 0), len(stamp))
        first = begin + torn
        missed = max(first - max(start, 0), 0)
        return Chunk(first, stamp[torn:], sent[torn:], stream_time[torn:], values[torn:], missed)

    def _copied(self, column: np.ndarray, begin: int, end: int) -> np.ndarray:
        """Copies of one column of the samples of these numbers."""
        first, last = begin % self.capacity, begin % self.capacity + end - begin
        if last <= self.capacity:
            return column[first:last].copy()
        return np.concatenate([column[first:], column[: last - self.capacity]])

    def latest(self, count: int) -> Chunk:
        """Copies of the last `count` samples, or of all if there are fewer."""
        return self.read(max(self.written - count, self.oldest))

    def first_after(self, stream_time: int) -> int:
        """Number of the oldest intact sample with time > `stream_time` [ns]."""
        low, high = self.oldest, self.written
        while low < high:
            middle = (low + high) // 2
            if self._time[middle % self.capacity] > stream_time:
                high = middle
            else:
                low = middle + 1
        return low

    def first_sent_after(self, sent: int) -> int:
        """Number of the first sample sent after `sent` [ns], searched back from the newest until the clock was last set back.

        Callers usually want few samples, so the search is short.
        """
        oldest, end, count = self.oldest, self.written, 256
        while True:
            begin = max(end - count, oldest)
            column = self._copied(self._sent, begin, end)
            back = np.flatnonzero(np.diff(column) < 0)
            start = int(back[-1]) + 1 if len(back) else 0
            if begin == oldest or start or column[0] <= sent:
                return begin + start + int(np.searchsorted(column[start:], sent, side="right"))
            count *= 4

    # -- the reader's signs of life, for the writer's process --------------------------------------

    @property
    def consumed(self) -> int:
        """Number of samples that the learning process has processed."""
        return int(self._header[_CONSUMED])

    @consumed.setter
    def consumed(self, number: int) -> None:
        self._header[_CONSUMED] = number

    def beat(self) -> None:
        """Signal that the learning process is alive."""
        self._header[_BEAT] = time.monotonic_ns()

    @property
    def silence(self) -> float:
        """Time since the last `beat` [s]; infinite before the first."""
        beat = int(self._header[_BEAT])
        return (time.monotonic_ns() - beat) * 1e-9 if beat else float("inf")

    def close(self) -> None:
        """Unmap the memory; the ring is unusable afterwards. Arrays that `read` returned stay valid."""
        if self.descriptor < 0:
            return
        for name in ("_header", "_stamp", "_sent", "_time", "_values"):
            setattr(self, name, None)
        with suppress(BufferError):  # a slot somebody still holds keeps the mapping until it goes
            self._memory.close()
        os.close(self.descriptor)
        self.descriptor = -1


def fence() -> None:
    """Memory fence: reads and writes do not move across this call, as the CPU (arm64) otherwise might let them.

    Releasing and acquiring a lock orders them. The lock is private, so nothing ever waits for it.
    """
    lock = threading.Lock()
    lock.acquire()
    lock.release()
    lock.acquire()
