"""Results: files that appear whole, and together, or not at all."""

from __future__ import annotations

import errno
import fcntl
import os
import threading
from pathlib import Path

import pytest

from bdnn_ros.bdnn import modelfile
from bdnn_ros.cli import outputs
from bdnn_ros.errors import UsageError


def test_files_appear_whole_or_not_at_all(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), outputs.written_whole(tmp_path / "a.csv") as file:
        file.write("half")
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []
    with outputs.written_whole(tmp_path / "a.csv") as file:
        file.write("whole")
    assert (tmp_path / "a.csv").read_text() == "whole"


def test_a_link_to_a_file_stays_one(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "a.csv").write_text("old")
    for name, target in (("link.csv", "there/a.csv"), ("new.csv", "there/b.csv")):
        (tmp_path / name).symlink_to(target)
        with outputs.written_whole(tmp_path / name) as file:
            file.write("new")
        assert (tmp_path / name).is_symlink() and (tmp_path / target).read_text() == "new"
    assert sorted(path.name for path in (tmp_path / "there").iterdir()) == ["a.csv", "b.csv"]


def test_a_pipe_is_written_to_and_stays_one(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        with outputs.written_whole(pipe) as file:
            file.write("through")
        assert os.read(reader, 100) == b"through"
    finally:
        os.close(reader)
    assert pipe.is_fifo() and list(tmp_path.iterdir()) == [pipe]


def test_a_full_disk_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "new.csv"
    with pytest.raises(UsageError, match="Make room") as full, outputs.written_whole(path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert str(full.value).startswith(f"{path} cannot be written (No space left on device).")
    assert list(tmp_path.iterdir()) == []


def test_results_appear_together_or_not_at_all(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with (
        pytest.raises(UsageError, match=f"{out} cannot be written") as full,
        outputs.written_together(out) as place,
    ):
        (place / "a.txt").write_text("half")
        modelfile.write(Path("/dev/full/model.bdnn"), "bdnn", {}, {})
    assert ".new." not in str(full.value)
    assert list(tmp_path.iterdir()) == []
    for text in ("old", "new"):
        with outputs.written_together(out) as place:
            (place / "a.txt").write_text(text)
            (place / "bag").mkdir()
            (place / "bag" / text).touch()
    assert sorted(path.name for path in out.rglob("*")) == ["a.txt", "bag", "new"]
    assert (out / "a.txt").read_text() == "new"


def test_results_that_cannot_all_take_their_place_leave_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("a.txt", "c.txt"):
        (tmp_path / name).write_text("old")
    rename = os.rename

    def failing(source: Path, target: Path) -> None:
        if (source.parent.name, source.name) == ("new", "c.txt"):
            raise OSError(errno.ENOSPC, "No space left on device")
        rename(source, target)

    monkeypatch.setattr(outputs.os, "rename", failing)
    with pytest.raises(UsageError, match="No space left"), outputs.written_together(tmp_path) as place:
        for name in ("a.txt", "b.txt", "c.txt"):
            (place / name).write_text("new")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.txt": "old", "c.txt": "old"}


def test_results_written_at_once_take_their_place_one_after_the_other(tmp_path: Path) -> None:
    def write() -> None:
        with outputs.written_together(tmp_path) as place:
            (place / "a.txt").touch()

    writer, other = threading.Thread(target=write), os.open(tmp_path, os.O_RDONLY)
    fcntl.flock(other, fcntl.LOCK_EX)
    writer.start()
    writer.join(0.3)
    assert writer.is_alive() and not (tmp_path / "a.txt").exists()
    os.close(other)
    writer.join()
    assert (tmp_path / "a.txt").exists()


def test_results_are_refused_by_what_is_there_once_they_are_written(tmp_path: Path) -> None:
    def refuse() -> None:
        if (tmp_path / "a.txt").exists():
            raise UsageError("It is there.")

    with pytest.raises(UsageError), outputs.written_together(tmp_path, refuse) as slow:
        (slow / "a.txt").write_text("slow")
        with outputs.written_together(tmp_path, refuse) as fast:
            (fast / "a.txt").write_text("fast")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["fast"]


def test_a_link_among_results_stays_one(tmp_path: Path) -> None:
    """Also one that leads nowhere yet; and so does a link in the directory's place."""
    elsewhere = tmp_path / "elsewhere"
    (tmp_path / "out").symlink_to("real/out")
    for text in ("old", "new"):
        with outputs.written_together(tmp_path / "out") as place:
            for name in ("a.txt", "b.txt"):
                (place / name).write_text(text)
        if text == "old":
            (tmp_path / "out" / "a.txt").unlink()
            (tmp_path / "out" / "a.txt").symlink_to(elsewhere / "a.txt")
    assert (tmp_path / "out").is_symlink() and (tmp_path / "real" / "out" / "a.txt").is_symlink()
    assert (elsewhere / "a.txt").read_text() == (tmp_path / "out" / "b.txt").read_text() == "new"
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a.txt", "b.txt"]


def test_a_link_in_a_place_that_cannot_be_one_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "round").symlink_to("round")
    (tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("file/out")
    with pytest.raises(UsageError, match="round is a link that leads nowhere"):
        outputs.require_directory(tmp_path / "round" / "out")
    for refused in (outputs.require_directory, outputs.require_file):
        with pytest.raises(UsageError, match=f"{tmp_path / 'file'} is a file"):
            refused(tmp_path / "link" / "a.csv")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="there is no /proc here")
def test_a_place_that_takes_nothing_is_refused_before_the_work(tmp_path: Path) -> None:
    """Its permissions let root write, and a minute's work was lost."""
    with pytest.raises(
        UsageError, match=r"Nothing can be written into /proc \(.+\)\. Name another directory"
    ):
        outputs.require_directory(Path("/proc/x"))
    outputs.require_directory(tmp_path / "deep" / "out")
    assert list(tmp_path.iterdir()) == []
    outputs.require_file(Path("/dev/null"))  # a device needs no room beside it
