"""Executable `replay_node`, see `replay`."""

from __future__ import annotations

import sys

from bdnn_ros.nodes.entering import enter


def main(arguments: list[str] | None = None) -> int:
    """Entry point."""
    return enter("bdnn_ros.nodes.replay", arguments)


if __name__ == "__main__":
    sys.exit(main())
