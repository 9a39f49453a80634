"""Databases whose recorder was killed: what SQLite keeps beside them counts, and is left as it is."""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from bag_cases import motion, states, write_bag
from rosbags.rosbag2 import StoragePlugin

from bdnn_ros import bags
from bdnn_ros.bags import databases
from bdnn_ros.cli.main import main
from bdnn_ros.errors import BagError, UsageError


def killed(folder: Path, journal: str, checkpointed: int) -> Path:
    """What is left of a recorder that is killed when so many of 600 joint states are in the database itself.

    Args:
        journal: where SQLite keeps what is not: WAL, or DELETE, which takes it out again.
    """
    whole = write_bag(folder / "whole", states(motion()), StoragePlugin.SQLITE3) / "whole.db3"
    left = folder / "killed" / "a.db3"
    left.parent.mkdir()
    running = folder / "running.db3"
    database = sqlite3.connect(running, isolation_level=None)
    database.execute(f"PRAGMA journal_mode = {journal}")
    database.execute("PRAGMA wal_autocheckpoint = 0")
    database.execute("PRAGMA cache_size = 2")
    with sqlite3.connect(whole) as source:
        for line in source.iterdump():
            if "INSERT INTO" not in line or '"messages"' not in line:
                database.execute(line)
        rows = list(source.execute("SELECT * FROM messages ORDER BY id"))
    for first, stop in ((0, checkpointed), (checkpointed, 600)):
        if first:
            database.execute("PRAGMA wal_checkpoint(FULL)")
        database.execute("BEGIN")
        database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows[first:stop])
        if journal == "WAL" or not first:
            database.execute("COMMIT")
    for file in folder.glob("running.db3*"):
        if not file.name.endswith("-shm"):
            shutil.copy(file, left.parent / file.name.replace("running", "a"))
    database.close()
    return left


def content(folder: Path) -> dict[str, bytes]:
    """The files of a folder."""
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("checkpointed", [0, 300])
def test_what_is_not_yet_in_the_database_is_read_too(tmp_path: Path, checkpointed: int) -> None:
    """300 of 600 joint states were read without a word, or the bag was called damaged."""
    path = killed(tmp_path, "WAL", checkpointed)
    before = content(path.parent)
    assert set(before) == {"a.db3", "a.db3-wal"}
    assert len(bags.read(path)) == len(bags.read(path.parent)) == 600
    assert content(path.parent) == before


def test_what_was_not_committed_is_taken_out_of_the_database(tmp_path: Path) -> None:
    path = killed(tmp_path, "DELETE", 300)
    before = content(path.parent)
    assert set(before) == {"a.db3", "a.db3-journal"}
    assert len(bags.read(path)) == 300
    assert content(path.parent) == before


def written_on(path: Path) -> None:
    """What a recorder does that runs still."""
    os.utime(path, (1.0, 1.0))


def ended(path: Path) -> None:
    """What SQLite does when the last program closes a database: what lies beside it goes."""
    path.with_name(f"{path.name}-wal").unlink(missing_ok=True)


@pytest.mark.parametrize("meanwhile", [written_on, ended])
def test_a_database_that_changes_while_it_is_copied_is_refused(
    meanwhile: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = killed(tmp_path, "WAL", 300)
    copy = shutil.copyfile

    def slow(source: Path, target: Path) -> None:
        copy(source, target)
        meanwhile(path)

    monkeypatch.setattr(databases.shutil, "copyfile", slow)
    with pytest.raises(BagError, match=r"a\.db3 is being written\. Stop the recorder"):
        bags.read(path)


@pytest.fixture
def left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What a recorder left that was killed, where `temporary` beside it is the directory for temporary files."""
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return killed(tmp_path, "WAL", 300)


@pytest.fixture
def copied(left: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the files that are copied from there."""
    names: list[str] = []
    copy = shutil.copyfile

    def noted(source: Path, target: Path) -> None:
        names.append(source.name)
        copy(source, target)

    monkeypatch.setattr(databases.shutil, "copyfile", noted)
    return names


def test_a_command_copies_a_database_once(tmp_path: Path, left: Path, copied: list[str]) -> None:
    """`bdnn info` opens it for its topics, then for its messages."""
    assert main(["info", str(left)]) == 0
    assert copied == ["a.db3", "a.db3-wal"]
    assert not any((tmp_path / "temporary").iterdir())


def test_copies_are_kept_as_long_as_their_database_is_the_same(
    tmp_path: Path, left: Path, copied: list[str]
) -> None:
    with bags.copies_kept():
        assert len(bags.read(left)) == len(bags.read(left)) == 600
        assert len(copied) == 2
        left.with_name("a.db3-wal").write_bytes(b"cut off")
        assert len(bags.read(left)) == 300
        assert len(copied) == 4
    assert len(bags.read(left)) == len(bags.read(left)) == 300
    assert len(copied) == 8
    assert not any((tmp_path / "temporary").iterdir())


def test_a_copy_that_fails_leaves_nothing(
    tmp_path: Path, left: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(source: Path, target: Path) -> None:
        target.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(databases.shutil, "copyfile", full)
    with bags.copies_kept():
        with pytest.raises(UsageError, match="there is no room"):
            bags.read(left)
        assert not any((tmp_path / "temporary").iterdir())


def test_no_room_for_the_copy_is_no_damage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(source: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    path = killed(tmp_path, "WAL", 300)
    monkeypatch.setattr(databases.shutil, "copyfile", full)
    with pytest.raises(UsageError, match=r"there is no room in .*TMPDIR"):
        bags.read(path)
