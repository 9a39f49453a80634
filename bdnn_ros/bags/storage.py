"""The files of a bag and their serialized messages, by rosbags.

The files are opened one by one, and metadata.yaml only gives their order. So a directory is readable, too, if it lacks
metadata.yaml (files are then ordered by their first messages), if its quality-of-service profiles differ from those in the
files, and if only some of the files are compressed.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import gettempdir
from types import TracebackType
from typing import Any

import yaml
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.rosbag2.storage_mcap import McapReader

from bdnn_ros.bags import compressed
from bdnn_ros.bags.copies import copies
from bdnn_ros.bags.databases import finished, plainly_named, require_all_pages, unfinished
from bdnn_ros.bags.mixed import of_ros
from bdnn_ros.errors import BagError, BdnnError, UsageError, listed

SUFFIXES = (".mcap", ".db3")
TABLES = (".csv", ".tsv", ".txt", ".dat", ".npy", ".npz", ".mat")
"""Of files in which people keep what they logged otherwise."""
RECIPE = 'docs/on_your_robot.md, "Without a bag: from a CSV",'
JOINT_STATE = "sensor_msgs/msg/JointState"
STRING = "std_msgs/msg/String"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
READ = (JOINT_STATE, STRING, MULTI_ARRAY)
"""Types of messages that are read."""
RECOVER_SQLITE = "`sqlite3 FILE .recover`"
RECOVER_MCAP = "`mcap recover` (of the command-line tool at https://github.com/foxglove/mcap)"
"""What mends damaged files, and where that comes from if it is in no distribution."""
SPLIT = 1.0
"""Files of one bag that was split follow each other: they overlap, or leave a gap, of less than this [s]."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag: its name, message type (`package/msg/Name`) and number of messages."""

    name: str
    type: str
    count: int


class Storage:
    """An open bag: an `.mcap` file, a `.db3` file, a rosbag2 directory of either, or a directory around one.

    Raises:
        UsageError: there is nothing at the path, or nothing that is named like a bag.
        BagError: what is named like one is damaged, or no bag.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stack = ExitStack()
        self._copies = copies(self._stack)
        self._readers: list[Reader] = []

    def __enter__(self) -> Storage:
        try:
            parts, in_order = _parts(self.path)
            for part in parts:
                with _readable(part):
                    if part.suffix == compressed.SUFFIX:
                        part = self._copies.of(part, compressed.decompressed)
                    if unfinished(part):
                        part = self._copies.of(part, finished)
                    require_all_pages(part)
                    self._readers.append(self._reader(self._named(part)))
            if not in_order:
                self._readers.sort(key=lambda reader: reader.start_time)
                _require_splits(self.path, self._readers)
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def _named(self, part: Path) -> Path:
        """The file itself, or a link with a plain name: rosbags opens databases by URI, in which some characters are special."""
        odd = part.suffix == ".db3" and set(str(part)) & set("#?%")
        return self._copies.of(part, plainly_named) if odd else part

    def _reader(self, part: Path) -> Reader:
        try:
            reader = self._stack.enter_context(Reader(part))
        except (KeyError, ReaderError) as error:
            # a schema of an encoding that it does not know, or another profile of the file
            foreign = isinstance(error, KeyError) or "Profile" in str(error)
            if part.suffix != ".mcap" or not foreign:
                raise
        else:
            if not _lacks_index(reader):
                return reader
        return self._stack.enter_context(Reader(self._copies.of(part, _of_those_read)))

    @property
    def topics(self) -> list[Topic]:
        """All topics, in the order of their names."""
        found: dict[str, Topic] = {}
        for connection in (c for reader in self._readers for c in reader.connections):
            before = found[connection.topic].count if connection.topic in found else 0
            found[connection.topic] = Topic(
                connection.topic, connection.msgtype, before + connection.msgcount
            )
        return sorted(found.values(), key=lambda topic: topic.name)

    def messages(self, topics: Collection[str]) -> Iterator[tuple[str, int, bytes]]:
        """Topic, log time [ns] and bytes of each message of these topics, by log time within a file.

        Raises:
            BagError: the bag is damaged.
        """
        for reader in self._readers:
            chosen = [c for c in reader.connections if c.topic in topics]
            if not chosen:
                continue
            with _readable(self.path):
                for connection, stamp, data in reader.messages(chosen):
                    yield connection.topic, stamp, compressed.of_message(data)


def _of_those_read(part: Path, directory: Path) -> Path:
    return of_ros(part, directory, READ)


def _lacks_index(reader: Reader) -> bool:
    """Whether an MCAP file has no index of messages: rosbags skips such chunks, or requires the messages to be in order."""
    if not isinstance(reader.storage, McapReader):
        return False
    chunks = reader.storage.chunks
    return any(not chunk.channel_count for chunk in chunks) if chunks else reader.message_count > 0


@contextmanager
def _readable(path: Path) -> Iterator[None]:
    """Turn any exception into a `BagError`: on damaged files the library raises all kinds of errors."""
    try:
        yield
    except BdnnError:
        raise
    except PermissionError:
        raise UsageError(f"{path} may not be read.", "Check its permissions.") from None
    except Exception as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise UsageError(
                f"{path} is read from a copy, for which there is no room in {gettempdir()}.",
                "Make room there, or name a directory with room in the environment variable TMPDIR.",
            ) from None
        raise _damaged(path, error) from None


def _damaged(path: Path, error: Exception) -> BagError:
    size = path.stat().st_size if path.is_file() else -1
    if size == 0:
        return BagError(
            f"{path} is empty (0 bytes).", "Record it again, and stop the recorder before copying."
        )
    reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    head = b""
    if size > 0:
        with path.open("rb") as file:
            head = file.read(16)
    if size > 0 and not head.startswith((b"\x89MCAP0\r\n", b"SQLite format 3\0", compressed.MAGIC)):
        return BagError(
            f"{path} is not a bag: it is neither MCAP nor SQLite.", "Pass an .mcap, .db3 or rosbag2 folder."
        )
    packed = path.suffix == compressed.SUFFIX
    database = (path.with_suffix("") if packed else path).suffix == ".db3"
    repair = f"{'`zstd -d`, then ' * packed}{RECOVER_SQLITE if database else RECOVER_MCAP}"
    return BagError(
        f"{path} is truncated or damaged ({reason}).", f"Repair it with {repair}, or record it again."
    )


def _parts(path: Path) -> tuple[list[Path], bool]:
    """The files to open, and whether their order is certain (from metadata.yaml, or a single file)."""
    if not path.exists():
        raise UsageError(f"There is no bag {path}.", "Check the path.")
    if path.is_file():
        if not _is_part(path):
            remedy = "Pass an .mcap file, a .db3 file or a rosbag2 directory."
            if path.suffix.lower() in TABLES:
                remedy = f"Make one of it, as {RECIPE} shows."
            raise UsageError(f"{path} is not a bag.", remedy)
        return [path], True
    information = _information(path)
    paths = information.get("relative_file_paths")
    named = [path / Path(str(name)).name for name in paths] if isinstance(paths, list) else []
    # who compresses a file leaves it there until that is done
    every = (part for part in path.iterdir() if _is_part(part))
    found = sorted((p for p in every if p.suffix in SUFFIXES or not p.with_suffix("").exists()), key=_natural)
    missing = [part.name for part in named if not part.exists()]
    if missing:
        raise BagError(
            f"{path}: the file {missing[0]} that metadata.yaml names is missing.", "Copy the whole directory."
        )
    if not named and not found:
        return _parts(_inner(path))
    return named or found, bool(named)


def _inner(path: Path) -> Path:
    """The bag in a directory around it, as `bdnn simulate` makes; the current directory is never searched."""
    inner = sorted(child for child in path.iterdir() if child.is_dir() and _holds_bag(child))
    if len(inner) == 1 and path != Path():
        return inner[0]
    if inner:
        many = "several bags" if len(inner) > 1 else "a bag"
        raise UsageError(
            f"{path} holds {many} ({listed(child.name for child in inner)}).",
            "Pass one of them." if len(inner) > 1 else "Pass its name.",
        )
    raise UsageError(f"{path} is a directory without a bag.", "Pass one that holds .mcap or .db3 files.")


def _require_splits(path: Path, readers: list[Reader]) -> None:
    """Refuse files that are not splits of one recording: the same motion could otherwise be both learned and scored.

    Args:
        readers: in the order of their first messages.
    """
    filled = [reader for reader in readers if reader.message_count]
    for before, after in zip(filled[:-1], filled[1:], strict=True):
        if abs(after.start_time - before.end_time) > SPLIT * 1e9:
            names = listed(sorted(Path(str(reader.path)).name for reader in readers))
            raise UsageError(
                f"{path} holds several bags ({names}) that do not follow each other, and no metadata.yaml.",
                "Pass one of them, or several as arguments of their own.",
            )


def _natural(path: Path) -> list[tuple[str, int]]:
    """Sort key that orders numbers in names by value: part_2 before part_10."""
    return [(text, int(number or 0)) for text, number in re.findall(r"(\D*)(\d*)", path.name)]


def _holds_bag(path: Path) -> bool:
    return any(_is_part(part) for part in path.iterdir())


def _is_part(path: Path) -> bool:
    """Whether a file has the name of a bag file."""
    return (path.with_suffix("") if path.suffix == compressed.SUFFIX else path).suffix in SUFFIXES


def _information(path: Path) -> dict[str, Any]:
    """The content of metadata.yaml, empty where there is none or it does not parse."""
    try:
        content = yaml.safe_load((path / "metadata.yaml").read_text(encoding="utf-8"))
        information = content["rosbag2_bagfile_information"]
    except Exception:  # of dates, numbers and depth that cannot be, YAML raises errors of every kind
        return {}
    return information if isinstance(information, dict) else {}
