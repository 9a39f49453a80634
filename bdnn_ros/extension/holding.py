"""Which effects a `Robot` can hold, which a `Plant` can, and which need a motion."""

from __future__ import annotations

from collections.abc import Sequence

from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed
from bdnn_ros.robot import Robot

IN_BODIES = frozenset({"payload", "link_inertia", "base_tilt"})
"""Effects that are other inertial parameters or another gravity: installing them changes the rigid robot."""
IN_ROBOT = IN_BODIES | {"armature", "viscous_friction"}
"""Effects that a robot holds once they are installed."""
IN_PLANT = IN_ROBOT | {
    "position_offset",
    "effort_scale",
    "effort_offset",
    "effort_delay",
    "velocity_filter",
}
"""Effects that a plant carries as numbers; the others are efforts, one column or more each."""
WITH_MEMORY = frozenset(
    {
        "hysteresis",
        "effort_delay",
        "external_wrench",
        "drift",
        "velocity_filter",
        "joint_elasticity",
        "backlash",
    }
)
"""Effects that need the motion's past or its clock."""


def plant_of(robot: Robot, effects: Sequence[Installed]) -> Plant:
    """A robot with effects installed, as a plant."""
    plant = Plant(robot)
    for effect in effects:
        effect.install(plant)
    return plant
