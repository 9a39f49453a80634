"""What is written: files that take their names when complete, names that any file can hold, numbers in full precision."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_number = itertools.count()


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """A place in the same directory to write a file to, which takes its name at the end; what is there stays until then.

    Whatever fails, nothing of the new file is left. A link stays one: it is what it leads to that is replaced.

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
    """A path, or a sentence with one, in characters that every file holds: bytes that are none get a code, as on a terminal."""
    return str(text).encode("utf-8", "backslashreplace").decode("utf-8")


def numbers(*values: float) -> str:
    """Numbers as an attribute of an XML element has them: in full precision, with spaces between."""
    return " ".join(repr(float(value)) for value in values)
