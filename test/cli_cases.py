"""A model that knows the truth, and its motion, and an arm that slides, for tests of the command and the report."""

from __future__ import annotations

import numpy as np
from bag_cases import EPOCH, PENDULUM

from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals


class Pendulum(Robot):
    """A model that knows the truth."""

    kind = "pendulum"

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, 1) [N·m]."""
        return self.inverse_dynamics(signals.position, signals.velocity, signals.acceleration)


def swing(model: Robot, duration: float = 8.0, rate: float = 200.0) -> Recording:
    """The pendulum along a sinusoid."""
    time = np.round(np.arange(0.0, duration, 1.0 / rate), 9)
    q, v = 0.8 * np.sin(2.0 * time)[:, None], 1.6 * np.cos(2.0 * time)[:, None]
    effort = model.inverse_dynamics(q, v, -4.0 * q)
    return Recording(time, model.joints, q, v, effort, name="swing", urdf=PENDULUM, epoch=EPOCH)


def sliding_arm() -> Robot:
    """An arm whose second joint slides."""
    plain = Robot.bundled("arm2").urdf
    name = plain.index('name="arm2_joint2"')
    return Robot.from_urdf(plain[:name] + plain[name:].replace('"revolute"', '"prismatic"', 1))


def two_armed() -> Robot:
    """Two arms on a torso that turns about the vertical: a tree, not a chain."""
    plain = Robot.bundled("arm2").urdf
    arm = plain[plain.index("<link ") : plain.index("</robot>")]
    sides = [arm.replace("arm2_", f"{side}_") for side in ("left", "right")]
    mounts = [
        f"""<joint name="{side}_mount" type="fixed"><parent link="torso"/><child link="{side}_link0"/>
        <origin xyz="0.1 {y} 0.3" rpy="{2 * y} 0.2 0"/></joint>"""
        for side, y in (("left", 0.25), ("right", -0.25))
    ]
    torso = """<link name="base"/><link name="torso"><inertial><mass value="12"/>
    <inertia ixx="0.3" iyy="0.3" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="turn" type="revolute"><parent link="base"/><child link="torso"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="3" effort="100"/></joint>"""
    return Robot.from_urdf("".join(['<robot name="two">', torso, *mounts, *sides, "</robot>"]))
