"""The rigid-body robot of a URDF."""

from bdnn_ros.robot.robot import PER_LINK, STANDARD_GRAVITY, Robot
from bdnn_ros.robot.urdf_file import BUNDLED

__all__ = ["BUNDLED", "PER_LINK", "STANDARD_GRAVITY", "Robot"]
