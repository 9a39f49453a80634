"""The rigid-body robot of a URDF."""

from bdnn_ros.robot.mounting import STANDARD_GRAVITY
from bdnn_ros.robot.robot import PER_LINK, Robot
from bdnn_ros.robot.urdf_file import BUNDLED

__all__ = ["BUNDLED", "PER_LINK", "STANDARD_GRAVITY", "Robot"]
