"""Positions of single joints of a bag, whichever messages hold them and whether or not those can be merged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bdnn_ros.bags.clock import begun, stamped
from bdnn_ros.bags.joint_states import Samples
from bdnn_ros.bags.reading import Progress, collected
from bdnn_ros.bags.selection import Selection
from bdnn_ros.readings import credible
from bdnn_ros.recording import Recording, cleaned, renamed


def read_positions(
    path: str | Path, selection: Selection, progress: Progress | None = None
) -> list[Recording]:
    """A recording of its position alone for each of the selected joints that the bag has a position of.

    Samples that are implausible or late are dropped, and what follows a clock reset is appended after what came before.

    Raises:
        UsageError, BagError: as `read`.
    """
    states, _, _ = collected(path, selection, progress)
    new = dict(zip(states.joints, renamed(states.joints, selection.rename), strict=True))
    joints = selection.joints
    clocked, _ = stamped(str(path), states.samples([[old] for old, joint in new.items() if joint in joints]))
    return [_recording(str(path), new[one.joints[0]], one) for one in clocked if credible(one.position).any()]


def _recording(name: str, joint: str, samples: Samples) -> Recording:
    """The positions of one joint."""
    epoch = begun(samples.stamp)
    time = (samples.stamp - epoch) * 1e-9
    found, _ = cleaned(time, [joint], samples.position, name=name, drop_invalid=True)
    return replace(found, epoch=epoch)
