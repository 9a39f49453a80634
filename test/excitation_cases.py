"""A diagnosis with open questions, for the tests of excitation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

UNITS = {
    "coulomb": "N*m",
    "viscous": "N*m*s/rad",
    "offset": "N*m",
    "mass": "kg",
    "com_x": "m",
    "com_y": "m",
    "com_z": "m",
    "start_value": "N*m*s/rad",
    "end_value": "N*m*s/rad",
    "cutoff": "Hz",
}


def place(effect: str, joint: str | None = None, link: str | None = None, p: float = 0.5) -> dict[str, Any]:
    return {"effect": effect, "joint": joint, "link": link, "probability": p}


def finding(of: dict[str, Any], parameters: dict[str, float], *rivals: dict[str, Any]) -> dict[str, Any]:
    quantities = {
        name: {"value": v, "std": 0.1 * abs(v), "unit": UNITS[name]} for name, v in parameters.items()
    }
    return {**of, "parameters": quantities, "share": 0.5, "rivals": list(rivals), "sentence": "Something is."}


def write_diagnosis(
    path: Path, joints: tuple[str, ...], *findings: dict[str, Any], urdf: str = "", noise: float = 0.05
) -> Path:
    content = {
        "format": "bdnn_ros/diagnosis",
        "version": 1,
        "source": {"bags": ["bag"], "joints": list(joints), "urdf": urdf},
        "verdict": "explained",
        "findings": list(findings),
        "effort_rmse": {"noise_floor": [noise] * len(joints)},
    }
    path.write_text(json.dumps(content))
    return path
