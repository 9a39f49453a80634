"""Executable `identification_node`, see `identification`."""

from __future__ import annotations

import sys

from bdnn_ros.nodes.entering import enter


def main(arguments: list[str] | None = None) -> int:
    """Entry point."""
    return enter("bdnn_ros.nodes.identification", arguments)


if __name__ == "__main__":
    sys.exit(main())
