"""Entries of a file while it is read: errors name the entry that is missing or wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from bdnn_ros.errors import BdnnError, ModelFileError
from bdnn_ros.robot.robot import PER_LINK


class Entries(dict[str, Any]):
    """Entries that append each key that is looked up to a list, which several of them may share."""

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


def require_shapes(arrays: Mapping[str, np.ndarray], shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Refuses, within `reading`, arrays that would not fit one another later, where nobody expects it.

    Args:
        shapes: of the arrays that there must be, by name.

    Raises:
        KeyError: one is missing.
        ValueError: one has another shape.
    """
    for name, shape in shapes.items():
        if np.shape(arrays[name]) != shape:
            raise ValueError(name)


def require_robot(arrays: Mapping[str, np.ndarray], width: int, prefix: str = "") -> None:
    """The same for the arrays of a robot of n = `width` joints, which must be finite, too.

    Args:
        prefix: begins their names.
    """
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("armature", "viscous", "coulomb"), (width,))
    shapes |= {"inertials": (width, PER_LINK), "gravity_vector": (3,)}
    if f"{prefix}zeros" in arrays:  # files of before have none
        shapes["zeros"] = (width,)
    for name, shape in shapes.items():
        require_shapes(arrays, {prefix + name: shape})
        if not np.isfinite(arrays[prefix + name]).all():
            raise ValueError(name)
