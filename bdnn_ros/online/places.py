"""Where models are kept: names inside one directory, and nothing outside it."""

from __future__ import annotations

from pathlib import Path

from bdnn_ros.bdnn.modelfile import FILE_NAME
from bdnn_ros.errors import UsageError

LONGEST_NAME = 200


def model_place(directory: str, name: str) -> Path:
    """The file of a named model: `directory/name/model.bdnn`; without a name, `directory/model.bdnn`.

    Raises:
        UsageError: no directory is set, or the name would leave it.
    """
    if not directory:
        raise UsageError("The parameter model_directory is not set.", "Set it to keep models.")
    root = Path(directory).expanduser().resolve()
    if not name:
        return root / FILE_NAME
    parts = name.split("/")
    plain = name.isprintable() and len(name) <= LONGEST_NAME and "\\" not in name
    if not plain or any(part in ("", ".", "..") for part in parts):
        raise UsageError(
            f"{name[:LONGEST_NAME]!r} is not a name inside model_directory.", "Use a plain name."
        )
    place = root.joinpath(*parts)
    if place.name != FILE_NAME:
        place = place / FILE_NAME
    if root not in place.resolve().parents:  # a link may lead out
        raise UsageError(f"{name!r} leads out of model_directory.", "Use a plain name.")
    return place
