"""Which efforts the messages of a bag report, and which a driver only fills in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bdnn_ros.bags.joint_states import Samples


def reported_effort(name: str, samples: Samples) -> tuple[Samples, list[str]]:
    """The samples, without an effort that the messages do not report, and a note: a driver without one may say zero."""
    if samples.effort is None or np.nan_to_num(samples.effort).any():
        return samples, []
    return replace(samples, effort=None), [f"{name}: every effort is zero or NaN; taken as not measured."]
