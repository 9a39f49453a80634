"""What draws from another simulator add up to."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from _naming_text import Rows, markdown, percent, share

RECORDS = Path(__file__).resolve().parent / "results" / "naming_mujoco.jsonl"
NOTHING = "nothing"

Record = Mapping[str, Any]


def table(records: Sequence[Record]) -> Rows:
    """A row for each hidden effect, one for nothing hidden and one for all."""
    rows = [["hidden", "draws", "named", "first", "silent", "false findings", "median error", "covered"]]
    kinds = dict.fromkeys(record["draw"]["hidden"] for record in records)
    for kind in [*sorted(kinds, key=lambda name: (name == NOTHING, name)), "all"]:
        some = [record for record in records if kind in (record["draw"]["hidden"], "all")]
        told = [record["outcome"] for record in some if record["status"] == "diagnosed"]
        hidden = [one for outcome in told for one in outcome["hidden"]]
        unheard = sum(
            record["status"] != "diagnosed" and record["draw"]["hidden"] != NOTHING for record in some
        )
        parameters = [p for one in hidden for p in one["parameters"].values()]
        errors = [p["error"] for p in parameters]
        shares = [
            share([*(one[key] for one in hidden), *[False] * unheard])
            for key in ("named", "first", "abstained")
        ]
        rows.append(
            [
                kind,
                str(len(some)),
                *map(percent, shares),
                str(sum(len(outcome["false"]) for outcome in told)),
                percent(float(np.median(errors)) if errors else np.nan, 1),
                percent(share([p["covered"] for p in parameters])),
            ]
        )
    return rows


def in_words(records: Sequence[Record]) -> str:
    """How many draws there are, and how many of all findings are false."""
    told = [record["outcome"] for record in records if record["status"] == "diagnosed"]
    false = sum(len(outcome["false"]) for outcome in told)
    true = sum(len(outcome[key]) for outcome in told for key in ("true", "links"))
    worn = sum(record["draw"]["worn"] for record in records)
    return (
        f"{len(records)} draws, {worn} of them of worn robots; {false} of {false + true} findings are false."
    )


def section(code: str) -> list[str]:
    """Part of a document; nothing without results.

    Args:
        code: tells the sources as they stand from those that made the results.
    """
    if not RECORDS.is_file():
        return []
    latest = {}
    for row in RECORDS.read_text(encoding="utf-8").splitlines():
        record = json.loads(row)
        latest[record["draw"]["seed"]] = record
    records, now = list(latest.values()), sum(record["code"] == code for record in latest.values())
    return [
        "\n## Another simulator\n",
        "Made by `python benchmarks/naming_mujoco.py --budget 0`: MuJoCo reads the description and moves the robot with joints,\n"
        "friction and an integrator of its own; the recording holds what the controller commanded, at 100 to 500 Hz and with\n"
        "noise of .2 to 1.5 % of its spread. Links are off by 0, 3 or 5 %, half of the robots are worn. Sizes are 8 to 40 %\n"
        "of the effort's spread; a delay 10 to 19 ms, a tilt up to 5 degrees about each axis, a payload .5 to 2 kg, a zero\n"
        "30 to 120 mrad, a scale 10 to 35 %, a push 5 to 15 N.\n",
        f"{in_words(records)} {now} by the sources as they stand.\n",
        markdown(table(records)),
    ]
