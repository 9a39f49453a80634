"""The status that the node publishes on /diagnostics once a second, and the warnings in its log."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import listed
from bdnn_ros.nodes.error_now import ErrorNow
from bdnn_ros.nodes.unusable import Unusable
from bdnn_ros.online.session import Session
from bdnn_ros.online.stream.intake import CommandIntake
from bdnn_ros.physical.model import PhysicalModel

NAME = "bdnn: identification"
SILENCE = 2.0
"""Without a joint state for so long [s], the stream counts as broken."""
PERSISTENCE = 5.0
"""An effort command that was refused, or a drive that repeats itself, is told of for so long [s]."""
THROTTLE = 10.0
"""Warnings about the same go to the log so often at most [s]."""


NO_SENSOR = (
    "No effort comes for {} (NaN throughout): not measured there. The others are learned and diagnosed."
)
NO_CHANGE = (
    "The effort of {} never changes while the robot moves: not measured there. "
    "What is measured is learned and diagnosed."
)
REPEATS = "{} repeated the last reading while the robot moved: such moments are left out. Check the driver and the bus."
SILENT = "No joint state comes."
UNSTAMPED = "joint_states comes without stamps: when it was sent stands for them. Let the driver stamp at measurement."


class Warnings:
    """Writes warnings to the log without repeating the same one every second.

    Args:
        log: writes one warning.
    """

    def __init__(self, log: Callable[[str], object]) -> None:
        self._log = log
        self._said: dict[str, tuple[str, float]] = {}

    def say(self, subject: str, sentence: str, again: bool = False, ends: bool = False) -> None:
        """Log a sentence on a subject, unless it is the one logged last for that subject.

        Args:
            again: log it even if it is the same, at most once in `THROTTLE` [s].
            ends: an empty sentence means that the problem is over: it is logged anew if it returns.
        """
        before, since = self._said.get(subject, ("", -math.inf))
        now = time.monotonic()
        if ends and not sentence:
            self._said[subject] = "", since
        if sentence and now - since >= THROTTLE and (again or sentence != before):
            self._said[subject] = sentence, now
            self._log(sentence)


class Repetitions:
    """Joints whose drive repeated its last reading within the last `PERSISTENCE` [s] while the robot moved."""

    def __init__(self) -> None:
        self._known: dict[str, int] = {}
        self._since: dict[str, float] = {}

    def look(self, repeated: Mapping[str, int]) -> str:
        """The complaint about them, by the number of samples left out of each joint so far; empty if there is none."""
        now = time.monotonic()
        self._since |= {joint: now for joint, count in repeated.items() if count > self._known.get(joint, 0)}
        self._known = dict(repeated)
        recent = [joint for joint in repeated if now - self._since[joint] < PERSISTENCE]
        return REPEATS.format(listed(recent)) if recent else ""


class Refusals:
    """Effort commands that were refused within the last `PERSISTENCE` [s]."""

    def __init__(self) -> None:
        self._count = 0
        self._since = -math.inf

    def look(self, commands: CommandIntake | None) -> tuple[str, bool]:
        """The complaint about them, empty if there is none; and whether more were refused since the last call."""
        count = sum(dict(commands.rejected).values()) if commands else 0
        more, self._count = count > self._count, count
        now = time.monotonic()
        if more:
            self._since = now
        recent = commands is not None and count and now - self._since < PERSISTENCE
        return commands.complaint if commands and recent else "", more


class Reporter:
    """Builds the diagnostic status from the counts of the session.

    Args:
        session: that counts.
        log: writes a warning.
        name: full name of the node, which tells several apart.
    """

    def __init__(self, session: Session, log: Callable[[str], object], name: str) -> None:
        self._session = session
        self._name = name
        self._without_stamp = 0
        self._warnings = Warnings(log)
        self._refusals = Refusals()
        self._unusable = Unusable()
        self._repetitions = Repetitions()
        self._received = 0
        self._progress = time.monotonic()
        self._looked = time.monotonic()

    def status(
        self,
        error: ErrorNow,
        active: bool,
        trouble: str,
        message_lost: int,
        unheard: str = "",
        refused: str = "",
    ) -> DiagnosticStatus:
        """The status now.

        Args:
            active: the node is in the lifecycle state active.
            trouble: what keeps the node from working, one sentence; empty if nothing does.
            message_lost: messages that the middleware reported as lost.
            unheard: which publisher is not received and what to do, one sentence; empty if all are.
            refused: why a new robot description was refused; empty if none was.
        """
        now = time.monotonic()
        rate = self._rate(now, active)
        lacking, still = _without_effort(self._session)
        values = self._values(error.nrmse, rate, message_lost, (*lacking, *still))
        since = now - self._progress
        silence = since if since > SILENCE else 0.0
        strange = self._session.watch.strange if silence else ""
        self._warnings.say("silence", f"{SILENT} {strange}".rstrip() if silence else "", ends=True)
        stream = " ".join(filter(None, (refused, *self._complaints(unheard, lacking, still))))
        beside = " ".join(filter(None, (strange, refused, unheard)))
        level, message = self._verdict(active, trouble, silence, stream, beside)
        pairs = [KeyValue(key=key, value=_text(value)) for key, value in values.items()]
        return DiagnosticStatus(level=level, name=NAME, message=message, hardware_id=self._name, values=pairs)

    def _rate(self, now: float, active: bool) -> float:
        """Joint states per second since the last look [Hz]."""
        intake = self._session.intake
        received = intake.received if intake else 0
        rate = max(received - self._received, 0) / max(now - self._looked, 1e-3)
        listens = active and intake is not None and self._session.supervisor.alive
        if received != self._received or not listens:  # fewer, where the stream began anew
            self._progress = now
        self._received, self._looked = received, now
        return rate

    def _complaints(self, unheard: str, lacking: Sequence[str], still: Sequence[str]) -> list[str]:
        """Complaints about the incoming data, empty strings where there are none; they are logged, too."""
        session, intake, say = self._session, self._session.intake, self._warnings.say
        complaint, more = self._refusals.look(session.commands)
        unstamped = self._look_for_stamps()
        unusable = self._unusable.look(intake, session.learning)
        repeating = self._repetitions.look(session.counts.repeated)
        small = session.smoother.complaint(intake.ring.most) if intake else ""
        say("quality of service", unheard)
        say("stamps", unstamped)
        say("buffer", small)
        say("use", unusable)
        say("repeated", repeating)
        say("joints", session.watch.complaint)
        say("absent", session.watch.absent)
        say("commands", f"effort_commands: {complaint}" if more else "", again=True)
        say("without effort", NO_SENSOR.format(listed(lacking)) if lacking else "")
        say("unchanged effort", NO_CHANGE.format(listed(still)) if still else "")
        return [complaint, unheard, unstamped, unusable, repeating, small]

    def _values(
        self, nrmse: np.ndarray, rate: float, message_lost: int, without_effort: Sequence[str]
    ) -> dict[str, object]:
        """The numbers, at the last look."""
        session = self._session
        intake, commands, served = session.intake, session.commands, session.served
        rejected = dict(intake.rejected) if intake else {}
        if commands is not None:
            rejected |= {f"command_{reason}": count for reason, count in dict(commands.rejected).items()}
        known = nrmse[np.isfinite(nrmse)]
        return {
            "samples_received": self._received,
            "samples_lost": intake.clock.lost if intake else 0,
            "samples_rejected": sum(rejected.values()),
            "model_version": served.number if served else 0,
            "effort_nrmse": f"{known.mean():.4g}" if len(known) else math.nan,
            "trainer_alive": session.supervisor.alive,
            **{f"rejected_{reason}": count for reason, count in sorted(rejected.items())},
            **(
                {f"effort_nrmse_{j}": f"{x:.4g}" for j, x in zip(intake.joints, nrmse, strict=False)}
                if intake and len(nrmse) == len(intake.joints)
                else {}
            ),
            "joints_left_out": ", ".join((*session.left_out, *session.led)),
            "joints_without_effort": ", ".join(without_effort),
            "stream_rate": f"{rate:.1f}",
            "stream_pauses": intake.clock.pauses if intake else 0,
            "stream_clock_restarts": intake.clock.restarts if intake else 0,
            "stream_messages_lost": message_lost,
            **({"commands_received": commands.received} if commands else {}),
            "samples_buffered": intake.ring.written - intake.ring.consumed if intake else 0,
            "samples_unlearned": session.counts.overrun,
            **{f"samples_repeated_{joint}": count for joint, count in session.counts.repeated.items()},
            "model_age": f"{self._looked - served.since:.1f}" if served else math.nan,
            "model_samples": served.samples if served else 0,
            "model_origin": served.origin if served else "",
            **(setup(served.model) if served else {}),
            "updates_rejected": session.counts.updates_rejected,
            "training": session.learning,
            "trainer_restarts": session.supervisor.restarts,
        }

    def _look_for_stamps(self) -> str:
        """What is wrong with the stamps since the last look, empty if nothing is."""
        intake = self._session.intake
        before, self._without_stamp = self._without_stamp, intake.unstamped if intake else 0
        return UNSTAMPED if self._without_stamp > before else ""

    def _verdict(
        self, active: bool, trouble: str, silence: float, stream: str, beside: str
    ) -> tuple[bytes, str]:
        session = self._session
        if trouble:
            return DiagnosticStatus.ERROR, trouble
        if session.counts.trouble:
            return DiagnosticStatus.ERROR, session.counts.trouble
        if not active:
            return DiagnosticStatus.OK, "inactive"
        if session.robot is None:
            return DiagnosticStatus.WARN, ". ".join(filter(None, ("waiting for robot_description", beside)))
        if session.intake is None:
            return DiagnosticStatus.WARN, ". ".join(filter(None, ("waiting for joint states", beside)))
        if not session.supervisor.alive:
            why = session.supervisor.trouble
            return DiagnosticStatus.WARN, f"the trainer is being started{f' again ({why})' if why else ''}"
        if silence:
            silent = f"no joint state for {silence:.0f} s"
            return DiagnosticStatus.WARN, ". ".join(filter(None, (silent, beside)))
        watch = session.watch
        told = (session.counts.unlike, stream, watch.complaint, watch.absent)
        if any(told):
            return DiagnosticStatus.WARN, " ".join(filter(None, told))
        if session.counts.updates_rejected and session.counts.reason:
            return DiagnosticStatus.OK, f"an update was refused: {session.counts.reason}"
        return DiagnosticStatus.OK, "training" if session.learning else "serving, training is paused"


def _without_effort(session: Session) -> tuple[list[str], list[str]]:
    """Joints in use without an effort sensor: those whose effort never came, and those whose effort never changed."""
    intake = session.intake
    if intake is None:
        return [], []
    silent = intake.silent
    lacking, still = (
        [intake.joints[k] for k in np.flatnonzero(which)] for which in (silent.joints, silent.still)
    )
    return lacking, still


def setup(model: Dynamics) -> dict[str, object]:
    """The base tilt [deg] and joint zeros [rad] ([m]) that were identified; only values that differ from the description."""
    if not isinstance(model, PhysicalModel):
        return {}
    angles = zip(("roll", "pitch"), model.tilt, strict=True) if model.leans else ()
    return {
        **{f"base_{name}_deg": f"{math.degrees(angle):.2f}" for name, angle in angles},
        **{f"zero_of_{model.joints[joint]}": f"{value:.4f}" for joint, value, _ in model.zeros},
    }


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
