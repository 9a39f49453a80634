"""The identification node and a bag played at it: `ros2 launch bdnn_ros replay.launch.py bag:=PATH`."""

from typing import Any, List  # noqa: UP035 - launch knows the lists of typing only

from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription

ARGUMENTS = {
    "bag": (None, "an .mcap file, a rosbag2 directory or a .db3 file"),
    "rate": ("1.0", "speed, as a multiple of the bag's own"),
    "urdf_file": ("", "URDF; empty takes the bag's own"),
    "joint_states_topic": ("/joint_states", "topic of the joint states in the bag"),
    "effort_commands_topic": ("", "topic of the effort commands in the bag; empty plays none"),
    "effort_source": ("measured", "measured takes the joint states' efforts, command the played commands"),
    "joints": (
        "['']",
        "joints to identify, as [a, b], in the order of the commands; [''] takes those that move",
    ),
    "loop": ("false", "start over at the end"),
    "use_sim_time": ("false", "play the bag's stamps on /clock and let the node take its time from there"),
    "model_directory": ("", "where the model is kept; empty keeps none"),
}


def generate_launch_description() -> LaunchDescription:
    """Both nodes; everything ends with the bag."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=text)
        for name, (value, text) in ARGUMENTS.items()
    ]

    def argument(name: str, kind: Any = str) -> ParameterValue:
        return ParameterValue(LaunchConfiguration(name), value_type=kind)

    identification = LifecycleNode(
        package="bdnn_ros",
        executable="identification_node",
        name="identification_node",
        namespace="",
        parameters=[
            {
                "urdf_file": argument("urdf_file"),
                "effort_source": argument("effort_source"),
                "joints": argument("joints", List[str]),  # noqa: UP006
                "model_directory": argument("model_directory"),
                "use_sim_time": argument("use_sim_time", bool),
            }
        ],
        output="screen",
    )
    player = Node(
        package="bdnn_ros",
        executable="replay_node",
        name="replay_node",
        parameters=[
            {
                "bag": argument("bag"),
                "rate": argument("rate", float),
                "urdf_file": argument("urdf_file"),
                "joint_states_topic": argument("joint_states_topic"),
                "effort_commands_topic": argument("effort_commands_topic"),
                "loop": argument("loop", bool),
                "clock": argument("use_sim_time", bool),
            }
        ],
        output="screen",
    )
    end = RegisterEventHandler(
        OnProcessExit(target_action=player, on_exit=[EmitEvent(event=Shutdown(reason="the bag has ended"))])
    )
    return LaunchDescription([*declared, identification, player, end])
