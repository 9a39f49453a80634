"""The rigid-body robot of a URDF."""

from bdnn_ros.robot.robot import BUNDLED, PER_LINK, STANDARD_GRAVITY, Robot

__all__ = ["BUNDLED", "PER_LINK", "STANDARD_GRAVITY", "Robot"]
