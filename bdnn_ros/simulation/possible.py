"""Effects that a simulation cannot have, and those that would never act in it."""

from __future__ import annotations

from collections.abc import Iterable

from bdnn_ros.effects.registry import Installed
from bdnn_ros.errors import UsageError
from bdnn_ros.readings import MOST
from bdnn_ros.robot import Robot


def refuse_impossible(effects: Iterable[Installed], robot: Robot) -> None:
    """Looks at the numbers of effects.

    Raises:
        UsageError: one is beyond what any robot has, an effect ends before it starts, or two contradict each other.
    """
    before = set[str]()
    for one in effects:
        what = f"{one.effect.name} at {one.place(robot)}"
        if one.effect.once and what in before:
            raise UsageError(
                f"{what} is given twice, and says how things are, not what is added.",
                "Give it once, with all its numbers.",
            )
        before.add(what)
        for name, value in one.values.items():
            if name != "end" and not abs(value) <= MOST:
                raise UsageError(f"{what}: {name}={value:g} is beyond any robot's.", "Give a smaller number.")
        if {"start", "end"} <= one.values.keys() and not one.values["start"] < one.values["end"]:
            raise UsageError(
                f"{what} ends at {one.values['end']:g} s, not after its start at {one.values['start']:g} s.",
                "Let it end after it starts.",
            )


def never_acting(effects: Iterable[Installed], robot: Robot, duration: float) -> list[str]:
    """A sentence for each effect that acts at other times than those simulated, 0 to `duration` [s]."""
    return [
        f"{one.effect.name} at {one.place(robot)} acts from {one.values['start']:g} s to {one.values['end']:g} s, "
        f"the simulation from 0 s to {duration:g} s."
        for one in effects
        if {"start", "end"} <= one.values.keys()
        and (one.values["start"] >= duration or one.values["end"] <= 0.0)
    ]
