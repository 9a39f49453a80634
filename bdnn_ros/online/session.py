"""A live session: the stream, the trainer process and the model in service. Everything of the node that is not ROS."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from bdnn_ros.efforts import EffortConvention
from bdnn_ros.errors import DataError, UsageError
from bdnn_ros.likeness import require_arm
from bdnn_ros.models import Model, build_model, load_to_serve, save_model
from bdnn_ros.online.channel import Message
from bdnn_ros.online.course import Course
from bdnn_ros.online.estimate import Instant, Smoother
from bdnn_ros.online.order import require_joints
from bdnn_ros.online.requests import Requests
from bdnn_ros.online.serving import COMMANDED, LEARNED_HERE, Counts, Served, Settings, nominal
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.feed import Feed
from bdnn_ros.online.stream.intake import CommandIntake, Intake
from bdnn_ros.online.stream.watch import Watch
from bdnn_ros.online.supervisor import PATIENCE, Supervisor
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import with_mimics


class Session:
    """Receives the joint states of a robot, has a model learned from them, and serves the newest that passed the checks.

    One thread takes samples in (`intake.take`, `commands.take`, `instant`); it never waits there.

    Attributes:
        training: whether is learned where that is possible; see `learning`.
        description: the robot with all joints that may be used; None until it is known.
        led: joints that may not, and what each moves as well.
        robot: the robot with the joints in use.
        served: the model that answers; None until the robot is known.
        intake: counts of the stream; None until the first joint state of the robot.
        findings: what diagnoses said, for the node to take from the left.
        watch: which joints come in which messages.
        smoother: the low-pass of `instant`.
        unlearned: samples at the end that the trainer was still busy with when it was ended.
        forgotten: how often what was learned was forgotten; what was said before that holds no longer.
    """

    def __init__(self, settings: Settings, training: bool = True) -> None:
        self.settings, self.training = settings, training
        self.description: Robot | None = None
        self.led: dict[str, str] = {}
        self.robot: Robot | None = None
        self.served: Served | None = None
        self.intake: Intake | None = None
        self.commands: CommandIntake | None = None
        self.counts = Counts()
        self.findings: deque[Message] = deque(maxlen=16)
        self.supervisor = Supervisor(self._hear, self._introduce, niceness=settings.niceness)
        self.watch = Watch()
        self.forgotten = self.unlearned = 0
        self._feed: Feed | None = None
        self._given_up: list[Ring] = []
        self._turn = threading.RLock()  # what is served and what the trainer works on change together
        self.smoother = Smoother(settings.cutoff)
        self._requests = Requests()
        self._files = ThreadPoolExecutor(1, thread_name_prefix="files")
        self._course = Course()

    # -- life ------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start the trainer; it waits for a stream."""
        self.supervisor.start()

    def set_robot(self, robot: Robot) -> None:
        """Use this robot description from now on; a stream of the same joints continues.

        Raises:
            UsageError: a stream of another robot is being learned from, or there is a factor of a joint it lacks.
        """
        EffortConvention.of(self.settings.effort_factors, robot.joints)
        if self.robot is not None and robot.urdf == self.robot.urdf:
            return
        if self.intake is not None and not set(self.intake.joints) <= set(robot.joints):
            raise UsageError(
                "The new robot description lacks joints of the one in use.",
                "Restart the node for another robot.",
            )
        self.description = robot
        if self.intake is not None:
            robot = Robot.from_urdf(robot.urdf, self.intake.joints)
        with self._turn:
            self.robot, self._course.resumed = robot, None
            self.served = Served(nominal(robot), 0, time.monotonic())
            if self._feed is not None:
                self._feed.convention = self.settings.convention(robot)
                self._forget()
                self._begin_again(self._course.start, kept=self._course.kept)

    def begin(self, joints: Sequence[str]) -> None:
        """Create the ring buffers for a stream of these joints and start the trainer on it; an earlier stream ends.

        No sample may be taken in meanwhile.

        Raises:
            RobotError: the robot lacks one of them.
        """
        assert self.robot is not None and self.description is not None
        same = tuple(joints) == self.robot.joints
        robot = self.robot if same else Robot.from_urdf(self.description.urdf, joints)
        commanded, capacity = self.settings.effort_source == COMMANDED, self.settings.capacity
        states = Ring.create(capacity, 3 * len(joints))
        commands = Ring.create(capacity, len(joints)) if commanded else None
        feed = Feed(robot.joints, states, commands, convention=self.settings.convention(robot))
        with self._turn:
            if self.intake is not None:
                self._forget()
            self._given_up += self._rings
            if self.served is None or self.served.joints != robot.joints:
                self.served = Served(nominal(robot), 0, time.monotonic())
                self._course.resumed = None
            self.robot, self._feed = robot, feed
            self.intake = Intake(joints, states, needs_effort=not commanded)
            self.commands = CommandIntake(joints, commands) if commands else None
            self.watch = Watch()
            self.supervisor.ring = states
            self._begin_again(0, self._course.resumed)

    def wider(self) -> tuple[str, ...]:
        """The joints to restart with if messages contain more of the robot's joints than are in use; empty otherwise."""
        if self.intake is None or self.description is None:
            return ()
        return self.watch.look(self.intake, self.description.joints)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Joints of the description that are not in use."""
        if self.intake is None or self.description is None:
            return ()
        return tuple(joint for joint in self.description.joints if joint not in self.intake.joints)

    def stop(self, patience: float = PATIENCE) -> bool:
        """Let the trainer learn the rest and hand it over within `patience` [s], end it, and free the memory.

        Returns:
            Whether a model serves that is worth keeping: learned here, or loaded.
        """
        if not self.supervisor.stop(patience) and self.learning:
            self.unlearned = self._written - self._course.trained
        self._files.shutdown()
        self._requests.cancel()
        self._feed = None
        for ring in (*self._rings, *self._given_up):
            ring.close()
        return self.served is not None and self.served.number > 0

    @property
    def learning(self) -> bool:
        """Whether the trainer is learning: paused while the model in service is one that learning cannot continue from."""
        return self.training and (self.served is None or isinstance(self.served.model, PhysicalModel))

    @property
    def _written(self) -> int:
        return self.intake.ring.written if self.intake is not None else 0

    @property
    def _rings(self) -> list[Ring]:
        return [intake.ring for intake in (self.intake, self.commands) if intake is not None]

    def known(self) -> Robot:
        """The robot with the joints in use.

        Raises:
            UsageError: it is not known yet.
        """
        if self.robot is None:
            raise UsageError("The robot is not known yet.", "Publish robot_description, or set urdf_file.")
        return self.robot

    # -- what the model says -----------------------------------------------------------------------

    def instant(self) -> Instant | None:
        """The low-passed motion at the newest possible stamp; None if there is none."""
        if self._feed is None or self.intake is None or self.intake.clock.period <= 0.0:
            return None
        return self.smoother.newest(self._feed, self.intake.clock.period * 1e-9)

    # -- requests ----------------------------------------------------------------------------------

    def set_training(self, on: bool) -> None:
        """Resume or pause learning; samples received during a pause are not learned from."""
        with self._turn:
            if on and not self.training:
                self._course.skip(self._written, self.served)
            self.training = on
        self.supervisor.send(Message("training", {"on": self.learning}))

    def reset(self) -> None:
        """Discard what was learned: the robot description serves, and learning starts with the next sample.

        Raises:
            UsageError: the robot is not known yet.
        """
        with self._turn:
            self.served = Served(nominal(self.known()), 0, time.monotonic())
            self._forget()
            self._begin_again(self._written)

    def diagnose(self, window: float) -> Future[Message]:
        """Request a diagnosis of the last `window` [s], 0 for all that is kept.

        Raises:
            DataError: there is nobody to ask just now.
        """
        if not self.supervisor.alive:
            raise DataError("The trainer is just being started.", "Ask again in a moment.")
        number, future = self._requests.new()
        self.supervisor.send(Message("diagnose", {"window": window, "request": number}))
        return future

    def save(self, place: Callable[[], Path], model: Model | None = None) -> Future[Path]:
        """Save a model, by default the one in service by then, in the background; the future raises what `place` raises."""
        self.known()
        return self._files.submit(lambda: self.save_now(place(), model))

    def save_now(self, path: Path, model: Model | None = None) -> Path:
        """As `save`, waiting for the disk."""
        assert self.served is not None
        return save_model(path, self.served.model if model is None else model)

    def load(self, path: Path) -> Future[Model]:
        """Load a model of this robot, in any order of joints, and serve it; the future raises ModelFileError."""
        return self._files.submit(self.load_now, path)

    def read(self, path: Path) -> Model:
        """Read a model of this robot and the joints in use, in any order; raises UsageError while the joints are not known."""
        model, robot = load_to_serve(path), self.known()
        require_joints(model, robot.joints, with_mimics(Robot.from_urdf(robot.urdf)), path.name)
        require_arm(model, robot, path.name)
        return model

    def load_now(self, path: Path) -> Model:
        """As `load`, waiting for the disk."""
        with self._turn:
            model, joints = self.read(path), self.known().joints
            number = 1 + (self.served.number if self.served else 0)
            resumed = model if isinstance(model, PhysicalModel) else None
            self.served = Served(model, number, time.monotonic(), origin=str(path), joints=joints)
            self._begin_again(self._written, resumed, self._course.kept)
        return model

    # -- the trainer -------------------------------------------------------------------------------

    def _forget(self) -> None:
        self.findings.clear()
        self.counts = Counts()
        self.forgotten += 1

    def _begin_again(self, start: int, resumed: PhysicalModel | None = None, kept: int | None = None) -> None:
        self._course.begin(start, self.served.number if self.served is not None else 0, resumed, kept)
        for message in self._introduce():
            self.supervisor.send(message)

    def _introduce(self) -> Sequence[Message]:
        """The messages by which a new trainer takes over the stream."""
        with self._turn:
            if self.robot is None or self.intake is None:
                return ()
            course, arrays = self._course.introduction(self.intake.ring, self.served, self.learning)
            info = {
                "urdf": self.robot.urdf,
                "joints": list(self.robot.joints),
                **course,
                **self.settings.for_trainer(),
            }
            return (Message("begin", info, arrays, tuple(ring.descriptor for ring in self._rings)),)

    def _hear(self, message: Message) -> None:
        """Handle a message of the trainer, in the supervisor's thread; attributes are replaced as a whole."""
        with self._turn:
            self._heed(message)
        if message.kind == "lost":
            self._requests.fail(DataError("The trainer ended while it was asked.", "Ask again."))
        self._requests.answer(message)

    def _heed(self, message: Message) -> None:
        info = message.info
        if message.kind != "repeated" or info["epoch"] == self._course.epoch:
            self.counts.heed(message)
        if message.kind == "version":
            self._take_over(message)
        elif message.kind == "begun":
            while self._given_up and info["epoch"] == self._course.epoch:  # nobody reads them any more
                self._given_up.pop().close()
        elif message.kind == "findings" and self._course.tells(info):  # not of what was given up
            self._take_note(message)
        elif message.kind == "lost" and info["ran"]:  # else it is not the samples that it died of
            self._course.died()

    def _take_note(self, message: Message) -> None:
        self.findings.append(message)
        if "unlike" in message.info:  # nothing is known of it where a diagnosis failed otherwise
            self.counts.unlike = str(message.info["error"]) if message.info["unlike"] else ""

    def _take_over(self, message: Message) -> None:
        """Put a version in service if it belongs to this stream."""
        info = message.info
        if not self._course.advance(info):
            return
        model = build_model(info["kind"], message.arrays, info["model"])
        number, samples = int(info["number"]), int(info["samples"])
        self.served = Served(model, number, time.monotonic(), samples, LEARNED_HERE)
