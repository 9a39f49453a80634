"""Runs diagnoses of the live stream beside learning: on request, and periodically."""

from __future__ import annotations

import queue
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bdnn_ros.diagnosis.recorded.excerpts import refuse_short
from bdnn_ros.errors import BdnnError
from bdnn_ros.online.channel import Channel, Message
from bdnn_ros.online.diagnosing import question
from bdnn_ros.online.noticed import Noticed, still_told
from bdnn_ros.online.stamping import diagnosis_with_stamps
from bdnn_ros.online.stream.feed import Feed
from bdnn_ros.robot import Robot

FIRST = 10.0
"""Stream time before the first diagnosis of its own accord [s]."""
MOST_WAITING = 4
MOST_CHANGES = 16
"""So many changes are told beside the last diagnosis."""
LONGEST = 600.0
"""And each no longer than this [s], where no diagnosis looks at them."""
UNTOLD = "{count} older changes are no longer told. Call ~/diagnose for what differs now."
UNDIAGNOSED = (
    "Only this change was looked at so far. Move the robot, or call ~/diagnose, for what else differs."
)
DIAGNOSIS = (sys.executable, "-m", "bdnn_ros.online.diagnosing")


@dataclass(frozen=True)
class _Job:
    robot: Robot
    feed: Feed
    window: float
    request: int
    cutoff: float | None
    epoch: int


class Analyst:
    """Runs one diagnosis at a time in a separate process, while learning continues.

    Attributes:
        since: when the robot last changed, stream time [s].
        unlike: the last diagnosis found that the stream and the robot description do not match.
    """

    def __init__(self, say: Callable[[Message], None]) -> None:
        self._say = say
        self._jobs: queue.Queue[_Job] = queue.Queue(MOST_WAITING)
        self._busy = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._robot: Robot | None = None
        self._feed: Feed | None = None
        self._cutoff: float | None = None
        self._epoch = 0
        self._period = 0.0
        self._window = 0.0
        self._due = FIRST
        self._last: dict[str, Any] = {}
        self._changes: list[Noticed] = []
        self._untold = 0
        # held while a new stream begins, and while a result of the stream is stored: never both at once
        self._merging = threading.Lock()
        self.since = 0.0
        self.unlike = False
        threading.Thread(target=self._work, name="analyst", daemon=True).start()

    def begin(self, robot: Robot, feed: Feed, info: dict[str, Any]) -> None:
        """Diagnose this stream from now on."""
        with self._merging:
            self._robot, self._feed, self._cutoff = robot, feed, info.get("cutoff")
            self._epoch = int(info["epoch"])
            self._period, self._window = float(info["diagnosis_period"]), float(info["diagnosis_window"])
            self._due = feed.latest_time() + FIRST
            self._last, self._changes, self._untold, self.unlike = {}, [], 0, False
            if info["kept"] == info["start"]:  # else the same stream goes on, with the changes seen in it
                self.since = 0.0

    def with_changes(self, changes: Sequence[Noticed]) -> dict[str, Any]:
        """Merge the last diagnosis with these changes and those noticed since it was made, sorted by share.

        Changes that a later one supersedes are dropped, and the oldest ones when there are more than `MOST_CHANGES`.
        """
        with self._merging:
            valid = still_told(self._changes, changes)
            since = max(change.seen for change in valid) - LONGEST
            self._changes = [change for change in valid if change.seen >= since][-MOST_CHANGES:]
            self._untold += len(valid) - len(self._changes)
            return self._merged()

    def _merged(self) -> dict[str, Any]:
        """The verdict is `explained` only if the last diagnosis explained everything; before the first one nothing is known."""
        findings = [change.finding for change in self._changes] + self._last.get("findings", [])
        findings.sort(key=lambda finding: -finding["share"])
        gain = 1.0 - float(np.sqrt(1.0 - max(change.finding["share"] for change in self._changes)))
        last = self._last or {"gain": {"value": gain, "interval": [gain, gain]}, "advice": [UNDIAGNOSED]}
        if self._untold:
            last = {**last, "notes": [*last.get("notes", []), UNTOLD.format(count=self._untold)]}
        explained = last.get("verdict") in ("nothing_wrong", "explained")
        return {**last, "verdict": "explained" if explained else "partly_explained", "findings": findings}

    def _take(self, told: dict[str, Any], until: float, epoch: int) -> None:
        """Store a diagnosis of the stream up to `until` [s], and add the changes that were seen later.

        A diagnosis of an earlier stream (another `epoch`) is discarded.
        """
        with self._merging:
            if epoch != self._epoch:
                return
            self.unlike = told.get("unlike", self.unlike)
            if "diagnosis" not in told:
                return
            self._last, self._untold = told["diagnosis"], 0
            self._changes = [change for change in self._changes if change.seen > until]
            if self._changes:
                told["diagnosis"] = self._merged()

    def tick(self, time: float) -> None:
        """Start the periodic diagnosis if it is due at this stream time [s]."""
        if self._period <= 0.0 or time < self._due or self._robot is None or self._busy.is_set():
            return
        self._due = time + self._period
        self.ask(self._window, 0)

    def ask(self, window: float, request: int) -> None:
        """Diagnose the last `window` [s], 0 for all that is kept; the answer carries the number `request`."""
        if self._robot is None or self._feed is None:
            self._refuse(request, "No joint state has come yet. Check the topic joint_states.")
            return
        try:
            reach = self._reach(window, request)
            self._jobs.put_nowait(_Job(self._robot, self._feed, reach, request, self._cutoff, self._epoch))
        except queue.Full:
            self._refuse(request, f"{MOST_WAITING} diagnoses are waiting already. Ask again later.")

    def _reach(self, window: float, request: int) -> float:
        """The window [s], shortened to begin after the last change of the robot, unless a client asked for it."""
        assert self._feed is not None
        unchanged = self._feed.latest_time() - self.since
        if request or self.since <= 0.0:
            return window
        return min(window, unchanged) if window > 0.0 else unchanged

    def _refuse(self, request: int, reason: str) -> None:
        self._say(Message("findings", {"request": request, "epoch": self._epoch, "error": reason}))

    def end(self) -> None:
        """Abort a running diagnosis; no process is left behind."""
        process = self._process
        if process is not None:
            process.kill()
            process.wait()

    def _work(self) -> None:
        while True:
            job = self._jobs.get()
            self._busy.set()
            until = job.feed.latest_time()
            try:
                recording = job.feed.recording(job.window)
                refuse_short([recording])  # a process takes a second to say no more than that
                told = self._answer(question(recording, job.robot, job.cutoff))
                if "diagnosis" in told:
                    told["diagnosis"] = diagnosis_with_stamps(told["diagnosis"], job.feed.states)
            except (BdnnError, OSError) as error:  # OSError: the machine has no room for another process
                told = {"error": str(error)}
            except Exception as error:  # whatever it is, who asked must hear of it, and who asks next
                traceback.print_exc()
                told = {"error": f"The diagnosis failed ({type(error).__name__})."}
            finally:
                self._busy.clear()
            self._take(told, until, job.epoch)
            self._say(Message("findings", {"request": job.request, "epoch": job.epoch, **told}))

    def _answer(self, asked: Message) -> dict[str, Any]:
        """The diagnosis, or the reason why there is none, from a process that ends with it."""
        channel, there = Channel.pair()
        with there:
            command = [*DIAGNOSIS, "--channel", str(there.fileno())]
            process = subprocess.Popen(command, pass_fds=[there.fileno()], stdin=subprocess.DEVNULL)
        self._process = process
        try:
            channel.send(asked)
            return channel.receive().info
        except ConnectionError:
            return {"error": "The process of the diagnosis was ended. Is there memory enough?"}
        finally:
            channel.close()
            process.wait()
