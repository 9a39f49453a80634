"""Remarks on the identified set-up of the robot: base tilt and joint zeros that differ from the description."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.remark import Remark

LINEAR = math.radians(25.0)
"""Tilts up to this angle are found to their standard deviation: what tilting adds to efforts is taken to be linear in it."""
ROUGH = 10.0
"""Larger ones are told to so many degrees."""


def tilted(model: PhysicalModel) -> Iterator[Remark]:
    """The base tilt, if it differs from the description."""
    if not model.leans:
        return
    roll, pitch = np.degrees(model.tilt)
    if math.acos(min(math.cos(model.tilt[0]) * math.cos(model.tilt[1]), 1.0)) > LINEAR:
        near = [f"{ROUGH * round(angle / ROUGH):.0f}°" for angle in (roll, pitch)]
        yield Remark(
            "",
            f"The base is tilted far, by something like roll {near[0]}, pitch {near[1]}: so large a tilt is only estimated.",
            "Mount it as it is in the robot description, and identify again.",
        )
        return
    by_roll, by_pitch = np.degrees(model.tilt_std)
    yield Remark(
        "",
        f"The base is tilted: roll {roll:.2f}° (± {by_roll:.2f}), pitch {pitch:.2f}° (± {by_pitch:.2f}).",
        "Level it, or mount it so in the robot description; the model allows for it.",
    )


def zeros_off(model: PhysicalModel) -> Iterator[Remark]:
    """Joints whose reported zero is wrong."""
    for joint, value, std in model.zeros:
        name, unit = model.joints[joint], model.position_unit(joint)
        yield Remark(
            name,
            f"{name} reports its position {value:+.4f} {unit} (± {std:.4f}) off the true one.",
            "Set its encoder's zero, or move the joint's origin in the robot description; the model allows for it.",
        )
