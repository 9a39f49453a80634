"""The search for the set of effects the data supports: add, replace, drop, until nothing changes.

A term enters only if the evidence pays its prior cost, if held-out blocks gain from it, and if it is large enough to matter.
A first choice is never final: every term is compared again with its rivals once the others are in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.candidates import Candidates
from bdnn_ros.diagnosis.equations import Equations, Term
from bdnn_ros.diagnosis.evidence import Fit, Pool
from bdnn_ros.diagnosis.noise import Noise
from bdnn_ros.diagnosis.odds import contains, having_each, log_odds, near, unbelievable
from bdnn_ros.diagnosis.settling import at_own_noise, refined

LINK_ERRORS = (0.02, 0.05, 0.1, 0.2)
"""Spreads of the links' relative errors that are tried; the evidence chooses."""
DOUBTS = (0.01, 0.02, 0.05, 0.1)
"""The same where links were identified before: one to ten standard deviations of that."""
LINK_ERROR_COST = 400.0
"""Log prior against a spread s of all links' errors is this times s²: a description is rarely off by 20 % everywhere."""
ABSURD = 1e9
"""Log odds against an effect that cannot be."""
NOISE_FLOOR = 1e-4
"""Smallest noise as a share of the effort's spread."""
MOST_ROUNDS = 4
OUTSTANDING = 0.1
"""What brings less than this share of the largest gain waits until noise and load are known better."""
RIVALS_TRIED = 6
HIDDEN_TRIED = 3
"""So many effects are tried that only white noise shows."""
LOUD = 15.0
"""Evidence that white noise must show of them: it overstates it."""
UNSURE = 30.0
"""A rival's gain is found with the others' bounds left as they are: by so much it may be too low."""
BETTER = 0.5
"""A rival must score so much better to take a term's place."""
WORSE = 1.01
"""What raises the plain error by this factor does not pay, however white it makes the rest."""
WINS = 0.6
"""Share of held-out blocks (of those that change) that must gain."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Selection:
    """The set of effects that was found, with everything needed to judge it.

    Attributes:
        pool: candidates at the final noise model; `chosen` are indices into it.
        fit: posterior of the chosen terms.
    """

    pool: Pool
    chosen: tuple[int, ...]
    fit: Fit

    @property
    def terms(self) -> list[Term]:
        """The chosen terms."""
        return [self.pool.terms[c] for c in self.chosen]


class Search:
    """One search over the candidates of one regression."""

    def __init__(
        self,
        equations: Equations,
        candidates: Candidates,
        progress: Progress,
        link_errors: Sequence[float] = LINK_ERRORS,
    ) -> None:
        self.equations, self.candidates = equations, candidates
        self.progress = progress
        self.link_errors = tuple(link_errors)
        self.link_error = self.link_errors[2]
        self.floor = NOISE_FLOOR * equations.effort_scale

    def run(self) -> Selection:
        """The best set of effects."""
        noise = self._start()
        selection = self._select(noise, [], OUTSTANDING)
        for round_ in range(MOST_ROUNDS):
            self.progress(f"round {round_ + 1}: {len(selection.chosen)} effects")
            previous = {t.place for t in selection.terms}
            settled = self._at_own_noise(selection.pool, selection.chosen, self.candidates.common())
            selection = self._select(settled.noise, settled.terms)
            if {t.place for t in selection.terms} == previous:
                break
        found = self._hidden_in_noise(selection)
        return selection if found is None else self._select(found.noise, found.terms)

    def _hidden_in_noise(self, selection: Selection) -> Pool | None:
        """The terms and one more that white noise shows and its own noise confirms; None without.

        What is constant or acts for a time can make the noise look slow, and slow noise then explains it.
        """
        now = self._at_own_noise(selection.pool, selection.chosen)
        chosen = range(len(now.terms))
        noise = self.equations.white_noise_of(now.residual(now.fit(chosen)), self.floor)
        pool = Pool(self.equations, noise, now.terms, self.link_error)
        shaped = self.candidates.shaped(self.equations, pool, pool.fit(chosen))
        pool = Pool(self.equations, noise, [*pool.terms, *shaped], self.link_error)
        open_ = self.open_to(pool, chosen)
        gains = pool.gains(pool.fit(chosen), open_) - self.costs(pool, chosen)[open_]
        motion, score = self.equations.motion, self.score(now, chosen)
        for best in np.argsort(-gains)[:HIDDEN_TRIED]:
            if gains[best] <= LOUD:
                break
            term = pool.terms[open_[best]]
            kept = [t for t in now.terms if not contains(term, t)]
            every = range(len(kept) + 1)
            trial = self._at_own_noise(Pool(self.equations, noise, [*kept, term], self.link_error), every)
            if self.score(trial, every) > score + BETTER and self._pays(trial, every, every[-1]):
                return trial
            self.equations.take(motion)
        return None

    def _at_own_noise(self, pool: Pool, chosen: Sequence[int], beside: Sequence[Term] = ()) -> Pool:
        terms = [pool.terms[c] for c in chosen]
        alone = Pool(self.equations, pool.noise, terms, pool.link_error)
        return at_own_noise(self.candidates, self.equations, alone, self.floor, beside)

    def _start(self) -> Noise:
        """Noise of what the commonest causes on every joint would leave, trends left out; a first estimate of the load.

        Trends are left out so that a push or a drift is not taken for slow noise before it could be named.
        """
        equations = self.equations
        common = self.candidates.common()
        noise = Noise(np.zeros((equations.width, 1)), equations.effort_scale * 0.1)
        for _ in range(2):
            pool = Pool(equations, noise, common, self.link_errors[-1])
            fit = pool.fit(range(len(common)))
            noise = equations.noise_of(pool.residual(fit), self.floor, steady=True)
        equations.relieve(*self.candidates.load(equations, pool, fit))
        return noise

    def _select(self, noise: Noise, start: Sequence[Term], least: float = 0.0) -> Selection:
        """Best set at one noise model, starting from some terms.

        Args:
            least: share of the largest gain that a term must bring.
        """
        count = len(start)
        pool = Pool(self.equations, noise, start, self.link_error)
        pool = refined(self.candidates, self.equations, pool, range(count))
        shaped = self.candidates.shaped(self.equations, pool, pool.fit(range(count)))
        pool = Pool(self.equations, noise, [*pool.terms, *shaped], self.link_error)
        found = [
            self._descend(pool.believing(error), list(range(count)), least) for error in self._beliefs(noise)
        ]
        scores = [self.score(pool, chosen) - LINK_ERROR_COST * pool.link_error**2 for pool, chosen in found]
        pool, chosen = found[int(np.argmax(scores))]
        self.link_error = pool.link_error
        return Selection(pool, tuple(chosen), pool.fit(chosen))

    def _beliefs(self, noise: Noise) -> list[float]:
        """Spreads of the links' errors worth a search: the likeliest beside the commonest causes, and the next smaller one.

        A single link far off makes all links look worse than they are; the smaller spread lets it be named.
        """
        common = self.candidates.common()
        pool = Pool(self.equations, noise, common, self.link_errors[-1])
        scores = [
            pool.believing(error).fit(range(len(common))).evidence - LINK_ERROR_COST * error**2
            for error in self.link_errors
        ]
        best = int(np.argmax(scores))
        return list(self.link_errors[max(best - 1, 0) : best + 1])

    def _descend(self, pool: Pool, chosen: list[int], least: float) -> tuple[Pool, list[int]]:
        """Add, replace and drop terms until nothing changes; once only where weak terms have to wait.

        A wrong term gives way first: what is added to mend it would keep it.
        """
        chosen = self._replace(pool, chosen)
        for _ in range(1 if least else MOST_ROUNDS):
            before = {pool.terms[c].place for c in chosen}
            pool, chosen = self._add(pool, chosen, least)
            chosen = self._replace(pool, chosen)
            chosen = self._drop(pool, chosen)
            if {pool.terms[c].place for c in chosen} == before:
                break
        return pool, chosen

    # -- moves --------------------------------------------------------------------------------------------------

    def _add(self, pool: Pool, chosen: list[int], least: float) -> tuple[Pool, list[int]]:
        refused: set[int] = set()
        largest = 0.0
        while True:
            fit = pool.fit(chosen)
            open_ = [c for c in self.open_to(pool, chosen) if c not in refused]
            if not open_:
                return pool, chosen
            gains = pool.gains(fit, open_) - self.costs(pool, chosen)[open_]
            best = int(np.argmax(gains))
            largest = max(largest, float(gains[best]))
            if gains[best] <= least * largest:
                return pool, chosen
            candidate = open_[best]
            grown = [c for c in chosen if not contains(pool.terms[candidate], pool.terms[c])] + [candidate]
            trial = self._refined_one(pool, grown, candidate)
            if self._pays(trial, grown, candidate):
                pool, chosen = trial, grown
            else:
                refused.add(candidate)

    def _refined_one(self, pool: Pool, chosen: Sequence[int], one: int) -> Pool:
        term = self.candidates.refined(self.equations, pool, pool.fit(chosen), one)
        return pool if term == pool.terms[one] else pool.replacing(one, term)

    def _replace(self, pool: Pool, chosen: list[int]) -> list[int]:
        """Give each term's place to a rival, and each two terms' place of one joint to one rival, where that scores better."""
        groups: list[tuple[int, ...]] = [(c,) for c in chosen]
        groups += [
            (a, b)
            for i, a in enumerate(chosen)
            for b in chosen[i + 1 :]
            if pool.terms[a].target == pool.terms[b].target
        ]
        for group in groups:
            if not set(group) <= set(chosen):
                continue
            rest = [c for c in chosen if c not in group]
            fit = pool.fit(rest)
            costs = self.costs(pool, rest)
            where = near(pool.terms[group[0]])
            rivals = [c for c in self.open_to(pool, rest, where) if c not in group]
            if not rivals:
                continue
            scores = pool.gains(fit, rivals) - costs[rivals]
            now = self.score(pool, chosen)
            kept = now - self.score(pool, rest)
            for best in np.argsort(-scores)[:RIVALS_TRIED]:
                if scores[best] <= kept - UNSURE:
                    break
                rival = rivals[best]
                grown = [*(c for c in rest if not contains(pool.terms[rival], pool.terms[c])), rival]
                if self.score(pool, grown) > now + BETTER and self._pays(pool, grown, rival):
                    chosen = grown
                    break
        return chosen

    def _drop(self, pool: Pool, chosen: list[int]) -> list[int]:
        while chosen:
            score = self.score(pool, chosen)
            losses = [score - self.score(pool, [c for c in chosen if c != out]) for out in chosen]
            weakest = int(np.argmin(losses))
            without = [c for c in chosen if c != chosen[weakest]]
            if losses[weakest] > 0.0 and self._pays(pool, chosen, chosen[weakest]):
                return chosen
            chosen = without
        return chosen

    # -- judgements ---------------------------------------------------------------------------------------------

    def score(self, pool: Pool, chosen: Sequence[int]) -> float:
        """Log evidence of a set less the log prior odds against it."""
        having, fit = having_each(pool, chosen), pool.fit(chosen)
        against = ABSURD * unbelievable(pool, fit)
        return (
            fit.evidence
            - against
            - sum(log_odds(pool.terms[one], having, self.equations.width) for one in chosen)
        )

    def costs(self, pool: Pool, company: Sequence[int]) -> np.ndarray:
        """Log prior odds against each pool term beside some company."""
        having = having_each(pool, company)
        return np.array([log_odds(term, having, self.equations.width) for term in pool.terms])

    def open_to(self, pool: Pool, chosen: Sequence[int], where: int = -1) -> list[int]:
        """Candidates that the chosen do not say already: not at the same place, nor contained in one of them.

        Args:
            where: only those that can stand for an effect at this joint; -1 for all.
        """
        taken = {pool.terms[c].place for c in chosen}
        inside = {(name, pool.terms[c].target) for c in chosen for name in pool.terms[c].effect.contains}
        return [
            c
            for c, term in enumerate(pool.terms)
            if (where < 0 or term.target in (where, -1) or term.link)
            and term.place not in taken
            and (term.effect.name, term.target) not in inside
        ]

    def _pays(self, pool: Pool, grown: Sequence[int], candidate: int) -> bool:
        """Whether a term pays on blocks it was not fitted to.

        Links that bend beyond belief to stand in for it predict held-out blocks as well, so belief is weighed, too.
        """
        if unbelievable(pool, pool.fit(grown)):
            return False
        without = [c for c in grown if c != candidate]
        if self._left(pool, grown) > WORSE * self._left(pool, without):
            return False
        gained = pool.held_out(without) - pool.held_out(grown)
        gained += (pool.disbelief(without) - pool.disbelief(grown)) / len(gained)
        if gained.sum() <= 0.0:
            return False
        return bool(gained.sum() > 1.645 * gained.std() * np.sqrt(len(gained)) or (gained > 0).mean() >= WINS)

    def _left(self, pool: Pool, chosen: Sequence[int]) -> float:
        """Squared error that a set leaves, per squared spread of the effort, with all frequencies counted alike."""
        residual = pool.residual(pool.fit(chosen)) / self.equations.effort_scale
        return float(np.sum(np.where(self.equations.usable, residual, 0.0) ** 2))
