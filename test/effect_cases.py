"""One specification of every effect and variant, on the 7-axis robot, with a motion to see it on."""

from __future__ import annotations

import numpy as np

from bdnn_ros.effects.drawing import planned
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import Installed
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import fourier

SPECS = (
    "coulomb_friction@arm7_joint2:coulomb=2",
    "viscous_friction@arm7_joint2:viscous=3",
    "stribeck_friction@arm7_joint4:coulomb=0.5,static=1,velocity=0.1",
    "asymmetric_friction@arm7_joint4:positive=1,negative=0.3",
    "load_dependent_friction@arm7_joint4:ratio=0.1",
    "quadratic_drag@arm7_joint1:drag=1",
    "hysteresis@arm7_joint1:force=1,breakaway=0.02",
    "armature@arm7_joint1:armature=0.2",
    "payload@arm7_hand:mass=1,com_x=0.02,com_z=0.1",
    "link_inertia@arm7_link4:scale=1.2",
    "base_tilt:roll_deg=5,pitch_deg=-3",
    "joint_spring@arm7_joint1:stiffness=3,rest=0.2",
    "effort_offset@arm7_joint1:offset=1",
    "effort_scale@arm7_joint2:scale=1.2",
    "effort_delay:delay=0.02",
    "effort_delay@arm7_joint3:delay=0.02",
    "cogging@arm7_joint1:amplitude=0.5,periods_per_rev=20,phase=1",
    "backlash@arm7_joint4:gap=0.01",
    "joint_elasticity@arm7_joint2:stiffness=3000",
    "position_offset@arm7_joint2:offset=0.05",
    "velocity_filter@arm7_joint1:cutoff=5",
    "external_wrench@arm7_hand:start=3,end=6,force_x=10,torque_z=1",
    "external_wrench@arm7_joint2:start=3,end=6,torque=4",
    "drift@arm7_joint2:of=coulomb,start_value=1,end_value=2",
    "drift@arm7_joint2:of=viscous,start_value=1,end_value=2",
    "drift@arm7_joint1:of=offset,start_value=-0.5,end_value=1",
)


def robot() -> Robot:
    """The 7-axis robot."""
    return Robot.bundled("arm7")


def motion(robot: Robot, seconds: float = 8.0, rate: float = 200.0, seed: int = 3) -> Motion:
    """A noise-free motion of a robot within its limits."""
    time = np.arange(round(seconds * rate)) / rate
    plan = fourier(robot, time, np.random.default_rng(seed))
    return planned(robot, time, (plan.position, plan.velocity, plan.acceleration))


def linear(one: Installed) -> tuple[np.ndarray, dict[str, float]]:
    """Linear coefficients and shape of an effect."""
    return one.effect.coefficients(one.values)
