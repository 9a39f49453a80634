"""A model's files for other programs: URDF, MuJoCo model, effects.yaml."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from bdnn_ros.extension.effects_file import effects_text
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.mjcf import beside_mjcf, extended_mjcf
from bdnn_ros.extension.urdf import beside_urdf, extended_urdf
from bdnn_ros.written import whole

EFFECTS = "effects.yaml"
ROBOTS = ("urdf", "mjcf")
"""Formats that hold links and joints."""


def write_model_files(
    model: ExtendedModel, out: Path, stem: str = "extended", formats: Collection[str] = ROBOTS
) -> list[Path]:
    """Write an extended model as URDF, MuJoCo model and effects; each file whole or not at all.

    Args:
        model: what is written.
        out: the directory.
        stem: of the names of the URDF and the MuJoCo model.
        formats: which of the two are written; effects.yaml has what the first of them cannot say.
    """
    urdf = f"{stem}.urdf" if "urdf" in formats else ""
    mjcf = f"{stem}.mjcf.xml" if "mjcf" in formats else ""
    beside = beside_urdf(model)
    in_mjcf = beside_mjcf(beside)
    if not urdf:
        beside = [effect for effect in beside if effect not in in_mjcf]
    texts = {EFFECTS: effects_text(beside, model.robot, in_mjcf, urdf, mjcf)}
    if mjcf:
        texts = {mjcf: extended_mjcf(model), **texts}
    if urdf:
        texts = {urdf: extended_urdf(model), **texts}
    out.mkdir(parents=True, exist_ok=True)
    return [write_text(out / name, text) for name, text in texts.items()]


def write_text(path: Path, text: str) -> Path:
    """Write a text file, whole or not at all."""
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> Path:
    """Write a file, whole or not at all."""
    with whole(path) as beside:
        beside.write_bytes(content)
    return path
