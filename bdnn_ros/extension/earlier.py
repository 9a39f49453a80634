"""An extended model in recordings of another time, its sensors aside."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from bdnn_ros.diagnosis.compared import Compared
from bdnn_ros.effects.drift import Drift
from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed, get

if TYPE_CHECKING:
    from bdnn_ros.extension.extended import ExtendedModel

Known = tuple[Installed, Mapping[str, float]]
"""An effect with the standard deviations of its values, where they are known."""
AT_SENSORS = frozenset({"effort_scale", "effort_delay", "velocity_filter"})
"""Effects that are taken out of recordings, or told apart from what was found in them."""
IN_ZEROS = "position_offset"


def known_effects(model: ExtendedModel) -> list[Known]:
    """A model's effects, each with its standard deviations."""
    return list(zip(model.effects, model.stds or ({},) * len(model.effects), strict=True))


def with_effects(model: ExtendedModel, known: Iterable[Known]) -> ExtendedModel:
    """A model with these effects alone."""
    pairs = list(known)
    return replace(model, effects=tuple(e for e, _ in pairs), stds=tuple(std for _, std in pairs))


def at_another_time(model: ExtendedModel) -> tuple[ExtendedModel, list[Known]]:
    """A model as it predicts what acts along a motion of another time, and what its sensors do beside.

    What pushed has ended, what drifted stays where it ended, and its encoders' zeros are its robot's.
    """
    lasting = [one for before in known_effects(model) for one in _lasting(*before)]
    offsets = Plant(model.bare)
    for effect, _ in lasting:
        if effect.effect.name == IN_ZEROS:
            effect.install(offsets)
    aside = {IN_ZEROS, *AT_SENSORS}
    acting = with_effects(model, (one for one in lasting if one[0].effect.name not in aside))
    zeros = model.bare.zeros + offsets.position_offset
    sensors = [one for one in lasting if one[0].effect.name in AT_SENSORS]
    return replace(acting, bare=replace(model.bare, zeros=zeros)), sensors


def compared(model: ExtendedModel) -> Compared:
    """A model as recordings of another time are compared with it."""
    acting, sensors = at_another_time(model)
    plant = Plant(acting.bare)
    for effect, _ in sensors:
        effect.install(plant)
    held = (*acting.beside_robot, *(effect for effect, _ in sensors))
    return Compared(acting, acting.robot, plant.scale, plant.delay, plant.velocity_cutoff, held)


def _lasting(effect: Installed, std: Mapping[str, float]) -> list[Known]:
    """What is left of an effect once its recording is over."""
    if effect.effect.timed:
        return []
    if not isinstance(effect.effect, Drift):
        return [(effect, std)]
    lasting = get(str(effect.effect.settles_into))
    (name,) = (parameter.name for parameter in lasting.parameters)
    spread = {name: std["end_value"]} if "end_value" in std else {}
    return [(Installed(lasting, effect.target, effect.link, {name: effect.values["end_value"]}), spread)]
