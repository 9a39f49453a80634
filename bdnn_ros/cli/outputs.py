"""Output files that appear only when complete; places that cannot be written are refused before the work begins."""

from __future__ import annotations

import errno
import fcntl
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO

from bdnn_ros.bdnn.modelfile import SUFFIX, model_place
from bdnn_ros.errors import UsageError, unwritable
from bdnn_ros.written import whole


def require_directory(path: Path) -> None:
    """Refuse an output directory that cannot be made or written to, which is tried.

    Permissions alone do not tell: some file systems, such as /proc, accept no files.

    Raises:
        UsageError: a file is in its way, or there is no permission or no room.
    """
    real = _real(path)
    there = next(place for place in (real, *real.parents) if os.path.lexists(place))
    if not there.is_dir():
        what = "a file" if there.exists() else "a link that leads nowhere"
        raise UsageError(f"{path} cannot be a directory: {there} is {what}.", "Name another one.")
    try:
        with tempfile.TemporaryDirectory(prefix=".new.", dir=there):
            pass
    except OSError as error:
        raise UsageError(
            f"Nothing can be written into {there} ({error.strerror or error}).", "Name another directory."
        ) from None


def require_model_place(path: Path) -> None:
    """Refuse a place where `save_model` cannot write: a file if it ends in `.bdnn`, else a directory.

    Raises:
        UsageError: as `require_directory`; or a file is there that is no model.
    """
    if path.is_file() and path.suffix != SUFFIX:
        raise UsageError(f"{path} is a file that is no model.", "Name a directory, or a .bdnn file.")
    require_directory(_real(model_place(path)).parent)


def require_file(path: Path) -> None:
    """Refuse a path at which no output file can be written.

    Raises:
        UsageError: it is a directory, or there can be none around it; a device or a pipe needs none.
    """
    if path.is_dir():
        raise UsageError(f"{path} is a directory.", "Name a file in it.")
    if path.exists() and not path.is_file():
        return
    require_directory(_real(path).parent)


def _real(path: Path) -> Path:
    """The path with links resolved, whether or not it exists."""
    return Path(os.path.realpath(path))


@contextmanager
def written_whole(path: Path) -> Iterator[TextIO]:
    """Open a text file that takes its name only when complete; devices and pipes are written to directly.

    Raises:
        UsageError: it is a directory, or cannot be written.
    """
    require_file(path)
    try:
        if path.exists() and not path.is_file():  # renaming would put a file in its place
            with path.open("w", encoding="utf-8", newline="") as file:
                yield file
            return
        _real(path).parent.mkdir(parents=True, exist_ok=True)
        with whole(path) as beside, beside.open("w", encoding="utf-8", newline="") as file:
            yield file
    except BrokenPipeError:
        raise  # whoever reads has had enough
    except OSError as error:
        raise unwritable(path, error) from error


@contextmanager
def written_together(out: Path, refuse: Callable[[], None] = lambda: None) -> Iterator[Path]:
    """A temporary directory whose content moves to `out` at the end: all of it or nothing.

    What had these names before is removed only when all is written, and restored if the move fails. Concurrent writers take
    turns with the move, so that results never mix.

    Args:
        out: the directory, made if there is none.
        refuse: raises where they may not take the place of what is there by then.

    Raises:
        UsageError: it is none, or something cannot be written; names the directory.
    """
    require_directory(out)
    real = _real(out)
    absent = [place for place in (real, *real.parents) if not place.exists()]
    try:
        real.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".new.", dir=real) as scratch:
            new, old = Path(scratch) / "new", Path(scratch) / "old"
            new.mkdir()
            old.mkdir()
            yield new
            with _alone(real):
                refuse()
                _exchange(new, old, real)
    except BaseException as error:
        for place in absent:
            with suppress(OSError):  # it may be in use by now
                place.rmdir()
        reason = error.__cause__ if isinstance(error, UsageError) else error
        if isinstance(reason, OSError):
            raise unwritable(out, reason) from reason
        raise


@contextmanager
def _alone(directory: Path) -> Iterator[None]:
    """Lock the directory against other writers; where it cannot be locked (some network disks) it is not."""
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _exchange(new: Path, old: Path, out: Path) -> None:
    """Move everything from `new` to `out`, and what had these names there to `old`; undone on failure."""
    places = {name: _place(out / name) for name in sorted(path.name for path in new.iterdir())}
    try:
        for name, place in places.items():
            place.parent.mkdir(parents=True, exist_ok=True)
            if os.path.lexists(place):
                _move(place, old / name)
            _move(new / name, place)
    except BaseException:
        for name, place in places.items():
            if os.path.lexists(place) and not os.path.lexists(new / name):
                _move(place, new / name)
            if os.path.lexists(old / name):
                _move(old / name, place)
        raise


def _place(path: Path) -> Path:
    """Where a file of this name is really put: through a link, unless it leads to a directory."""
    return path if path.is_dir() else _real(path)


def _move(source: Path, target: Path) -> None:
    try:
        os.rename(source, target)
    except OSError as error:
        if error.errno != errno.EXDEV:  # a link may lead to another disk
            raise
        shutil.move(source, target)
