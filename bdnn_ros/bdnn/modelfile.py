"""Model files: named arrays and their description in one safetensors file.

The JSON description is stored in the metadata of the file: a model is one file, it contains no code, and reading it executes
nothing. A SHA-256 of description and arrays reveals alterations.
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as serialized

from bdnn_ros.errors import ModelFileError
from bdnn_ros.written import whole

FILE_NAME = "model.bdnn"
SUFFIX = ".bdnn"
FORMAT = "bdnn_ros/model"
VERSION = 1
HEADER, CHECKSUM = "bdnn_ros", "bdnn_ros.sha256"
"""Keys of the file's metadata."""


def model_path(path: str | Path) -> Path:
    """The model file that a path means: the file itself, or `model.bdnn` in a directory."""
    path = Path(path)
    return path / FILE_NAME if path.is_dir() else path


def model_place(path: str | Path) -> Path:
    """The file to save a model to: the path itself if it ends in `.bdnn`, else `model.bdnn` in that directory.

    Other suffixes do not mean a file: directory names with dates, versions or numbers have dots, too.
    """
    path = Path(path)
    return path if path.suffix == SUFFIX and not path.is_dir() else path / FILE_NAME


def save(path: str | Path, kind: str, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> Path:
    """Write a model; an earlier file is kept until the new one is complete.

    Args:
        path: the `.bdnn` file, or the directory that is to hold `model.bdnn`, which is made.
        kind, arrays, info: as of `write`.

    Returns:
        The path of the file.

    Raises:
        ModelFileError: the place cannot be written to.
    """
    return write(model_place(path), kind, arrays, info)


def write(target: Path, kind: str, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> Path:
    """Write a model to exactly this file; an earlier one is kept until the new one is complete.

    Args:
        kind: what reads it back, as "bdnn".
        arrays: numeric arrays by name.
        info: what else the model is made of, JSON-able.

    Returns:
        The path of the file.

    Raises:
        ModelFileError: the place cannot be written to.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        header = json.dumps(
            {"format": FORMAT, "version": VERSION, "kind": kind, "info": info}, allow_nan=False
        )
        tensors = {key: np.ascontiguousarray(value) for key, value in arrays.items()}
        with whole(target) as beside, beside.open("wb") as file:
            file.write(serialized(tensors, {HEADER: header, CHECKSUM: checksum(header, tensors)}))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise ModelFileError(
            f"The model cannot be written to {target} ({error.strerror or error}).",
            "Make room and check permissions there, or name another place.",
        ) from error
    return target


def checksum(header: str, arrays: dict[str, np.ndarray]) -> str:
    """SHA-256, in hexadecimal, of a model's description and arrays, including their names and types."""
    digest = hashlib.sha256(header.encode())
    for name, values in sorted(arrays.items()):
        values = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
        digest.update(json.dumps([name, values.dtype.str, values.shape]).encode() + values.tobytes())
    return digest.hexdigest()


def load(path: str | Path, *, finite: bool = True) -> tuple[str, dict[str, np.ndarray], dict[str, Any]]:
    """Kind, arrays and info of a model file.

    Args:
        path: the file, or the directory that holds `model.bdnn`.
        finite: refuse arrays that hold NaN or infinity: nothing can be predicted by them.

    Raises:
        ModelFileError: it is missing, damaged, not a model, or of a later version. Files of before have no checksum: what
            was altered in these is not told here.
    """
    target = model_path(path)
    if not target.is_file():
        raise ModelFileError(
            f"There is no model at {target}.", f"Give a {FILE_NAME} file or the directory that holds it."
        )
    try:
        with safe_open(target, framework="numpy") as file:
            metadata = file.metadata() or {}
            header = json.loads(metadata.get(HEADER, "null"))
            arrays = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError, TypeError, RecursionError):
        raise ModelFileError(
            f"{target} is damaged or not a model file.", "Identify the model again."
        ) from None
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ModelFileError(f"{target} is a safetensors file, but not a model of bdnn_ros.")
    if header.get("version") != VERSION:
        raise ModelFileError(
            f"{target} has model version {header.get('version')}, this program reads version {VERSION}.",
            "Use the release that wrote it, or identify the model again.",
        )
    if CHECKSUM in metadata and metadata[CHECKSUM] != checksum(metadata[HEADER], arrays):
        raise ModelFileError(
            f"{target} is damaged: its content is no longer what was written (SHA-256 differs).",
            "Copy it again from where it was written, or identify the model again.",
        )
    if not isinstance(header.get("kind"), str) or not isinstance(header.get("info"), dict):
        raise ModelFileError(
            f"{target} is damaged: its description is incomplete.", "Identify the model again."
        )
    for name, values in arrays.items() if finite else ():
        if not np.isfinite(values).all():
            raise ModelFileError(
                f"{target} is damaged: its array {name} holds values that are no numbers.",
                "Identify the model again.",
            )
    return header["kind"], arrays, header["info"]
