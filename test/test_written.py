"""Files that appear whole: what was there stays until then, and nothing is left of what failed."""

from __future__ import annotations

from pathlib import Path

import pytest

from bdnn_ros.written import whole


def test_a_file_takes_its_name_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "one.txt"
    path.write_text("old")
    with whole(path) as beside:
        beside.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new" and list(tmp_path.iterdir()) == [path]
    other = tmp_path / "other.txt"
    other.touch()
    assert path.stat().st_mode == other.stat().st_mode


def test_what_failed_leaves_the_earlier_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "one.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), whole(path) as beside:
        beside.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_two_writers_at_once_do_not_meet(tmp_path: Path) -> None:
    path = tmp_path / "one.txt"
    with whole(path) as first, whole(path) as second:
        assert first != second
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first" and list(tmp_path.iterdir()) == [path]


def test_a_link_stays_one_and_what_it_leads_to_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "link").symlink_to("there/one.txt")
    for text in ("new", "newer"):
        with whole(tmp_path / "link") as beside:
            beside.write_text(text)
        assert (tmp_path / "link").is_symlink() and (tmp_path / "there" / "one.txt").read_text() == text
    assert [path.name for path in (tmp_path / "there").iterdir()] == ["one.txt"]
