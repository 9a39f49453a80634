"""A change of the robot as a finding of diagnosis.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from bdnn_ros.online.changed.hypotheses import Explanation
from bdnn_ros.online.changed.scene import Scene
from bdnn_ros.robot import PER_LINK
from bdnn_ros.robot.units import along, printed


def finding(
    scene: Scene, best: Explanation, rivals: tuple[Explanation, ...], before: np.ndarray
) -> dict[str, Any]:
    """The change as a finding.

    Args:
        best: what changed.
        rivals: what else it might be.
        before: base parameters before it, (P,).
    """
    if best.kind == "friction":
        entry = _friction(scene, best, before)
    else:
        entry = {"payload": _payload, "push": _push}[best.kind](scene, best)
    odds = np.exp([e.evidence - best.evidence for e in (best, *rivals)])
    probability = odds / odds.sum()
    entry |= {
        "share": float(np.clip(best.share, 0.0, 1.0)),
        "probability": float(probability[0]),
        "rivals": [
            {**_where(scene, rival), "probability": float(p)}
            for rival, p in zip(rivals, probability[1:], strict=True)
        ],
    }
    return entry


def _where(scene: Scene, found: Explanation) -> dict[str, Any]:
    effect = {"payload": "payload", "friction": "drift", "push": "external_wrench"}[found.kind]
    joint = scene.robot.joints[found.target] if found.kind == "friction" else None
    return {"effect": effect, "joint": joint, "link": None if joint else scene.links[found.target]}


def _quantity(value: float, std: float, unit: str) -> dict[str, Any]:
    return {"value": float(f"{value:.6g}"), "std": float(f"{std:.3g}"), "unit": unit}


def _moment(value: float, std: float) -> dict[str, Any]:
    """A stream time: to the millisecond however long the stream is."""
    return {"value": round(value, 3), "std": std, "unit": "s"}


def _payload(scene: Scene, found: Explanation) -> dict[str, Any]:
    """A payload gripped (mass added) or released (mass removed)."""
    mass = float(found.value[0])
    released = mass < 0
    centre = found.value[1:4] / mass
    std = np.sqrt(np.diagonal(found.covariance))
    time = "end" if released else "start"
    parameters = {
        "mass": _quantity(abs(mass), std[0], "kg"),
        **{f"com_{axis}": _quantity(centre[k], std[1 + k] / abs(mass), "m") for k, axis in enumerate("xyz")},
        time: _moment(found.start, 0.25),
    }
    link = scene.links[found.target]
    verb = "released" if released else "gripped"
    sentence = f"{link} {verb} {abs(mass):.2f} kg (± {std[0]:.2f}) at {found.start:.1f} s."
    return {**_where(scene, found), "parameters": parameters, "sentence": sentence}


def _friction(scene: Scene, found: Explanation, before: np.ndarray) -> dict[str, Any]:
    """The friction parameter of a joint that changed most."""
    n = scene.width
    index = n * PER_LINK + np.array([1, 2, 3]) * n + found.target
    std = np.sqrt(np.diagonal(found.covariance))
    which = int(np.argmax(np.abs(found.value) / scene.changed("friction", found.target)[1].diagonal() ** 0.5))
    name = ("viscous friction", "Coulomb friction", "effort offset")[which]
    unit = along(("N*m*s/rad", "N*m", "N*m")[which], bool(scene.robot.slides[found.target]))
    old, new = before[index[which]], before[index[which]] + found.value[which]
    parameters = {
        "start_value": _quantity(old, std[which], unit),
        "end_value": _quantity(new, std[which], unit),
        "start": _moment(found.start, 0.5),
    }
    joint = scene.robot.joints[found.target]
    sentence = f"{joint} drifts: its {name} went from {old:.3g} to {new:.3g} {printed(unit)} since {found.start:.1f} s."
    return {**_where(scene, found), "parameters": parameters, "sentence": sentence}


def _push(scene: Scene, found: Explanation) -> dict[str, Any]:
    """A temporary external wrench."""
    std = np.sqrt(np.diagonal(found.covariance))
    names = [f"{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz"]
    units = ["N"] * 3 + ["N*m"] * 3
    parameters = {
        "start": _moment(found.start, 0.25),
        "end": _moment(found.end, 0.25),
        **{
            name: _quantity(value, spread, unit)
            for name, value, spread, unit in zip(names, found.value, std, units, strict=True)
        },
    }
    force = ", ".join(
        f"{value:.1f} ± {spread:.1f}" for value, spread in zip(found.value[:3], std[:3], strict=True)
    )
    link = scene.links[found.target]
    sentence = f"Something pushed {link} from {found.start:.1f} s to {found.end:.1f} s with ({force}) N."
    return {**_where(scene, found), "parameters": parameters, "sentence": sentence}
