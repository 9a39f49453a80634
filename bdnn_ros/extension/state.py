"""Serialization of an extended model: named arrays and JSON-able information."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from bdnn_ros.bdnn.rest import RestNetwork
from bdnn_ros.diagnosis.regression.unsure import Unsure
from bdnn_ros.effects.registry import Installed
from bdnn_ros.errors import BdnnError, ModelFileError
from bdnn_ros.extension.effects_file import entry, from_entries
from bdnn_ros.extension.holding import plant_of
from bdnn_ros.extension.recorded import Recorded
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.plausible import TAKEN_OFF, require_plausible
from bdnn_ros.robot import Robot
from bdnn_ros.robot.entries import reading, require_robot, require_shapes
from bdnn_ros.robot.state import robot_from_state, robot_state

if TYPE_CHECKING:
    from bdnn_ros.extension.extended import ExtendedModel

BEYOND = "beyond."
"""Begins the names of the arrays of an identified model within."""
UNSURE = "unsure"
"""The name of the covariance of what is not known of what acts at joints."""
NETWORK = "network."
"""Begins the names of the arrays of the networks that learned what effects leave."""
RECORDED = "recorded."
"""Begins the names of the arrays of the recordings that the model was diagnosed from."""


def state_of(model: ExtendedModel) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The arrays and JSON-able information of a model."""
    arrays, info = robot_state(model.bare)
    arrays["noise"] = model.noise
    info |= {
        "effects": [entry(effect, model.bare) for effect in model.effects],
        "stds": [dict(std) for std in model.stds],
        "lead": model.lead,
        "lag": model.lag,
        "sticking": list(model.sticking),
        "creep": [list(ways) for ways in model.creep],
    }
    if model.recorded:
        info["recorded"] = [one.begin for one in model.recorded]
    for k, one in enumerate(model.recorded):
        arrays |= {f"{RECORDED}{k}.stamps": one.stamps, f"{RECORDED}{k}.position": one.position}
    if model.unsure is not None:
        info["unsure"], arrays[UNSURE] = model.unsure.to_state(model.joints), model.unsure.covariance
    info["networks"] = []
    for k, network in enumerate(model.networks):
        own, told = network.to_state()
        info["networks"].append(told)
        arrays |= {f"{NETWORK}{k}.{name}": values for name, values in own.items()}
    if model.beyond is not None:
        held, info["beyond"] = model.beyond.to_state()
        arrays |= {f"{BEYOND}{key}": value for key, value in held.items()}
    return arrays, info


def parts_of(arrays: dict[str, np.ndarray], info: dict[str, Any]) -> dict[str, Any]:
    """The arguments of `ExtendedModel`, by name, from `state_of`.

    Raises:
        ModelFileError: something is missing, does not fit or cannot be.
    """
    with reading("The extended model", "Diagnose again.", arrays, info) as (arrays, info):
        held = {key.removeprefix(BEYOND): v for key, v in arrays.items() if key.startswith(BEYOND)}
        width = len(info["joints"])
        require_robot(arrays, width)
        require_shapes(arrays, {"noise": (width,)})
        try:
            robot = robot_from_state(arrays, info)
            effects = tuple(from_entries(info["effects"], robot))
            require_plausible(robot, _bodies(robot, effects), TAKEN_OFF)
            beyond = PhysicalModel.from_state(held, info["beyond"]) if held else None
            unsure = (
                Unsure.from_state(info["unsure"], arrays[UNSURE], robot.joints) if "unsure" in info else None
            )
        except BdnnError as error:
            raise ModelFileError(
                f"The extended model is damaged: {error.problem}", "Diagnose again."
            ) from None
        if beyond is not None and beyond.joints != robot.joints:
            raise ValueError("beyond")
        sticking = tuple(float(value) for value in info.get("sticking", ()))
        if len(sticking) not in (0, width):
            raise ValueError("sticking")
        creep = tuple(tuple(map(float, ways)) for ways in info.get("creep", ()))
        if np.shape(creep) not in ((0,), (width, 3)):
            raise ValueError("creep")
        stds = tuple({str(k): float(v) for k, v in std.items()} for std in info["stds"])
        if len(stds) not in (0, len(effects)):
            raise ValueError("stds")
        return {
            "bare": robot,
            "effects": effects,
            "noise": np.asarray(arrays["noise"], float),
            "stds": stds,
            "lead": float(info["lead"]),
            "lag": float(info.get("lag", 0.0)),
            "sticking": sticking,
            "creep": creep,
            "beyond": beyond,
            "recorded": _recorded(arrays, [float(begin) for begin in info.get("recorded", ())], width),
            "unsure": unsure,
            "networks": _networks(arrays, info.get("networks", ()), width),
        }


def _networks(
    arrays: dict[str, np.ndarray], told: list[dict[str, Any]], width: int
) -> tuple[RestNetwork, ...]:
    """The networks of a model with n = `width` joints; older files have none."""
    found = []
    for k, info in enumerate(told):
        begin = f"{NETWORK}{k}."
        own = {key.removeprefix(begin): values for key, values in arrays.items() if key.startswith(begin)}
        found.append(RestNetwork.from_state(own, info, width))
    return tuple(found)


def _bodies(robot: Robot, effects: Iterable[Installed]) -> np.ndarray:
    """Inertial parameters of the bodies with the payloads of effects, (n, PER_LINK)."""
    return plant_of(robot, [effect for effect in effects if effect.effect.on_body]).robot.inertials


def _recorded(arrays: dict[str, np.ndarray], begins: list[float], width: int) -> tuple[Recorded, ...]:
    """The recordings that a model with n = `width` joints was diagnosed from; older files have none."""
    found = []
    for k, begin in enumerate(begins):
        stamps, position = arrays[f"{RECORDED}{k}.stamps"], arrays[f"{RECORDED}{k}.position"]
        if stamps.dtype != np.int64 or not stamps.ndim == 1 <= len(stamps):
            raise ValueError("recorded")
        require_shapes(arrays, {f"{RECORDED}{k}.position": (len(stamps), width)})
        found.append(Recorded(begin, stamps, np.asarray(position, float)))
    return tuple(found)
