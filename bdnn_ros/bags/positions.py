"""Where joints of a bag are, whoever tells it, and whether or not it fits to what others tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from bdnn_ros.bags.clock import begun, stamped
from bdnn_ros.bags.joint_states import Samples
from bdnn_ros.bags.reading import Progress, collected
from bdnn_ros.readings import credible
from bdnn_ros.recording import Recording, cleaned, renamed


def read_positions(
    path: str | Path,
    joint_states: str = "/joint_states",
    progress: Progress | None = None,
    *,
    rename: Sequence[str] = (),
    joints: Sequence[str],
) -> list[Recording]:
    """A recording without velocity and effort of each of some joints of which the bag holds a position.

    Of each joint what is not credible or late is left out, and what follows a clock that was set back is moved behind.

    Raises:
        UsageError, BagError: as `read`.
    """
    states, _, _ = collected(path, joint_states, None, "measured", progress)
    new = dict(zip(states.joints, renamed(states.joints, rename), strict=True))
    clocked, _ = stamped(str(path), states.samples([[old] for old, joint in new.items() if joint in joints]))
    return [_recording(str(path), new[one.joints[0]], one) for one in clocked if credible(one.position).any()]


def _recording(name: str, joint: str, samples: Samples) -> Recording:
    """The positions of one joint."""
    epoch = begun(samples.stamp)
    time = (samples.stamp - epoch) * 1e-9
    found, _ = cleaned(time, [joint], samples.position, name=name, drop_invalid=True)
    return replace(found, epoch=epoch)
