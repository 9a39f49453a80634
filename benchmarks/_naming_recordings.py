"""Causes in real recordings: whether each half of a recording names the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from _physical_recordings import RECORDINGS, load

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot

RECORDED = Path(__file__).resolve().parent / "results" / "naming_recordings.json"
"""What was diagnosed last."""
PARTS = ("whole", "first half", "second half")
LEAST = 24.0
"""A shorter recording has no halves that a diagnosis takes [s]."""
AGREE = 0.25
"""Halves agree on a cause where its first parameter differs by less than this share, or by three standard deviations."""

Json = dict[str, Any]


def recorded(data: Path) -> dict[str, dict[str, Json]]:
    """The report of each recording and of each of its halves."""
    return {name: parts_of(*load(data, name)) for name in RECORDINGS}


def parts_of(robot: Robot, recording: Recording) -> dict[str, Json]:
    """Reports of a recording and of its halves, what is needed of them."""
    pieces = dict(zip(PARTS, (recording, *recording.split(0.5)), strict=True))
    if recording.duration < LEAST:
        pieces = {PARTS[0]: recording}
    return {part: _short(diagnose([piece], robot).as_json()) for part, piece in pieces.items()}


def _short(report: Json) -> Json:
    findings = [
        {key: one[key] for key in ("effect", "joint", "link", "parameters", "share", "probability", "rivals")}
        for one in report["findings"]
    ]
    return {
        "findings": findings,
        "gain": report["gain"],
        "unexplained": report["unexplained"],
        "verdict": report["verdict"],
    }


def tables(results: Mapping[str, Mapping[str, Json]]) -> list[tuple[str, list[list[str]]]]:
    """For each recording a title and a table: what each part names, with its first parameter."""
    found = []
    for name, parts in results.items():
        rows = [["cause", *parts, *(["halves"] if len(parts) > 1 else [])]]
        named, rivals = _named(parts), _rivals(parts)
        for place in dict.fromkeys(place for part in parts for place in named[part]):
            row = [f"{place[0]}, {place[1]}"]
            row += [_value(named[part].get(place), place in rivals[part]) for part in parts]
            pair = [named[part].get(place) for part in parts if part != PARTS[0]]
            rows.append([*row, *([_agreement(pair)] if pair else [])])
        gains = ", ".join(f"{part} {100 * parts[part]['gain']['value']:.0f} %" for part in parts)
        left = 100 * parts["whole"]["unexplained"]["share"]
        found.append(
            (f"{name}: held-out gain {gains}; {left:.1f} % of the squared error is not explained", rows)
        )
    return found


def in_words(results: Mapping[str, Mapping[str, Json]]) -> str:
    """How many causes that the whole of some recording names each of its halves names, too, or lists as a rival."""
    every = both = agree = listed = 0
    for parts in (one for one in results.values() if len(one) > 1):
        named, rivals = _named(parts), _rivals(parts)
        for place in map(_place, parts[PARTS[0]]["findings"]):
            pair = [named[part].get(place) for part in PARTS[1:]]
            every += 1
            both += all(pair)
            agree += _agreement(pair) == "agree"
            listed += not all(pair) and all(
                place in named[part] or place in rivals[part] for part in PARTS[1:]
            )
    return (
        f"Of {every} causes that a whole recording names, both halves name {both}, {agree} of them in the same size; "
        f"{listed} more are a rival of what a half names instead."
    )


def _place(finding: Json) -> tuple[str, str]:
    return finding["effect"], finding["joint"] or finding["link"] or "base"


def _named(parts: Mapping[str, Json]) -> dict[str, dict[tuple[str, str], Json]]:
    """What each part of a recording names, by its place."""
    return {part: {_place(one): one for one in report["findings"]} for part, report in parts.items()}


def _rivals(parts: Mapping[str, Json]) -> dict[str, set[tuple[str, str]]]:
    """What each part lists as a rival of something that it names."""
    return {
        part: {_place(rival) for one in report["findings"] for rival in one["rivals"]}
        for part, report in parts.items()
    }


def _first(finding: Json) -> tuple[float, float, str]:
    quantity = next(iter(finding["parameters"].values()))
    return float(quantity["value"]), float(quantity["std"]), str(quantity["unit"])


def _value(finding: Json | None, rival: bool) -> str:
    if finding is None:
        return "a rival" if rival else "-"
    value, std, unit = _first(finding)
    return f"{value:.3g} ± {1.96 * std:.2g} {unit}".rstrip(" -")


def _agreement(pair: Sequence[Json | None]) -> str:
    first, second = pair
    if first is None or second is None:
        return "one" if first or second else "none"
    (a, da, _), (b, db, _) = _first(first), _first(second)
    close = abs(a - b) <= max(AGREE * max(abs(a), abs(b)), 3.0 * (da**2 + db**2) ** 0.5)
    return "agree" if close else "differ"
