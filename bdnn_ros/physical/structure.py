"""The terms of a robot's effort model, and the places of their coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bdnn_ros.physical.couplings import PER_COUPLING, Coupling
from bdnn_ros.physical.dictionary import CURVE_FEATURES, FEATURES, GROUPS, feature_spread, group_slices
from bdnn_ros.physical.gathering import Gathering
from bdnn_ros.physical.parameters import PER_JOINT, Prior
from bdnn_ros.physical.presliding import BREAKAWAYS, COUPLING_SIGNS, USUAL
from bdnn_ros.physical.statistics import Regression, Statistics
from bdnn_ros.robot import PER_LINK

LEAD = 0.003
"""Prior standard deviation of how far the measured effort may be ahead of the motion [s]."""
SETUP = 0.1
"""Prior standard deviation of the angles by which a tilted base rolls and pitches, and of zeros that are off [rad] ([m])."""
TILT = (0, 1)
"""Roll and pitch of the base, among what may be unknown of how a robot is set up; then follow the zeros of its joints."""
MOTOR_CURVE = 0.2
"""Prior standard deviation of the weights of a coupled motor's curve, in units of its joints' friction."""


@dataclass(frozen=True)
class Structure:
    """The terms that are switched on.

    Attributes:
        breakaway: index into `BREAKAWAYS` of each joint, n.
        groups: names of the groups of features of each joint, n tuples.
        friction: typical friction of each joint, n [N·m].
        beyond: what is learned of each joint is believed to be of this order, n [N·m].
        couplings: motors that turn with two joints.
        relevance: prior deviation of the weight of each feature, n tuples of FEATURES [N·m]; empty before the
            motion has shown any.
        setup: what is not as described of how the robot is set up, in ascending order: `TILT`, len(TILT) + k the zero of joint k.
    """

    breakaway: tuple[int, ...]
    groups: tuple[tuple[str, ...], ...]
    friction: tuple[float, ...]
    beyond: tuple[float, ...]
    couplings: tuple[Coupling, ...] = ()
    relevance: tuple[tuple[float, ...], ...] = ()
    setup: tuple[int, ...] = ()

    @classmethod
    def plain(cls, belief: Prior) -> Structure:
        """Rigid bodies, armature, viscous and Coulomb friction, offset only."""
        width, usual = len(belief.effort_scale), tuple(0.1 * belief.effort_scale)
        return cls((USUAL,) * width, ((),) * width, usual, usual)

    def with_joint(self, joint: int, breakaway: int, groups: tuple[str, ...]) -> Structure:
        """The same with other terms for one joint."""
        return replace(
            self,
            breakaway=(*self.breakaway[:joint], breakaway, *self.breakaway[joint + 1 :]),
            groups=(*self.groups[:joint], groups, *self.groups[joint + 1 :]),
        )


class Columns:
    """Places of the terms among the K columns of a joint.

    First the columns low-passed once: the bodies (n · PER_LINK), armature, viscous friction and offset; armature and viscous
    friction of a coupled motor, for the pair with the joint before and the joint after and for each sign; the rate of the
    measured effort; base tilt and joint zeros. Then the columns low-passed twice: Coulomb friction for each of `BREAKAWAYS`,
    the features, and Coulomb friction of the coupled motors with its curve.
    """

    def __init__(self, width: int) -> None:
        pairs = 2 * len(COUPLING_SIGNS)
        self.own = width * PER_LINK
        self.coupled_smooth = self.own + 3
        self.lead = self.coupled_smooth + 2 * pairs
        self.setup = self.lead + 1
        self.coulomb = self.setup + len(TILT) + width
        self.features = self.coulomb + len(BREAKAWAYS)
        self.coupled_sharp = self.features + FEATURES
        self.count = self.coupled_sharp + pairs * (1 + CURVE_FEATURES)

    def of_joint(self, breakaway: int) -> np.ndarray:
        """Columns of the joint's `JOINT_NAMES`, (PER_JOINT,)."""
        return np.array([self.own, self.own + 1, self.coulomb + breakaway, self.own + 2])

    def of_group(self, name: str) -> np.ndarray:
        """Columns of a group of features."""
        part = group_slices()[name]
        return self.features + np.arange(part.start, part.stop)

    def of_coupling(self, after: bool, sign: int) -> np.ndarray:
        """Columns of a coupled motor, seen from its first joint (shared with the joint `after` it) or its second.

        First the `PER_COUPLING` parameters, then the features of its friction curve.
        """
        pair = len(COUPLING_SIGNS) * after + COUPLING_SIGNS.index(sign)
        smooth = self.coupled_smooth + 2 * pair
        sharp = self.coupled_sharp + (1 + CURVE_FEATURES) * pair
        return np.array([smooth, smooth + 1, *range(sharp, sharp + 1 + CURVE_FEATURES)])


@dataclass(frozen=True)
class Layout:
    """Places of the P parameters of a structure.

    Those of `Prior`, then `PER_COUPLING` for each coupling, the lead of the effort, the deviations of the set-up, the weights
    of the couplings' curves, and the weights of the joints' features.

    Attributes:
        columns: of each joint, which of its K columns take part.
        parameters: which of the P parameters those columns belong to.
        deviation: prior standard deviation of the parameters after the base, (P - base,).
        base: number of parameters in the order of `Prior`.
        lead: where the time is by which the effort is ahead.
        setup: where the angles are by which the base and zeros are further off.
        positive: parameters that cannot be negative.
        motors: where the weights of each coupling's curve are.
        weights: where the weights of each joint's features are, n slices.
        straight: viscous and Coulomb friction and offset that are taken from each feature, (weights, 3).
    """

    columns: tuple[np.ndarray, ...]
    parameters: tuple[np.ndarray, ...]
    deviation: np.ndarray
    base: int
    lead: int
    setup: np.ndarray
    positive: np.ndarray
    motors: tuple[slice, ...]
    weights: tuple[slice, ...]
    straight: tuple[np.ndarray, ...]

    @property
    def size(self) -> int:
        """P."""
        return self.base + len(self.deviation)

    def regression(self, statistics: Statistics, joint: int) -> Regression:
        """The regression of one joint's parameters, in their order."""
        sums, straight = statistics.of_joint(joint, self.columns[joint]), self.straight[joint]
        if len(straight):
            features, own = self._features_and_own(joint)
            sums.gram[:, features] -= sums.gram[:, own] @ straight.T
            sums.gram[features] -= straight @ sums.gram[own]
            sums.moment[features] -= straight @ sums.moment[own]
        return sums

    @property
    def shared(self) -> int:
        """Number of leading columns that belong to the same parameters for all joints: the bodies'."""
        return self.base // (PER_LINK + PER_JOINT) * PER_LINK

    @cached_property
    def _gatherings(self) -> dict[int, Gathering]:
        return {}

    def gathering(self, count: int) -> Gathering:
        """Index maps from sums over the first `count` columns of each joint to the parameters that they reach."""
        if count not in self._gatherings:
            self._gatherings[count] = Gathering(self.columns, self.parameters, self.shared, count)
        return self._gatherings[count]

    def gathered(self, statistics: Statistics, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The normal equations of all parameters, each joint's rows with its weight (n,): gram (P, P) and moment (P,)."""
        gathering = self.gathering(statistics.gram.shape[-1])
        gram, moment = (
            gathering.matrix(statistics.gram, weights),
            gathering.vector(statistics.moment, weights),
        )
        for joint, straight in enumerate(self.straight):
            if len(straight):
                features, own = (self.parameters[joint][rows] for rows in self._features_and_own(joint))
                where = slice(features[0], features[-1] + 1)
                gram[where] -= straight @ gram[own]
                gram[:, where] -= gram[:, own] @ straight.T
                moment[where] -= straight @ moment[own]
        return gram, moment

    def score(self, statistics: Statistics, joint: int, coefficients: np.ndarray) -> np.ndarray:
        """Σ w φ (y − φᵀ x) of the parameters of one joint under coefficients, as of `regression`."""
        straight = self.straight[joint]
        if not len(straight):
            return statistics.score(joint, self.columns[joint], coefficients)
        features, own = self._features_and_own(joint)
        plain = coefficients.copy()
        plain[own] -= straight.T @ coefficients[features]
        score = statistics.score(joint, self.columns[joint], plain)
        score[features] -= straight @ score[own]
        return score

    def _features_and_own(self, joint: int) -> tuple[slice, slice]:
        """Places of a joint's features among its columns, and of its friction and offset."""
        count, bodies = len(self.columns[joint]), len(self.columns) * PER_LINK
        return slice(count - len(self.straight[joint]), count), slice(bodies + 1, bodies + PER_JOINT)


def straightened(structure: Structure, gram: np.ndarray) -> tuple[np.ndarray, ...]:
    """The friction and offset contained in each joint's features, to be subtracted from them.

    Viscous and Coulomb friction and offset thus remain the best fit to the motion, whatever is learned beside them.

    Args:
        gram: Σ φ φᵀ of each joint's columns after the bodies', over fast motion: where a joint turns round, dry
            friction is anything, (n, K - n · PER_LINK, K - n · PER_LINK).
    """
    result = []
    where = Columns(len(structure.groups))
    for joint, (breakaway, groups) in enumerate(zip(structure.breakaway, structure.groups, strict=True)):
        own = where.of_joint(breakaway)[1:]
        chosen = [where.of_group(name) for name in GROUPS if name in groups]
        columns = np.concatenate([own, *chosen]) - where.own
        sums = gram[joint][np.ix_(columns, columns)]
        count = len(own)
        known = sums[:count, :count]
        ridge = 1e-9 * np.diag(np.diagonal(known) + 1e-12)
        result.append(np.linalg.solve(known + ridge, sums[:count, count:]).T)
    return tuple(result)


def layout(structure: Structure, belief: Prior, straight: Sequence[np.ndarray] = ()) -> Layout:
    """The layout of a structure, with the prior of the parameters beyond the base.

    Args:
        straight: of `straightened`; none leaves the features as they are.
    """
    width = len(structure.breakaway)
    where = Columns(width)
    bodies = np.arange(width * PER_LINK)
    base = width * (PER_LINK + PER_JOINT)
    columns = [[bodies, where.of_joint(structure.breakaway[j])] for j in range(width)]
    parameters = [[bodies, width * PER_LINK + np.arange(PER_JOINT) * width + j] for j in range(width)]
    deviation: list[np.ndarray] = []
    lead = base + PER_COUPLING * len(structure.couplings)
    setup = lead + 1 + np.arange(len(structure.setup))
    free = lead + 1 + len(setup)
    common = np.arange(lead, free), np.array([where.lead, *(where.setup + k for k in structure.setup)])
    positive = [width * PER_LINK + np.arange(PER_COUPLING * width), np.arange(base, lead)]
    motors = []
    for k, coupling in enumerate(structure.couplings):
        own = np.concatenate(
            [base + PER_COUPLING * k + np.arange(PER_COUPLING), free + np.arange(CURVE_FEATURES)]
        )
        for joint, after in ((coupling.joint, True), (coupling.joint + 1, False)):
            columns[joint].append(where.of_coupling(after, coupling.sign))
            parameters[joint].append(own)
        spread = coupling_deviation(belief, structure, coupling.joint)
        deviation.insert(k, spread[:PER_COUPLING])
        deviation.append(spread[PER_COUPLING:])
        motors.append(slice(free, free + CURVE_FEATURES))
        free += CURVE_FEATURES
    for joint in range(width):
        parameters[joint].append(common[0])
        columns[joint].append(common[1])
    deviation.insert(len(structure.couplings), np.array([LEAD, *[SETUP] * len(setup)]))
    weights = []
    for joint, groups in enumerate(structure.groups):
        begin = free
        for name in (name for name in GROUPS if name in groups):
            chosen = where.of_group(name)
            columns[joint].append(chosen)
            parameters[joint].append(free + np.arange(len(chosen)))
            deviation.append(group_deviation(structure, name, joint))
            free += len(chosen)
        weights.append(slice(begin, free))
    return Layout(
        tuple(np.concatenate(parts) for parts in columns),
        tuple(np.concatenate(parts) for parts in parameters),
        np.concatenate(deviation) if deviation else np.empty(0),
        base,
        lead,
        setup,
        np.concatenate(positive),
        tuple(motors),
        tuple(weights),
        tuple(straight) or (np.empty((0, PER_JOINT - 1)),) * width,
    )


def coupling_deviation(belief: Prior, structure: Structure, joint: int) -> np.ndarray:
    """Prior deviation of a coupled motor's parameters and curve weights: the means of its two joints."""
    width = len(belief.effort_scale)
    deviation = np.sqrt(np.diagonal(belief.covariance)[width * PER_LINK :]).reshape(PER_JOINT, width)
    curve = np.full(CURVE_FEATURES, MOTOR_CURVE * np.mean(structure.friction[joint : joint + 2]))
    return np.concatenate([deviation[:PER_COUPLING, joint : joint + 2].mean(axis=1), curve])


def group_deviation(structure: Structure, name: str, joint: int) -> np.ndarray:
    """Prior deviation of the weights of a joint's group of features [N·m]."""
    where = group_slices()[name]
    if structure.relevance:
        return np.array(structure.relevance[joint][where])
    return np.asarray(feature_spread()[where] * structure.beyond[joint])
