"""Where results go: files that appear whole, and places that cannot hold any refused before the work."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from bdnn_ros.bdnn.modelfile import SUFFIX, model_place
from bdnn_ros.errors import UsageError


def require_directory(path: Path) -> None:
    """Refuses a directory for results that is none and cannot be made.

    Raises:
        UsageError: a file is in its way, or there is no permission.
    """
    there = next(place for place in (path, *path.parents) if place.exists())
    if not there.is_dir():
        raise UsageError(f"{path} cannot be a directory: {there} is a file.", "Name another one.")
    if not os.access(there, os.W_OK | os.X_OK):
        raise UsageError(f"Nothing can be written into {there}.", "Name another directory.")


def require_model_place(path: Path) -> None:
    """Refuses what `save_model` cannot write to: a file if it ends in `.bdnn`, else a directory.

    Raises:
        UsageError: as `require_directory`; or a file is there that is no model.
    """
    if path.is_file() and path.suffix != SUFFIX:
        raise UsageError(f"{path} is a file that is no model.", "Name a directory, or a .bdnn file.")
    require_directory(model_place(path).parent)


def require_file(path: Path) -> None:
    """Refuses a file for results that cannot be one.

    Raises:
        UsageError: it is a directory, or there can be none around it.
    """
    if path.is_dir():
        raise UsageError(f"{path} is a directory.", "Name a file in it.")
    require_directory(path.parent)


@contextmanager
def written_whole(path: Path) -> Iterator[TextIO]:
    """A text file that appears under its name only when it is complete; a device or a pipe is written to as it is.

    Raises:
        UsageError: it is a directory.
        OSError: it cannot be written; names the path, whatever was written beside it.
    """
    require_file(path)
    try:
        if path.exists() and not path.is_file():  # renaming would put a file in its place
            with path.open("w", encoding="utf-8", newline="") as file:
                yield file
            return
        target = path.resolve()  # a link stays one
        target.parent.mkdir(parents=True, exist_ok=True)
        beside = target.with_name(f".{target.name}.{os.getpid()}")
        try:
            with beside.open("w", encoding="utf-8", newline="") as file:
                yield file
            os.replace(beside, target)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None
