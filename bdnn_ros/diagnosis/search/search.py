"""The search for the set of effects that the data support: add, replace and drop terms until nothing changes.

A term enters only if its evidence pays its prior cost, held-out blocks gain from it, and it is large enough to matter. No
choice is final: every term is compared with its rivals again once the others are in.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from bdnn_ros.aside import first_in_two, in_two
from bdnn_ros.diagnosis.pushes.pushes import leftover
from bdnn_ros.diagnosis.regression.coloring import noise_of, white_noise_of
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.odds import COST, contains, link_error_cost, related
from bdnn_ros.diagnosis.regression.term import Shape, Term, new_shapes, of_shapes
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.gathering import gathered
from bdnn_ros.diagnosis.search.leads import DELAY, moved
from bdnn_ros.diagnosis.search.moves import BETTER, MOST_ROUNDS, RIVALS_TRIED, UNSURE, Moves, bends
from bdnn_ros.diagnosis.search.scales import scaled_together
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.diagnosis.search.settling import anew, at_own_noise, refined

LINK_ERRORS = (0.02, 0.05, 0.1, 0.2)
"""Prior standard deviations of relative link errors that are tried; the evidence chooses."""
IDENTIFIED_LINK_ERRORS = (0.01, 0.02, 0.05, 0.1)
"""The same against an identified model: one to ten of its own standard deviations."""
NOISE_FLOOR = 1e-4
"""Smallest noise, as a share of the effort's spread."""
OUTSTANDING = 0.1
"""In a first look, terms that gain less than this share of the largest gain wait until noise and load are known better."""
FALLS = 0.8
"""Search again while a joint's noise falls below this share of its last estimate: it may have hidden an effect."""
HIDDEN_TRIED = 3
"""Most effects, or sets of them, that each last check tries at their own noise."""
FAINT = 3.0
"""Least gain at white noise, before prior costs, of an effect that is tried [nats]."""

Progress = Callable[[str], None]


class Search:
    """One search over the candidates of a regression.

    Attributes:
        moves: add, replace and drop terms, and tell which set is better.
        floor: smallest noise, (n,) [N·m].
    """

    def __init__(
        self,
        equations: Equations,
        candidates: Candidates,
        progress: Progress,
        link_errors: Sequence[float] = LINK_ERRORS,
    ) -> None:
        self.equations, self.candidates = equations, candidates
        self.moves = Moves(equations, candidates)
        self.progress = progress
        self.link_errors = tuple(link_errors)
        self.link_error = self.link_errors[2]
        self.floor = NOISE_FLOOR * equations.rows.effort_scale

    def first(self) -> Selection:
        """First look: the terms that stand out against the noise that common causes leave."""
        noise, worn = self._start()
        return self._select(noise, worn, OUTSTANDING)

    def run(self, selection: Selection) -> Selection:
        """The best set of effects, starting from a first look."""
        for round_ in range(MOST_ROUNDS):
            self.progress(f"round {round_ + 1}: {len(selection.chosen)} effects")
            previous, noise = selection.places, selection.pool.noise.std
            settled = self._at_own_noise(selection.pool, selection.chosen, self.candidates.common())
            selection = self._select(settled.noise, settled.terms)
            falls = (settled.noise.std < FALLS * noise).any()
            if selection.places == previous and not falls:
                break
        now = self._at_own_noise(selection.pool, selection.chosen)
        for hidden in (self._by_delays, self._by_scales, self._without, self._in_noise, self._behind_rivals):
            found = hidden(selection, now)
            if found is not None:
                selection, now = self._from(found)
        return selection

    def _from(self, found: Pool) -> tuple[Selection, Pool]:
        """Best set from some terms on, with its pool at its own noise; only those terms if the additions prove worse there."""
        motion = self.equations.motion
        selection = self._select(found.noise, found.terms)
        now = self._at_own_noise(selection.pool, selection.chosen)
        places = {term.place: c for c, term in enumerate(selection.pool.terms)}
        alone = tuple(places[term.place] for term in found.terms)
        if not set(alone) <= set(selection.chosen) or self._worth(now) >= self._worth(found):
            return selection, now
        self.equations.use_motion(motion)
        pool = selection.pool
        for one, term in zip(alone, found.terms, strict=True):  # restore the shapes that they have alone
            pool = pool.replacing({one: term})
        return Selection(pool, alone, pool.fit(alone)), found

    def _worth(self, pool: Pool, chosen: Sequence[int] | None = None) -> float:
        """Score of some terms of a pool (all by default), including the prior of its link error."""
        members = range(len(pool.terms)) if chosen is None else chosen
        return self.moves.score(pool, members) - link_error_cost(pool)

    def _by_delays(self, selection: Selection, now: Pool) -> Pool | None:
        """The terms with a delay found by shifting the measured effort, where that is better; None if not.

        Args:
            now: the selection at its own noise.
        """
        pool, chosen = selection.pool, selection.chosen
        late = [c for c in chosen if pool.terms[c].effect.name == DELAY]
        sets = [partial(moved, self.candidates, pool, chosen, delay, self.floor) for delay in late]
        return self._first_better(now, sets)

    def _by_scales(self, selection: Selection, now: Pool) -> Pool | None:
        """The terms with efforts of several joints scaled of which none may be alone; None where none are better."""
        pool, chosen = selection.pool, selection.chosen
        sets = scaled_together(pool, chosen, self.link_errors, self._worth)
        return self._likeliest(now, pool.noise, [one for one in sets if one[0] < 0.0])

    def _without(self, selection: Selection, now: Pool) -> Pool | None:
        """The terms but one that the others need only in the shapes found beside it; None if each is needed.

        A soft gear bends with the load of all terms, and shapes found beside a wrong term keep it in. A soft gear may itself
        be kept only for reducing the noise: with and without it, each set is scored at its own noise.
        """
        pool, chosen, likely = selection.pool, selection.chosen, []
        for one in chosen:
            rest = [c for c in chosen if c != one]
            other = self._shaped_anew(pool, rest, pool.terms[one].target)
            behind = self.moves.score(pool, chosen) - self.moves.score(other, rest)
            terms = [other.terms[c] for c in rest]
            if bends(pool.terms[one]):
                likely.append((-np.inf, terms))
            elif any(map(bends, terms)) or (other is not pool and behind < UNSURE):
                likely.append((behind, terms))
        return self._likeliest(now, pool.noise, likely)

    def _shaped_anew(self, pool: Pool, chosen: Sequence[int], joint: int) -> Pool:
        """The pool with shapes of a joint's chosen terms searched over their whole grid again, each beside the others."""
        for one in chosen:
            term = pool.terms[one]
            if term.target == joint and not term.effect.timed and term.link is None:
                beside = pool.fit([c for c in chosen if c != one])
                pool = self.candidates.anew(self.equations, pool, beside, one)
        return pool

    def _in_noise(self, selection: Selection, now: Pool) -> Pool | None:
        """The terms and one more that is seen under white noise and confirmed at its own noise; None without.

        A constant or temporary effect can make the noise look slow, and slow noise then explains it.
        """
        chosen = range(len(now.terms))
        noise = white_noise_of(self.equations, now.residual(now.whole), self.floor)
        pool = Pool(self.equations, noise, now.terms, self.link_error)
        shaped = self.candidates.shaped(self.equations, pool, pool.fit(chosen))
        pool = Pool(self.equations, noise, [*pool.terms, *shaped], self.link_error)
        open_ = self.moves.open_to(pool, chosen)
        shown = pool.gains(pool.fit(chosen), open_)
        order = np.argsort(self.moves.costs(pool, chosen, open_) - shown)
        likely = [pool.terms[open_[k]] for k in order if shown[k] > FAINT][:HIDDEN_TRIED]
        sets = ([*(t for t in now.terms if not contains(term, t)), term] for term in likely)
        return self._first_better(now, [partial(self._pool, noise, terms) for terms in sets])

    def _behind_rivals(self, selection: Selection, now: Pool) -> Pool | None:
        """The terms with one replaced by a rival that is better at its own noise; None without.

        Noise is estimated from the residual, so with a wrong term it includes what the right one would explain; and a joint's
        other terms take other shapes beside the wrong one.
        """
        pool = selection.pool
        likely, shapely = list[tuple[float, list[Term]]](), list[tuple[float, list[Term]]]()
        own = self.moves.score(pool, selection.chosen)
        for one in selection.chosen:
            rest = [c for c in selection.chosen if c != one]
            for rival, behind in self.moves.rivals(pool, selection.chosen, one):
                if behind >= UNSURE or related(pool.terms[rival], pool.terms[one]):
                    continue
                # the estimate lets other terms leave their bounds, which flatters rivals: score within bounds
                behind = own - self.moves.score_beside(pool, rest, rival)
                if behind < UNSURE:
                    target = pool.terms[one].target
                    mates = (pool.terms[c] for c in rest if pool.terms[c].target == target)
                    sets = shapely if any(map(_shaped, mates)) else likely
                    sets.append((behind, [*(pool.terms[c] for c in rest), pool.terms[rival]]))
        found = self._likeliest(now, pool.noise, likely)
        return found or self._likeliest(now, pool.noise, shapely, RIVALS_TRIED)

    def _likeliest(
        self, now: Pool, noise: Noise, sets: list[tuple[float, list[Term]]], most: int = HIDDEN_TRIED
    ) -> Pool | None:
        """First better one of some sets of terms, in order of how little their scores seem to fall behind; None without."""
        nearest = sorted(sets, key=lambda pair: pair[0])[:most]
        return self._first_better(now, [partial(self._pool, noise, terms) for _, terms in nearest])

    def _first_better(self, now: Pool, others: Sequence[Callable[[], Pool]]) -> Pool | None:
        """The first of some pools that scores better than `now`, each at its own noise; None without.

        Its last term has to pay. No push may be a leftover of another one at its time.
        """
        motion, worth = self.equations.motion, self._worth(now)

        def at_own_noise(one: int) -> Pool:
            pool = others[one]()
            return self._at_own_noise(pool, range(len(pool.terms)))

        def better(one: int) -> bool | None:
            trial = at_own_noise(one)
            every = range(len(trial.terms))
            found = self._worth(trial) > worth + BETTER and self.moves.pays(trial, every, every[-1])
            found = found and not any(leftover(trial, every, one) for one in every)
            self.equations.use_motion(motion)
            return found or None

        found = first_in_two(better, range(len(others)))
        return None if found is None else at_own_noise(found[0])

    def _pool(self, noise: Noise, terms: Sequence[Term]) -> Pool:
        return Pool(self.equations, noise, terms, self.link_error)

    def _at_own_noise(self, pool: Pool, chosen: Sequence[int], beside: Sequence[Term] = ()) -> Pool:
        terms = [pool.terms[c] for c in chosen]
        alone = Pool(self.equations, pool.noise, terms, pool.link_error)
        return at_own_noise(self.candidates, self.equations, alone, self.floor, beside)

    def _start(self) -> tuple[Noise, list[Term]]:
        """Noise that common causes on every joint would leave, and the wear among them to start with.

        Trends are removed so that a push or drift is not taken for slow noise. The load is estimated with all common causes.
        """
        equations, common = self.equations, self.candidates.common()
        noise = Noise(np.zeros((equations.rows.width, 1)), equations.rows.effort_scale * 0.1)
        for _ in range(2):
            pool = Pool(equations, noise, common, self.link_errors[-1])
            fit = pool.fit(range(len(common)))
            noise = noise_of(equations, pool.residual(fit), self.floor, steady=True)
        equations.update_load(*self.candidates.load(equations, pool, fit))
        return noise, self._worn(Pool(equations, noise, common, self.link_errors[-1]))

    def _worn(self, pool: Pool) -> list[Term]:
        """Common causes that each pay beside all others, if more than half of the joints have some; else none.

        On a worn robot a hidden cause is large only beside the wear. A robot with one cause is searched from nothing.
        """
        every = range(len(pool.terms))
        whole = pool.whole.evidence
        kept = [
            pool.terms[c] for c in every if whole - pool.fit([o for o in every if o != c]).evidence > COST
        ]
        return kept if len({term.target for term in kept}) > 0.5 * self.equations.rows.width else []

    def _select(self, noise: Noise, start: Sequence[Term], least: float = 0.0) -> Selection:
        """Best set at one noise model, starting from some terms.

        Args:
            least: share of the largest gain that a term must reach.
        """
        pool, every = Pool(self.equations, noise, start, self.link_error), range(len(start))
        pool = anew(self.candidates, self.equations, pool)
        pool = refined(self.candidates, self.equations, pool, every)
        shaped = self.candidates.shaped(self.equations, pool, pool.fit(every))
        pool = Pool(self.equations, noise, [*pool.terms, *shaped], self.link_error)
        pool, begun = gathered(pool, list(every), self.candidates.robot, self.moves.score)

        def descended(error: float) -> tuple[float, float, list[int], dict[int, Shape]]:
            found, chosen = self.moves.descend(pool.with_link_error(error), begun, least)
            return self._worth(found, chosen), error, chosen, new_shapes(found.terms, pool.terms)

        found = in_two(descended, self._beliefs(noise, start))
        _, self.link_error, chosen, shapes = max(found, key=lambda one: one[0])
        pool = pool.with_link_error(self.link_error).replacing(of_shapes(pool.terms, shapes))
        return Selection(pool, tuple(chosen), pool.fit(chosen))

    def _beliefs(self, noise: Noise, start: Sequence[Term]) -> list[float]:
        """Link errors worth a search: the likeliest beside what is known, and the next smaller one.

        A single link far off, or any cause not known yet, makes all links look worse; the smaller value lets it be named.
        """
        places = {term.place for term in start}
        known = [*start, *(term for term in self.candidates.common() if term.place not in places)]
        pool = Pool(self.equations, noise, known, self.link_errors[-1])
        scores = [
            other.whole.evidence - link_error_cost(other)
            for other in map(pool.with_link_error, self.link_errors)
        ]
        best = int(np.argmax(scores))
        return list(self.link_errors[max(best - 1, 0) : best + 1])

    def beliefs_of(self, pool: Pool) -> list[Pool]:
        """A pool at its own and at the next larger link error."""
        larger = [error for error in self.link_errors if error > pool.link_error]
        return [pool, *(pool.with_link_error(error) for error in larger[:1])]


def _shaped(term: Term) -> bool:
    """Whether the search refines a shape of the term."""
    return not term.effect.timed and any(name in term.effect.shape_bounds for name, _ in term.shape)
