"""Result of a diagnosis: findings, their rivals, the gain, and what cannot be told apart."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bdnn_ros.diagnosis.sentences import SINCE, Kind, Note
from bdnn_ros.effects.environment import EDGES
from bdnn_ros.effects.registry import EFFECTS
from bdnn_ros.written import whole

FORMAT = "bdnn_ros/diagnosis"
VERSION = 1

Verdict = Literal["nothing_wrong", "explained", "partly_explained", "cannot_tell"]


@dataclass(frozen=True)
class Quantity:
    """A parameter's value with its standard deviation, in `unit`."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Rival:
    """Another cause that could stand in a finding's place, with its probability."""

    effect: str
    joint: str | None
    link: str | None
    probability: float
    variant: str = ""

    @property
    def where(self) -> str:
        """Joint or link it acts on, "base", or "all joints"."""
        return place(self.joint, self.link, self.effect)


@dataclass(frozen=True)
class Finding:
    """One named cause, with the fields of the contract.

    Attributes:
        share: share of the simulation's held-out squared error that the finding removes; for a fault of the reported velocity,
            share of the velocity's squared error, which diagnosis.json leaves out.
        probability: against its rivals and against no cause at all.
        variant: which effect of this name, where there are several: what drifts, what is pushed.
    """

    effect: str
    joint: str | None
    link: str | None
    parameters: Mapping[str, Quantity]
    share: float
    probability: float
    rivals: tuple[Rival, ...]
    sentence: str
    variant: str = ""

    @property
    def where(self) -> str:
        """Joint or link it acts on, "base", or "all joints"."""
        return place(self.joint, self.link, self.effect)

    @property
    def of_velocity(self) -> bool:
        """Whether the cause is in the reported velocity: `share` is then of that velocity's error, not of the effort's."""
        known = EFFECTS.get(self.effect)
        return known is not None and known.kinematic


@dataclass(frozen=True)
class Diagnosis:
    """Everything a diagnosis found; `as_json` is the contract's diagnosis.json.

    Attributes:
        source: bags, duration without pauses [s], samples and rate [Hz] of what was examined, urdf, joints.
        effort_rmse: root mean square error on held-out blocks per joint [N·m] of the simulation, the extended model, and
            the noise floor; zero where nothing was measured while the joint moved (a note says so).
        verdict: whether the findings explain what the simulation gets wrong.
        findings: those with the largest shares first, those of a reported velocity last.
        gain: 1 - RMSE(extended) / RMSE(simulation) on held-out blocks.
        gain_interval: its bounds at 95 %.
        unexplained_share: share of the simulation's squared error that remains above the noise.
        unexplained_depends_on: inputs that predict it, as `joint.quantity`.
        unexplained_sentence: the sentence that reports it.
        learned: relative reduction of the extended model's held-out error by networks, at the joints where they learned the
            rest, with its bounds at 95 %; None where they learned nothing.
        advice: what to do next.
        notes: remarks on the recordings and the findings.
        above: joints whose extended-model error exceeds the noise, largest first; not in diagnosis.json, nor are the next two.
        slight: joints whose error exceeds twice the noise, though by too little to matter.
        noted: what the notes say, except for those of the recordings.
    """

    source: Mapping[str, Any]
    verdict: Verdict
    findings: tuple[Finding, ...]
    effort_rmse: Mapping[str, np.ndarray]
    gain: float
    gain_interval: tuple[float, float]
    unexplained_share: float
    unexplained_depends_on: tuple[str, ...]
    unexplained_sentence: str
    advice: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())
    above: tuple[str, ...] = field(default=())
    slight: tuple[str, ...] = field(default=())
    noted: tuple[Note, ...] = field(default=())
    learned: tuple[float, float, float] | None = None

    @property
    def stays(self) -> bool:
        """Whether the extended model is the reference (simulation or earlier model) unchanged: both have the same error."""
        return not self.findings and self.gain == 0.0 and self.gain_interval == (0.0, 0.0)

    @property
    def kinds(self) -> set[Kind]:
        """Kinds of its notes."""
        return {note.kind for note in self.noted}

    @property
    def also(self) -> tuple[str, ...]:
        """Corrections that are no findings but make up most of what the extended model improves beside some."""
        return ("links",) * (Kind.MOSTLY_LINKS in self.kinds) + ("stamps",) * (Kind.BY_LEAD in self.kinds)

    @property
    def endless(self) -> bool:
        """Whether something is named that another cause that changed may imitate, as a push that is not seen to end."""
        return not self.kinds.isdisjoint({Kind.ENDLESS, Kind.WITH_TIME})

    def as_json(self) -> dict[str, Any]:
        """The contract's diagnosis.json."""
        return {
            "format": FORMAT,
            "version": VERSION,
            "source": dict(self.source),
            "verdict": self.verdict,
            "findings": [_finding_json(finding) for finding in self.findings],
            "effort_rmse": {key: [_rounded(v) for v in values] for key, values in self.effort_rmse.items()},
            "gain": {"value": _rounded(self.gain), "interval": [_rounded(v) for v in self.gain_interval]},
            "unexplained": {
                "share": _rounded(self.unexplained_share),
                "depends_on": list(self.unexplained_depends_on),
                "sentence": self.unexplained_sentence,
                **self._learned_json(),
            },
            "advice": list(self.advice),
            "notes": list(self.notes),
        }

    def _learned_json(self) -> dict[str, Any]:
        if self.learned is None:
            return {}
        value, low, high = map(_rounded, self.learned)
        return {"learned": {"value": value, "interval": [low, high]}}

    def save(self, path: Path) -> None:
        """Write diagnosis.json atomically."""
        with whole(path) as beside:
            beside.write_text(json.dumps(self.as_json(), indent=1) + "\n", encoding="utf-8")


def _finding_json(finding: Finding) -> dict[str, Any]:
    return {
        **_place_json(finding),
        "parameters": {
            name: {"value": _value(name, q.value), "std": _rounded(q.std), "unit": q.unit}
            for name, q in finding.parameters.items()
        },
        # a share of the velocity's error would be ranked above shares of the effort's
        "share": _rounded(0.0 if finding.of_velocity else finding.share),
        "probability": _rounded(finding.probability),
        "rivals": [{**_place_json(r), "probability": _rounded(r.probability)} for r in finding.rivals],
        "sentence": finding.sentence,
    }


def _place_json(one: Finding | Rival) -> dict[str, Any]:
    """Effect and place, as in truth.yaml; a variant only where the effect has any."""
    named: dict[str, Any] = {"effect": one.effect}
    if one.variant:
        named["variant"] = one.variant
    return named | {"joint": one.joint, "link": one.link}


def _value(name: str, value: float) -> float:
    """A parameter's value as written: times rounded to the millisecond, however late in a recording, others to six digits."""
    return round(float(value), 3) if name in EDGES else _rounded(value)


def _rounded(value: float) -> float:
    """A value to six significant digits, more than data ever support."""
    return float(f"{float(value):.6g}")


def place(joint: str | None, link: str | None, effect: str) -> str:
    """Where an effect is: a link, a joint, the base or all joints."""
    if link or joint:
        return str(link or joint)
    known = EFFECTS.get(effect)
    return "base" if known is not None and known.on == "base" else "all joints"


def reference(since: bool) -> str:
    """What a recording is compared with: the earlier model if `since`, else the simulation."""
    return str(SINCE[since]["reference"])


def remaining(share: float) -> str:
    """A share of the squared error that is left, in per cent."""
    return f"{100.0 * share:.1f} %" if share >= 0.0005 else "less than 0.1 %"
