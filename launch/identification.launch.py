"""The identification node beside a robot: `ros2 launch bdnn_ros identification.launch.py`."""

from launch.actions import DeclareLaunchArgument
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
    "model_directory": ("", "where models are kept; empty keeps none"),
    "use_sim_time": ("false", "take the time from /clock"),
}
REMAPPED = ("joint_states", "effort_commands", "robot_description")


def generate_launch_description() -> LaunchDescription:
    """The node with its arguments."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text)
        for name, (value, text) in ARGUMENTS.items()
    ]
    node = LifecycleNode(
        package="bdnn_ros",
        executable="identification_node",
        name="identification_node",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("params_file"),
            {
                "model_directory": ParameterValue(LaunchConfiguration("model_directory"), value_type=str),
                "use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool),
            },
        ],
        remappings=[(name, LaunchConfiguration(name)) for name in REMAPPED],
        output="screen",
    )
    return LaunchDescription([*declared, node])
