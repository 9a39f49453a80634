"""The identification node beside a robot: `ros2 launch bdnn_ros identification.launch.py`."""

from typing import Any

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

DEFAULTS = PathJoinSubstitution([FindPackageShare("bdnn_ros"), "config", "identification_node.yaml"])
ARGUMENTS = {
    "namespace": ("", "namespace of the robot"),
    "params_file": (DEFAULTS, "parameters of the node"),
    "joint_states": ("joint_states", "topic of sensor_msgs/JointState"),
    "effort_commands": ("effort_commands", "topic of the commanded efforts, for effort_source command"),
    "robot_description": ("robot_description", "topic of the URDF"),
    "model_directory": (
        "",
        "where models are kept; empty leaves it to params_file, whose default keeps none",
    ),
    "use_sim_time": ("", "true takes the time from /clock; empty leaves it to params_file"),
}
REMAPPED = ("joint_states", "effort_commands", "robot_description")


def generate_launch_description() -> LaunchDescription:
    """The node with its arguments."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text)
        for name, (value, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=_node)])


def _node(context: Any) -> list[LifecycleNode]:
    """The node, with what params_file says and what is given beside it."""
    node = LifecycleNode(
        package="bdnn_ros",
        executable="identification_node",
        name="identification_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("params_file"),
            *_given(context, {"model_directory": str, "use_sim_time": bool}),
        ],
        remappings=[(name, LaunchConfiguration(name)) for name in REMAPPED],
        output="screen",
    )
    return [node]


def _given(context: Any, kinds: dict[str, type]) -> list[dict[str, ParameterValue]]:
    """Parameters from arguments of these types that are given; the others stay as the file has them."""
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=kind)
        for name, kind in kinds.items()
        if context.launch_configurations[name]
    }
    return [given] if given else []
