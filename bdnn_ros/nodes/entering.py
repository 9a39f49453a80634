"""Entry point of all nodes. It imports little, so that Ctrl-C ends the node during the slow imports, too."""

from __future__ import annotations

import signal
from importlib import import_module

INTERRUPTED_STATUS = 128 + signal.SIGINT


def enter(module: str, arguments: list[str] | None) -> int:
    """Import the module of a node and run its `main`; returns the exit status, without a traceback after Ctrl-C."""
    try:
        node = import_module(module)
    except KeyboardInterrupt:
        return INTERRUPTED_STATUS
    return int(node.main(arguments))
