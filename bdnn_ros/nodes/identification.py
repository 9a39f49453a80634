"""`identification_node`: learns the dynamics of a robot from its joint states while it works."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.logging import get_logger
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from bdnn_ros.errors import BdnnError, UsageError, listed
from bdnn_ros.nodes import parameters
from bdnn_ros.nodes.beginning import outlived, run, told
from bdnn_ros.nodes.choosing import leading, one_drive, with_joints
from bdnn_ros.nodes.configuring import session_settings
from bdnn_ros.nodes.keeping import Kept
from bdnn_ros.nodes.lane import Lane
from bdnn_ros.nodes.lifecycle import Lifecycle
from bdnn_ros.nodes.publishing import LATCHED, Publishing
from bdnn_ros.nodes.services import Services
from bdnn_ros.nodes.streams import Streams
from bdnn_ros.nodes.unheard import NOT_LATCHED, Hearing
from bdnn_ros.online import serving
from bdnn_ros.online.places import make_directory
from bdnn_ros.online.session import Session
from bdnn_ros.robot import Robot

NAME = "identification_node"
TRAINER_TIMEOUT = 10.0
"""Joint states are subscribed to when the trainer is ready, or after so long [s]."""
SWITCH_INTERVAL = 5e-4
"""Longest time another thread may hold up the stream [s]."""
HOUSEKEEPING = 1.0
COMPARED = 20.0
"""Estimates a second that only tell the error, where none is published [Hz]."""


class IdentificationNode(Lifecycle):
    """Receives joint states, has a trainer process learn a model from them, publishes estimates and answers service calls.

    Raises:
        UsageError: a parameter given at start is wrong.
    """

    def __init__(self) -> None:
        super().__init__(NAME)
        self._session: Session | None = None
        self._active = False
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.settings = parameters.Settings(
            self, parameters.IDENTIFICATION, lambda: self._session is not None, self._setting_changed
        )
        self._set_up = ExitStack()  # what ends all that configuring began, the latest first
        self._offered: Services | None = None
        self._description: Hearing | None = None
        self._streams: Streams | None = None
        self._trouble = ""
        self._message_lost = 0
        self._opening: Any = None
        self._complained = self._refused = ""
        self.failed = False

    # -- lifecycle -------------------------------------------------------------------------------

    @told
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the trainer, offer services and topics."""
        settings = self.settings
        session = Session(session_settings(settings), training=settings["training"])
        self._kept = Kept(settings["model_directory"], session, self._log)
        self._set_up.callback(self._kept.leave)
        try:
            if settings["model_directory"]:
                make_directory(settings["model_directory"])
            if settings["effort_source"] == serving.COMMANDED and not settings["joints"]:
                raise UsageError(
                    "effort_source command needs the parameter joints, the order of the commands."
                )
            if settings["urdf_file"]:
                self._meet(session, Robot.from_file(settings["urdf_file"]))
        except BdnnError as error:
            self._log().error(str(error))
            self._trouble = str(error)
            self.finish()
            return TransitionCallbackReturn.FAILURE
        self._trouble = self._complained = self._refused = ""
        session.start()
        self._session = session
        self._publishing = Publishing(self, session)
        self._set_up.callback(self._publishing.close)
        self._lane = Lane(self.context)
        self._set_up.callback(self._end_lane)
        if self._offered is not None:
            self._offered.withdraw()  # the last clean-up left some until refusals were sent
        self._offered = Services(
            self,
            self._lane,
            session,
            lambda: self.settings["model_directory"],
            self._kept,
            self._training_was_set,
            self._publishing.forget,
        )
        self._set_up.callback(self._offered.close)
        self._set_up.callback(self.destroy_timer, self._every(HOUSEKEEPING, self._keep_house))
        if settings["save_period"] > 0.0:
            saving = self._every(settings["save_period"], self._kept.save_meanwhile)
            self._set_up.callback(self.destroy_timer, saving)
        if not settings["urdf_file"]:
            heard = Hearing(self, String, "robot_description", self._on_description, LATCHED, NOT_LATCHED)
            self._description = heard
            self._set_up.callback(self.destroy_subscription, heard.subscription)
        self._set_up.callback(self._close_streams)
        return TransitionCallbackReturn.SUCCESS

    @told
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Subscribe once the trainer is ready: earlier messages would only fill the queue."""
        self._active = True
        self._waited_since = time.monotonic()
        self._opening = self._every(0.02, self._open)
        rate = self.settings["estimate_rate"]
        chore = self._publishing.estimate if rate > 0.0 else self._publishing.compare
        self._lane.do(chore, 1.0 / (rate or COMPARED))
        return super().on_activate(state)

    @told
    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop listening; services go on answering."""
        self._active = False
        self._close_streams()
        self._lane.do(None)
        return super().on_deactivate(state)

    @told
    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Save, end the trainer, withdraw services and topics."""
        self.finish()
        return TransitionCallbackReturn.SUCCESS

    # whatever state the node is in; after an error it can be configured anew
    on_shutdown = on_error = on_cleanup

    def finish(self) -> None:
        """Learn from the rest, save, stop the trainer, free the memory; an error in one step does not skip the others."""
        self._session, self._description, self._active = None, None, False
        self._set_up.close()

    def _end_lane(self) -> None:
        self._lane.stop()
        self.failed = self._lane.error is not None

    def _log(self) -> Any:
        """The logger; after ROS has shut down, one that does not publish to /rosout."""
        logger = self.get_logger()
        return logger if self.context.ok() else get_logger(f"{logger.name}.end")

    def _every(self, period: float, callback: Callable[[], None]) -> Any:
        """A timer on the steady clock: simulated time may stand still."""
        return self.create_timer(period, callback, clock=self._steady)

    # -- the robot -------------------------------------------------------------------------------

    def _on_description(self, message: String) -> None:
        assert self._session is not None
        self._refused, used = "", self._session.robot is not None
        try:
            self._meet(self._session, Robot.from_urdf(message.data))
        except BdnnError as error:
            sentence = f"robot_description: {error}"
            self.get_logger().error(sentence)
            if used:  # what it was to replace goes on serving
                self._refused = sentence
            else:
                self._trouble = sentence
        else:
            self._trouble = ""

    def _meet(self, session: Session, robot: Robot) -> None:
        """Set the robot up: choose the joints if parameters name them, and continue from a saved model."""
        joints = self.settings["joints"]
        self._kept.serve(with_joints(robot, joints))
        led = {} if joints else leading(robot)
        if led and led != session.led:
            self.get_logger().info(one_drive(led))
        session.led = led
        if joints and session.intake is None:
            self._begin(session, joints)

    def _begin(self, session: Session, joints: Sequence[str]) -> None:
        again = session.intake is not None
        self._complained = ""
        self._kept.begin(joints)
        self.get_logger().info(f"identifying {listed(joints, 20)}{', anew: more joints come now' * again}")

    # -- the stream ------------------------------------------------------------------------------

    def _open(self) -> None:
        """Subscribe to joint states once the trainer is ready."""
        session = self._session
        if session is None or session.robot is None:
            return
        if not session.supervisor.alive and time.monotonic() - self._waited_since < TRAINER_TIMEOUT:
            return
        self.destroy_timer(self._opening)
        self._opening = None
        gc.collect()
        gc.freeze()
        reliability = ReliabilityPolicy[self.settings["reliability"].upper()]
        profile = QoSProfile(depth=self.settings["queue_depth"], reliability=reliability)
        commands = self.settings["effort_source"] == serving.COMMANDED
        self._streams = Streams(self, self._lane, session, self._choose_joints, profile, commands)

    def _close_streams(self) -> None:
        if self._opening is not None:
            self.destroy_timer(self._opening)
            self._opening = None
        if self._streams is not None:
            self._message_lost += self._streams.lost
            self._streams.close()
            self._streams = None

    def _choose_joints(self, names: Sequence[str]) -> bool:
        """Choose the joints from the names in the first joint states that contain joints of the robot."""
        session = self._session
        if session is None or session.description is None:
            return False
        known = session.description.joints
        joints = [joint for joint in known if joint in names]
        if joints:
            self._begin(session, joints)
            return True
        complaint = f"joint_states has {listed(names, 20)}, the robot {listed(known, 20)}."
        if complaint != self._complained:
            self._complained = complaint
            self.get_logger().warning(complaint)
        return False

    def _keep_house(self) -> None:
        self._tell()
        # what outlives a collection is not looked at again: it stays short however long the node runs
        gc.collect()
        gc.freeze()

    @outlived
    def _tell(self) -> None:
        if self._streams is not None:
            self._streams.look_around()
        lost = self._message_lost + (self._streams.lost if self._streams else 0)
        unheard = self._streams.complaint if self._streams else ""
        if self._description is not None and self._session is not None and self._session.robot is None:
            unheard = self._description.look()  # the streams wait for the robot
        self._publishing.tell(self._active, self._trouble or self._complained, lost, unheard, self._refused)

    # -- parameters ------------------------------------------------------------------------------

    def _setting_changed(self, name: str, value: Any) -> None:
        if name == "training" and self._session is not None and value != self._session.training:
            self._session.set_training(value)

    def _training_was_set(self, on: bool) -> None:
        if self.settings["training"] != on:
            self.set_parameters([rclpy.parameter.Parameter("training", value=on)])


def main(arguments: list[str] | None) -> int:
    """Run the node until it is shut down; returns the exit status."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run(NAME, arguments, IdentificationNode, _spin, _finish)


def _spin(node: IdentificationNode) -> int:
    if node.settings["autostart"] and not node.start():
        return UsageError.exit_status
    gc.disable()  # its pauses over a growing heap hold up the stream; `_keep_house` collects instead
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    executor.spin()
    return 0


def _finish(node: IdentificationNode) -> int:
    node.finish()
    return int(node.failed)
