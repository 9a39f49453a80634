"""What the data cannot tell apart: rivals of each finding, with probabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.aside import in_two
from bdnn_ros.diagnosis.judging.lookalikes import Placed, hang, turn_alike
from bdnn_ros.diagnosis.judging.scaled import scaled
from bdnn_ros.diagnosis.pushes.pushes import reshaped, tie_margin
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.gains import MINIMUM_SHARE, acting
from bdnn_ros.diagnosis.regression.noise import rms
from bdnn_ros.diagnosis.regression.odds import contains, link_error_cost, rival_joint
from bdnn_ros.diagnosis.regression.term import Shape, Term, new_shapes, of_shapes
from bdnn_ros.diagnosis.search.moves import Moves
from bdnn_ros.diagnosis.search.search import Search
from bdnn_ros.diagnosis.search.selection import Selection

Weighed = tuple[float, float, dict[int, float], dict[int, Shape]]
TEMPERATURE = 2.0
"""Divisor of evidence differences: no noise model is quite right."""
LISTED = 0.02
"""Rivals less probable than this are not listed."""
MOST_LISTED = 6
CLOSE = 12.0
PLAINLY = 4.0
"""Odds by which a richer law must beat the simpler one that it contains."""
TIE = 0.1
"""A rival at least this probable makes a tie, which earns advice."""
SLIGHT = 0.01
"""An excess over a part below this share of the effort, where there is any, is negligible."""
ALIKE = 6.0
"""Loads on two links whose losses differ by less than this may be one load on either [nats]."""
SAME_PHYSICS = {
    "payload": "link_inertia",
    "link_inertia": "payload",
    "asymmetric_friction": "effort_offset",
}
"""The same physics under another name, always listed as a rival: uneven friction is Coulomb friction and an offset."""


@dataclass(frozen=True)
class Judgement:
    """How sure a chosen term is.

    Attributes:
        probability: against its rivals and against no cause at all.
        nothing: probability that neither it nor a rival is there.
        rivals: other terms for its place and their probabilities, most probable first.
        steady: whether it helps on held-out blocks.
        changing: whether it is a push that changes over time.
    """

    probability: float
    nothing: float
    rivals: tuple[tuple[Term, float], ...]
    steady: bool = True
    changing: bool = False

    def at_least(self, term: Term) -> float:
        """Probability of the chosen term or of a rival that contains it, which does not speak against it."""
        return self.probability + sum(p for rival, p in self.rivals if contains(rival, term))

    def told_as(self, plain: Term) -> Judgement:
        """The judgement of a simpler law that replaces the term and may have been its rival."""
        same = sum(probability for rival, probability in self.rivals if rival.place == plain.place)
        others = tuple(pair for pair in self.rivals if pair[0].place != plain.place)
        return replace(self, probability=self.probability + same, rivals=others)


def judge(search: Search, selection: Selection) -> list[Judgement]:
    """Judge every chosen term against its rivals, in the order of `selection.chosen`."""
    pool, chosen = selection.pool, selection.chosen
    pushes = [one for one in chosen if pool.terms[one].effect.timed]  # one takes as long as all other terms
    odds = {one: _best_scores(search, selection, one) for one in pushes}
    others = [one for one in chosen if one not in odds]
    odds |= zip(others, in_two(lambda one: _best_scores(search, selection, one), others), strict=True)

    def judgement(one: int) -> Judgement:
        own, nothing, scores, moved = odds[one]
        term, terms = pool.terms[one], dict(enumerate(pool.terms)) | of_shapes(pool.terms, moved)
        return judged(terms, term, own, nothing, scores, tie_margin(term, own - nothing))

    return [judgement(one) for one in chosen]


def likelier(search: Search, selection: Selection, judgements: Sequence[Judgement]) -> Selection | None:
    """The selection with one finding replaced by a rival; None if none should be.

    A finding gives way to a likelier rival (four times as likely for a push, and for one that settles into it), to a simpler
    part of itself unless four times likelier than that, and to a richer law that is four times as likely if held-out blocks
    confirm it. Among pushes that tie the best place was chosen already.
    """
    pool = selection.pool
    for one, judgement in zip(selection.chosen, judgements, strict=True):
        term = pool.terms[one]
        for rival, probability in judgement.rivals:
            richer = contains(rival, term)
            ahead = not richer and probability > judgement.nothing
            tied = term.effect.timed or _settles_into(rival, term)
            ahead &= probability > judgement.probability * (PLAINLY if tied else 1.0)
            simpler = contains(term, rival) or _settles_into(term, rival)
            simpler &= judgement.probability < PLAINLY * probability
            plainly = richer and probability > PLAINLY * judgement.probability
            if plainly or simpler or ahead:
                other = _instead(selection, one, rival)
                if ahead:
                    other = _with_parts(search, other, term)
                if not plainly or _earned(search, other, selection, one):
                    return other
    return None


def _with_parts(search: Search, selection: Selection, term: Term) -> Selection:
    """The selection, with a part of the dropped term added if the rest needs it."""
    pool = selection.pool
    bases = _bases(pool, term, list(selection.chosen))
    best = max(bases, key=lambda chosen: search.moves.score(pool, chosen))
    return Selection(pool, tuple(best), pool.fit(best))


def _earned(search: Search, richer: Selection, plain: Selection, part: int) -> bool:
    """Whether a richer law's excess over a part of it is large enough for a name and confirmed by held-out blocks."""
    if _slight(richer, part):
        return False
    return search.moves.predicts_better(richer.pool, richer.chosen, plain.chosen)


def _slight(richer: Selection, part: int) -> bool:
    """Whether the last chosen term exceeds a part of it only negligibly."""
    law = richer.chosen[-1]
    brief = richer.pool.terms[law].effect.brief
    return not brief and _beyond(richer.pool, richer.fit, law, part) < SLIGHT


def weighed(search: Search, selection: Selection, judgements: Sequence[Judgement]) -> list[Judgement]:
    """Final judgements, with whether each term helps on held-out blocks."""
    pool, chosen = selection.pool, selection.chosen
    return [
        replace(judgement, steady=search.moves.predicts_better(pool, chosen, [c for c in chosen if c != one]))
        for one, judgement in zip(chosen, folded(selection, judgements), strict=True)
    ]


def folded(selection: Selection, judgements: Sequence[Judgement]) -> list[Judgement]:
    """Judgements in which rivals that exceed a finding only negligibly count for that finding."""
    result = []
    for one, judgement in zip(selection.chosen, judgements, strict=True):
        term, own = selection.pool.terms[one], judgement.probability
        others = []
        for rival, probability in judgement.rivals:
            if contains(rival, term) and _slight(_instead(selection, one, rival), one):
                own += probability
            else:
                others.append((rival, probability))
        result.append(replace(judgement, probability=own, rivals=tuple(others)))
    return result


def _instead(selection: Selection, one: int, rival: Term) -> Selection:
    """The selection with a rival in place of one term and of all that it contains."""
    pool = selection.pool
    instead = [term.place for term in pool.terms].index(rival.place)
    if pool.terms[instead] != rival:
        pool = pool.replacing({instead: rival})
    rest = [c for c in selection.chosen if c != one and not contains(rival, pool.terms[c])]
    chosen = (*rest, instead)
    return Selection(pool, chosen, pool.fit(chosen))


def plainer(selection: Selection) -> Selection:
    """The selection with every law replaced by a part of it that does the same but for a negligible excess.

    Beside such a part a law has to earn its own name. Brief effects are exempt: the few moments that differ show them.
    """
    pool, chosen = selection.pool, list[int]()
    for one in selection.chosen:
        term = pool.terms[one]
        parts = [
            c
            for c, other in enumerate(pool.terms)
            if other.target == term.target and (contains(term, other) or _settles_into(term, other))
        ]
        left = {} if term.effect.brief else {c: _beyond(pool, selection.fit, one, c) for c in parts}
        if any(left[c] < MINIMUM_SHARE for c in left if c in selection.chosen):
            continue
        least = min(left, key=lambda c: left[c], default=one)
        chosen.append(least if left.get(least, np.inf) < SLIGHT else one)
    return Selection(pool, tuple(chosen), pool.fit(chosen))


def _beyond(pool: Pool, fit: Fit, one: int, part: int) -> float:
    """Excess of a term over a part at its joint: root mean square where there is any, per spread of the effort.

    Rows where the joint dwells, which make dry friction appear smaller, count only for a richer law with an excess large
    enough for a name.
    """
    equations, law, plain = pool.equations, pool.terms[one], pool.terms[part]
    joint = law.target

    def share(rows: np.ndarray) -> float:
        does = (equations.columns.of(law)[rows, joint]) @ pool.coefficients(fit, one)
        columns = equations.columns.of(plain)[rows, joint]
        left = does - columns @ np.linalg.lstsq(columns, does, rcond=None)[0]
        return rms(left[acting(left)]) / float(equations.rows.effort_scale[joint])

    anywhere = share(equations.usable[:, joint]) if contains(law, plain) else 0.0
    return anywhere if anywhere >= MINIMUM_SHARE else share(equations.exact[:, joint])


def _best_scores(search: Search, selection: Selection, one: int) -> Weighed:
    """Scores with a term, without it and with each rival in its place, and new shapes of rivals.

    Each is the best over two link errors: what one link's error explains, larger errors of all links may explain as well.
    """
    fair, term = selection.pool, selection.pool.terms[one]
    own, nothing, scores = -np.inf, -np.inf, dict[int, float]()
    if term.effect.timed:
        rest = [c for c in selection.chosen if c != one]
        fair = reshaped(fair, rest, search.candidates.robot).replacing({one: term})
    for pool in search.beliefs_of(fair):
        weighed = _scores(search.moves, pool, selection.chosen, one)
        own, nothing = max(own, weighed[0]), max(nothing, weighed[1])
        for rival, score in weighed[2].items():
            scores[rival] = max(scores.get(rival, -np.inf), score)
    return own, nothing, scores, new_shapes(fair.terms, selection.pool.terms)


def judged(
    terms: Mapping[int, Term], term: Term, own: float, nothing: float, scores: dict[int, float], amiss: float
) -> Judgement:
    """Judgement of a term from its score, that of nothing in its place, and those of its rivals.

    Args:
        amiss: possible error of these scores [nats].
    """
    keys = list(scores)
    logs = np.array([own, nothing, *(scores[k] for k in keys)]) / (TEMPERATURE + amiss)
    weights = np.exp(logs - np.logaddexp.reduce(logs))
    rivals_found = [(terms[k], float(w)) for k, w in zip(keys, weights[2:], strict=True)]
    return Judgement(float(weights[0]), float(weights[1]), _listed(term, rivals_found))


def _listed(term: Term, rivals: Sequence[tuple[Term, float]]) -> tuple[tuple[Term, float], ...]:
    """Rivals probable enough to be listed, and the same physics under another name, most probable first."""
    listed = [(rival, p) for rival, p in rivals if p >= LISTED or same_physics(term, rival)]
    listed.sort(key=lambda pair: (not same_physics(term, pair[0]), -pair[1]))
    return tuple(sorted(listed[:MOST_LISTED], key=lambda pair: -pair[1]))


def _scores(
    moves: Moves, pool: Pool, chosen: Sequence[int], one: int
) -> tuple[float, float, dict[int, float]]:
    """Scores with a term, without it, and with each rival in its place.

    What a rival would explain beside the term as one more cause is not credited to it.
    """
    term, rest = pool.terms[one], [c for c in chosen if c != one]
    both = [*rest, one]
    own, fit_both = moves.score(pool, both), pool.fit(both)
    scores: dict[int, float] = {}
    for base in _bases(pool, term, rest):
        fit, start = pool.fit(base), moves.score(pool, base)
        possible = moves.open_to(pool, base, rival_joint(term), term)
        rivals = [c for c in possible if pool.terms[c].spot != term.spot]
        instead = pool.gains(fit, rivals) - moves.costs(pool, base, rivals)
        beside = pool.gains(fit_both, rivals) - moves.costs(pool, both, rivals)
        for c, gain, more in zip(rivals, instead, beside, strict=True):
            score = start + float(gain)
            if score > own - CLOSE:  # the gain ignores bounds of the other terms: score within them
                score = moves.score_beside(pool, base, c)
            more = 0.0 if contains(pool.terms[c], term) else max(float(more), 0.0)
            scores[c] = max(scores.get(c, -np.inf), score - more)
    for c, score in scaled(moves, pool, rest, one).items():
        scores[c] = max(scores.get(c, -np.inf), score)
    for c in [c for c in scores if hang(term, pool.terms[c])]:
        # a load centred on the axis between two links fits on either: how exactly it lies there decides nothing
        behind = pool.fit([*rest, c]).loss - fit_both.loss
        if behind < ALIKE:
            cost, other = moves.costs(pool, rest, [one, c])
            scores[c] = own + float(cost - other) - behind
    for c in [c for c in scores if turn_alike(moves.candidates, term, pool.terms[c])]:
        scores[c] = max(scores[c], own)
    cost = link_error_cost(pool)
    return own - cost, moves.score(pool, rest) - cost, {c: score - cost for c, score in scores.items()}


def _bases(pool: Pool, term: Term, rest: list[int]) -> list[list[int]]:
    """Sets that a rival may join: the other terms, and these plus a part that the term contains at its place."""
    bases = [rest]
    for c, other in enumerate(pool.terms):
        if c not in rest and contains(term, other) and other.target == term.target:
            bases.append([*rest, c])
    return bases


def _settles_into(term: Term, rival: Term) -> bool:
    """Whether a term differs from a rival only in moments that the motion may lack."""
    return term.effect.settles_into == rival.effect.name and term.target == rival.target


def same_physics(term: Placed, rival: Placed) -> bool:
    """Whether a rival is the same physics as a term under another name."""
    return SAME_PHYSICS.get(term.effect.name) == rival.effect.name and term.target == rival.target
