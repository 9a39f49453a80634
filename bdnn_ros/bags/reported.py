"""Efforts that messages really report, as opposed to placeholders of a driver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.bags.joint_states import Samples


def reported_effort(name: str, samples: Samples) -> tuple[Samples, list[str]]:
    """The samples without an effort that is only a placeholder (a driver without sensors may send zeros), and a note."""
    if samples.effort is None or np.nan_to_num(samples.effort).any():
        return samples, []
    return replace(samples, effort=None), [f"{name}: every effort is zero or NaN; taken as not measured."]
