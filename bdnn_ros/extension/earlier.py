"""An extended model in recordings of another time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from bdnn_ros.diagnosis.compared import Compared
from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed

if TYPE_CHECKING:
    from bdnn_ros.extension.extended import ExtendedModel

Known = tuple[Installed, Mapping[str, float]]
"""An effect with the standard deviations of its values, where they are known."""
IN_ZEROS = "position_offset"


def known_effects(model: ExtendedModel) -> list[Known]:
    """A model's effects, each with its standard deviations."""
    return list(zip(model.effects, model.stds or ({},) * len(model.effects), strict=True))


def with_effects(model: ExtendedModel, known: Iterable[Known]) -> ExtendedModel:
    """A model with these effects alone."""
    pairs = list(known)
    return replace(model, effects=tuple(e for e, _ in pairs), stds=tuple(std for _, std in pairs))


def at_another_time(model: ExtendedModel) -> ExtendedModel:
    """A model as it predicts along a motion of another time: its encoders' zeros are its robot's."""
    known = known_effects(model)
    offsets = Plant(model.bare)
    for effect, _ in known:
        if effect.effect.name == IN_ZEROS:
            effect.install(offsets)
    acting = with_effects(model, (one for one in known if one[0].effect.name != IN_ZEROS))
    zeros = model.bare.zeros + offsets.position_offset
    return replace(acting, bare=replace(model.bare, zeros=zeros))


def compared(model: ExtendedModel) -> Compared:
    """A model as recordings of another time are compared with it."""
    acting = at_another_time(model)
    return Compared(acting, acting.robot)
