"""Times of findings: from stream time to the stamps of the publisher, which users see."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from bdnn_ros.effects.environment import EDGES
from bdnn_ros.online.stream.buffer import Ring

MOMENT = re.compile(r"\b(at|from|to|until|since) (\d+\.\d+) s\b")
"""A moment as sentences of findings state it."""


def diagnosis_with_stamps(diagnosis: dict[str, Any], states: Ring) -> dict[str, Any]:
    """The diagnosis with stream times replaced by the publisher's stamps [s], in parameters and sentences."""
    times: list[tuple[float, float]] = []
    findings = []
    for finding in diagnosis["findings"]:
        findings.append(with_stamps(finding, states))
        times += _times(finding, findings[-1])
    return {
        **diagnosis,
        "findings": findings,
        **{key: [_in_stamps(sentence, times) for sentence in diagnosis[key]] for key in ("advice", "notes")},
    }


def with_stamps(finding: dict[str, Any], states: Ring) -> dict[str, Any]:
    """The finding with stream times replaced by the publisher's stamps [s], in parameters and sentence."""
    parameters = dict(finding["parameters"])
    for name in EDGES:
        if name in parameters:
            time = states.origin + round(parameters[name]["value"] * 1e9)
            parameters[name] = {**parameters[name], "value": _stamp(time, states) * 1e-9}
    told = {**finding, "parameters": parameters}
    return {**told, "sentence": _in_stamps(finding["sentence"], _times(finding, told))}


def _times(finding: dict[str, Any], told: dict[str, Any]) -> list[tuple[float, float]]:
    """Each time of a finding, in stream time and as a stamp [s]."""
    before, after = finding["parameters"], told["parameters"]
    return [(before[name]["value"], after[name]["value"]) for name in EDGES if name in before]


def _in_stamps(sentence: str, times: Sequence[tuple[float, float]]) -> str:
    """The sentence with moments of stream time replaced by stamps; durations stay as they are."""

    def stamped(match: re.Match[str]) -> str:
        word, text = match.groups()
        digits = len(text.partition(".")[2])
        time, stamp = min(times, key=lambda one: abs(float(text) - one[0]), default=(np.nan, np.nan))
        near = abs(float(text) - time) <= 10.0**-digits
        return f"{word} {stamp:.{digits}f} s" if near else match[0]

    return MOMENT.sub(stamped, sentence)


def _stamp(time: int, states: Ring) -> int:
    """The publisher's stamp at a stream time [ns], counted from the nearest sample that is still kept."""
    near = states.read(states.first_after(time - 1), 1)
    if len(near) == 0:  # it was overwritten in this instant, or has not come yet
        near = states.latest(1)
    return time + int(near.stamp[0] - near.time[0])
