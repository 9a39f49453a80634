"""The trainer process: reads the ring buffer, learns, and hands over models that passed the checks.

Started by `supervisor.Supervisor` as `python -m bdnn_ros.online.trainer`, so it shares nothing with the node and has no ROS in
it. It ends when its channel closes: no trainer outlives its node.
"""

from __future__ import annotations

import argparse
import os
import select
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np

from bdnn_ros.errors import BdnnError, UsageError
from bdnn_ros.online.analysis import Analyst
from bdnn_ros.online.channel import Channel, Message, close_all, leave_signals_to_the_node
from bdnn_ros.online.learning import Learning, Version
from bdnn_ros.online.noticed import Noticed
from bdnn_ros.online.serving import Settings
from bdnn_ros.online.stamping import with_stamps
from bdnn_ros.online.stream.buffer import Ring
from bdnn_ros.online.stream.feed import Feed
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

BATCH = 100
"""Samples taken at once; commands are looked at between batches: where there are few a second, more of them are long to learn."""
CATCHING_UP = 1.0
"""What came already is learned for so long before the end [s]: who asked for it waits, and kills what takes much longer."""
IDLE = 0.02
"""Pause when there is nothing to learn [s]."""
STANDSTILL = "Learning stands still until the node is configured with other parameters, or reset while another stream comes."


class Trainer:
    """The main loop of the process: learns between two looks at its channel.

    Attributes:
        learning: None before a stream is begun, and where nothing can be learned from it.
    """

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.training = True
        self.feed: Feed | None = None
        self.learning: Learning | None = None
        self.epoch = 0
        self._silent = np.zeros(0, bool)
        self.analyst = Analyst(self.say)
        self._missed = 0
        self._repeated: dict[str, int] = {}

    def say(self, message: Message) -> None:
        """Send a message to the node; ends the process if the node is gone."""
        try:
            self.channel.send(message)
        except ConnectionError:
            os._exit(0)

    def run(self) -> None:
        """Work until told to stop, or until the node is gone."""
        self.say(Message("ready"))
        handlers: dict[str, Callable[[Message], None]] = {
            "begin": self._begin,
            "training": self._set_training,
            "diagnose": self._diagnose,
        }
        busy = False
        while True:
            readable, _, _ = select.select([self.channel], [], [], 0.0 if busy else IDLE)
            if readable:
                message = self.channel.receive()
                if message.kind == "stop":
                    self._stop()
                    return
                handlers.get(message.kind, close_all)(message)
            busy = self._learn()

    # -- learning ----------------------------------------------------------------------------------

    def _learn(self) -> bool:
        """Learn from one batch; False if there was none."""
        if self.feed is None:
            return False
        self.feed.states.beat()
        samples = self.feed.read(BATCH)
        self.feed.states.consumed = self.feed.next
        self._missed += samples.missed
        if len(samples) == 0:
            return False
        if self.training and self.learning is not None:
            known = samples.with_effort()
            if len(known):
                self._heed(samples.silent)
            self._learn_all(self.learning.take(known.time, known.position, known.effort))
        self.analyst.tick(float(samples.time[-1]))
        return True

    def _heed(self, silent: np.ndarray) -> None:
        """Start learning again if a joint taken to have no effort sensor reports effort: zero was learned in its place.

        Args:
            silent: joints without an effort now, (n,) bool.
        """
        before, self._silent = self._silent, silent
        if self.learning is not None and (before & ~silent).any():
            self.learning = self.learning.anew()

    def _learn_all(self, versions: Iterator[Version]) -> None:
        """Hand over the versions as they are learned; if learning fails, report it once and continue without."""
        try:
            for version in versions:
                self._hand_over(version)
        except UsageError as error:
            # as a cut-off that the rate does not allow: another trainer fares no better
            self.learning = None
            self.say(Message("trouble", {"reason": f"{error} {STANDSTILL}"}))
            return
        assert self.learning is not None
        self._tell_rejected()
        self._tell_repeated()
        self._tell_changes()
        self.learning.errors.clear()

    def _hand_over(self, version: Version) -> None:
        arrays, info = version.model.to_state()
        self.say(
            Message(
                "version",
                {
                    "kind": version.model.kind,
                    "model": info,
                    "number": version.number,
                    "samples": version.samples,
                    "end": self._end(version.time),
                    "epoch": self.epoch,
                    "missed": self._missed,
                },
                arrays,
            )
        )

    def _end(self, time: float) -> int:
        """The number of the first sample after a stream time [s]."""
        assert self.feed is not None
        states = self.feed.states
        return states.first_after(states.origin + round(time * 1e9))

    def _tell_rejected(self) -> None:
        assert self.learning is not None
        for reason in self.learning.rejected:
            self.say(Message("rejected", {"reason": reason}))
        self.learning.rejected.clear()

    def _tell_repeated(self) -> None:
        """Report how many samples of which joints were left out because the drive repeated its reading, if there are more."""
        assert self.learning is not None
        robot, repeated = self.learning.identifier.robot, self.learning.identifier.stream.repeated
        told = {joint: int(count) for joint, count in zip(robot.joints, repeated, strict=True) if count}
        if told != self._repeated:
            self._repeated = told
            self.say(Message("repeated", {"samples": told, "epoch": self.epoch}))

    def _tell_changes(self) -> None:
        """Report changes of the robot, and let later diagnoses look back no further than the last one.

        Nothing is reported while the units or the robot seem to be others than described.
        """
        assert self.learning is not None and self.feed is not None
        changes = [] if self.analyst.unlike else self.learning.changes
        for change in changes:
            if change.explanation.kind != "push":
                self.analyst.since = change.explanation.start
        if changes:
            told = [Noticed(change.seen, with_stamps(change.finding, self.feed.states)) for change in changes]
            end = self._end(max(change.seen for change in changes))
            diagnosis = self.analyst.with_changes(told)
            self.say(
                Message("findings", {"request": 0, "epoch": self.epoch, "diagnosis": diagnosis, "end": end})
            )
        self.learning.changes.clear()

    def _finish(self) -> None:
        if self.learning is not None:
            self._learn_all(self.learning.finish())

    # -- commands ----------------------------------------------------------------------------------

    def _begin(self, message: Message) -> None:
        """Take over a stream: its robot and its ring buffers, from the sample `start` on."""
        info = message.info
        settings = Settings(effort_factors=tuple(info["effort_factors"]), add_gravity=info["add_gravity"])
        try:
            robot = Robot.from_urdf(info["urdf"], info["joints"])
            convention = settings.convention(robot)
            resume = PhysicalModel.from_state(message.arrays, info["resume"]) if "resume" in info else None
        except BdnnError as error:
            close_all(message)
            self.say(Message("trouble", {"reason": str(error)}))
            return
        rings = [Ring.received(descriptor) for descriptor in message.descriptors]
        self.training = bool(info["training"])
        self.epoch = int(info["epoch"])
        if info["kept"] == info["start"]:  # else the same stream goes on
            self._missed = 0
        self._repeated = {}
        self.feed = Feed(
            robot.joints,
            rings[0],
            rings[1] if len(rings) > 1 else None,
            int(info["start"]),
            convention,
            int(info["kept"]),
        )
        # of many joints, one choice of terms takes longer than a trainer may be silent
        beat = self.feed.states.beat
        self.learning = Learning(robot, info.get("cutoff"), resume, int(info["number"]), beat)
        self._silent = np.zeros(robot.width, bool)
        self.analyst.begin(robot, self.feed, info)
        self.say(Message("begun", {"epoch": self.epoch}))

    def _set_training(self, message: Message) -> None:
        self.training = bool(message.info["on"])
        if not self.training:
            self._finish()

    def _diagnose(self, message: Message) -> None:
        self.analyst.ask(float(message.info["window"]), int(message.info["request"]))

    def _stop(self) -> None:
        """Learn from what is in the buffer as far as time allows, hand it over, and end."""
        if self.training:
            if self.learning is not None:
                self.learning.identifier.hurry()
            until = time.monotonic() + CATCHING_UP
            while time.monotonic() < until and self._learn():
                pass
            self._finish()
        self.say(Message("stopped"))


def main(arguments: list[str] | None = None) -> int:
    """Entry point of the process."""
    parser = argparse.ArgumentParser(description="Trainer of an identification node; started by the node.")
    parser.add_argument("--channel", type=int, required=True, help="descriptor of the socket to the node")
    parser.add_argument("--nice", type=int, default=10, help="how much to yield to other processes, 0 to 19")
    options = parser.parse_args(arguments)
    leave_signals_to_the_node()
    os.nice(options.nice)
    threading.current_thread().name = "trainer"
    channel = Channel(socket.socket(fileno=options.channel))
    trainer = Trainer(channel)
    try:
        trainer.run()
    except ConnectionError:
        pass  # the node is gone
    finally:
        trainer.analyst.end()
        channel.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
