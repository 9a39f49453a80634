"""What many blind draws add up to: recall, precision, errors, coverage, and the confusion matrix."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from _naming_text import Rows, percent, share

from bdnn_ros.effects.registry import EFFECTS
from bdnn_ros.robot import BUNDLED

Record = Mapping[str, Any]
WITHIN, FLOOR = 0.1, 1.2
"""A parameter is good within this share; a model is within this factor of the noise floor."""
TELLING = float(np.log(150.0))
"""Log evidence that outweighs so many effects at so many places."""
NOTHING, ELSEWHERE, REFUSED = "nothing", "elsewhere", "refused"

NOT_DRAWN = "not drawn"
"""Status of a draw whose simulation came to nothing."""


def counted(records: Iterable[Record]) -> list[Record]:
    """Those that were drawn."""
    return [record for record in records if record["status"] != NOT_DRAWN]


@dataclass(frozen=True)
class Totals:
    """Counts over some records."""

    records: Sequence[Record]

    @property
    def diagnosed(self) -> list[Record]:
        """Those that a diagnosis came out of."""
        return [r for r in self.records if r["status"] == "diagnosed"]

    @property
    def hidden(self) -> list[Mapping[str, Any]]:
        """Every hidden effect's outcome; where a diagnosis refused or crashed, none was named."""
        found: list[Mapping[str, Any]] = []
        for record in self.records:
            if record["status"] == "diagnosed":
                found += record["outcome"]["hidden"]
            else:
                found += [_unnamed(effect["effect"]) for effect in record["truth"]]
        return found

    @property
    def tellable(self) -> list[Mapping[str, Any]]:
        """Hidden effects that the data tell from all links' errors and from simpler effects, for one who looks for them."""
        return [one for one in self.hidden if one["evidence"] is None or one["evidence"] > TELLING]

    @property
    def all_tellable(self) -> Totals:
        """The draws of which the data tell every hidden effect."""
        return Totals([r for r in self.records if (one := Totals([r])).tellable == one.hidden])

    @property
    def parameters(self) -> list[Mapping[str, Any]]:
        """Parameters of all rightly named effects."""
        return [p for one in self.hidden for p in one["parameters"].values()]

    @property
    def false(self) -> list[str]:
        """Names of all false findings."""
        return [name for r in self.diagnosed for name in r["outcome"]["false"]]

    @property
    def true(self) -> list[str]:
        """Names of all true findings."""
        return [name for r in self.diagnosed for key in ("true", "links") for name in r["outcome"][key]]

    def named(self, key: str = "named") -> float:
        """Share of hidden effects that were named, or named first, or passed over in silence."""
        return share([one[key] for one in self.hidden])

    def all_named(self) -> float:
        """Share of draws with hidden effects in which every one was named."""
        draws = [r for r in self.records if r["draw"]["hidden"]]
        return share(
            [r["status"] == "diagnosed" and all(o["named"] for o in r["outcome"]["hidden"]) for r in draws]
        )

    def with_false(self) -> float:
        """Share of draws with a false finding."""
        return share([bool(r["outcome"]["false"]) for r in self.diagnosed])

    def false_findings(self) -> float:
        """Share of all findings that are false."""
        return share([True] * len(self.false) + [False] * len(self.true))

    def error(self) -> float:
        """Median error of parameters, as a share of their magnitude."""
        errors = [p["error"] for p in self.parameters]
        return float(np.median(errors)) if errors else np.nan

    def within(self) -> float:
        """Share of parameters within 10 %."""
        return share([p["error"] <= WITHIN for p in self.parameters])

    def covered(self) -> float:
        """Share of 95 % intervals that hold the truth."""
        return share([p["covered"] for p in self.parameters])

    def near_floor(self) -> float:
        """Share of draws whose extended model is near the noise floor."""
        return share([r["over_floor"] <= FLOOR for r in self.diagnosed])

    def cpu(self) -> float:
        """Median CPU seconds of a diagnosis."""
        return float(np.median([r["cpu_seconds"] for r in self.diagnosed])) if self.diagnosed else np.nan


def by_effect(records: Sequence[Record]) -> Rows:
    """A row for each hidden effect; precision over all findings of that name."""
    totals = Totals(records)
    rows = [
        [
            "effect",
            "hidden",
            "named",
            "tellable",
            "named of these",
            "first (alone)",
            "silent",
            "precision",
            "median error",
            "within 10 %",
            "covered",
        ]
    ]
    for name in EFFECTS:
        own = [one for one in totals.hidden if one["effect"] == name]
        told = [one for one in totals.tellable if one["effect"] == name]
        alone = [
            one
            for r in records
            if r["draw"]["hidden"] == 1
            for one in Totals([r]).hidden
            if one["effect"] == name
        ]
        true, false = totals.true.count(name), totals.false.count(name)
        if not own and not true + false:
            continue
        parameters = [p for one in own for p in one["parameters"].values()]
        rows.append(
            [
                name,
                str(len(own)),
                percent(share([one["named"] for one in own])),
                str(len(told)),
                percent(share([one["named"] for one in told])),
                percent(share([one["first"] for one in alone])),
                percent(share([one["abstained"] for one in own])),
                f"{true}/{true + false}" if true + false else "-",
                percent(float(np.median([p["error"] for p in parameters])) if parameters else np.nan, 1),
                percent(share([p["error"] <= WITHIN for p in parameters])),
                percent(share([p["covered"] for p in parameters])),
            ]
        )
    return rows


CONDITIONS: dict[str, Callable[[Record], str]] = {
    "robot": lambda r: str(r["draw"]["robot"]).rsplit("/", 1)[-1],
    "noise": lambda r: "coloured" if r["draw"]["coloured"] else "white",
    "links off by": lambda r: f"{100 * r['draw']['wrong']:.0f} %",
    "duration": lambda r: f"{r['draw']['duration']:.0f} s",
    "excitation": lambda r: "poor" if r["draw"]["poor"] else "rich",
    "robot is": lambda r: "worn" if r["draw"]["worn"] else "new",
    "hidden": lambda r: str(r["draw"]["hidden"]),
    "all": lambda r: "",
}


def by_condition(records: Sequence[Record]) -> Rows:
    """A row for each value of each condition."""
    head = [
        "draws",
        "named",
        "all named",
        "silent",
        "false findings",
        "draws with one",
        "parameters within 10 %",
    ]
    rows = [["condition", *head, "covered", "within 1.2 floors", "CPU s"]]
    for title, of in CONDITIONS.items():
        for value in sorted({of(r) for r in records}, key=lambda v: (len(v), v)):
            t = Totals([r for r in records if of(r) == value])
            rows.append(
                [
                    f"{title} {value}".strip(),
                    str(len(t.records)),
                    percent(t.named()),
                    percent(t.all_named()),
                    percent(t.named("abstained")),
                    percent(t.false_findings(), 1),
                    percent(t.with_false(), 1),
                    percent(t.within()),
                    percent(t.covered()),
                    percent(t.near_floor()),
                    f"{t.cpu():.1f}",
                ]
            )
    return rows


def confusion(records: Sequence[Record]) -> Rows:
    """What each hidden effect was named as: rows the truth, columns by the rows' numbers."""
    counts: dict[str, Counter[str]] = {name: Counter() for name in EFFECTS}
    for one in Totals(records).hidden:
        named = str(one["as"])
        counts[one["effect"]][ELSEWHERE if named.endswith(ELSEWHERE) else named] += 1
    columns = [*EFFECTS, ELSEWHERE, NOTHING, REFUSED]
    heads = [*(str(k) for k in range(1, len(EFFECTS) + 1)), ELSEWHERE, NOTHING, REFUSED]
    rows = [["hidden, named as", *heads]]
    for number, name in enumerate(EFFECTS, start=1):
        if counts[name]:
            rows.append([f"{number} {name}", *(str(counts[name][c] or "") for c in columns)])
    return rows


def plentiful(records: Iterable[Record]) -> list[Record]:
    """Those of rich motion of at least 30 s."""
    return [r for r in records if not r["draw"]["poor"] and r["draw"]["duration"] >= 30.0]


def shows(records: Sequence[Record]) -> Rows:
    """What is promised, and what was measured; and what is not, of less motion and of more effects."""
    seen = [r for r in records if r["draw"]["robot"] in BUNDLED]
    rich = plentiful(seen)
    unseen = Totals([r for r in plentiful(records) if r not in seen and r["draw"]["hidden"] == 1])
    plain = [r for r in seen if not r["draw"]["worn"] and r["draw"]["wrong"] == 0.05]
    one = [r for r in plain if r["draw"]["hidden"] == 1]
    short = Totals([r for r in one if not r["draw"]["poor"] and r["draw"]["duration"] < 30.0])
    poor = Totals([r for r in one if r["draw"]["poor"]])
    three = Totals([r for r in plentiful(plain) if r["draw"]["hidden"] == 3])
    new, worn = ([r for r in rich if r["draw"]["worn"] is w] for w in (False, True))
    single = Totals([r for r in new if r["draw"]["hidden"] == 1 and r["draw"]["wrong"] == 0.05])
    further = Totals([r for r in new if r["draw"]["hidden"] == 1 and r["draw"]["wrong"] == 0.1])
    two = Totals([r for r in new if r["draw"]["hidden"] == 2])
    clean = Totals([r for r in new if r["draw"]["hidden"] == 0])
    worn_one = Totals([r for r in worn if r["draw"]["hidden"] == 1 and r["draw"]["wrong"] <= 0.05])
    worn_none = Totals([r for r in worn if r["draw"]["hidden"] == 0])
    every = Totals(rich)
    rows = [
        ["what", "wanted", "measured", "draws"],
        ["one effect, links 5 % off: named first", "≥ 95 %", *_of(single, single.named("first"))],
        ["of those that the data can tell", "", *_of_tellable(single)],
        ["the effect least often named first", "≥ 80 %", *_of(single, *_weakest(single))],
        ["the same on robots not seen before", "5 less", *_of(unseen, unseen.named("first"))],
        ["robots not seen before: draws with a false finding", "≤ 2 %", *_of(unseen, unseen.with_false())],
        ["one effect, links 10 % off: named first", "≥ 90 %", *_of(further, further.named("first"))],
        ["of those that the data can tell", "", *_of_tellable(further)],
        ["two effects: both named", "≥ 85 %", *_of(two, two.all_named())],
        ["of those of which the data can tell both", "", *_of(both := two.all_tellable, both.all_named())],
        ["nothing hidden: draws with a false finding", "≤ 2 %", *_of(clean, clean.with_false())],
        ["worn, one hidden: named", "≥ 90 %", *_of(worn_one, worn_one.named())],
        ["of those that the data can tell", "", *_of_tellable(worn_one, "named")],
        ["worn, one hidden: findings that are false", "≤ 3 %", *_of(worn_one, worn_one.false_findings())],
        ["worn, nothing hidden: draws with a false finding", "0 %", *_of(worn_none, worn_none.with_false())],
        ["three effects: all named", "", *_of(three, three.all_named())],
        ["three effects: named", "", *_of(three, three.named())],
        ["one effect, 10 s of motion: named first", "", *_of(short, short.named("first"))],
        ["10 s of motion: findings that are false", "", *_of(short, short.false_findings())],
        ["one effect, poor motion of 30 s: named first", "", *_of(poor, poor.named("first"))],
        ["poor motion: findings that are false", "", *_of(poor, poor.false_findings())],
        ["parameters: median error", "≤ 3 %", *_of(every, every.error())],
        ["parameters within 10 %", "most", *_of(every, every.within())],
        ["95 % intervals that hold the truth", "≥ 90 %", *_of(every, every.covered())],
        ["extended model within 1.2 noise floors", "≥ 90 %", *_of(every, every.near_floor())],
    ]
    return [_with_miss(*row) for row in rows]


def _with_miss(what: str, wanted: str, measured: str, draws: str) -> list[str]:
    """A row of what is promised, its measured share in bold where it falls short."""
    bound, _, limit = ("≤ " + wanted if wanted == "0 %" else wanted).partition(" ")
    if bound in ("≥", "≤") and not measured.startswith("-"):
        apart = float(measured.split()[0]) - float(limit.split()[0])
        if apart < 0.0 if bound == "≥" else apart > 0.0:
            measured = f"**{measured}**"
    return [what, wanted, measured, draws]


def side_by_side(every: Rows, last: Rows) -> Rows:
    """What was measured of all draws, with what of those that were made by the sources that were measured last."""
    head = ["measured last", "draws"]
    return [[*row, *(head if k == 0 else last[k][2:])] for k, row in enumerate(every)]


def summary(records: Sequence[Record]) -> dict[str, Any]:
    """The same as numbers by name, for machines."""
    t = Totals(records)
    return {
        "draws": len(records),
        "named": t.named(),
        "first": t.named("first"),
        "all_named": t.all_named(),
        "abstained": t.named("abstained"),
        "false_findings": t.false_findings(),
        "draws_with_false": t.with_false(),
        "parameter_error_median": t.error(),
        "parameters_within": t.within(),
        "covered": t.covered(),
        "near_floor": t.near_floor(),
        "cpu_seconds": t.cpu(),
        "status": dict(Counter(str(r["status"]) for r in records)),
    }


def _of(totals: Totals, value: float, word: str = "") -> tuple[str, str]:
    return f"{percent(value, 1)}{word}", str(len(totals.records))


def _of_tellable(totals: Totals, key: str = "first") -> tuple[str, str]:
    told = totals.tellable
    return percent(share([one[key] for one in told]), 1), str(len(told))


def _weakest(totals: Totals) -> tuple[float, str]:
    """The effect named first least often."""
    names = {one["effect"] for one in totals.hidden}
    shares = {
        name: share([one["first"] for one in totals.hidden if one["effect"] == name])
        for name in sorted(names)
    }
    if not shares:
        return np.nan, ""
    least = min(shares, key=lambda name: shares[name])
    return shares[least], f" ({least})"


def _unnamed(effect: str) -> dict[str, Any]:
    return {
        "effect": effect,
        "named": False,
        "first": False,
        "abstained": False,
        "as": REFUSED,
        "parameters": {},
        "evidence": None,
    }
