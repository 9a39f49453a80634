"""The text of a URDF file, in whatever encoding it declares, and of the bundled ones."""

from __future__ import annotations

import codecs
import re
from importlib import resources
from pathlib import Path

from bdnn_ros.errors import RobotError, UsageError, listed

BUNDLED = ("arm2", "arm6", "arm7")
DECLARED = re.compile(r"""^\s*<\?xml\b[^>]*?\bencoding\s*=\s*["']([A-Za-z][\w.-]*)["']""")
MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
"""Byte order marks and the encodings they indicate."""
LINE = '<?xml version="1.0" encoding="ISO-8859-1"?>'


def text_of(path: str | Path) -> str:
    """The text of a URDF file, its declared encoding replaced by UTF-8, in which the text is passed on.

    Raises:
        RobotError: it cannot be read.
    """
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise RobotError(f"The URDF {path} cannot be read ({error}).", "Check the path.") from None
    encoding = _encoding(content)
    try:
        text = content.decode(encoding)
    except (UnicodeError, LookupError):
        raise RobotError(
            f"The URDF {path} is no text in the encoding {encoding.upper()}.",
            f"Save it as UTF-8, or declare its encoding in its first line, for example {LINE}.",
        ) from None
    declared = DECLARED.match(text)
    return text if declared is None else f"{text[: declared.start(1)]}UTF-8{text[declared.end(1) :]}"


def bundled_text(name: str) -> str:
    """The text of a bundled URDF.

    Raises:
        UsageError: there is none of that name.
    """
    if name not in BUNDLED:
        raise UsageError(f"No bundled robot {name!r}.", f"There are {listed(BUNDLED)}.")
    file = resources.files("bdnn_ros") / "robots" / f"{name}.urdf"
    return file.read_text(encoding="utf-8")


def _encoding(content: bytes) -> str:
    """The encoding of the byte order mark, else the declared one, else UTF-8."""
    for mark, encoding in MARKS:
        if content.startswith(mark):
            return encoding
    declared = DECLARED.match(content[:200].decode("ascii", errors="replace"))
    return declared[1] if declared else "utf-8"
