"""Identified parameters with their uncertainty, for parameters.json."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from bdnn_ros.physical.agreement import Agreement
from bdnn_ros.physical.combinations import combinations, unit_of
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.presliding import BREAKAWAYS, USUAL
from bdnn_ros.physical.remark import Remark

FORMAT, VERSION = "bdnn_ros/parameters", 1


def as_json(
    model: PhysicalModel, remarks: Sequence[Remark] = (), agreements: Sequence[Agreement] = ()
) -> dict[str, Any]:
    """Parameters, identifiable combinations, learned terms and remarks as plain values.

    The standard deviation of a single inertial parameter may be large although combinations are known well.
    """
    vector = model.parameters.vector()
    return {
        "format": FORMAT,
        "version": VERSION,
        "joints": list(model.joints),
        "parameters": [
            {"name": name, "value": value, "std": std, "unit": unit_of(name, model.robot)}
            for name, value, std in model.table()
        ],
        "combinations": [
            {
                "words": one.words,
                "value": one.value(vector),
                "std": one.std(model.covariance),
                "unit": one.unit,
            }
            for one in combinations(model.robot)
        ],
        "lead": {"value": model.lead, "std": model.lead_std, "unit": "s"},
        "lag": {"value": model.lag, "unit": "s"},
        "tilt": tilt_entry(model),
        "zeros": zeros_entry(model),
        "terms": [_terms(model, k) for k in range(model.robot.width)],
        "remarks": [{"about": one.about, "problem": one.problem, "remedy": one.remedy} for one in remarks],
        "agreement": [
            {
                "words": one.words,
                "unit": one.unit,
                "values": one.values.tolist(),
                "stds": one.stds.tolist(),
                "mean": one.mean,
                "spread": one.spread,
                "differs": one.differs,
                "by_motion": one.by_motion,
            }
            for one in agreements
        ],
    }


def tilt_entry(model: PhysicalModel) -> dict[str, Any]:
    """The base tilt in degrees, as plain values."""
    angles = zip(("roll", "pitch"), model.tilt, model.tilt_std, strict=True)
    return {
        name: {"value": math.degrees(value), "std": math.degrees(std), "unit": "deg"}
        for name, value, std in angles
    }


def zeros_entry(model: PhysicalModel) -> dict[str, Any]:
    """The identified joint zeros, as plain values."""
    return {
        model.joints[joint]: {"value": value, "std": std, "unit": model.position_unit(joint)}
        for joint, value, std in model.zeros
    }


def _terms(model: PhysicalModel, joint: int) -> dict[str, Any]:
    """The terms of the joint's effort beside the rigid bodies."""
    breakaway = BREAKAWAYS[model.breakaway[joint] if model.breakaway else USUAL]
    pairs = [c for c in model.motors.couplings if joint - c.joint in (0, 1)]
    return {
        "joint": model.joints[joint],
        "breakaway": breakaway,
        "learned": list(model.learned.groups[joint]) if model.learned is not None else [],
        "motor_shared_with": [model.joints[2 * c.joint + 1 - joint] for c in pairs],
    }
