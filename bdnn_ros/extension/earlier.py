"""An extended model at another time than its recordings, and on their clock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bdnn_ros.diagnosis.recorded.compared import Compared
from bdnn_ros.effects.drift import Drift
from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed, get
from bdnn_ros.effects.rigid import Payload
from bdnn_ros.errors import listed
from bdnn_ros.extension.recorded import Recorded
from bdnn_ros.recording import Recording
from bdnn_ros.signals import mended

if TYPE_CHECKING:
    from bdnn_ros.extension.extended import ExtendedModel

Known = tuple[Installed, Mapping[str, float]]
"""An effect with the standard deviations of its values, where they are known."""
AT_SENSORS = frozenset({"effort_scale", "effort_delay", "velocity_filter"})
"""Effects that are taken out of recordings, or told apart from what was found in them."""
IN_ZEROS = "position_offset"
OTHER = "{name} is none of the recordings that the model was diagnosed from: {ended}."


def known_effects(model: ExtendedModel) -> list[Known]:
    """The model's effects with their standard deviations."""
    return list(zip(model.effects, model.stds or ({},) * len(model.effects), strict=True))


def with_effects(model: ExtendedModel, known: Iterable[Known]) -> ExtendedModel:
    """The model with these effects only."""
    pairs = list(known)
    return replace(model, effects=tuple(e for e, _ in pairs), stds=tuple(std for _, std in pairs))


def at_another_time(model: ExtendedModel) -> tuple[ExtendedModel, list[Known]]:
    """The model for motion at another time, and separately the effects of its sensors.

    Pushes are over, drifts stay at their end value, and joint zeros move into the robot.
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
    """The model in the form in which new recordings are compared with it."""
    acting, sensors = at_another_time(model)
    plant = Plant(acting.bare)
    for effect, _ in sensors:
        effect.install(plant)
    loads = (one for one in acting.effects if one.effect.name == Payload.name and one.values["mass"] > 0.0)
    held = (*acting.beside_robot, *loads, *(effect for effect, _ in sensors))
    sensed = plant.scale, plant.delay, plant.velocity_cutoff
    lead, creep = acting.lead - acting.lag, np.array(acting.creep) if acting.creep else None
    learned = None if acting.beyond is None else acting.beyond.learned
    known = Compared(acting, acting.robot, *sensed, held, lead=lead, creep=creep, unloaded=acting.bare)
    return replace(known, learned=learned, unsure=acting.unsure, networks=acting.networks)


def along(model: ExtendedModel, recording: Recording) -> tuple[ExtendedModel, str]:
    """The model on the clock of a recording, and a sentence on what is left out (empty if nothing is).

    The times of its effects are those of the recordings it was diagnosed from; if these are unknown, the times are used as
    they are.
    """
    known = known_effects(model)
    changing = [effect for effect, _ in known if by_the_clock(effect)]
    if not changing or not model.recorded:
        return model, ""
    # where efforts had passed a low-pass, the model was made of what was mended
    same = _held_by(model, recording) or _held_by(model, mended(recording))
    if same:
        return with_effects(model, (one for before in known for one in _moved(*before, same, recording))), ""
    return afterwards(model), OTHER.format(name=recording.name, ended=_ended(model, changing))


def _held_by(model: ExtendedModel, recording: Recording) -> list[Recorded]:
    """Which of the model's recordings are this one, contain it, or are contained in it."""
    return [one for one in model.recorded if one.holds(recording)]


def afterwards(model: ExtendedModel) -> ExtendedModel:
    """The model after its recordings: pushes are over, drifts stay at their end value."""
    return with_effects(model, (one for before in known_effects(model) for one in _lasting(*before)))


def by_the_clock(effect: Installed) -> bool:
    """Whether an effect depends on time."""
    return effect.effect.timed or isinstance(effect.effect, Drift)


def _moved(
    effect: Installed, std: Mapping[str, float], same: Sequence[Recorded], recording: Recording
) -> list[Known]:
    """An effect on the clock of a recording that matches some of the model's: a push for each of those in which it acted."""
    if not by_the_clock(effect):
        return [(effect, std)]
    times = {name: effect.values[name] for name in ("start", "end")}
    parts = [one for one in same if one.meets(**times)] if effect.effect.timed else same[:1]
    since = [one.since(recording) for one in parts]
    by_it = [{name: time - shift for name, time in times.items()} for shift in since]
    return [(replace(effect, values={**effect.values, **moved}), std) for moved in by_it]


def _ended(model: ExtendedModel, changing: Sequence[Installed]) -> str:
    """A sentence part on what became of the time-dependent effects."""

    def places(timed: bool) -> str:
        return listed(dict.fromkeys(e.place(model.bare) for e in changing if e.effect.timed == timed), 20)

    pushed, drifted = places(True), places(False)
    said = [f"what pushed {pushed} there is over"] if pushed else []
    said += [f"what drifted there at {drifted} stays where it ended"] if drifted else []
    return ", and ".join(said)


def _lasting(effect: Installed, std: Mapping[str, float]) -> list[Known]:
    """What remains of an effect after its recording."""
    if effect.effect.timed:
        return []
    if not isinstance(effect.effect, Drift):
        return [(effect, std)]
    lasting = get(str(effect.effect.settles_into))
    (name,) = (parameter.name for parameter in lasting.parameters)
    spread = {name: std["end_value"]} if "end_value" in std else {}
    return [(Installed(lasting, effect.target, effect.link, {name: effect.values["end_value"]}), spread)]
