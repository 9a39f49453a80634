"""Which terms the data supports: each is switched on only where it lowers the error on stretches left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bdnn_ros.physical.couplings import Coupling
from bdnn_ros.physical.dictionary import GROUPS
from bdnn_ros.physical.presliding import BREAKAWAYS, COUPLING_SIGNS, USUAL
from bdnn_ros.physical.recursive import Recursion, solve
from bdnn_ros.physical.statistics import Statistics, summed
from bdnn_ros.physical.structure import (
    Columns,
    Layout,
    Structure,
    coupling_deviation,
    group_deviation,
)

FOLDS = 6
"""Stretches of time left out in turn."""
FEWEST_BLOCKS = 4
"""With fewer blocks of data nothing is switched on."""
GROUP_COST = {"curve": 0.05, "load": 0.05, "direction": 0.1, "position": 0.2, "neighbours": 0.1}
"""Share of the squared error on what was left out that a group must remove; more if it could fit anything."""
BREAKAWAY_COST = 0.05
"""The same, of another breakaway than the usual one."""
CHANGE_COST = 0.01
"""The same, for any change at all."""
COUPLING_GAIN = 0.2
"""Share of the squared error on what was left out that a coupling must remove from each of its joints."""
CERTAINTY = 1.0
"""Standard errors, over the stretches, by which a change must lower the error."""
MOST_CHANGES = 8
NEGLIGIBLE = 1e-4
"""Share of the squared effort that needs no explanation."""


def choose(recursion: Recursion, structure: Structure, layout: Layout) -> Structure:
    """The structure that predicts best what was left out, starting from a structure and its layout."""
    blocks = recursion.blocks
    if len(blocks) < FEWEST_BLOCKS:
        return structure
    edges = np.linspace(0, len(blocks), min(FOLDS, len(blocks)) + 1).round().astype(int)
    folds = [summed(blocks[a:b]) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    joints = [_Joint(recursion, layout, folds, joint) for joint in range(len(structure.groups))]
    chosen = replace(structure, couplings=_couplings(joints, structure))
    for number, joint in enumerate(joints):
        breakaway, groups = _improved(joint, chosen, number)
        chosen = chosen.with_joint(number, breakaway, groups)
    return chosen


class _Joint:
    """One joint's regression; what the other joints say of the bodies is its prior."""

    def __init__(self, recursion: Recursion, layout: Layout, folds: Sequence[Statistics], joint: int) -> None:
        self.joint = joint
        self.belief = recursion.belief
        self.weight = float(recursion.weights()[joint])
        self.where = Columns(len(recursion.noise))
        self.information, self.vector = recursion.without_joint(layout, joint)
        total = summed(folds)
        self.gram = total.gram[joint] - np.array([fold.gram[joint] for fold in folds])
        self.moment = total.moment[joint] - np.array([fold.moment[joint] for fold in folds])
        self.folds = folds
        self.negligible = NEGLIGIBLE * float(total.energy[joint]) / len(folds)

    def error(
        self, breakaway: int, groups: Sequence[str] = (), couplings: Sequence[Coupling] = ()
    ) -> np.ndarray:
        """Squared error on each fold under the coefficients of all others, (folds,)."""
        columns = [np.arange(self.where.own), self.where.of_joint(breakaway)]
        deviation = []
        for coupling in couplings:
            if self.joint - coupling.joint in (0, 1):
                columns.append(self.where.of_coupling(self.joint == coupling.joint, coupling.sign))
                deviation.append(coupling_deviation(self.belief, coupling.joint))
        for name in groups:
            columns.append(self.where.of_group(name))
            deviation.append(group_deviation(self.belief, name, self.joint))
        index = np.concatenate(columns)
        known = len(self.vector)
        information = np.diag(1.0 / np.concatenate([np.ones(known), *deviation]) ** 2)
        information[:known, :known] = self.information
        vector = np.concatenate([self.vector, np.zeros(len(index) - known)])
        errors = []
        for fold, gram, moment in zip(self.folds, self.gram, self.moment, strict=True):
            coefficients = solve(
                information + self.weight * gram[np.ix_(index, index)], vector + self.weight * moment[index]
            )
            errors.append(fold.of_joint(self.joint, index).squared_error(coefficients))
        return np.array(errors) + self.negligible


def _couplings(joints: Sequence[_Joint], structure: Structure) -> tuple[Coupling, ...]:
    """Motors that turn with two joints: those that both joints' errors speak for."""
    found = []
    own = ("curve",)  # or a coupling would be taken for the curve of the joints' own friction
    plain = [joint.error(structure.breakaway[k], own).sum() for k, joint in enumerate(joints)]
    for first in range(len(joints) - 1):
        best, least = None, 1.0 - COUPLING_GAIN
        for sign in COUPLING_SIGNS:
            coupling = Coupling(first, sign)
            left = max(
                joints[k].error(structure.breakaway[k], own, (coupling,)).sum() / plain[k]
                for k in (first, first + 1)
            )
            if left < least:
                best, least = coupling, left
        if best is not None:
            found.append(best)
    return tuple(found)


def _improved(joint: _Joint, structure: Structure, number: int) -> tuple[int, tuple[str, ...]]:
    """Breakaway and groups of one joint after the changes that pay, one at a time, the best first."""

    def tried(breakaway: int, groups: tuple[str, ...]) -> tuple[float, np.ndarray]:
        error = joint.error(breakaway, groups, structure.couplings)
        cost = sum(GROUP_COST[name] for name in groups) + BREAKAWAY_COST * (breakaway != USUAL)
        return float(np.log(error.sum()) + cost), error

    choice = structure.breakaway[number], structure.groups[number]
    cost, errors = tried(*choice)
    for attempt in range(MOST_CHANGES):
        breakaway, groups = choice
        others = [(other, groups) for other in range(len(BREAKAWAYS)) if other != breakaway]
        if attempt:  # the simplest explanation comes first
            for name in GROUPS:
                toggled = tuple(g for g in GROUPS if (g in groups) != (g == name))
                others.append((breakaway, toggled))
        results = []
        for other in others:
            total, left = tried(*other)
            gain = errors - left
            doubt = float(gain.std(ddof=1) * np.sqrt(len(gain)))
            if gain.sum() > CERTAINTY * doubt or len(other[1]) < len(groups):
                results.append((total, left, other))
        least, left, other = min(results, key=lambda result: result[0], default=(np.inf, errors, choice))
        if least < cost - CHANGE_COST:
            choice, cost, errors = other, least, left
        elif attempt:
            break
    return choice
