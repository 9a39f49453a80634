"""Records of draws: the latest of each, and a group of them in one row."""

from __future__ import annotations

import json
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path

from _naming_tables import Record, Totals, counted
from _naming_text import percent

BRIEF = ["draws", "named", "first", "silent", "false findings", "median error", "covered"]
"""What `in_brief` counts."""


def latest(path: Path, draw: Callable[[Record], Hashable]) -> list[Record]:
    """The last record of each draw in a file of JSON lines, without those that could not be drawn."""
    records = (json.loads(row) for row in path.read_text(encoding="utf-8").splitlines())
    return counted({draw(record): record for record in records}.values())


def standing(records: Sequence[Record], code: str) -> str:
    """How many records are of the sources as they stand, whose fingerprint is given, as a sentence ends."""
    return f"{sum(record['code'] == code for record in records)} by the sources as they stand."


def in_brief(records: Sequence[Record]) -> list[str]:
    """How many draws, how many of them named, and how well."""
    totals = Totals(records)
    return [
        str(len(records)),
        *(percent(totals.named(key)) for key in ("named", "first", "abstained")),
        str(len(totals.false)),
        percent(totals.error(), 1),
        percent(totals.covered()),
    ]
