"""Writing of files: atomic replacement, encodable names, numbers in full precision."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_number = itertools.count()


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A temporary path in the same directory, which replaces the file at the end; until then the old file stays.

    On failure nothing of the new file is left. If the path is a link, the file that it leads to is replaced.

    Raises:
        OSError: it cannot take the name.
    """
    target = Path(os.path.realpath(path))
    beside = target.with_name(f".{target.name}.{os.getpid()}.{next(_number)}")
    try:
        yield beside
        os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes) -> Path:
    """Write a file, whole or not at all; returns its path."""
    with whole(path) as beside:
        beside.write_bytes(content)
    return path


def spelled(text: object) -> str:
    """Text with bytes that are no valid characters (as in odd file names) escaped."""
    return str(text).encode("utf-8", "backslashreplace").decode("utf-8")


def numbers(*values: float) -> str:
    """Numbers for an XML attribute: in full precision, separated by blanks."""
    return " ".join(repr(float(value)) for value in values)
