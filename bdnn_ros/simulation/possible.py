"""Refuses effects that a simulation cannot have, or that would never act in it."""

from __future__ import annotations

from collections.abc import Iterable

from bdnn_ros.effects.registry import Installed
from bdnn_ros.errors import UsageError
from bdnn_ros.readings import MOST
from bdnn_ros.robot import Robot


def refuse_impossible(effects: Iterable[Installed], robot: Robot, duration: float) -> None:
    """Looks at the numbers of effects and at when they act.

    Args:
        duration: of the simulation [s].

    Raises:
        UsageError: a number is one that no robot has, or an effect ends before it starts or acts at another time.
    """
    for one in effects:
        what = f"{one.effect.name} at {one.place(robot)}"
        for name, value in one.values.items():
            if name != "end" and not abs(value) <= MOST:
                raise UsageError(f"{what}: {name}={value:g} is beyond any robot's.", "Give a smaller number.")
        if {"start", "end"} <= one.values.keys():
            _refuse_never(what, one.values["start"], one.values["end"], duration)


def _refuse_never(what: str, start: float, end: float, duration: float) -> None:
    if not start < end:
        raise UsageError(
            f"{what} ends at {end:g} s, not after its start at {start:g} s.", "Let it end after it starts."
        )
    if start >= duration or end <= 0.0:
        raise UsageError(
            f"{what} acts from {start:g} s to {end:g} s, the simulation from 0 s to {duration:g} s.",
            "Change its start and end, or simulate longer with --duration.",
        )
