"""Tables of text and their cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Rows = list[list[str]]


def text(rows: Rows) -> str:
    """A table for a terminal."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [
            c.ljust(w) if k == 0 else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def markdown(rows: Rows) -> str:
    """A table for a document."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def share(values: Sequence[bool]) -> float:
    """Share of true ones; not a number where there are none."""
    return float(np.mean(values)) if len(values) else np.nan


def percent(value: float, digits: int = 0) -> str:
    """A share for a table."""
    return "-" if np.isnan(value) else f"{100.0 * value:.{digits}f} %"
