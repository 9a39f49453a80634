"""What draws from another simulator add up to."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from _naming_records import BRIEF, in_brief, latest, standing
from _naming_tables import Record, Totals
from _naming_text import Rows, markdown

RECORDS = Path(__file__).resolve().parent / "results" / "naming_mujoco.jsonl"
OF_MOTIONS = RECORDS.with_name("naming_motions.jsonl")
OF_STRANGERS = RECORDS.with_name("naming_strangers.jsonl")
OTHERS = (
    (
        OF_MOTIONS,
        "motion",
        "\nThe same robots on other motions (`--motion NAME`): all joints from point to point with pauses, one sine a joint,\n"
        "one joint after the other, of which each then moves for some seconds only, and what `bdnn excite` makes of the\n"
        "description.\n",
    ),
    (
        OF_STRANGERS,
        "robot",
        "\nArms of example-robot-data (`--robots NAMES`), by their descriptions of links and joints alone. Payloads and pushes\n"
        "are as large as on the robots above. Where a joint is light in its first pose, MuJoCo's dry friction comes on little\n"
        "by little (see [what is corrected](diagnosis.md#what-is-corrected-with-a-note)).\n",
    ),
)
"""Draws of other kinds: where they are, what they differ in, and in words."""
NOTHING = "nothing"


def table(records: Sequence[Record], by: str = "hidden") -> Rows:
    """A row for each hidden effect, one for nothing hidden and one for all; or for each of something else that is drawn."""
    rows = [[by, *BRIEF]]
    kinds = dict.fromkeys(record["draw"][by] for record in records)
    for kind in [*sorted(kinds, key=lambda name: (name == NOTHING, name)), "all"]:
        rows.append([kind, *in_brief([r for r in records if kind in (r["draw"][by], "all")])])
    return rows


def in_words(records: Sequence[Record]) -> str:
    """How many draws there are, and how many of all findings are false."""
    false, true = (len(names) for names in (Totals(records).false, Totals(records).true))
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
    records = latest(RECORDS, lambda record: record["draw"]["seed"])
    return [
        "\n## Another simulator\n",
        "Made by `python benchmarks/naming_mujoco.py --budget 0`: MuJoCo reads the description and moves the robot with joints,\n"
        "friction and an integrator of its own; the recording holds what the controller commanded, at 100 to 500 Hz and with\n"
        "noise of .2 to 1.5 % of its spread. Links are off by 0, 3 or 5 %, half of the robots are worn. Sizes are 8 to 40 %\n"
        "of the effort's spread; a delay 10 to 19 ms, a tilt up to 5 degrees about each axis, a payload .5 to 2 kg (a sphere of\n"
        "4 to 16 cm or a box of 4 to 30 cm), a zero 30 to 120 mrad, a scale 10 to 35 %, a push 5 to 15 N, a link 28 to 57 %\n"
        "heavier or 22 to 36 % lighter, load-dependent friction 8 to 30 % of the effort, a velocity filter of 3 to 12 Hz, a\n"
        "gap of 4 to 30 mrad, a gear on which its link swings at 25 to 45 rad/s. Gap and soft gear are second joints of\n"
        "MuJoCo's, between rotor and link, on worn robots.\n",
        f"{in_words(records)} {standing(records, code)}\n",
        markdown(table(records)),
        *(line for part in OTHERS for line in _part(*part, code)),
    ]


def _part(path: Path, by: str, words: str, code: str) -> list[str]:
    """A part of the document on draws of another kind; nothing without results."""
    if not path.is_file():
        return []
    records = latest(path, lambda record: (record["draw"]["seed"], record["draw"][by]))
    return [
        words,
        f"{in_words(records)} {standing(records, code)}\n",
        markdown(table(records, by)),
    ]
