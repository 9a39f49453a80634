"""Moves of a search (add, replace, drop) and the conditions under which a set of effects is better."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from bdnn_ros.aside import first_in_two
from bdnn_ros.diagnosis.pushes.pushes import leftover, tie_margin
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.odds import contains, having_each, log_odds, rival_joint, unbelievable
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.settling import refined

ABSURD = 1e9
"""Log odds against a physically impossible effect."""
MOST_ROUNDS = 4
RIVALS_TRIED = 6
UNSURE = 30.0
"""A rival's gain is estimated without solving for the others' bounds again, and may be too low by this much [nats]."""
BETTER = 0.5
"""A rival must score this much better to replace a term [nats]."""
WORSE = 1.01
"""A term that raises the plain (not whitened) error by this factor does not pay."""
SURELY = 1.645
"""A total gain must exceed zero by this many standard deviations."""
WINS = 0.6
"""Least share of held-out blocks that must gain."""
PARTNERS_TRIED = 3
SAME = 0.01
"""Relative difference within which a law is no more than what it settles into."""
FEW_BLOCKS = 3
"""A push that acts in no more blocks than this is hardly known once one of them is held out."""


class Moves:
    """Moves of a search over the candidates of one regression."""

    def __init__(self, equations: Equations, candidates: Candidates) -> None:
        self.equations, self.candidates = equations, candidates

    def descend(self, pool: Pool, chosen: list[int], least: float) -> tuple[Pool, list[int]]:
        """Add, replace and drop terms until nothing changes; only one pass if weak terms have to wait.

        Wrong terms are replaced first: terms added to make up for them would keep them in. An unchanged set is not tried
        again.
        """
        given, chosen = chosen, self._replace(pool, chosen)
        for _ in range(1 if least else MOST_ROUNDS):
            before = {pool.terms[c].place for c in chosen}
            stays = chosen if chosen is given else None
            pool, given = self._add(pool, chosen, least)
            chosen = given if given is stays else self._replace(pool, given)
            pool, chosen = self._regrow(pool, chosen, least)
            chosen = self._drop(pool, chosen)
            if {pool.terms[c].place for c in chosen} == before:
                break
        return pool, chosen

    def _add(
        self,
        pool: Pool,
        chosen: list[int],
        least: float,
        barred: Sequence[int] = (),
        wanted: float = -np.inf,
    ) -> tuple[Pool, list[int]]:
        """Add terms that pay, the best first, as long as a wanted score is still within reach."""
        refused, largest = set(barred), 0.0
        while True:
            fit = pool.fit(chosen)
            open_ = [c for c in self.open_to(pool, chosen) if c not in refused]
            if not open_ or pool.evidence_bound([*chosen, *open_]) < wanted:
                return pool, chosen
            gains = pool.gains(fit, open_) - self.costs(pool, chosen, open_)
            best = int(np.argmax(gains))
            largest = max(largest, float(gains[best]))
            if gains[best] <= least * largest:
                return pool, chosen
            candidate = open_[best]
            trial, grown = self._grown(pool, chosen, candidate)
            found = (trial, grown) if self.pays(trial, grown, candidate) else None
            if found is None and gains[best] > UNSURE and self._worse(trial, grown, chosen):
                found = self._with_partner(trial, grown, chosen)
            if found is None:
                refused.add(candidate)
            else:
                pool, chosen = found

    def _grown(self, pool: Pool, chosen: Sequence[int], *added: int) -> tuple[Pool, list[int]]:
        """The chosen with some terms added, their shapes refined, and what these contain removed."""
        kept = [c for c in chosen if not any(contains(pool.terms[one], pool.terms[c]) for one in added)]
        grown = [*kept, *added]
        return refined(self.candidates, self.equations, pool, grown, added), grown

    def _with_partner(
        self, pool: Pool, grown: Sequence[int], chosen: Sequence[int]
    ) -> tuple[Pool, list[int]] | None:
        """The last of the grown with a second term at its joint, where both pay only together; None without.

        Friction that a delay shifts enlarges plain errors as long as its column is not shifted.
        """
        candidate, joint = grown[-1], pool.terms[grown[-1]].target
        open_ = [c for c in self.open_to(pool, grown) if pool.terms[c].target == joint]
        if joint < 0 or not open_ or not self.predicts_better(pool, grown, chosen):
            return None
        gains = pool.gains(pool.fit(grown), open_) - self.costs(pool, grown, open_)
        for k in np.argsort(-gains)[:PARTNERS_TRIED]:
            trial, both = self._grown(pool, chosen, candidate, open_[k])
            pay = all(self.pays(trial, both, one) for one in (candidate, open_[k]))
            if pay and not self._worse(trial, both, chosen):
                return trial, both
        return None

    def _replace(self, pool: Pool, chosen: list[int], late: bool = False, alone: bool = True) -> list[int]:
        """Replace each term, and each pair of terms at one joint, by one rival that scores better.

        Args:
            late: only by rivals no richer than what they replace, and neither from nor to pushes, whose times fit the terms
                they were found beside.
            alone: also single terms, not only pairs.
        """
        groups: list[tuple[int, ...]] = [(c,) for c in chosen] if alone else []
        groups += [
            (a, b)
            for i, a in enumerate(chosen)
            for b in chosen[i + 1 :]
            if pool.terms[a].target == pool.terms[b].target
        ]
        while found := first_in_two(partial(self._instead, pool, chosen, late), groups):
            at, chosen = found
            groups = groups[at + 1 :]
        return chosen

    def _instead(self, pool: Pool, chosen: list[int], late: bool, group: tuple[int, ...]) -> list[int] | None:
        """The chosen with a rival in place of a group, see `_replace`; None if none scores better."""
        if not set(group) <= set(chosen):
            return None
        rest = [c for c in chosen if c not in group]
        now = self.score(pool, chosen)
        better = BETTER + tie_margin(pool.terms[group[0]], now - self.score(pool, rest))
        for rival, behind in self.rivals(pool, chosen, *group)[:RIVALS_TRIED]:
            if behind >= UNSURE:
                break
            grown = [*(c for c in rest if not contains(pool.terms[rival], pool.terms[c])), rival]
            if late and not self._plainer(pool, chosen, group, rival):
                continue
            worth = self.score_beside(pool, grown[:-1], rival)
            if worth > now + better and self.pays(pool, grown, rival):
                return grown
        return None

    def _plainer(self, pool: Pool, chosen: list[int], group: Sequence[int], rival: int) -> bool:
        # an offset beside dry friction equals uneven friction
        own = () if len(group) == 1 or pool.terms[rival].shape else group
        richer = any(contains(pool.terms[rival], pool.terms[c]) for c in chosen if c not in own)
        return not (richer or any(pool.terms[c].effect.timed for c in (*group, rival)))

    def _regrow(self, pool: Pool, chosen: list[int], least: float) -> tuple[Pool, list[int]]:
        """Replace what acts on several joints by as many terms as it takes: one body may look like many rotors."""
        for wide in [c for c in chosen if pool.terms[c].effect.on_body or pool.terms[c].target < 0]:
            rest = [c for c in chosen if c != wide]
            wanted = self.score(pool, chosen) + BETTER
            other, grown = self._add(pool, rest, least, [wide], wanted)
            if self.score(other, grown) > wanted:
                pool, chosen = other, grown
        return pool, chosen

    def _drop(self, pool: Pool, chosen: list[int]) -> list[int]:
        while chosen:
            score = self.score(pool, chosen)
            losses = [score - self.score(pool, [c for c in chosen if c != out]) for out in chosen]
            weakest = int(np.argmin(losses))
            without = [c for c in chosen if c != chosen[weakest]]
            if losses[weakest] > 0.0 and self.pays(pool, chosen, chosen[weakest]):
                return chosen
            chosen = without
        return chosen

    def reconsidered(self, pool: Pool, chosen: list[int]) -> list[int]:
        """The chosen reconsidered with other rows than the search's: terms are replaced or dropped, none added."""
        return self._drop(pool, self._replace(pool, chosen, late=True))

    def joined(self, pool: Pool, chosen: list[int]) -> list[int]:
        """The chosen with pairs of terms at a joint replaced by one rival wherever that scores better."""
        return self._replace(pool, chosen, late=True, alone=False)

    def rivals(self, pool: Pool, chosen: Sequence[int], *group: int) -> list[tuple[int, float]]:
        """Terms that could replace some of the chosen, best first, each with the estimated loss of score."""
        rest = [c for c in chosen if c not in group]
        fit = pool.fit(rest)
        kept = self.score(pool, chosen) - self.score(pool, rest)
        where = rival_joint(pool.terms[group[0]])
        spots = {pool.terms[c].spot for c in group}  # another occurrence at the same place is no rival
        found = [c for c in self.open_to(pool, rest, where) if pool.terms[c].spot not in spots]
        if not found:
            return []
        scores = pool.gains(fit, found) - self.costs(pool, rest, found)
        return [(found[k], kept - float(scores[k])) for k in np.argsort(-scores)]

    def score(self, pool: Pool, chosen: Sequence[int]) -> float:
        """Log evidence of a set minus its prior costs."""
        fit = pool.fit(chosen)
        against = ABSURD * unbelievable(pool, fit)
        return fit.evidence - against - float(self.costs(pool, chosen, chosen).sum())

    def score_beside(self, pool: Pool, rest: Sequence[int], one: int) -> float:
        """Score of some terms and one that replaces others.

        The load is recomputed without those others; otherwise a scale or delay of it could explain their effort again.
        """
        term, equations = pool.terms[one], self.equations
        if term.effect.of_load:
            load = equations.motion.with_load(*self.candidates.load(equations, pool, pool.fit(rest)))
            pool = pool.replacing({one: term}, equations.columns.fresh(term, load))
        return self.score(pool, [*rest, one])

    def costs(self, pool: Pool, company: Sequence[int], of: Sequence[int]) -> np.ndarray:
        """Prior cost of each of some terms in some company, (len(of),) [nats]."""
        having, carried = having_each(pool, company), self.candidates.robot.carried
        return np.array([log_odds(pool.terms[one], having, carried) for one in of])

    def open_to(
        self, pool: Pool, chosen: Sequence[int], where: int = -1, instead: Term | None = None
    ) -> list[int]:
        """Candidates that may join the chosen: at a free place, contained in none of them, and excluded by none.

        Args:
            where: only those that can replace an effect at this joint, including all that move bodies; -1 for all.
            instead: term to be replaced; a candidate that equals it along this motion is not excluded by others.
        """
        taken = {pool.terms[c].place for c in chosen}
        each = [(pool.terms[c].effect, pool.terms[c].target) for c in chosen]
        barred = {(name, at) for effect, at in each for name in effect.contains}
        apart = {(name, at) for effect, at in each for name in effect.without}
        return [
            c
            for c, term in enumerate(pool.terms)
            if (where < 0 or term.target in (where, -1) or term.link or term.effect.of_bodies)
            and term.place not in taken
            and (term.effect.name, term.target) not in barred
            and ((term.effect.name, term.target) not in apart or self._settled(term, instead))
        ]

    def _settled(self, term: Term, instead: Term | None) -> bool:
        """Whether a term equals, along this motion, what it settles into, and that is the term it would replace."""
        plain = None if instead is None else term.settled(self.equations.motion)
        if instead is None or plain is None or plain.spot != instead.spot:
            return False
        law, of = (self.equations.columns.of(one).ravel() for one in (term, plain))
        return float(np.linalg.norm(law - of * (of @ law / (of @ of)))) <= SAME * float(np.linalg.norm(law))

    def pays(self, pool: Pool, grown: Sequence[int], candidate: int) -> bool:
        """Whether a term improves the prediction of held-out blocks and does not raise the plain error.

        Link errors beyond belief may predict held-out blocks as well, so the prior counts, too.
        """
        if unbelievable(pool, pool.fit(grown)) or leftover(pool, grown, candidate):
            return False
        without = [c for c in grown if c != candidate]
        if self._worse(pool, grown, without) and not self._for_belief(pool, grown, without):
            return False
        if bends(pool.terms[candidate]) and self._worse(pool, grown, without, blur=False):
            return False  # a blur is curvature of the load, too, but is in no model
        return self.predicts_better(pool, grown, without)

    def _worse(self, pool: Pool, one: Sequence[int], other: Sequence[int], blur: bool = True) -> bool:
        """Whether one set leaves a larger plain error than another, all frequencies weighted alike.

        Args:
            blur: include the blurs; see `Pool.contribution`.
        """
        return self._left(pool, one, blur) > WORSE * self._left(pool, other, blur)

    def _for_belief(self, pool: Pool, one: Sequence[int], other: Sequence[int]) -> bool:
        """Whether one set wins over another more by letting links stay near their prior than by smaller held-out errors."""
        whiter = float(np.sum(pool.held_out(other) - pool.held_out(one)))
        return pool.disbelief(other) - pool.disbelief(one) > whiter

    def predicts_better(self, pool: Pool, one: Sequence[int], other: Sequence[int]) -> bool:
        """Whether one set surely predicts held-out blocks better than another, departures from the prior included.

        A single unusual block, as at the start of a recording, has no veto. Nor have those of a push in both sets that hardly
        any other block knows.
        """
        gained = pool.held_out(other) - pool.held_out(one)
        gained += (pool.disbelief(other) - pool.disbelief(one)) / len(gained)
        gained = gained[~self._briefly_pushed(pool, set(one) & set(other))]
        often = bool((gained > 0).mean() >= WINS)
        if gained.sum() > 0.0:
            return often or _surely(gained)
        return often and _surely(np.delete(gained, np.argmin(gained)))

    def _briefly_pushed(self, pool: Pool, chosen: Iterable[int]) -> np.ndarray:
        """Blocks in which a push acts that acts in few of them, (B,) bool; none if that leaves too few blocks."""
        block, pushed = self.equations.rows.block, np.zeros(self.equations.rows.blocks, bool)
        for one in chosen:
            if pool.terms[one].effect.timed:
                acts = np.unique(block[self.equations.columns.of(pool.terms[one]).any(axis=(1, 2))])
                pushed[acts] |= len(acts) <= FEW_BLOCKS
        return pushed & (2 * pushed.sum() < len(pushed))

    def _left(self, pool: Pool, chosen: Sequence[int], blur: bool) -> float:
        """Squared plain residual of a set, relative to the effort's squared spread, all frequencies weighted alike."""
        residual = pool.residual(pool.fit(chosen), blur) / self.equations.rows.effort_scale
        return float(np.sum(np.where(pool.sure, residual, 0.0) ** 2))


def bends(term: Term) -> bool:
    """Whether a term moves the bodies under the load that all terms make together, as an elastic gear does."""
    return term.effect.of_load and term.effect.of_bodies


def _surely(gained: np.ndarray) -> bool:
    """Whether the sum of gains (B,) is significantly positive."""
    return bool(gained.sum() > SURELY * gained.std() * np.sqrt(len(gained)))
