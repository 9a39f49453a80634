"""From a recording to clean signals: what drivers spoil mended, low-passed, with derivatives."""

from bdnn_ros.signals.copies import without_copies
from bdnn_ros.signals.preparing import (
    CUTOFF_PER_RATE,
    DEFAULT_CUTOFF,
    LEAST_CUTOFF,
    MINIMUM_SAMPLES,
    SAMPLES_PER_CUTOFF,
    flattened,
    mended,
    prepare,
    suitable_cutoff,
    usual_cutoff,
)
from bdnn_ros.signals.signals import Signals

__all__ = [
    "CUTOFF_PER_RATE",
    "DEFAULT_CUTOFF",
    "LEAST_CUTOFF",
    "MINIMUM_SAMPLES",
    "SAMPLES_PER_CUTOFF",
    "Signals",
    "flattened",
    "mended",
    "prepare",
    "suitable_cutoff",
    "usual_cutoff",
    "without_copies",
]
