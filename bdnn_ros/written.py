"""Files that are written beside their names and take them when they are complete."""

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

    Whatever fails, nothing of the new file is left.

    Raises:
        OSError: it cannot take the name.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.{next(_number)}")
    try:
        yield beside
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
