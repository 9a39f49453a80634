"""A group of draws in one row."""

from __future__ import annotations

from collections.abc import Sequence

from _naming_tables import Record, Totals
from _naming_text import percent

BRIEF = ["draws", "named", "first", "silent", "false findings", "median error", "covered"]
"""What `in_brief` counts."""


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
