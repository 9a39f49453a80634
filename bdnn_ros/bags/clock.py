"""Which stamps of a bag's joint states are valid times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.bags.cdr import NANOSECONDS
from bdnn_ros.bags.joint_states import Samples


def stamped(name: str, parts: Sequence[Samples], every: bool = False) -> tuple[list[Samples], list[str]]:
    """Joint states with valid stamps: the recorder's if all header stamps are zero; single zero stamps are dropped.

    A clock that starts at zero, as in simulation, is valid.

    Args:
        every: leave out none of the first part.
    """
    if any(len(part) > 1 and not part.stamp.any() for part in parts):
        recorded = [replace(part, stamp=part.log) for part in parts]
        return recorded, [f"{name}: all header stamps are zero; the recorder's are taken."]
    kept = [part.part(told(part.stamp)) for part in parts]
    if every:
        kept[0] = parts[0]
    count, left = sum(map(len, parts)), sum(map(len, kept))
    if left == count:
        return list(parts), []
    return kept, [
        f"{name}: {count - left} of {count} header stamps are zero; these joint states are left out."
    ]


def begun(stamps: np.ndarray) -> int:
    """The first valid stamp of (N,) [ns], also if its sample is dropped later; 0 if there is none."""
    return next(iter(stamps[told(stamps)].tolist()), 0)


def told(stamps: np.ndarray) -> np.ndarray:
    """Which stamps (N,) [ns] are valid times, (N,) bool: zero is not, if the others come long after it."""
    set_ = stamps != 0
    if set_.all() or not set_.any() or stamps[set_].min() < NANOSECONDS:
        return np.ones(len(stamps), bool)
    return np.asarray(set_)
