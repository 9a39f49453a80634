"""Where models are stored: names inside one directory, never outside it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bdnn_ros.bdnn import modelfile
from bdnn_ros.bdnn.modelfile import FILE_NAME, SUFFIX
from bdnn_ros.errors import UsageError

LONGEST_NAME = 200
"""Of a model [bytes]."""


def make_directory(directory: str) -> None:
    """Create the model directory if it is missing, and check that files can be written there.

    Raises:
        UsageError: they cannot.
    """
    try:
        root = Path(directory).expanduser()
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root):
            pass
    except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user that does not exist
        raise UsageError(
            f"Models cannot be written to model_directory {directory} ({_reason(error)}).",
            "Set it to a directory that can be written to, or leave it empty to keep none.",
        ) from None


@contextmanager
def looking_at(what: str) -> Iterator[None]:
    """Turn errors of the file system into a refusal.

    Raises:
        UsageError: a directory on the way is closed, links go round, and the like.
    """
    try:
        yield
    except (OSError, RuntimeError) as error:  # RuntimeError: links that go round
        raise UsageError(
            f"{what} cannot be looked at ({_reason(error)}).",
            "Check permissions and links in model_directory.",
        ) from None


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error).partition(" from ")[0].rstrip(".")


def model_to_load(directory: str, name: str) -> Path:
    """The existing file of a named model: as `model_place`, or `directory/name.bdnn`.

    Raises:
        UsageError: as `model_place`.
    """
    place = model_place(directory, name)
    with looking_at(repr(name) if name else str(place)):
        if place.exists() or not name or name.endswith(SUFFIX):
            return place
        beside = model_place(directory, f"{name}{SUFFIX}")
        return beside if beside.exists() else place


def model_place(directory: str, name: str) -> Path:
    """The file for a named model: `directory/name/model.bdnn`, or `directory/model.bdnn` without a name.

    A name that ends in `.bdnn` is the file itself, unless a directory has that name.

    Raises:
        UsageError: no directory is set, the name is blank, begins like a home directory's or would leave it, or what is
            there cannot be looked at.
    """
    if not directory:
        raise UsageError("The parameter model_directory is not set.", "Set it to keep models.")
    with looking_at(f"The model_directory {directory}"):
        root = Path(directory).expanduser().resolve()
    if not name:
        return root / FILE_NAME
    parts = name.split("/")
    plain = (
        name.isprintable() and len(name.removesuffix(SUFFIX).encode()) <= LONGEST_NAME and "\\" not in name
    )
    blank = any(not part.removesuffix(SUFFIX).strip() for part in parts)
    if not plain or blank or name.startswith("~") or any(part in (".", "..") for part in parts):
        raise UsageError(
            f"{name[:LONGEST_NAME]!r} is not a name inside model_directory.", "Use a plain name."
        )
    with looking_at(repr(name)):
        place = modelfile.model_place(root.joinpath(*parts))
        inside = root in place.resolve().parents
    if not inside:  # a link may lead out
        raise UsageError(f"{name!r} leads out of model_directory.", "Use a plain name.")
    return place
