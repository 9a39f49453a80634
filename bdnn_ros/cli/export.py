"""`bdnn export`: a model as URDF, MuJoCo model, YAML and ONNX."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.cli import options, outputs
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import DataError, UsageError, listed
from bdnn_ros.extension.effects_file import entry
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.files import MODEL, ROBOTS, require_own_effects, write_model_files
from bdnn_ros.extension.identified import of_physical
from bdnn_ros.extension.unwritten import NETWORKS, of_joints
from bdnn_ros.models import Model, load_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import INERTIAL_NAMES
from bdnn_ros.physical.parameters_report import tilt_entry, zeros_entry
from bdnn_ros.robot import Robot
from bdnn_ros.written import write_bytes

FORMATS = (*ROBOTS, "yaml", "onnx")
PARAMETERS, GRAPH = "parameters.yaml", "inverse_dynamics.onnx"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bdnn export`."""
    options.add_model_argument(parser)
    parser.add_argument("--out", metavar="DIR", type=Path, required=True, help="directory for the files")
    parser.add_argument(
        "--formats",
        metavar="A,B",
        default=",".join(FORMATS),
        help="which of them: urdf and mjcf (with effects.yaml), yaml, onnx (default: all)",
    )


def run(args: argparse.Namespace) -> int:
    """Write the formats that the kind of model allows, and report what cannot be written."""
    formats = {name.strip() for name in args.formats.split(",") if name.strip()}
    unknown = sorted(formats - set(FORMATS))
    if not formats:
        raise UsageError("--formats names no format.", f"There are {listed(FORMATS)}.")
    if unknown:
        raise UsageError(f"There is no format {listed(unknown)}.", f"There are {listed(FORMATS)}.")
    outputs.require_directory(args.out)
    model = load_model(args.model)
    written: list[Path] = []
    with outputs.written_together(args.out) as place:
        if formats & set(ROBOTS):
            written += _write_robot(model, place, formats)
            require_own_effects(args.out, place)
        if "yaml" in formats:
            text = yaml.safe_dump(describe(model), sort_keys=False, allow_unicode=True)
            written.append(write_bytes(place / PARAMETERS, text.encode("utf-8")))
        if "onnx" in formats:
            written += _write_graph(model, place / GRAPH)
        if not written:
            raise DataError(
                f"{args.model} cannot be written as {listed(sorted(formats))}.",
                "The notes above say why; name other --formats.",
            )
    for path in written:
        print(args.out / path.name)
    return 0


def _write_robot(model: Model, out: Path, formats: set[str]) -> list[Path]:
    robot, left_out = _as_robot(model)
    if robot is None:
        options.say(left_out)
        return []
    if left_out:
        options.say(left_out)
    beside = [NETWORKS] if isinstance(model, BDNN) else []
    return write_model_files(robot, out, MODEL, formats & set(ROBOTS), beside)


def _as_robot(model: Dynamics) -> tuple[ExtendedModel | None, str]:
    """The extended model that a model is or contains, and what of the model it leaves out."""
    if isinstance(model, ExtendedModel):
        return model, "" if model.beyond is None else _beyond(model.beyond)
    if isinstance(model, Robot):
        return ExtendedModel(model, (), np.zeros(model.width)), ""
    if isinstance(model, PhysicalModel):
        return of_physical(model), _beyond(model)
    if isinstance(model, BDNN) and isinstance(model.core, PriorCore) and model.kind != "bdnn":
        inner, _ = _as_robot(model.core.prior)
        return inner, f"URDF and MJCF hold the prior only; {NETWORKS} is in the ONNX graph."
    if isinstance(model, BDNN) and isinstance(model.core, PriorCore):
        return None, "Bodies learned from the data alone are no links of a description; use the ONNX graph."
    return None, "A black box has no links or joints to write as URDF or MJCF; use the ONNX graph."


def _beyond(model: PhysicalModel) -> str:
    parts = of_joints(model)
    return f"URDF and MJCF leave out {' and '.join(parts)}; the ONNX graph has it." if parts else ""


def _write_graph(model: Model, path: Path) -> list[Path]:
    try:
        from bdnn_ros.extension.onnx_export import inverse_dynamics_graph
    except ImportError:
        options.say("ONNX is not written: the package onnx is missing (pip install 'bdnn_ros[export]').")
        return []
    try:
        graph = inverse_dynamics_graph(model)
    except DataError as error:
        options.say(f"ONNX is not written. {error}")
        return []
    forgotten = _with_memory(model)
    if forgotten:
        options.say(f"ONNX answers for one point in time: it leaves out {listed(forgotten)}.")
    return [write_bytes(path, graph.SerializeToString())]


def _with_memory(model: Model) -> list[str]:
    from bdnn_ros.extension.holding import WITH_MEMORY

    effects = model.effects if isinstance(model, ExtendedModel) else ()
    return list(dict.fromkeys(e.effect.name for e in effects if e.effect.name in WITH_MEMORY))


def describe(model: Model) -> dict[str, Any]:
    """The content of a model in plain numbers: kind, joints, parameters with standard deviations."""
    result: dict[str, Any] = {"format": "bdnn_ros/parameters", "version": 1, "kind": model.kind}
    result["joints"] = list(model.joints)
    if isinstance(model, PhysicalModel):
        result["parameters"] = {
            name: {"value": float(value), "std": float(std)} for name, value, std in model.table()
        }
        result |= {"tilt": tilt_entry(model), "zeros": zeros_entry(model)}
    elif isinstance(model, ExtendedModel):
        stds: tuple[Mapping[str, float], ...] = model.stds or ({},) * len(model.effects)
        result["effects"] = [
            {**entry(effect, model.robot), "std": {k: float(v) for k, v in std.items()}}
            for effect, std in zip(model.effects, stds, strict=True)
        ]
        result |= _bodies(model.robot)
    elif isinstance(model, BDNN):
        arrays, _ = model.to_state()
        result["core"] = "networks" if not isinstance(model.core, PriorCore) else "prior and networks"
        result["weights"] = int(sum(value.size for value in arrays.values()))
        if isinstance(model.core, PriorCore) and isinstance(model.core.prior, Robot):
            result |= _bodies(model.core.prior)
    return result


def _bodies(robot: Robot) -> dict[str, Any]:
    """Inertial and joint parameters by joint; moments and inertia about the joint's frame."""
    return {
        "bodies": {
            joint: dict(zip(INERTIAL_NAMES, map(float, values), strict=True))
            for joint, values in zip(robot.joints, robot.inertials, strict=True)
        },
        "armature": dict(zip(robot.joints, robot.armature.tolist(), strict=True)),
        "viscous": dict(zip(robot.joints, robot.viscous.tolist(), strict=True)),
        "coulomb": dict(zip(robot.joints, robot.coulomb.tolist(), strict=True)),
        "zeros": dict(zip(robot.joints, robot.zeros.tolist(), strict=True)),
        "gravity": robot.gravity_vector.tolist(),
    }
