"""Remarks on the identified set-up of the robot: base tilt and joint zeros that differ from the description."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.remark import Remark


def tilted(model: PhysicalModel) -> Iterator[Remark]:
    """The base tilt, if it differs from the description."""
    if not model.leans:
        return
    (roll, pitch), (by_roll, by_pitch) = np.degrees(model.tilt), np.degrees(model.tilt_std)
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
