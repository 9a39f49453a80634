"""`replay_node`: what starts the node that plays a bag's joint states at other nodes, with the bag's own stamps."""

from __future__ import annotations

import sys

from bdnn_ros.nodes.entering import enter


def main(arguments: list[str] | None = None) -> int:
    """Entry point."""
    return enter("bdnn_ros.nodes.replay", arguments)


if __name__ == "__main__":
    sys.exit(main())
