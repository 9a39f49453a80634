"""Causes that the library does not hold: what each adds to a joint's effort, and what diagnoses of them add up to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from _naming_records import latest, standing
from _naming_tables import Record, counted
from _naming_text import Rows, markdown, percent, share

from bdnn_ros.recording import Recording
from bdnn_ros.simulation.simulate import Simulated

RECORDS = Path(__file__).resolve().parent / "results" / "naming_outside.jsonl"
WEAR = ("coulomb_friction", "viscous_friction", "armature")
SMALLEST, LARGEST = 0.1, 0.3
"""Root mean square of what is added, by the spread of the joint's effort."""
BUMP = 0.1
"""Half width of a bump at one position [rad]."""


@dataclass(frozen=True)
class Along:
    """A motion, and a joint that something outside the library acts on.

    Attributes:
        q, v: positions and velocities halfway between samples, over which efforts are held, (N, n) [rad], [rad/s].
        time: from the start, (N,) [s].
        effort: of the joint, (N,) [N·m].
        joint, other: of the joint, and of another one that may play its part.
        phase: anything between 0 and 2 π.
    """

    q: np.ndarray
    v: np.ndarray
    time: np.ndarray
    effort: np.ndarray
    joint: int
    other: int
    phase: float

    @property
    def at(self) -> np.ndarray:
        """Position of the joint from the middle of its way, in standard deviations."""
        return _from_the_middle(self.q[:, self.joint])

    @property
    def beside(self) -> np.ndarray:
        """The same of the other one."""
        return _from_the_middle(self.q[:, self.other])

    @property
    def direction(self) -> np.ndarray:
        """Of the joint's motion, (N,)."""
        return np.sign(self.v[:, self.joint])


def _from_the_middle(position: np.ndarray) -> np.ndarray:
    return np.asarray((position - np.median(position)) / position.std())


OWN, OTHER = "joint", "other"
Inputs = frozenset[tuple[str, str]]


@dataclass(frozen=True)
class Outside:
    """A cause that the library does not hold.

    Attributes:
        effort: what it adds but for its size, (N,).
        inputs: what that depends on: "joint" or "other", and which quantity of it.
        part: effect of the library that is true of the joint as a part of it.
    """

    effort: Callable[[Along], np.ndarray]
    inputs: Inputs
    part: str = ""


def _of(*inputs: tuple[str, str]) -> Inputs:
    return frozenset(inputs)


POSITION, VELOCITY, LOAD = (OWN, "position"), (OWN, "velocity"), (OWN, "load")
THEIR_POSITION, THEIR_VELOCITY = (OTHER, "position"), (OTHER, "velocity")
CAUSES: dict[str, Outside] = {
    "friction that differs along the way": Outside(
        lambda m: m.direction * (1.0 + np.sin(2.0 * m.q[:, m.joint] + m.phase)), _of(POSITION, VELOCITY)
    ),
    "friction that differs with another joint's position": Outside(
        lambda m: m.direction * (1.0 + np.sin(2.0 * m.q[:, m.other] + m.phase)), _of(THEIR_POSITION, VELOCITY)
    ),
    "a bump at one position": Outside(
        lambda m: np.exp(-(((m.q[:, m.joint] - np.quantile(m.q[:, m.joint], 0.6)) / BUMP) ** 2)),
        _of(POSITION),
    ),
    "a soft stop at one end": Outside(lambda m: np.maximum(m.at - 1.0, 0.0), _of(POSITION)),
    "effort by another joint's position": Outside(
        lambda m: np.sin(2.0 * m.q[:, m.other] + m.phase), _of(THEIR_POSITION)
    ),
    "a spring between two joints": Outside(
        lambda m: m.at + m.beside, _of(POSITION, THEIR_POSITION), "joint_spring"
    ),
    "drag by another joint's velocity": Outside(lambda m: m.v[:, m.other], _of(THEIR_VELOCITY)),
    "the product of two velocities": Outside(
        lambda m: m.v[:, m.joint] * m.v[:, m.other], _of(VELOCITY, THEIR_VELOCITY)
    ),
    "a motor that is weaker the faster it turns": Outside(
        lambda m: m.effort * np.abs(m.v[:, m.joint]), _of(LOAD, VELOCITY)
    ),
    "friction that wears in": Outside(
        lambda m: m.direction * np.exp(-4.0 * m.time / m.time[-1]), _of(("", "time")), "drift"
    ),
}


def hiding(simulated: Simulated, cause: str, seed: int) -> tuple[Recording, dict[str, Any]]:
    """A simulated recording with one cause at one joint, along the same motion, and the truth of it."""
    recording, rng = simulated.recording, np.random.default_rng([seed, *b"outside"])
    joint, other = (int(one) for one in rng.permutation(len(recording.joints))[:2])
    along = Along(
        *(_halfway(values) for values in (simulated.position, simulated.velocity)),
        recording.time - recording.time[0],
        simulated.effort[:, joint],
        joint,
        other,
        float(rng.uniform(0.0, 2.0 * np.pi)),
    )
    effort = recording.require_effort().copy()
    added = CAUSES[cause].effort(along)
    size = float(rng.uniform(SMALLEST, LARGEST)) * float(effort[:, joint].std())
    effort[:, joint] += size * added / np.sqrt(np.mean(added**2))
    of = {OWN: f"{recording.joints[joint]}.", OTHER: f"{recording.joints[other]}.", "": ""}
    inputs = sorted(of[which] + quantity for which, quantity in CAUSES[cause].inputs)
    return replace(recording, effort=effort), {
        "cause": cause,
        "joint": recording.joints[joint],
        "inputs": inputs,
    }


def _halfway(values: np.ndarray) -> np.ndarray:
    """Values between each sample and the next one, (N, n)."""
    return np.asarray(0.5 * (values + np.concatenate([values[1:], values[-1:]])))


def judged(truth: Mapping[str, Any], report: Mapping[str, Any], worn: bool) -> dict[str, Any]:
    """What a diagnosis says of a cause that has no name.

    Friction at the joint and what is a part of the cause, and on worn robots wear anywhere, is no false name.
    """
    told = report["unexplained"]["depends_on"]
    named = [f["effect"] for f in report["findings"] if not _true(f, truth, worn)]
    return {
        "false": named,
        "nothing wrong": report["verdict"] == "nothing_wrong",
        "explained": report["verdict"] == "explained" and bool(named),
        "first": bool(told) and told[0] in truth["inputs"],
        "all": set(truth["inputs"]) <= set(told),
        "learned": report["unexplained"].get("learned", {}).get("value", 0.0),
    }


def _true(finding: Mapping[str, Any], truth: Mapping[str, Any], worn: bool) -> bool:
    there = finding["joint"] == truth["joint"]
    part = there and finding["effect"] == CAUSES[truth["cause"]].part
    return part or (finding["effect"] in WEAR and (worn or there))


def table(records: Sequence[Record]) -> Rows:
    """A row for each cause, and one for all."""
    rows = [
        [
            "cause",
            "draws",
            "depends on: right first",
            "all told",
            "false name",
            "of these",
            "explained by them",
            "nothing wrong",
            "learned",
            "networks' gain",
        ]
    ]
    for cause in (*CAUSES, "all"):
        some = [r["outcome"] for r in counted(records) if cause in (r["truth"]["cause"], "all")]
        if some:
            false = Counter(name for one in some for name in dict.fromkeys(one["false"]))
            rows.append(
                [
                    cause,
                    str(len(some)),
                    *(percent(share([one[key] for one in some])) for key in ("first", "all")),
                    percent(share([bool(one["false"]) for one in some])),
                    ", ".join(f"{name} {count}" for name, count in false.most_common(4)) or "-",
                    *(percent(share([one[key] for one in some])) for key in ("explained", "nothing wrong")),
                    percent(share([one["learned"] > 0.0 for one in some])),
                    percent(float(np.median(gains))) if (gains := _gains(some)) else "-",
                ]
            )
    return rows


def _gains(outcomes: Sequence[Mapping[str, Any]]) -> list[float]:
    """What networks take off the extended model's held-out error at the joints where they learned something."""
    return [one["learned"] for one in outcomes if one["learned"] > 0.0]


def section(code: str) -> list[str]:
    """Part of a document; nothing without results.

    Args:
        code: tells the sources as they stand from those that made the results.
    """
    if not RECORDS.is_file():
        return []
    records = latest(RECORDS, lambda record: (record["draw"]["seed"], record["draw"]["worn"]))
    return [
        "\n## Causes that the library does not hold\n",
        "Made by `python benchmarks/naming_outside.py --budget 0`: what is added to one joint's effort follows none of the laws\n"
        "that can be named. It should be said what it depends on; a name is false, but of friction there and of a part of the\n"
        "cause (a spring of the joint itself, a drift). It is 10 to 30 % of the joint's effort; half of the robots are worn.\n"
        "What motion predicts of it networks [learn](diagnosis.md#the-rest): how often, and the median of what they take off\n"
        "the extended model's held-out error there.\n",
        f"{len(records)} diagnoses, {standing(records, code)}\n",
        markdown(table(records)),
    ]
