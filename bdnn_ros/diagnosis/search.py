"""The search for the set of effects the data supports: add, replace, drop, until nothing changes.

A term enters only if the evidence pays its prior cost, if held-out blocks gain from it, and if it is large enough to matter.
A first choice is never final: every term is compared again with its rivals once the others are in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bdnn_ros.diagnosis.candidates import Candidates
from bdnn_ros.diagnosis.equations import Equations, Noise, Term
from bdnn_ros.diagnosis.evidence import Fit, Pool

COST = 8.0
"""Log prior odds against one effect at one place: about 150 candidates, and a false name is worse than none."""
COMMON_COST = 2.0
"""What a kind of effect costs that every other joint has, too."""
MINIMUM_SHARE = 0.02
"""An effect whose contribution is below this share of the effort's spread at every joint is not worth a name."""
LINK_ERRORS = (0.01, 0.03, 0.06, 0.12, 0.25)
"""Spreads of the links' relative errors that are tried; the evidence chooses."""
NOISE_FLOOR = 1e-4
"""Smallest noise as a share of the effort's spread."""
MOST_ROUNDS = 4
WINS = 0.6
"""Share of held-out blocks (of those that change) that must gain."""

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Selection:
    """The set of effects that was found, with everything needed to judge it.

    Attributes:
        pool: candidates at the final noise model; `chosen` are indices into it.
        fit: posterior of the chosen terms.
        costs: log prior odds of each pool term in the company of the chosen.
    """

    pool: Pool
    chosen: tuple[int, ...]
    fit: Fit
    costs: np.ndarray

    @property
    def terms(self) -> list[Term]:
        """The chosen terms."""
        return [self.pool.terms[c] for c in self.chosen]


class Search:
    """One search over the candidates of one regression."""

    def __init__(
        self, equations: Equations, candidates: Candidates, stamp_error: float, progress: Progress
    ) -> None:
        self.equations, self.candidates = equations, candidates
        self.stamp_error, self.progress = stamp_error, progress
        self.link_error = LINK_ERRORS[2]
        self.floor = NOISE_FLOOR * equations.effort_scale

    def run(self) -> Selection:
        """The best set of effects."""
        noise, rich = self._start()
        terms: list[Term] = []
        selection = self._select(noise, rich, terms)
        for round_ in range(MOST_ROUNDS):
            self.progress(f"round {round_ + 1}: {len(selection.chosen)} effects")
            previous = [t.place for t in selection.terms]
            noise = self._noise(selection)
            refined = self.candidates.refined(self.equations, selection.pool, selection.fit)
            selection = self._select(noise, selection.fit, refined, selection.pool)
            if {t.place for t in selection.terms} == set(previous) and round_ > 0:
                break
        return selection

    def _start(self) -> tuple[Noise, Fit | None]:
        """Noise of the residual that the commonest causes on every joint would leave, and a first estimate of the load."""
        equations = self.equations
        common = self.candidates.common()
        noise = Noise(np.zeros((equations.width, 1)), equations.effort_scale * 0.1)
        for _ in range(2):
            pool = Pool(equations, noise, common, LINK_ERRORS[-1], self.stamp_error)
            fit = pool.fit(range(len(common)))
            noise = equations.noise_of(pool.residual(fit), self.floor)
        equations.relieve(self.candidates.load(equations, pool, fit))
        return noise, None

    def _noise(self, selection: Selection) -> Noise:
        return self.equations.noise_of(selection.pool.residual(selection.fit), self.floor)

    def _select(
        self, noise: Noise, fit: Fit | None, start: Sequence[Term], pool: Pool | None = None
    ) -> Selection:
        """Best set at one noise model, starting from some terms."""
        base = Pool(self.equations, noise, list(start), self.link_error, self.stamp_error)
        self.link_error = self._best_link_error(noise, start)
        base = Pool(self.equations, noise, list(start), self.link_error, self.stamp_error)
        shaped = self.candidates.shaped(self.equations, base, base.fit(range(len(start))))
        pool = Pool(self.equations, noise, [*start, *shaped], self.link_error, self.stamp_error)
        chosen = list(range(len(start)))
        for _ in range(MOST_ROUNDS):
            before = set(chosen)
            chosen = self._add(pool, chosen)
            chosen = self._replace(pool, chosen)
            chosen = self._drop(pool, chosen)
            if set(chosen) == before:
                break
        return Selection(pool, tuple(chosen), pool.fit(chosen), self.costs(pool, chosen))

    def _best_link_error(self, noise: Noise, start: Sequence[Term]) -> float:
        scores = []
        for error in LINK_ERRORS:
            pool = Pool(self.equations, noise, list(start), error, self.stamp_error)
            scores.append(pool.fit(range(len(start))).evidence)
        return LINK_ERRORS[int(np.argmax(scores))]

    # -- moves --------------------------------------------------------------------------------------------------

    def _add(self, pool: Pool, chosen: list[int]) -> list[int]:
        refused: set[int] = set()
        while True:
            fit = pool.fit(chosen)
            open_ = [
                c for c in range(len(pool.terms)) if c not in refused and not self.conflict(pool, c, chosen)
            ]
            if not open_:
                return chosen
            gains = pool.gains(fit, open_) - self.costs(pool, chosen)[open_]
            best = int(np.argmax(gains))
            if gains[best] <= 0.0:
                return chosen
            candidate = open_[best]
            grown = [c for c in chosen if not contains(pool.terms[candidate], pool.terms[c])] + [candidate]
            if self._worth(pool, grown, chosen, candidate):
                chosen = grown
            else:
                refused.add(candidate)

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
            rivals = [
                c for c in range(len(pool.terms)) if c not in group and not self.conflict(pool, c, rest)
            ]
            if not rivals:
                continue
            scores = pool.gains(fit, rivals) - costs[rivals]
            now = self.score(pool, chosen) - self.score(pool, rest)
            best = int(np.argmax(scores))
            if scores[best] > now + 0.5:
                grown = [c for c in rest if not contains(pool.terms[rivals[best]], pool.terms[c])] + [
                    rivals[best]
                ]
                if self.score(pool, grown) > self.score(pool, chosen) + 0.5 and self._worth(
                    pool, grown, rest, rivals[best]
                ):
                    chosen = grown
        return chosen

    def _drop(self, pool: Pool, chosen: list[int]) -> list[int]:
        while chosen:
            score = self.score(pool, chosen)
            losses = [score - self.score(pool, [c for c in chosen if c != out]) for out in chosen]
            weakest = int(np.argmin(losses))
            without = [c for c in chosen if c != chosen[weakest]]
            if losses[weakest] > 0.0 and self._worth(pool, chosen, without, chosen[weakest]):
                return chosen
            chosen = without
        return chosen

    # -- judgements ---------------------------------------------------------------------------------------------

    def score(self, pool: Pool, chosen: Sequence[int]) -> float:
        costs = [self.costs(pool, [c for c in chosen if c != one])[one] for one in chosen]
        return pool.fit(chosen).evidence - float(np.sum(costs))

    def costs(self, pool: Pool, company: Sequence[int]) -> np.ndarray:
        """Log prior odds against each pool term: kinds that most other joints have are expected on this one."""
        width = self.equations.width
        having: dict[str, set[int]] = {}
        for c in company:
            term = pool.terms[c]
            for name in (term.effect.name, *term.effect.contains):
                having.setdefault(name, set()).add(term.target)
        costs = np.full(len(pool.terms), COST)
        for i, term in enumerate(pool.terms):
            if term.effect.on == "joint" and width > 2:
                others = len(having.get(term.effect.name, set()) - {term.target})
                share = min(others / (width - 1), 1.0)
                costs[i] = COST + (COMMON_COST - COST) * max(2.0 * share - 1.0, 0.0)
        return costs

    def conflict(self, pool: Pool, candidate: int, chosen: Sequence[int]) -> bool:
        """Whether a candidate is already said by the chosen: same effect and place, or contained in one of them."""
        term = pool.terms[candidate]
        return any(pool.terms[c].place == term.place or contains(pool.terms[c], term) for c in chosen)

    def _worth(self, pool: Pool, grown: Sequence[int], without: Sequence[int], candidate: int) -> bool:
        """Whether a term is large enough to matter and pays on blocks it was not fitted to."""
        fit = pool.fit(grown)
        coefficients, _ = pool.part(fit, candidate)
        columns = self.equations.columns(pool.terms[candidate])
        part = np.where(self.equations.usable, columns @ coefficients, 0.0)
        size = np.sqrt(np.mean(part**2, axis=0)) / self.equations.effort_scale
        if size.max() < MINIMUM_SHARE:
            return False
        gained = pool.held_out([c for c in grown if c != candidate]) - pool.held_out(grown)
        if gained.sum() <= 0.0:
            return False
        return bool(gained.sum() > 1.645 * gained.std() * np.sqrt(len(gained)) or (gained > 0).mean() >= WINS)


def contains(larger: Term, smaller: Term) -> bool:
    return smaller.effect.name in larger.effect.contains and smaller.target == larger.target
