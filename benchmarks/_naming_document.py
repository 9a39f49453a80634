"""docs/naming.md: what all draws add up to, and how they were made."""

from __future__ import annotations

import json
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from _naming_outside import section as outside
from _naming_readings import section as readings
from _naming_recordings import RECORDED, in_words, tables
from _naming_records import latest
from _naming_simulator import section
from _naming_tables import by_condition, by_effect, confusion, plentiful, shows, side_by_side
from _naming_text import Rows, markdown

from bdnn_ros.written import whole

DOCUMENT = Path(__file__).resolve().parent.parent / "docs" / "naming.md"
HEAD = """# Naming hidden effects: blind draws

Made by `python benchmarks/naming.py --write-docs` from `benchmarks/results/naming.jsonl`; do not edit.
"""
TERMS = """
## What is drawn, and what is counted

A draw takes robot, effect, place, size (5 to 40 % of the spread of the effort), noise, errors of the links and
motion from its seed, writes a bag without the truth, diagnoses the bag, and only then compares. Shorter and poorer
motions (`--duration`, `--excitation poor`: one joint, slowly and a little) are counted in rows of their own and under
[By condition](#by-condition), which mixes all else: there silence may be the right answer.
What contains a simpler effect (Stribeck and asymmetric friction, a drift) adds at least 5 % to what the simpler one
says; a link is off by 20 % or more, beside others that are off by 5 or 10 %; a payload hangs from the second link on.
The load of a loose joint changes its sign, so that its gap is crossed: one that never is, is a wrong zero.
A push on a link acts at the origin of its frame, at its centre of mass or, a force alone, anywhere within a tenth of a
metre of the origin along each axis.
The share of a payload or a link is that of the joint that carries most of it: a gram is 5 % of what a last joint
does, and less than any description knows.

- *Named*: the effect and its joint or link are among the findings. What is physically the same (payload and
  scaled link; asymmetric friction, and Coulomb friction with an offset, either way, also where friction falls besides;
  the base's tilt, and the zero of a first joint that is not vertical; a force on the axis of a link's joint, and the
  same on the link before; a gap, and a wrong zero of half of it, where the load hardly ever leaves one side) counts where
  it is listed as a rival.
- *Tellable*: with all else that is true of the robot given, the recording holds more evidence for the hidden effect
  than outweighs 150 others, against the errors of all links and against a simpler effect that it contains or
  settles into. This knows what to look for; a diagnosis does not. It sees what the diagnosis does, behind one low-pass
  for all joints.
  A wrong link among links that are all a little wrong often is not tellable.
- *First*: no finding but wear stands before it. *Silent*: not named, and nothing false named either.
- On worn robots Coulomb, viscous friction and rotor inertia are true on every joint. A link's inertia
  is true where the link really is off by about as much.
- Errors of parameters are shares of the true value: of the vector's length for centres of mass and forces, of
  the larger end of a drift, of 1 rad for phases and rest positions; a torque of nothing is counted against what the
  force does at a tenth of a metre.
- The noise floor is what the sensors' noise leaves of a perfect model on the same held-out rows: the effort's own,
  and the position's through bodies, friction and effects.
- A link that is off by hardly more than all links are is not named, here or on a real robot: the extended model
  mends it silently.
"""


def _real_recordings() -> list[str]:
    """What real recordings name, for the document; nothing where they were not diagnosed."""
    if not RECORDED.is_file():
        return []
    results = json.loads(RECORDED.read_text(encoding="utf-8"))
    parts = [
        "\n## Real recordings\n",
        "Made by `python benchmarks/naming.py --recordings DIR`. The truth is not known; what can be asked is whether each\n"
        "half of a recording names what the whole does, and what is left unexplained.\n",
        in_words(results) + "\n",
    ]
    for title, rows in tables(results):
        parts += [f"\n**{title}**\n", markdown(rows)]
    return parts


def write(results: Path, sources: str) -> None:
    """docs/naming.md from every draw's latest record.

    Args:
        sources: fingerprint of those that stand.
    """
    records = latest(results, lambda record: record["key"])
    last = [r for r in records if r["code"] == records[-1]["code"]]
    now = len(last) if records[-1]["code"] == sources else 0
    rich = plentiful(records)
    parts = [
        HEAD,
        f"{len(records)} [blind draws](#what-is-drawn-and-what-is-counted), {now} of them by the sources as they stand, "
        f"{len(last)} by those that were measured last.\n",
        "## Promised and measured\n\nRich motion of at least 30 s but where it says otherwise. What falls short is in bold.\n",
        markdown(side_by_side(shows(records), shows(last))),
        TERMS,
        "## What was named in place of what\n",
        markdown(confusion(rich)),
        "\n## By effect\n",
        markdown(by_effect(rich)),
        "\n## By condition\n",
        markdown(by_condition(records)),
        *outside(sources),
        *readings(sources),
        *section(sources),
        *_real_recordings(),
        "\n## How the draws were made\n",
        markdown(_made(records)),
    ]
    with whole(DOCUMENT) as beside:
        beside.write_text("\n".join(parts) + "\n", encoding="utf-8")
    print(f"{DOCUMENT}: {len(records)} draws")


def _made(records: Sequence[Mapping[str, Any]]) -> Rows:
    """A row for all draws of the same choices, with the seeds that they were made of."""
    seeds: dict[str, list[str]] = {}
    drawn: Counter[str] = Counter()
    for command, count in Counter(r["command"] for r in records).items():
        words = shlex.split(command)[2:]
        told = dict(zip(words[::2], words[1::2], strict=True))
        first, wanted = int(told.pop("--seed0")), int(told.pop("--draws"))
        for aside in ("--jobs", "--budget"):
            told.pop(aside, None)
        chosen = " ".join(f"{name} {value}" for name, value in sorted(told.items()))
        seeds.setdefault(chosen, []).append(f"{first}-{first + wanted - 1}")
        drawn[chosen] += count
    rows = [[f"`{chosen}`", ", ".join(seeds[chosen]), str(drawn[chosen])] for chosen in seeds]
    return [["`python benchmarks/naming.py`", "seeds", "drawn"], *rows]
