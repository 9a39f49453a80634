"""Diagnoses beside the learning: when asked, and from time to time."""

from __future__ import annotations

import queue
import re
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bdnn_ros.diagnosis.recorded.excerpts import refuse_short
from bdnn_ros.effects.environment import EDGES
from bdnn_ros.errors import BdnnError
from bdnn_ros.online.channel import Channel, Message
from bdnn_ros.online.diagnosing import question
from bdnn_ros.online.stream.buffer import Ring
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
MOMENT = re.compile(r"\b(at|from|to|until|since) (\d+\.\d+) s\b")
"""How sentences tell them."""
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


@dataclass(frozen=True)
class Noticed:
    """A change of the robot as a finding, and when it was seen, stream time [s]."""

    seen: float
    finding: dict[str, Any]

    def taken_back(self, earlier: Sequence[Noticed]) -> list[Noticed]:
        """Those of earlier ones, oldest first, of which it says what has become: more drift of its joint; at its link
        releases before and the grips whose masses are nearest to what was let go: one, the last few, or none."""
        alike = [one for one in earlier if self._is_like(one)]
        if not alike or self.finding["effect"] == "drift":
            return alike
        if not self._lets_go:
            return []
        grips = [one for one in alike if not one._lets_go]
        single = [[one] for one in reversed(grips)]
        several = [grips[k:] for k in reversed(range(len(grips) - 1))]
        gone = min([*single, *several, []], key=lambda some: abs(sum(one._mass for one in some) - self._mass))
        return [*(one for one in alike if one._lets_go), *gone]

    def _is_like(self, other: Noticed) -> bool:
        return all(self.finding[key] == other.finding[key] for key in ("effect", "joint", "link"))

    @property
    def _lets_go(self) -> bool:
        return self.finding["effect"] == "payload" and "start" not in self.finding["parameters"]

    @property
    def _mass(self) -> float:
        """Gripped, or let go [kg]."""
        return float(self.finding["parameters"]["mass"]["value"])


def still_told(told: Sequence[Noticed], changes: Sequence[Noticed]) -> list[Noticed]:
    """What was told and these changes, oldest first, without those that a later one of these takes back."""
    left = list(told)
    for change in changes:
        gone = {id(one) for one in change.taken_back(left)}
        left = [*(one for one in left if id(one) not in gone), change]
    return left


class Analyst:
    """Has one diagnosis at a time made, in a process of its own; learning goes on beside it.

    Attributes:
        since: when the robot last changed, stream time [s].
        unlike: the stream and the robot description do not go together, by the last diagnosis.
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
        self._merging = (
            threading.Lock()
        )  # a stream begins, or something of it is remembered: never half of each
        self.since = 0.0
        self.unlike = False
        threading.Thread(target=self._work, name="analyst", daemon=True).start()

    def begin(self, robot: Robot, feed: Feed, info: dict[str, Any]) -> None:
        """Look at this stream from now on."""
        with self._merging:
            self._robot, self._feed, self._cutoff = robot, feed, info.get("cutoff")
            self._epoch = int(info["epoch"])
            self._period, self._window = float(info["diagnosis_period"]), float(info["diagnosis_window"])
            self._due = feed.latest_time() + FIRST
            self._last, self._changes, self._untold, self.unlike = {}, [], 0, False
            if (
                info["kept"] == info["start"]
            ):  # else the same stream goes on, and what changed in it has changed
                self.since = 0.0

    def with_changes(self, changes: Sequence[Noticed]) -> dict[str, Any]:
        """The last diagnosis with the changes that were noticed since it looked, these too, the largest share first.

        Those that a later one takes back are left out, and the oldest where they are many.
        """
        with self._merging:
            valid = still_told(self._changes, changes)
            since = max(change.seen for change in valid) - LONGEST
            self._changes = [change for change in valid if change.seen >= since][-MOST_CHANGES:]
            self._untold += len(valid) - len(self._changes)
            return self._merged()

    def _merged(self) -> dict[str, Any]:
        """All is explained only where all but the changes was: of a robot that was not diagnosed yet nobody knows."""
        findings = [change.finding for change in self._changes] + self._last.get("findings", [])
        findings.sort(key=lambda finding: -finding["share"])
        gain = 1.0 - float(np.sqrt(1.0 - max(change.finding["share"] for change in self._changes)))
        last = self._last or {"gain": {"value": gain, "interval": [gain, gain]}, "advice": [UNDIAGNOSED]}
        if self._untold:
            last = {**last, "notes": [*last.get("notes", []), UNTOLD.format(count=self._untold)]}
        explained = last.get("verdict") in ("nothing_wrong", "explained")
        return {**last, "verdict": "explained" if explained else "partly_explained", "findings": findings}

    def _take(self, told: dict[str, Any], until: float, epoch: int) -> None:
        """Remember a diagnosis of what came until a stream time [s], and add the changes that were seen later.

        One of a stream that was given up meanwhile is not remembered.
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
        """Diagnose if it is time to, at this stream time [s]."""
        if self._period <= 0.0 or time < self._due or self._robot is None or self._busy.is_set():
            return
        self._due = time + self._period
        self.ask(self._window, 0)

    def ask(self, window: float, request: int) -> None:
        """Diagnose the last `window` [s], 0 for all that is kept, and say what it found under `request`."""
        if self._robot is None or self._feed is None:
            self._refuse(request, "No joint state has come yet. Check the topic joint_states.")
            return
        try:
            reach = self._reach(window, request)
            self._jobs.put_nowait(_Job(self._robot, self._feed, reach, request, self._cutoff, self._epoch))
        except queue.Full:
            self._refuse(request, f"{MOST_WAITING} diagnoses are waiting already. Ask again later.")

    def _reach(self, window: float, request: int) -> float:
        """The window [s], cut where the robot changed, unless somebody asks for so much."""
        assert self._feed is not None
        unchanged = self._feed.latest_time() - self.since
        if request or self.since <= 0.0:
            return window
        return min(window, unchanged) if window > 0.0 else unchanged

    def _refuse(self, request: int, reason: str) -> None:
        self._say(Message("findings", {"request": request, "epoch": self._epoch, "error": reason}))

    def end(self) -> None:
        """Break off a diagnosis that is being made: no process is left."""
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
        """The diagnosis, or why there is none, from a process that is gone afterwards."""
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


def diagnosis_with_stamps(diagnosis: dict[str, Any], states: Ring) -> dict[str, Any]:
    """A diagnosis whose findings' times are the publisher's stamps [s] instead of stream time, in its sentences, too."""
    times: list[tuple[float, float]] = []
    findings = []
    for finding in diagnosis["findings"]:
        findings.append(with_stamps(finding, states))
        times += _times(finding, findings[-1])
    return {
        **diagnosis,
        "findings": findings,
        **{key: [_in_stamps(sentence, times) for sentence in diagnosis[key]] for key in ("advice", "notes")},
    }


def with_stamps(finding: dict[str, Any], states: Ring) -> dict[str, Any]:
    """A finding whose times are the publisher's stamps [s] instead of stream time, in its sentence, too."""
    parameters = dict(finding["parameters"])
    for name in EDGES:
        if name in parameters:
            time = states.origin + round(parameters[name]["value"] * 1e9)
            parameters[name] = {**parameters[name], "value": _stamp(time, states) * 1e-9}
    told = {**finding, "parameters": parameters}
    return {**told, "sentence": _in_stamps(finding["sentence"], _times(finding, told))}


def _times(finding: dict[str, Any], told: dict[str, Any]) -> list[tuple[float, float]]:
    """Each time of a finding, in stream time and as a stamp [s]."""
    before, after = finding["parameters"], told["parameters"]
    return [(before[name]["value"], after[name]["value"]) for name in EDGES if name in before]


def _in_stamps(sentence: str, times: Sequence[tuple[float, float]]) -> str:
    """A sentence that tells moments in stream time, with their stamps; durations stay as they are."""

    def stamped(match: re.Match[str]) -> str:
        word, text = match.groups()
        digits = len(text.partition(".")[2])
        time, stamp = min(times, key=lambda one: abs(float(text) - one[0]), default=(np.nan, np.nan))
        near = abs(float(text) - time) <= 10.0**-digits
        return f"{word} {stamp:.{digits}f} s" if near else match[0]

    return MOMENT.sub(stamped, sentence)


def _stamp(time: int, states: Ring) -> int:
    """The publisher's stamp of a moment of stream time [ns], counted from a sample that is still kept."""
    near = states.read(states.first_after(time - 1), 1)
    if len(near) == 0:  # it was overwritten in this instant, or has not come yet
        near = states.latest(1)
    return time + int(near.stamp[0] - near.time[0])
