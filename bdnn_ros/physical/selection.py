"""Selection of model terms by cross-validation: a term is switched on only if it lowers the error on stretches left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain, combinations

import numpy as np

from bdnn_ros.physical.couplings import Coupling
from bdnn_ros.physical.dictionary import FEATURES, GROUPS, largest_waves
from bdnn_ros.physical.linear import inverse, solve
from bdnn_ros.physical.parameters import Prior
from bdnn_ros.physical.presliding import BREAKAWAYS, COUPLING_SIGNS, USUAL
from bdnn_ros.physical.recursive import SMALLEST_NOISE, Posterior, Recursion
from bdnn_ros.physical.statistics import Statistics, summed
from bdnn_ros.physical.structure import (
    LEAD,
    TILT,
    Columns,
    Layout,
    Structure,
    coupling_deviation,
    group_deviation,
    layout,
)

FOLDS = 6
"""Stretches of time left out in turn."""
FEWEST_BLOCKS = 4
"""With fewer blocks of data nothing is switched on."""
GROUP_COST = {"curve": 0.03, "load": 0.02, "direction": 0.2, "position": 0.1, "neighbours": 0.1}
"""Share of the squared error on what was left out that a group must remove; more if it could fit anything."""
BREAKAWAY_COST = 0.05
"""The same, of another breakaway than the usual one."""
COUPLING_GAIN = 0.2
"""Share of the squared error on what was left out that a coupling must remove from each of its joints."""
SETUP_GAIN, SETUP_COST = 0.1, 0.1
"""The same, of a tilted base or a zero from each of two joints; and what others may lose, as a share of all that is gained."""
KNOWN = 5.0
"""A base is tilted, and a zero is off, where it is so many times its standard deviation."""
NEGLIGIBLE = 1e-4
"""Share of the squared effort that needs no explanation."""
BELIEVED = 100.0
"""Bodies that are believed are so as if their description had told so many times what it does."""
LARGE = "position"
BEST = 8
"""The large group is tried beside so many of the best sets of the others."""
RELEVANCE_ROUNDS = 10
"""In which what is believed of the harmonics and their weights are found in turn."""
LEAST_SHOWN = 1e-3
"""A motion is taken to show at least so much of a harmonic's two weights: what is divided by it stays finite."""
LEAST_WAVE = 1e-4
"""Of what a harmonic may weigh at most: what is left of one that the motion does not show."""
ROUNDS = 2
"""Choices of one joint's terms, each with the rows weighed by the error that the one before left."""

Terms = tuple[int, tuple[str, ...]]
"""Index of the breakaway, and the groups that are on."""


def choose(
    recursion: Recursion,
    plain: Structure,
    without: Layout,
    kinds: Sequence[int],
    possible: np.ndarray | None = None,
) -> Structure:
    """The structure that best predicts stretches left out.

    Args:
        plain: nothing switched on.
        without: its layout, by which the noise was estimated.
        kinds: of the joints, (n,), 0 of one that holds still: motors turn with two of one kind that both move.
        possible: inertials of bodies that are believed, flat; None where the motion may tell any.
    """
    folds = _folds(recursion)
    if not folds:
        return plain
    joints = [_Joint(recursion, plain, without, folds, joint, possible) for joint in range(len(plain.groups))]
    chosen = replace(plain, couplings=_couplings(joints, kinds))
    for number, joint in enumerate(joints):
        chosen = chosen.with_joint(number, *_best(joint, chosen.couplings))
    return replace(chosen, relevance=tuple(joint.relevance for joint in joints))


def set_up(recursion: Recursion, plain: Structure) -> Structure:
    """The structure with deviations of the set-up (base tilt, joint zeros), added greedily by the cross-validated error.

    A deviation must show on at least two joints: on a single one it could as well be a spring or a weight of its own.

    Args:
        plain: nothing switched on; by its layout the noise was estimated.
    """
    folds = _folds(recursion)
    if not folds:
        return plain
    negligible = NEGLIGIBLE * np.sum([fold.energy for fold in folds], axis=0) + np.finfo(float).tiny

    def left(structure: Structure) -> np.ndarray:
        return np.log(recursion.left_out(layout(structure, recursion.belief), folds) + negligible)

    chosen, before = plain, left(plain)
    kinds = [TILT, *((len(TILT) + joint,) for joint in range(len(plain.groups)))]
    while True:
        further = [
            replace(chosen, setup=(*chosen.setup, *kind)) for kind in kinds if not {*kind} & {*chosen.setup}
        ]
        gains = [before - left(structure) for structure in further]
        shown = [(gain.sum(), k) for k, gain in enumerate(gains) if _shows(gain)]
        if not shown:
            return replace(chosen, setup=tuple(sorted(chosen.setup)))
        best = max(shown)[1]
        chosen, before = further[best], before - gains[best]


def sure(posterior: Posterior, setup: tuple[int, ...]) -> tuple[int, ...]:
    """The deviations of the set-up that are significant; one angle of the base stands for both."""
    at = posterior.layout.setup
    sizes = np.abs(posterior.mean[at]) / posterior.std[at]
    off = {k for k, size in zip(setup, sizes, strict=True) if size > KNOWN}
    if off & {*TILT}:
        off |= {*TILT}
    return tuple(k for k in setup if k in off)


def _shows(gain: np.ndarray) -> bool:
    """Whether at least two joints gain enough, and the others do not lose too much of it."""
    lost = -gain[gain < 0.0].sum()
    return bool(np.count_nonzero(gain > SETUP_GAIN) > 1 and lost < SETUP_COST * gain[gain > 0.0].sum())


def _folds(recursion: Recursion) -> list[Statistics]:
    """Stretches of time to leave out in turn; empty if there is too little data."""
    blocks = list(recursion.blocks)
    if len(blocks) < FEWEST_BLOCKS:
        return []
    edges = np.linspace(0, len(blocks), min(FOLDS, len(blocks)) + 1).round().astype(int)
    return [summed(blocks[a:b]) for a, b in zip(edges[:-1], edges[1:], strict=True)]


class _Joint:
    """Regression of one joint, with the other joints' information on the bodies as its prior.

    The bodies are part of every choice of terms: they are eliminated once, so that a choice costs only its own columns.
    """

    def __init__(
        self,
        recursion: Recursion,
        plain: Structure,
        without: Layout,
        folds: Sequence[Statistics],
        joint: int,
        possible: np.ndarray | None,
    ) -> None:
        self.joint = joint
        self.where = Columns(len(recursion.noise))
        self.bodies = self.where.own
        self.correlation = float(recursion.correlation[joint])
        self.information, self.vector = recursion.without_joint(without, joint)
        if possible is not None:
            believed = BELIEVED * recursion.prior_information[: self.bodies, : self.bodies]
            self.information[: self.bodies, : self.bodies] += believed
            self.vector[: self.bodies] += believed @ possible
        self.prior, self.pull = self._prior(recursion.belief, plain)
        self._usual_waves = self.prior[self.where.of_group(LARGE) - self.bodies]
        self._largest_wave = plain.beyond[joint] * largest_waves()
        self.gram = np.array([fold.gram[joint] for fold in folds])
        self.moment = np.array([fold.moment[joint] for fold in folds])
        self.energy = np.array([fold.energy[joint] for fold in folds])
        self.count = float(sum(fold.count[joint] for fold in folds))
        self._least = (SMALLEST_NOISE * float(recursion.belief.effort_scale[joint])) ** 2
        self.weigh(float(recursion.noise[joint]) ** 2)

    def weigh(self, variance: float) -> None:
        """Eliminate the bodies, for rows of this variance [N²·m²]."""
        weight = 1.0 / (max(variance, self._least) * self.correlation)
        n = self.bodies
        total, said = self.gram.sum(axis=0), self.moment.sum(axis=0)
        system, right, quadratic, linear, constant = [], [], [], [], []
        for gram, moment, energy in zip(self.gram, self.moment, self.energy, strict=True):
            known, told = weight * (total - gram), weight * (said - moment)
            cross = known[:n, n:]
            solved = solve(
                self.information[:n, :n] + known[:n, :n], np.column_stack([cross, self.vector[:n] + told[:n]])
            )
            shift, mean = solved[:, :-1], solved[:, -1]
            system.append(np.diag(self.prior) + known[n:, n:] - cross.T @ shift)
            right.append(self.pull + told[n:] - cross.T @ mean)
            left = moment - gram[:, :n] @ mean
            half = (gram[n:, :n] - 0.5 * shift.T @ gram[:n, :n]) @ shift
            quadratic.append(gram[n:, n:] - half - half.T)
            linear.append(left[n:] - shift.T @ left[:n])
            constant.append(energy - mean @ (moment[:n] + left[:n]))
        self._system, self._right = np.array(system), np.array(right)
        self._quadratic, self._linear, self._constant = (
            np.array(quadratic),
            np.array(linear),
            np.array(constant),
        )

    def error(self, breakaway: int, groups: Sequence[str] = (), couplings: Sequence[Coupling] = ()) -> float:
        """Cross-validated squared error, fold by fold, under the coefficients of all other folds."""
        index = self._index(breakaway, groups, couplings)
        x = np.linalg.solve(self._system[:, index[:, None], index], self._right[:, index, None])[..., 0]
        fitted = np.einsum("fk,fkl,fl->f", x, self._quadratic[:, index[:, None], index], x)
        errors = self._constant - 2.0 * np.einsum("fk,fk->f", x, self._linear[:, index]) + fitted
        least = NEGLIGIBLE * float(self.energy.sum()) + np.finfo(float).tiny  # without any effort
        return float(np.maximum(errors, 0.0).sum() + least)

    def believe_waves(self, terms: Terms, couplings: Sequence[Coupling]) -> None:
        """Adapt the prior of each position harmonic to what the motion shows of it, beside these terms.

        Automatic relevance determination (MacKay 1992): otherwise each harmonic that the joint does not have would get a
        small weight, and these add up at positions where the joint has not been.
        """
        index = self._index(*terms, couplings)
        waves = self.where.of_group(LARGE) - self.bodies
        place = np.flatnonzero(np.isin(index, waves))
        told = self._system[:, index[:, None], index].mean(axis=0) - np.diag(self.prior[index])
        right, prior = self._right[:, index].mean(axis=0), self.prior[index]
        prior[place] = self._usual_waves
        for _ in range(RELEVANCE_ROUNDS):
            covariance = inverse(told + np.diag(prior))
            weights, variance = (covariance @ right)[place], np.diagonal(covariance)[place]
            shown = 2.0 - (variance * prior[place]).reshape(2, -1).sum(axis=0)
            size = (weights**2).reshape(2, -1).sum(axis=0) / np.maximum(shown, LEAST_SHOWN)
            size = np.clip(size, (LEAST_WAVE * self._largest_wave) ** 2, self._largest_wave**2)
            prior[place] = np.tile(1.0 / size, 2)
        self._system[:, waves, waves] += prior[place] - self.prior[waves]
        self.prior[waves] = prior[place]

    @property
    def relevance(self) -> tuple[float, ...]:
        """Prior deviation of the weight of each feature, FEATURES of them [N·m]."""
        first = self.where.features - self.bodies
        return tuple((1.0 / np.sqrt(self.prior[first : first + FEATURES])).tolist())

    def _index(self, breakaway: int, groups: Sequence[str], couplings: Sequence[Coupling]) -> np.ndarray:
        """Indices of the columns of these terms, counted after the bodies."""
        columns = [
            self.where.of_joint(breakaway),
            np.array([self.where.lead]),
            *(self.where.of_group(name) for name in groups),
        ]
        for coupling in couplings:
            if self.joint - coupling.joint in (0, 1):
                columns.append(self.where.of_coupling(self.joint == coupling.joint, coupling.sign))
        return np.concatenate(columns) - self.bodies

    def _prior(self, belief: Prior, plain: Structure) -> tuple[np.ndarray, np.ndarray]:
        """Prior information and vector of all columns except the bodies'."""
        where, n = self.where, self.bodies
        information, vector = np.ones(where.count), np.zeros(where.count)
        for breakaway in range(len(BREAKAWAYS)):
            own = where.of_joint(breakaway)
            information[own] = np.diagonal(self.information)[n:]
            vector[own] = self.vector[n:]
        information[where.lead] = 1.0 / LEAD**2
        for name in GROUPS:
            information[where.of_group(name)] = 1.0 / group_deviation(plain, name, self.joint) ** 2
        width = len(belief.effort_scale)
        for first in {max(self.joint - 1, 0), min(self.joint, width - 2)}:
            for sign in COUPLING_SIGNS:
                motor = where.of_coupling(self.joint == first, sign)
                information[motor] = 1.0 / coupling_deviation(belief, plain, first) ** 2
        return information[n:], vector[n:]


def _couplings(joints: Sequence[_Joint], kinds: Sequence[int]) -> tuple[Coupling, ...]:
    """Coupled motors supported by the errors of both their joints."""
    found = []
    own = ("curve",)  # or a coupling would be taken for the curve of the joints' own friction
    plain = [joint.error(USUAL, own) for joint in joints]
    for first in (k for k in range(len(joints) - 1) if kinds[k] == kinds[k + 1] != 0):
        best, least = None, 1.0 - COUPLING_GAIN
        for sign in COUPLING_SIGNS:
            coupling = Coupling(first, sign)
            left = max(joints[k].error(USUAL, own, (coupling,)) / plain[k] for k in (first, first + 1))
            if left < least:
                best, least = coupling, left
        if best is not None:
            found.append(best)
    return tuple(found)


def _best(joint: _Joint, couplings: tuple[Coupling, ...]) -> Terms:
    """The terms of one joint with the least cross-validated error, including a penalty for each.

    Every breakaway is tried with every set of small groups, then the best of them with the large group as well.
    """

    def cost(terms: Terms, error: float) -> float:
        breakaway, groups = terms
        price = sum(GROUP_COST[name] for name in groups) + BREAKAWAY_COST * (breakaway != USUAL)
        return float(np.log(error)) + price

    chosen: Terms = (USUAL, ())
    for _ in range(ROUNDS):
        joint.weigh(joint.error(*chosen, couplings) / joint.count)
        ranked = sorted((cost(*tried), tried[0]) for tried in _small_terms(joint, couplings))
        large = [(breakaway, (*groups, LARGE)) for _, (breakaway, groups) in ranked[:BEST]]
        joint.believe_waves(large[0], couplings)
        waves = ((cost(terms, joint.error(*terms, couplings)), terms) for terms in large)
        chosen = min([ranked[0], *waves])[1]
    return chosen[0], tuple(name for name in GROUPS if name in chosen[1])


def _small_terms(joint: _Joint, couplings: tuple[Coupling, ...]) -> Iterator[tuple[Terms, float]]:
    """Every breakaway with every set of small groups, with their errors; a friction curve only where it does not do harm."""
    small = [name for name in GROUPS if name not in ("curve", LARGE)]
    for groups in chain(*(combinations(small, count) for count in range(len(small) + 1))):
        errors = [joint.error(breakaway, groups, couplings) for breakaway in range(len(BREAKAWAYS))]
        for breakaway, error in enumerate(errors):
            yield (breakaway, groups), error
            if error <= errors[USUAL]:  # or the curve may hold a sharp direction beside a soft one
                yield (breakaway, ("curve", *groups)), joint.error(breakaway, ("curve", *groups), couplings)
