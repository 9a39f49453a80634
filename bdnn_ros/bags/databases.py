"""SQLite databases that a recorder did not finish, or that were truncated."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from contextlib import closing
from pathlib import Path

from bdnn_ros.errors import BagError

HEADER = 100
"""Bytes of a database's header."""
LOGS = ("-wal", "-journal")
"""Files beside a database in which SQLite keeps what is not yet in it, or what is to be taken out of it again."""


def require_all_pages(path: Path) -> None:
    """Raise if a database is shorter than its header says, which SQLite notices only when it reads the page.

    SQLite file format: page size at byte 16 (1 stands for 65536), number of pages at 28, valid if the change counters at 24
    and 92 agree.

    Raises:
        EOFError: it is.
    """
    if path.suffix != ".db3" or path.stat().st_size < HEADER:
        return
    with path.open("rb") as file:
        page, counter, pages, valid = struct.unpack(">16xH6xII60xI4x", file.read(HEADER))
    if counter == valid and path.stat().st_size < pages * (65536 if page == 1 else page):
        raise EOFError(f"{pages} pages announced, the file ends before")


def unfinished(path: Path) -> bool:
    """Whether a journal lies beside a database: its recorder is still running, or was killed.

    rosbag2's storage preset `resilient` writes one. Readers of the database alone, such as rosbags, do not see its content.
    """
    return path.suffix == ".db3" and any(log.stat().st_size for log in logs(path))


def finished(path: Path, directory: Path) -> Path:
    """A copy of a database with its journal applied; the files themselves are not changed.

    Raises:
        BagError: the database changed meanwhile, so that the copy fits nothing.
        sqlite3.Error: the database is damaged.
    """
    place, before = directory / path.name, path.stat().st_mtime_ns
    changed = False
    try:
        for file in (path, *logs(path)):
            shutil.copyfile(file, directory / file.name)
    except FileNotFoundError:  # its recorder has just ended, and SQLite removed what lay beside it
        changed = True
    if changed or path.stat().st_mtime_ns != before:
        raise BagError(f"{path} is being written.", "Stop the recorder before reading it.")
    with closing(sqlite3.connect(place)) as database:
        database.execute("PRAGMA journal_mode = DELETE")
    return place


def plainly_named(path: Path, directory: Path) -> Path:
    """A link to a database, in a directory, whose name is valid in a URI, too."""
    place = directory / "bag.db3"
    place.symlink_to(path.absolute())
    return place


def logs(path: Path) -> list[Path]:
    """The journal files that SQLite put beside a database; none for other files."""
    return [log for end in LOGS if (log := path.with_name(path.name + end)).is_file()]
