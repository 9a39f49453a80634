"""An identified model (`PhysicalModel`) in the form of an extended model."""

from __future__ import annotations

import numpy as np

from bdnn_ros.diagnosis.recorded.compared import offsets_of
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.effects.sensing import VelocityFilter
from bdnn_ros.extension.earlier import Known
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.physical.model import PhysicalModel


def of_physical(model: PhysicalModel) -> ExtendedModel:
    """An identified model as an extended model: its effort offsets become effects, what its joints learned goes into `beyond`.

    `beyond` is set even where nothing was learned: it holds the travel over which dry friction reverses.
    """
    offsets = offsets_of(model.offset)
    stds: tuple[dict[str, float], ...] = ({},) * len(offsets)
    return ExtendedModel(model.robot, offsets, model.noise, stds, beyond=model)


def filters_of(model: PhysicalModel) -> list[Known]:
    """The low-pass filters on the reported velocities that an identified model found, as effects."""
    each = enumerate(model.velocity_cutoff.tolist())
    known = get(VelocityFilter.name)
    return [
        (Installed(known, joint, None, {"cutoff": cutoff}), {})
        for joint, cutoff in each
        if np.isfinite(cutoff)
    ]
