"""Entries of a file as they are read: which of them is missing or makes no sense, in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from bdnn_ros.errors import BdnnError, ModelFileError


class Entries(dict[str, Any]):
    """Entries that tell a list, which they may share with others, which of them was looked at last."""

    def __init__(self, entries: Mapping[str, Any], seen: list[str]) -> None:
        super().__init__(entries)
        self._seen = seen

    def __getitem__(self, key: str) -> Any:
        self._seen.append(key)
        return super().__getitem__(key)

    def get(self, key: str, default: Any = None) -> Any:
        """The entry, or the default."""
        self._seen.append(key)
        return super().get(key, default)


@contextmanager
def reading(
    what: str, remedy: str, *parts: Mapping[str, Any], error: type[BdnnError] = ModelFileError
) -> Iterator[list[Entries]]:
    """The parts of what is read, for as long as it takes: what goes wrong with one of their entries is said by name.

    Whatever a conversion dislikes, it was given the entry that was looked at last, or one just before.

    Args:
        what: begins the sentence: "The BDNN".

    Raises:
        BdnnError: the kind that `error` says; an entry is missing or makes no sense.
    """
    seen: list[str] = []
    try:
        yield [Entries(part, seen) for part in parts]
    except KeyError as missing:
        raise error(f"{what} is incomplete: it lacks {missing.args[0]}.", remedy) from None
    except (TypeError, ValueError, IndexError, AttributeError, OverflowError, RecursionError):
        where = f" at or near its entry {seen[-1]}" if seen else ""
        raise error(f"{what} is damaged{where}.", remedy) from None
