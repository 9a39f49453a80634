"""What is told of a case: findings, verdict, gain, and where more than noise is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bdnn_ros.diagnosis.pushes.pushes import pushing
from bdnn_ros.diagnosis.recorded.velocity_filter import reported_velocity
from bdnn_ros.diagnosis.regression.gains import held_out_gain
from bdnn_ros.diagnosis.result import Finding, Verdict
from bdnn_ros.diagnosis.sentences import Note
from bdnn_ros.diagnosis.telling.alike import FEWEST, Common, common, scaled, tied
from bdnn_ros.diagnosis.telling.case import MOST, SLIGHT, Case
from bdnn_ros.diagnosis.telling.endless import endless
from bdnn_ros.diagnosis.telling.naming import Doubts, Named, name_of, named
from bdnn_ros.diagnosis.telling.with_time import with_time
from bdnn_ros.effects.rigid import LinkInertia
from bdnn_ros.signals.glitches import jumping, without_glitches

TOLD = 2.0
"""Ratio to the noise floor above which an error is mentioned, even if a small share of the effort."""


@dataclass(frozen=True)
class Outcome:
    """What is told of a case, before it is put into words.

    Attributes:
        cutoff: requested low-pass [Hz]; None for the usual one.
    """

    case: Case
    cutoff: float | None = None

    @cached_property
    def names(self) -> Named:
        """Terms with and without a name."""
        return named(self.case, Doubts.of(self.case))

    @cached_property
    def alike(self) -> Common | None:
        """One factor common to all link errors, if it matters.

        That is where links are named or most of what the extended model improves, and where efforts of several joints are
        scaled.
        """
        case, causes = self.case, self.names.findings
        links = sum(one.effect == LinkInertia.name for one in causes)
        told = case.by_links > (MOST if causes else SLIGHT)
        matters = told or links >= FEWEST or scaled(causes)
        if case.earlier is not None or case.equations.alone is not None or not matters:
            return None
        return common(case.equations, case.attempt.fitted)

    @cached_property
    def causes(self) -> list[Finding]:
        """Findings of the efforts, those with the largest shares first."""
        return sorted(tied(self.names.findings, self.alike), key=lambda finding: -finding.share)

    @cached_property
    def findings(self) -> list[Finding]:
        """The causes, and findings of a reported velocity: filtered, it is no cause of an effort's error."""
        before = None if self.case.earlier is None else self.case.earlier.velocity_cutoff
        of_velocity = reported_velocity(self.case.recordings, self.cutoff, before)
        return [*self.causes, *sorted(of_velocity, key=lambda finding: -finding.share)]

    @cached_property
    def doubted(self) -> list[Note]:
        """Notes on findings that another cause which changed meanwhile may imitate."""
        case, names = self.case, self.names
        told = (case.found[one] for one in names.weighty if one not in (*names.silent, *names.unknown))
        placed = [(one, name_of(case.robot, one.term), case.equations) for one in told]
        return [note for each in placed for note in (*endless(*each), *with_time(*each))]

    @cached_property
    def jumps(self) -> list[str]:
        """Notes on recordings with jumps that cannot be mended."""
        return [note for recording in self.case.recordings for note in jumping(without_glitches(recording))]

    @cached_property
    def gain(self) -> tuple[float, tuple[float, float]]:
        """1 - RMSE(extended) / RMSE(simulation) on held-out rows, and its bounds at 95 %."""
        equations, attempt = self.case.equations, self.case.attempt
        pushed = pushing(attempt.fitted.terms, equations.rows.time)
        return held_out_gain(equations, attempt.extended, self.case.held, pushed)

    @property
    def surely(self) -> float:
        """The gain's lower bound."""
        return self.gain[1][0]

    @property
    def near(self) -> np.ndarray:
        """Whether the extended model's error is near the noise, (n,) bool."""
        return self.case.near(self.case.extended)

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict on the effort; never "nothing wrong" if something large is likely without being sure."""
        near = bool(self.near.all()) and not self.jumps
        if not self.causes:
            return "nothing_wrong" if near and not self._unclear else "cannot_tell"
        changing = any(judgement.changing for judgement in self.case.attempt.judgements)
        said = self.names.unsaid <= MOST and not changing and not self.doubted
        return "explained" if near and said else "partly_explained"

    @property
    def _unclear(self) -> bool:
        """Whether something may be wrong though nothing is named."""
        case, names = self.case, self.names
        surely_removed = 1.0 - (1.0 - min(self.surely, 1.0)) ** 2
        of_weight = case.equations.alone is not None and not case.near(case.simulation).all()
        unsure = names.doubtful or bool(names.unknown) or bool(case.always)
        # unnamed link errors are expected; other unnamed terms that remove more than these are not
        unsure |= min(names.beside_links, surely_removed) > max(SLIGHT, case.by_links)
        return unsure or case.far_off or of_weight or bool(case.remainder.resting)

    @property
    def above(self) -> tuple[str, ...]:
        """Joints whose extended-model error exceeds the noise, in order of the remaining squared error."""
        return self._in_order(~self.near)

    @property
    def slight(self) -> tuple[str, ...]:
        """Joints where it exceeds twice the noise, though by too little to matter."""
        return self._in_order(self.near & (self.case.extended > TOLD * self.case.floor))

    def _in_order(self, joints: np.ndarray) -> tuple[str, ...]:
        """Names of some joints, (n,) bool, in order of the squared error that is left."""
        order: Sequence[int] = np.argsort(-self.case.left, kind="stable").tolist()
        return tuple(self.case.robot.joints[j] for j in order if joints[j])
