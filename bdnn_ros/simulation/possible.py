"""Refuses robots and effects that cannot be simulated, and finds effects that would never act."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import Installed
from bdnn_ros.errors import RobotError, UsageError
from bdnn_ros.readings import MOST
from bdnn_ros.robot import Robot

NOTHING = 1e-14
"""Share of the robot's largest inertia up to which an inertia is rounding error."""


def refuse_without_inertia(plant: Plant, poses: np.ndarray) -> None:
    """Checks the inertia that each joint of a plant moves, at some poses, (N, n) [rad].

    Raises:
        RobotError: a joint moves no inertia, so its acceleration would be undefined.
    """
    robot = plant.robot
    geared = np.isfinite(plant.stiffness) | (plant.gap > 0.0)  # there the rotor does not move with the link
    sizes, directions = np.linalg.eigh(robot.mass_matrix(poses) - np.diag(geared * robot.armature))
    worst = int(np.argmin(sizes[:, 0] / sizes[:, -1].clip(NOTHING)))
    if sizes[worst, 0] > NOTHING * sizes[worst, -1]:
        return
    which = int(np.argmax(np.abs(directions[worst, :, 0])))
    joint = robot.joints[which]
    remedy = f"Give the links that {joint} moves an <inertial>"
    if not geared[which]:
        remedy += f", or the joint a rotor: --worn, or --effect armature@{joint}:armature=0.01"
    raise RobotError(f"Nothing that {joint} moves has any inertia: no effort is right for it.", f"{remedy}.")


def refuse_impossible(effects: Iterable[Installed], robot: Robot) -> None:
    """Checks the numbers of effects.

    Raises:
        UsageError: one is beyond any robot's, an effect ends before it starts, or two contradict each other.
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
    """A sentence for each effect that acts only outside the simulated time, 0 to `duration` [s]."""
    return [
        f"{one.effect.name} at {one.place(robot)} acts from {one.values['start']:g} s to {one.values['end']:g} s, "
        f"the simulation from 0 s to {duration:g} s."
        for one in effects
        if {"start", "end"} <= one.values.keys()
        and (one.values["start"] >= duration or one.values["end"] <= 0.0)
    ]
