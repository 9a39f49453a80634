"""`identification_node`: what starts the node that learns a robot's dynamics from its joint states, beside the robot."""

from __future__ import annotations

import sys

from bdnn_ros.nodes.entering import enter


def main(arguments: list[str] | None = None) -> int:
    """Entry point."""
    return enter("bdnn_ros.nodes.identification", arguments)


if __name__ == "__main__":
    sys.exit(main())
