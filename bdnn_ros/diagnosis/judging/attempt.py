"""A search without some held-out rows, the choice of these, and how well the result predicts them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.diagnosis.judging.identifiability import Judgement, judge, likelier, plainer, weighed
from bdnn_ros.diagnosis.judging.steadiness import steadied
from bdnn_ros.diagnosis.pushes.pushes import edges
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.gains import MINIMUM_SHARE, acting, removed, rms
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.search import Progress, Search
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.diagnosis.search.settling import settled, windows_anew
from bdnn_ros.effects.motion import Motion

EVERY_TEST_BLOCK = 5
"""One block in so many is held out of the search and of the fit that the gain is measured with."""
TEST_PHASES = (2, 4)
"""Which of every five blocks is held out; the second is tried where the first holds something seen nowhere else."""
SURPRISING = 2.0
"""Ratio of the error in held-out rows to that in the others above which other blocks are held out."""
AROUND = 0.3
"""Time before and after a push that the low-pass affects [s]."""
SWAPS = 5
"""Most findings that may give way to a likelier rival."""


@dataclass(frozen=True)
class Attempt:
    """Result of a search without the test rows, judged by all rows.

    Attributes:
        test: rows held out of the search, and finally those of `completed`, (R,) bool.
        judgements: of each term, by all rows.
        fitted: the terms, fitted to all rows but the test rows.
        extended: residual of the search's own terms, fitted likewise, rows (R, n) [N·m]: terms that all rows chose would be
            biased towards the test rows.
    """

    test: np.ndarray
    judgements: list[Judgement]
    fitted: Pool
    extended: np.ndarray


@dataclass(frozen=True)
class Look:
    """A first look without the test rows.

    Attributes:
        test: the test rows, (R,) bool.
        found: the terms that stand out.
        motion: with the load estimate of this look.
        surprise: of the test rows, see `surprise`.
    """

    test: np.ndarray
    search: Search
    found: Selection
    motion: Motion
    surprise: float


class Looks:
    """First looks at one regression, one for each phase of held-out blocks."""

    def __init__(
        self, equations: Equations, candidates: Candidates, link_errors: Sequence[float], say: Progress
    ) -> None:
        self.equations, self.candidates, self.say = equations, candidates, say
        self.whole, self._motion = equations.usable, equations.motion
        self._link_errors = link_errors
        self._seen: dict[int, Look] = {}

    def at(self, phase: int) -> Look:
        """The look without the test rows of a phase; cached."""
        if phase not in self._seen:
            self.say("first look")
            self._seen[phase] = self._looked(self.equations.rows.block % EVERY_TEST_BLOCK == phase)
        return self._seen[phase]

    def pushed(self) -> np.ndarray:
        """Samples at which the first look finds a push, (N,) bool."""
        time = self.equations.motion.time
        pushed = np.zeros(len(time), bool)
        for term in self.at(TEST_PHASES[0]).found.terms:
            if term.effect.timed:
                start, end = edges(term)
                pushed |= (time > start - AROUND) & (time < end + AROUND)
        return pushed

    def tilt(self) -> tuple[float, float] | None:
        """Roll and pitch [rad] of the base if the first look finds it tilted, with consistent load and bodies; else None."""
        found = self.at(TEST_PHASES[0]).found
        if not any(term.effect.on == "base" for term in found.terms):
            return None
        pool = Pool(self.equations, found.pool.noise, found.terms, found.pool.link_error)
        pool = settled(self.candidates, self.equations, pool)
        (tilt,) = (one for one, term in enumerate(pool.terms) if term.effect.on == "base")
        roll, pitch = pool.coefficients(pool.whole, tilt)
        return float(roll), float(pitch)

    def _looked(self, test: np.ndarray) -> Look:
        equations = self.equations
        equations.use_motion(self._motion)
        search = Search(equations, self.candidates, self.say, self._link_errors)
        equations.use_rows(self.whole & ~test[:, None])
        found = search.first()
        sure = self.whole & found.pool.noise.sure(equations.rows.sticking_doubt)
        left = found.pool.residual(found.fit, blur=False)
        return Look(
            test, search, found, equations.motion, surprise(left, sure, test, equations.rows.effort_scale)
        )


def best_attempt(looks: Looks) -> Attempt:
    """The first attempt whose held-out rows are predicted about as well as the rest, or else the best predicted one.

    First looks choose which blocks to begin with: a search for something that acts in held-out rows only is long and in vain.
    """
    equations, say = looks.equations, looks.say
    phases = list(TEST_PHASES)
    if looks.at(phases[0]).surprise > SURPRISING:
        say("what was held out is not like the rest: other blocks as well")
        phases.sort(key=lambda phase: looks.at(phase).surprise)
    made: list[tuple[float, Attempt, Motion]] = []
    for phase in phases:
        if made:
            say("what was held out is not like the rest: again with other blocks")
        look = looks.at(phase)
        equations.use_motion(look.motion)
        attempt = attempted(look.search, look.found, looks.whole, look.test)
        surprising = surprise(attempt.extended, attempt.fitted.sure, look.test, equations.rows.effort_scale)
        made.append((surprising, attempt, equations.motion))
        if surprising <= SURPRISING:
            break
    _, attempt, motion = min(made, key=lambda one: one[0])
    equations.use_motion(motion)
    return attempt


def attempted(search: Search, first: Selection, whole: np.ndarray, test: np.ndarray) -> Attempt:
    """Search without the test rows (R,), then reconsider the result with all `whole` rows (R, n).

    With all rows the windows of pushes are refined and terms give way to rivals or are dropped; none is added.

    Args:
        first: result of the first look.
    """
    equations = search.equations
    equations.use_rows(whole & ~test[:, None])
    found = search.run(first)
    search.progress("weighing rivals")
    equations.use_rows(whole)
    noise, link_error = found.pool.noise, found.pool.link_error
    terms = windows_anew(search.candidates, equations, Pool(equations, noise, found.terms, link_error)).terms
    selection, judgements = _reconsidered(search, found, terms)
    if any(judgement.changing for judgement in judgements):
        # error is that of the one push reported, not of all that stood for it
        terms, noise = selection.terms, selection.pool.noise
    equations.use_rows(whole & ~test[:, None])
    alone = settled(search.candidates, equations, Pool(equations, noise, terms, link_error))
    extended, fitted = alone.residual_of_all(), alone
    if selection.terms != terms:
        fitted = settled(search.candidates, equations, Pool(equations, noise, selection.terms, link_error))
    equations.use_rows(whole)
    return Attempt(test, judgements, fitted, extended)


def completed(equations: Equations, attempt: Attempt) -> Attempt:
    """Add the middle fifth of each brief effect that acts outside the test rows only to these, predicted by a fit without it.

    Otherwise the held-out error would be that of a recording without such an effect.
    """
    fitted, test, counted = attempt.fitted, attempt.test.copy(), equations.usable
    removals = removed(equations, fitted, attempt.extended, counted & test[:, None])
    for one, (removal,) in enumerate(removals):
        if removal.brief and not removal.there:
            part = equations.columns.of(fitted.terms[one]) @ fitted.coefficients(fitted.whole, one)
            when = np.flatnonzero((acting(part) & counted).any(axis=1))
            half = len(when) * (EVERY_TEST_BLOCK - 1) // (2 * EVERY_TEST_BLOCK)
            test[when[half : len(when) - half]] = True
    if (test == attempt.test).all():
        return attempt
    equations.use_rows(counted & ~test[:, None])
    left = Pool(equations, fitted.noise, fitted.terms, fitted.link_error).residual_of_all()
    equations.use_rows(counted)
    among = (test & ~attempt.test)[:, None]
    return replace(attempt, test=test, extended=np.where(among, left, attempt.extended))


def _reconsidered(search: Search, found: Selection, terms: list[Term]) -> tuple[Selection, list[Judgement]]:
    """The found terms reconsidered by the rows usable now, and their judgements."""
    places = {term.place for term in terms}
    others = [term for term in found.pool.terms if term.place not in places]
    pool = Pool(search.equations, found.pool.noise, [*terms, *others], found.pool.link_error)
    chosen = tuple(search.moves.reconsidered(pool, list(range(len(terms)))))
    selection = plainer(Selection(pool, chosen, pool.fit(chosen)))
    judgements = judge(search, selection)
    seen = [selection.places]
    for _ in range(SWAPS):
        better = likelier(search, selection, judgements)
        # in a tie each may seem likelier from the other's side
        if better is None or better.places in seen:
            break
        seen.append(better.places)
        selection, judgements = better, judge(search, better)
    if len(seen) > 1:  # terms replaced one after the other may be one cause
        joined = tuple(search.moves.joined(selection.pool, list(selection.chosen)))
        if joined != selection.chosen:
            selection = Selection(selection.pool, joined, selection.pool.fit(joined))
            judgements = judge(search, selection)
    # only now: two constant pushes may seem to be a changing one until each is on its link
    selection, changing = steadied(search, selection)
    if changing:
        each = zip(selection.chosen, judge(search, selection), strict=True)
        judgements = [changing.get(one, judgement) for one, judgement in each]
    return selection, weighed(search, selection, judgements)


def surprise(left: np.ndarray, sure: np.ndarray, test: np.ndarray, scale: np.ndarray) -> float:
    """Largest ratio, over joints, of held-out error to that of the other rows, for errors large enough to matter.

    Above `SURPRISING` the search cannot have seen the cause.

    Args:
        left: error, rows (R, n) [N·m].
        sure: usable rows, (R, n) bool.
        test: those that were held out, (R,) bool.
        scale: spread of each joint's effort, (n,) [N·m].
    """
    held, rest = rms(left, sure & test[:, None]), rms(left, sure & ~test[:, None])
    return float(np.max(np.where(held > MINIMUM_SHARE * scale, held / np.maximum(rest, 1e-12), 0.0)))
