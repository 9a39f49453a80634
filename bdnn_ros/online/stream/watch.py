"""Which of the robot's joints arrive, and which together; checked now and then beside the stream."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.errors import listed
from bdnn_ros.online.stream.assembly import Group
from bdnn_ros.online.stream.intake import JOINTS, SECOND, Intake

LEAST = 5
"""Joints come where so many messages held them since the last look."""
SLOWER = 0.45
"""Messages are put together with others whose rate is at least this part of their own."""
PATIENCE = 3
"""Looks at a stream before a joint counts as one that does not come: other drivers may start later."""
MANY = 2
"""So many times the joints in use are worth it at any rate."""
VAIN = 2.0
"""Messages do not fit together where so many times more of them wait in vain than become samples."""
REMEDY = "Publish all joints together (joint_state_publisher with source_list), or set the parameter joints."


@dataclass(frozen=True)
class Coming:
    """Joints of the robot that arrive together.

    Attributes:
        joints: their names.
        period: usual step between stamps [ns].
        measured: with the effort of some of them; one without a sensor keeps nobody from the others'.
    """

    joints: frozenset[str]
    period: float
    measured: bool


class Watch:
    """Compares what arrived since the last look with the joints in use.

    Attributes:
        complaint: what is wrong with the messages, and what to do; empty if nothing is.
        absent: which of the robot's joints do not come, and what to do; empty if all do.
        strange: which joints come where none in use does, and what to do; empty if some do, or nothing comes.
    """

    def __init__(self) -> None:
        self.complaint = self.absent = self.strange = ""
        self._looks = 0
        self._seen: set[str] = set()
        self._counts: dict[Group, int] = {}
        self._samples = 0
        self._vain = 0
        self._second = 0

    def look(self, intake: Intake, joints: Sequence[str]) -> tuple[str, ...]:
        """The joints to use instead, always more of them; empty if those in use are right.

        Args:
            intake: of the stream.
            joints: all of the robot's that may be used.
        """
        fresh = self._fresh(intake)
        groups = [coming for group in fresh if (coming := _coming(group, joints)).joints]
        self.strange = strange(fresh, intake.joints)
        samples, vain, second = intake.ring.written, intake.rejected[JOINTS], intake.rejected[SECOND]
        more = wider(groups, intake.joints, intake.needs_effort)
        if groups and not more:
            misfit = vain - self._vain > VAIN * (samples - self._samples)
            another = intake.publishers.complaint if second > self._second else ""
            self.complaint = " ".join(filter(None, (another, complaint(groups, intake.joints, misfit))))
            self._looks += 1
            if self._looks >= PATIENCE:
                here = frozenset().union(*(group.joints for group in groups))
                self.absent = absent(here, self._seen, intake.joints, joints)
        self._samples, self._vain, self._second = samples, vain, second
        return tuple(joint for joint in joints if joint in more)

    def _fresh(self, intake: Intake) -> list[Group]:
        """What came since the last look."""
        counts = {group: group.messages for group in intake.kinds.groups}
        fresh = [group for group, count in counts.items() if count - self._counts.get(group, 0) >= LEAST]
        self._counts = counts
        for group in counts:
            self._seen.update(group.latest[0])
        return fresh


def _coming(group: Group, joints: Sequence[str]) -> Coming:
    names, effort = group.latest
    ours = [k for k, name in enumerate(names) if name in joints]
    measured = len(effort) == len(names) and bool(np.isfinite(np.asarray(effort)[ours]).any())
    return Coming(frozenset(names[k] for k in ours), group.period, measured)


def wider(groups: Sequence[Coming], used: Sequence[str], needs_effort: bool) -> frozenset[str]:
    """The largest set of joints that arrives together, if it is larger than the one in use; otherwise empty.

    Messages at about the same rate are merged. Much slower ones are left out, since they would slow down all samples; so are
    those without effort where others have it.
    """
    measured = [group for group in groups if group.measured]
    usable = measured if needs_effort and measured else groups
    sets = [_together(slowest, usable) for slowest in usable]
    now = min((each.period for each in sets if each.joints >= set(used)), default=np.inf)
    sets = [
        each
        for each in sets
        if len(each.joints) > len(used)
        and (each.period <= now / SLOWER or len(each.joints) >= MANY * len(used))
    ]
    return max(sets, key=lambda each: (len(each.joints), -each.period)).joints if sets else frozenset()


def _together(slowest: Coming, groups: Sequence[Coming]) -> Coming:
    """The groups that are not slower than `slowest` and not much faster, as one."""
    alike = [group.joints for group in groups if SLOWER * slowest.period <= group.period <= slowest.period]
    return Coming(frozenset().union(*alike), slowest.period, slowest.measured)


def complaint(groups: Sequence[Coming], used: Sequence[str], misfit: bool) -> str:
    """What is wrong with the messages, one sentence, and what to do; empty if nothing is.

    Args:
        groups: what comes; at least one.
        used: the joints in use.
        misfit: most messages that hold some of them wait for the others in vain.
    """
    here = frozenset().union(*(group.joints for group in groups))
    largest = max(groups, key=lambda group: len(group.joints & set(used))).joints
    missing = [joint for joint in used if joint not in here]
    if misfit and missing:
        return f"No message holds {listed(missing)}. Start the driver, or set the parameter joints."
    apart = [joint for joint in used if joint not in largest]
    if misfit and apart:
        return f"Other messages hold {listed(apart)}, with stamps that do not fit. {REMEDY}"
    others = sorted(here - set(used))
    if others:
        return f"Other messages hold {listed(others)}, at another rate or without effort: left out. {REMEDY}"
    return ""


def strange(fresh: Sequence[Group], used: Sequence[str]) -> str:
    """Which joints arrive while none in use does, one sentence, and what to do; empty otherwise."""
    names = dict.fromkeys(name for group in fresh for name in group.latest[0])
    if not names or any(group.members for group in fresh):
        return ""
    return f"joint_states has {listed(names, 20)}; in use are {listed(used, 20)}. Let the driver publish these names."


def absent(here: Collection[str], seen: Collection[str], used: Sequence[str], joints: Sequence[str]) -> str:
    """Which joints of the robot do not arrive, with the reason, and what to do; empty if all do.

    Args:
        here: those that come.
        seen: those that some message has held.
        used: those in use.
        joints: all of the robot's that may be used.
    """
    away = [joint for joint in joints if joint not in used and joint not in here]
    never, seldom = [joint for joint in away if joint not in seen], [joint for joint in away if joint in seen]
    told = []
    if never:
        told.append(f"No message holds {listed(never)} of the robot description: left out.")
    if seldom:
        told.append(f"{listed(seldom)} came only now and then, or no longer: left out.")
    if told:
        told.append(
            "The model takes what is left out to stand still at zero, or at the nearest limit. Publish it with the "
            f"rest, or set the parameter joints to [{', '.join(used)}] if that is right."
        )
    return " ".join(told)
