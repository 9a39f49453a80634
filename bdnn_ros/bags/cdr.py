"""CDR, the serialization of ROS 2 messages: JointState in blocks by NumPy, and two small messages.

Plain CDR (OMG DDSI-RTPS 2.5, 10.5; XCDR version 1) is a header of four bytes that names the byte order, then the fields, each
aligned to its own size from there. The layout of a JointState is fixed once its names are known, so a block of messages with
the same names is read by slicing columns of bytes; other messages are parsed one by one.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bdnn_ros.errors import BagError

HEADER = 4
"""Bytes in front that name the encoding; alignment counts from behind them."""
STAMP = slice(4, 12)
"""Where the header's stamp lies: seconds (int32), nanoseconds (uint32)."""
NANOSECONDS = 1_000_000_000
LONGEST_SEQUENCE = 1 << 24


DAMAGED = "Record it again: the messages are damaged, or of another type than the bag says."


class MalformedMessage(BagError):
    """The bytes of a message do not fit its type."""

    def __init__(self, problem: str, remedy: str = DAMAGED) -> None:
        super().__init__(problem, remedy)


class Span(NamedTuple):
    """Where a float64 sequence lies in a message: its first byte and number of values."""

    offset: int
    length: int


@dataclass(frozen=True)
class Layout:
    """Positions of the fields of a JointState with certain names.

    Attributes:
        size: bytes of a message.
        order: "<" little endian, ">" big endian.
        names: joint names.
        position, velocity, effort: their values' spans.
        fixed, expected: bytes that every message of this layout shares, and their values; alignment gaps are
            left out, since some writers leave them unset.
    """

    size: int
    order: str
    names: tuple[str, ...]
    position: Span
    velocity: Span
    effort: Span
    fixed: np.ndarray
    expected: np.ndarray

    def matches(self, rows: np.ndarray) -> np.ndarray:
        """Which messages have this layout, (K,) bool, of rows (K, size) uint8."""
        return np.asarray((rows[:, self.fixed] == self.expected).all(axis=1))

    def stamps(self, rows: np.ndarray) -> np.ndarray:
        """Header stamps of rows (K, size), (K,) int64 [ns]."""
        raw = np.ascontiguousarray(rows[:, STAMP])
        seconds = raw[:, :4].copy().view(self.order + "i4")[:, 0].astype(np.int64)
        return seconds * NANOSECONDS + raw[:, 4:].copy().view(self.order + "u4")[:, 0]

    def values(self, rows: np.ndarray, span: Span) -> np.ndarray | None:
        """Values of a sequence of rows (K, size), (K, count); None where the sequence is empty."""
        if not span.length:
            return None
        raw = np.ascontiguousarray(rows[:, span.offset : span.offset + 8 * span.length])
        return raw.view(self.order + "f8").astype(float, copy=False)


class _Cursor:
    """Reads fields in sequence and records which bytes the layout fixes."""

    def __init__(self, data: bytes) -> None:
        if len(data) < HEADER or data[0] != 0 or data[1] not in (0, 1):
            raise MalformedMessage(
                f"A message starts with {data[:HEADER].hex() or 'nothing'}, which is not plain CDR."
            )
        self.data = data
        self.order = "<" if data[1] else ">"
        self.at = HEADER
        self.fixed = [1]

    def align(self, size: int) -> None:
        self.at += -(self.at - HEADER) % size

    def unsigned(self, *, fix: bool = False) -> int:
        self.align(4)
        try:
            (value,) = struct.unpack_from(self.order + "I", self.data, self.at)
        except struct.error:
            raise MalformedMessage(f"A message of {len(self.data)} bytes ends too early.") from None
        if fix:
            self.fixed.extend(range(self.at, self.at + 4))
        self.at += 4
        return int(value)

    def string(self, *, fix: bool = True) -> str:
        length = self.unsigned(fix=True)
        self.require(length)
        start, self.at = self.at, self.at + length
        if fix:
            self.fixed.extend(range(start, self.at))
        return self.data[start : self.at].rstrip(b"\0").decode("utf-8", errors="replace")

    def doubles(self) -> Span:
        count = self.unsigned(fix=True)
        if count:
            self.align(8)
            self.require(8 * count)
        span = Span(self.at, count)
        self.at += 8 * count
        return span

    def require(self, length: int) -> None:
        if length > LONGEST_SEQUENCE or self.at + length > len(self.data):
            raise MalformedMessage(f"A message of {len(self.data)} bytes ends too early.")


def joint_state_layout(data: bytes) -> Layout:
    """The layout of one serialized sensor_msgs/JointState.

    Raises:
        MalformedMessage: the bytes end too early, or a field has neither none nor one value a joint.
    """
    cursor = _Cursor(data)
    cursor.unsigned()
    cursor.unsigned()
    cursor.string(fix=False)
    count = cursor.unsigned(fix=True)
    cursor.require(4 * count)
    names = tuple(cursor.string() for _ in range(count))
    position, velocity, effort = cursor.doubles(), cursor.doubles(), cursor.doubles()
    for field, span in (("position", position), ("velocity", velocity), ("effort", effort)):
        if span.length not in (0, len(names)):
            raise MalformedMessage(
                f"A JointState has {len(names)} names and {span.length} values of {field}.",
                f"Let the driver send one value of {field} for each joint, or none."
                if names
                else "Record a driver that names its joints.",
            )
    if len(set(names)) != len(names):
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise MalformedMessage(f"A JointState names {twice} twice.", "Let the driver name each joint once.")
    fixed = np.array(cursor.fixed)
    expected = np.frombuffer(data, np.uint8)[fixed]
    return Layout(len(data), cursor.order, names, position, velocity, effort, fixed, expected)


def decode_string(data: bytes) -> str:
    """The text of a serialized std_msgs/String.

    Raises:
        MalformedMessage: the bytes end too early.
    """
    return _Cursor(data).string()


def decode_float64_multi_array(data: bytes) -> np.ndarray:
    """The values of a serialized std_msgs/Float64MultiArray, (k,).

    Raises:
        MalformedMessage: the bytes end too early.
    """
    cursor = _Cursor(data)
    dimensions = cursor.unsigned()
    cursor.require(4 * dimensions)
    for _ in range(dimensions):
        cursor.string()
        cursor.unsigned()
        cursor.unsigned()
    cursor.unsigned()
    span = cursor.doubles()
    return np.frombuffer(data, cursor.order + "f8", span.length, span.offset).astype(float)


class _Encoder:
    """Appends fields, little endian."""

    def __init__(self) -> None:
        self.data = bytearray(b"\x00\x01\x00\x00")

    def align(self, size: int) -> None:
        self.data += bytes(-(len(self.data) - HEADER) % size)

    def unsigned(self, value: int) -> None:
        self.align(4)
        self.data += struct.pack("<I", value)

    def string(self, text: str) -> None:
        raw = text.encode() + b"\0"
        self.unsigned(len(raw))
        self.data += raw

    def doubles(self, values: np.ndarray) -> None:
        self.unsigned(len(values))
        if len(values):
            self.align(8)
            self.data += values.astype("<f8").tobytes()


def encode_string(text: str) -> bytes:
    """A serialized std_msgs/String."""
    encoder = _Encoder()
    encoder.string(text)
    return bytes(encoder.data)


def encode_float64_multi_array(values: np.ndarray) -> bytes:
    """A serialized std_msgs/Float64MultiArray without dimensions, values (k,)."""
    encoder = _Encoder()
    encoder.unsigned(0)
    encoder.unsigned(0)
    encoder.doubles(values)
    return bytes(encoder.data)


def encode_joint_states(
    names: Sequence[str],
    stamps: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray | None,
    effort: np.ndarray | None,
) -> list[bytes]:
    """Serialized sensor_msgs/JointState, one a row.

    Args:
        stamps: (K,) int64 [ns], from 0 to 2**31 s.
        position, velocity, effort: (K, n); None leaves the field empty.
    """
    encoder = _Encoder()
    encoder.data += bytes(STAMP.stop - STAMP.start)
    encoder.string("")
    encoder.unsigned(len(names))
    for name in names:
        encoder.string(name)
    fields = (position, velocity, effort)
    for values in fields:
        encoder.doubles(np.zeros(0 if values is None else len(names)))
    layout = joint_state_layout(bytes(encoder.data))
    rows = np.tile(np.frombuffer(bytes(encoder.data), np.uint8), (len(stamps), 1))
    clock = np.stack([stamps // NANOSECONDS, stamps % NANOSECONDS], axis=1).astype("<u4")
    rows[:, STAMP] = clock.view(np.uint8)
    for values, span in zip(fields, (layout.position, layout.velocity, layout.effort), strict=True):
        if values is not None:
            raw = np.ascontiguousarray(values, "<f8").view(np.uint8)
            rows[:, span.offset : span.offset + 8 * span.length] = raw
    whole, size = rows.tobytes(), layout.size
    return [whole[start : start + size] for start in range(0, len(whole), size)]
