"""What a regression takes from an earlier model beside its robot and its effort."""

from __future__ import annotations

from dataclasses import dataclass, field

from bdnn_ros.diagnosis.regression.load_friction import LoadFriction
from bdnn_ros.diagnosis.regression.unsure import Unsure
from bdnn_ros.physical.left_open import LeftOpen
from bdnn_ros.robot import Robot


@dataclass(frozen=True)
class Known:
    """What is known of a robot before a recording; by default what a description tells.

    Attributes:
        left_open: uncertainty of an identified model, else None.
        by_load: its load-dependent friction.
        unloaded: the robot without loads found on it, to which relative link errors refer; None for the robot itself.
        unsure: uncertainty of joint effects that an earlier diagnosis found, else None.
        lead: known lead of the recorded effort over the motion [s].
    """

    left_open: LeftOpen | None = None
    by_load: LoadFriction = field(default_factory=LoadFriction)
    unloaded: Robot | None = None
    unsure: Unsure | None = None
    lead: float = 0.0
