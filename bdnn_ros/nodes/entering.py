"""The entry of every node, light itself: what a node is made of takes seconds to import, which Ctrl-C may end."""

from __future__ import annotations

import signal
from importlib import import_module

INTERRUPTED_STATUS = 128 + signal.SIGINT


def enter(module: str, arguments: list[str] | None) -> int:
    """Import the module of a node and run its `main`; the exit status, with nothing printed where Ctrl-C came meanwhile."""
    try:
        node = import_module(module)
    except KeyboardInterrupt:
        return INTERRUPTED_STATUS
    return int(node.main(arguments))
