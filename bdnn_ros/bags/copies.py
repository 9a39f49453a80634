"""Temporary copies of files that cannot be read as they are, reused when a bag is opened several times."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from pathlib import Path
from tempfile import TemporaryDirectory

from bdnn_ros.bags.databases import logs

Make = Callable[[Path, Path], Path]
"""Makes a copy of a file in a directory, and says where it is."""


class Copies:
    """Copies that exist until they are closed."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._made: dict[object, Path] = {}

    def of(self, path: Path, make: Make) -> Path:
        """The copy of a file: the earlier one, unless the file or one beside it has changed."""
        state = (make, path.absolute(), _state(path))
        if state not in self._made:
            with ExitStack() as failing:
                directory = Path(failing.enter_context(TemporaryDirectory()))
                self._made[state] = make(path, directory)
                self._stack.enter_context(failing.pop_all())
        return self._made[state]

    def close(self) -> None:
        """Delete them."""
        self._made.clear()
        self._stack.close()


_kept: ContextVar[Copies | None] = ContextVar("kept", default=None)


def copies(stack: ExitStack) -> Copies:
    """The copies that `copies_kept` keeps, otherwise new ones until the stack is closed."""
    held = _kept.get()
    if held is None:
        held = Copies()
        stack.callback(held.close)
    return held


@contextmanager
def copies_kept() -> Iterator[None]:
    """Keep copies for the next time that their bags are opened: copying a long bag takes long."""
    held = Copies()
    token = _kept.set(held)
    try:
        yield
    finally:
        _kept.reset(token)
        held.close()


def _state(path: Path) -> tuple[tuple[int, int], ...]:
    """Times [ns] and sizes of a file and of those beside it."""
    found = [file.stat() for file in (path, *logs(path))]
    return tuple((file.st_mtime_ns, file.st_size) for file in found)
