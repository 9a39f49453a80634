"""A model's files for other programs: URDF, MuJoCo model, effects.yaml."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from bdnn_ros.errors import UsageError, listed
from bdnn_ros.extension.effects_file import ALSO_IN, HELD, EffectsFile, effects_text
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.mjcf import beside_mjcf, extended_mjcf
from bdnn_ros.extension.unwritten import unwritten
from bdnn_ros.extension.urdf import beside_urdf, extended_urdf
from bdnn_ros.written import write_bytes

EFFECTS = "effects.yaml"
SUFFIXES = {"urdf": ".urdf", "mjcf": ".mjcf.xml"}
ROBOTS = tuple(SUFFIXES)
"""Formats that hold links and joints."""
EXTENDED, MODEL = "extended", "model"
"""Stems of names: of what a diagnosis writes, and of what a model is exported as."""


def write_model_files(
    model: ExtendedModel,
    out: Path,
    stem: str = EXTENDED,
    formats: Collection[str] = ROBOTS,
    beside: Sequence[str] = (),
) -> list[Path]:
    """Write an extended model as URDF, MuJoCo model and effects.yaml; each file whole or not at all.

    Args:
        model: what is written.
        out: the directory.
        stem: of the names of the URDF and the MuJoCo model.
        formats: which of the two are written; effects.yaml has what the first of them cannot say.
        beside: what the model that this one is part of has beside it, in words.
    """
    urdf, mjcf = (f"{stem}{SUFFIXES[kind]}" if kind in formats else "" for kind in ROBOTS)
    left_out = [*unwritten(model), *beside]
    effects = beside_urdf(model)
    in_mjcf = beside_mjcf(effects)
    if not urdf:
        effects = [effect for effect in effects if effect not in in_mjcf]
    texts = {EFFECTS: effects_text(effects, model.robot, in_mjcf, urdf, mjcf, left_out)}
    if mjcf:
        texts = {mjcf: extended_mjcf(model, left_out), **texts}
    if urdf:
        texts = {urdf: extended_urdf(model), **texts}
    out.mkdir(parents=True, exist_ok=True)
    return [write_bytes(out / name, text.encode()) for name, text in texts.items()]


def require_own_effects(out: Path, written: Path) -> None:
    """Refuse to replace an effects.yaml that belongs to robot files which stay in the directory.

    Args:
        out: the directory, with what is there already.
        written: another, with what is to be put there.

    Raises:
        UsageError: a robot would be left with effects that are not its own.
    """
    now, then = out / EFFECTS, written / EFFECTS
    names = [f"{stem}{suffix}" for stem in (EXTENDED, MODEL) for suffix in SUFFIXES.values()]
    staying = [name for name in names if (out / name).exists() and not (written / name).exists()]
    if not (staying and now.exists() and then.exists()):
        return
    if _says(now) not in (None, _says(then)):
        both = all((written / f"{MODEL}{suffix}").exists() for suffix in SUFFIXES.values())
        raise UsageError(
            f"{now} has the effects of {listed(staying)} there, and would no longer fit.",
            f"Name another --out{'' if both else ', or write both with --formats ' + ','.join(ROBOTS)}.",
        )


def _says(path: Path) -> list[object] | None:
    """The effects in an effects.yaml, without the names of files beside it; None if it cannot be read."""
    try:
        content = EffectsFile.read(path).content
    except UsageError:
        return None
    effects = [
        {**one, ALSO_IN: ALSO_IN in one} if isinstance(one, dict) else one for one in content["effects"]
    ]
    return [effects, content.get("joints"), content.get(HELD)]
