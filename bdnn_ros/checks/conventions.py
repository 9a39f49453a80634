"""Whether a driver follows the conventions assumed here: radians, and the whole effort of each joint in N·m.

Physics tells: whatever the links weigh, inertia and friction are positive, the efforts contain other joints' motion in the
same proportion as gravity, and most joints bear about what the description says.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bdnn_ros.checks.alternatives import misread, weightless
from bdnn_ros.checks.positions import in_other_units
from bdnn_ros.checks.sampling import loud, some, telling
from bdnn_ros.errors import listed
from bdnn_ros.physical.remark import Remark
from bdnn_ros.robot import Robot
from bdnn_ros.robot.mimics import held_mimics
from bdnn_ros.signals import Signals

MOST_ROWS = 2000
"""Most samples to use."""
LEAST_ROWS = 20
CERTAIN = 10.0
"""Standard deviations from 0 that make a coefficient certain: model errors are not white noise."""
LARGEST, SMALLEST = 10.0, 1.0 / 3.0
"""Ratios of measured to described effort that no robot reaches on most joints."""
HEAVY = 0.3
"""Least share of gravity in a joint's effort to judge it,"""
COUPLED, OWN = 0.04, 0.05
"""of the other joints' motion, and of the joint's own inertia."""
LEFT_OUT, FITS = 0.3, 0.85
"""Gravity is left out if its coefficient is below this share of that of the other joints' motion, and all columns together
explain this share of the efforts."""
GONE, THERE = 0.1, 0.5
"""It is not left out, however large the other coefficients, if it explains more of the effort than the first share and its
coefficient exceeds the second."""
TOLD = 0.7
"""A joint's sign is judged only if bodies and friction explain this share of its effort: springs and pushes have any sign,"""
MUTE = 0.1
"""and if its described share of the effort is at least this part of the joints' median: for a link balanced about its axis even
the sign is uncertain."""
FACTOR = (
    "Pass --effort-factor JOINT=FACTOR (node: effort_factors), the N*m (N) in each reported unit: of a current "
    "the torque constant times the gear ratio."
)
HARDLY = 0.25
"""A joint that bears less than this share of the described effort, unlike the others, is in another unit."""
OVERDRIVEN = 10.0
"""Effort per limit that no drive reaches."""


class Fit(NamedTuple):
    """Regression of the joints' efforts on columns.

    Attributes:
        coefficients: (k, n).
        certainty: each coefficient per its standard deviation, (k, n); 0 where undetermined.
        explained: share of each effort's variance, (n,).
    """

    coefficients: np.ndarray
    certainty: np.ndarray
    explained: np.ndarray


@dataclass(frozen=True)
class Efforts:
    """Measured efforts, to be regressed on columns (R, n) and a constant.

    Attributes:
        measured: as the driver reports them, (R, n) [N·m].
        sign: direction of motion, (R, n).
        usable: rows to use, (R, n) bool.
    """

    measured: np.ndarray
    sign: np.ndarray
    usable: np.ndarray

    @classmethod
    def of(cls, signals: Signals, rows: np.ndarray, robot: Robot) -> Efforts:
        """Those of some samples (R,) of a motion."""
        assert signals.effort is not None
        usable = telling(signals)[rows] & loud(signals, robot, rows)
        return cls(signals.effort[rows], signals.sign[rows], usable)

    def fit(self, *columns: np.ndarray) -> Fit:
        """Regression of each joint's effort on its columns (R, n)."""
        fits = [
            _fit(self.measured[rows, j], [column[rows, j] for column in columns])
            for j, rows in enumerate(self.usable.T)
        ]
        return Fit(*(np.array(part).T for part in zip(*fits, strict=True)))

    def share(self, column: np.ndarray) -> np.ndarray:
        """Standard deviation of a column (R, n) per that of each joint's effort, (n,)."""
        sizes = [
            np.std(column[rows, j]) / max(np.std(self.measured[rows, j]), 1e-12) if rows.any() else 0.0
            for j, rows in enumerate(self.usable.T)
        ]
        return np.array(sizes)

    def factor(self, borne: np.ndarray, *own: np.ndarray) -> float | None:
        """Measured effort per expected effort (R, n), median of the joints; None if determined for less than half of them.

        Args:
            own: columns with a free coefficient of their own, such as rotor inertia, (R, n).
        """
        fit = self.fit(borne, self.sign, *own)
        known = np.abs(fit.coefficients[0])[np.abs(fit.certainty[0]) > CERTAIN]
        return float(np.median(known)) if len(known) >= max(0.5 * borne.shape[1], 1) else None


@dataclass(frozen=True)
class Borne:
    """Rigid-body efforts of some samples by the description, (R, n) each [N·m].

    Attributes:
        efforts: the measured ones.
        own, coupled: due to the joint's own acceleration, and to all other motion.
        gravity: due to gravity.
    """

    efforts: Efforts
    own: np.ndarray
    coupled: np.ndarray
    gravity: np.ndarray

    @classmethod
    def of(cls, signals: Signals, robot: Robot) -> Borne:
        """Those of a motion by a robot's description."""
        rows = _rows(signals)
        q, v, a = signals.position[rows], signals.velocity[rows], signals.acceleration[rows]
        inertia = np.diagonal(robot.mass_matrix(q), axis1=1, axis2=2) - robot.armature
        own, gravity = inertia * a, robot.gravity(q)
        return cls(
            Efforts.of(signals, rows, robot), own, robot.rigid_effort(q, v, a) - own - gravity, gravity
        )

    @property
    def total(self) -> np.ndarray:
        """Their sum, (R, n) [N·m]."""
        return self.own + self.coupled + self.gravity

    @cached_property
    def apart(self) -> Fit:
        """Regression of the efforts on own, coupled and gravity efforts and the direction."""
        return self.efforts.fit(self.own, self.coupled, self.gravity, self.efforts.sign)


def breaches(signals: Signals, robot: Robot) -> Iterator[Remark]:
    """Conventions that a recorded motion violates, judged by the robot's description; first those that would mask others."""
    others = list(in_other_units(signals, robot))
    yield from others
    if others or signals.effort is None:
        return
    borne = Borne.of(signals, robot)
    turned, plainly = _turned(borne, signals.joints)
    # a wrong mounting may reverse a joint's small efforts, but never all of its large ones
    found = turned if plainly else list(misread(signals, robot)) or turned
    found = (
        found
        or list(_overdriven(signals, robot))
        or list(_hardly_borne(borne, signals.joints, {*held_mimics(robot).values()}))
    )
    if not found and _gravity_left_out(borne):
        found = [weightless()]
    yield from found or _out_of_proportion(borne)


def unlike(signals: Signals, predicted: np.ndarray, robot: Robot) -> Iterator[Remark]:
    """Whether a motion's efforts are in another unit than a model's predictions for it, (N, n)."""
    rows = _rows(signals)
    yield from _another_unit(Efforts.of(signals, rows, robot).factor(predicted[rows]))


def _rows(signals: Signals) -> np.ndarray:
    return some(np.flatnonzero(signals.interior), MOST_ROWS)


def _out_of_proportion(borne: Borne) -> Iterator[Remark]:
    """Whether most joints' efforts are far larger or smaller than expected; if smaller only by gravity, it is left out."""
    factor = borne.efforts.factor(borne.total, borne.own)
    of_motion = borne.efforts.factor(borne.own + borne.coupled, borne.own)
    if factor is not None and of_motion is not None and factor < SMALLEST < of_motion:
        yield weightless()
    else:
        yield from _another_unit(factor)


def _another_unit(factor: float | None) -> Iterator[Remark]:
    """Whether a ratio of measured to expected efforts means another unit."""
    if factor is None or SMALLEST < factor < LARGEST:
        return
    yield Remark(
        "",
        f"The efforts are about {factor:.2g} times what the simulation says: they seem to be in another unit.",
        FACTOR,
    )


def _overdriven(signals: Signals, robot: Robot) -> Iterator[Remark]:
    """Joints, fewer than half, whose efforts far exceed their limits while the others keep theirs."""
    assert signals.effort is not None
    most, limit = np.nanmax(np.abs(signals.smooth(signals.effort)), axis=0), robot.limits.effort
    told = np.isfinite(limit) & (limit > 0.0)
    times = np.divide(most, limit, out=np.zeros_like(most), where=told)
    beyond = times > OVERDRIVEN
    if beyond.any() and beyond.sum() < 0.5 * told.sum():
        joints = listed(joint for joint, far in zip(signals.joints, beyond, strict=True) if far)
        yield Remark(
            joints,
            f"The effort of {joints} is {times[beyond].max():.0f} times what the description lets the drive give: "
            "it seems to be in another unit.",
            FACTOR,
        )


def _hardly_borne(borne: Borne, joints: tuple[str, ...], leading: set[str]) -> Iterator[Remark]:
    """Joints, fewer than half, whose effort certainly holds only a small part of gravity and of the other joints' motion.

    A spring may balance gravity, but not the other joints' motion; a light link would affect the joints before it as well. A
    hand's two fingers driven by one motor, one of which leads, balance each other and are left out.
    """
    _, coupled, gravity, _ = np.abs(borne.apart.coefficients)
    sure = np.abs(borne.apart.certainty[1:3])
    most = np.array([coupled, gravity]) * (1.0 + 5.0 / np.maximum(sure, 1e-9))
    hardly = ((most < HARDLY) & (sure > 0.0)).all(axis=0)
    hardly &= ~np.isin(joints, list(leading))
    if hardly.any() and hardly.sum() < 0.5 * len(hardly):
        named = listed(joint for joint, one in zip(joints, hardly, strict=True) if one)
        yield Remark(
            named,
            f"The effort of {named} holds only {gravity[hardly].min():.2g} times what gravity and the other joints' motion ask "
            "for: it seems to be in another unit.",
            FACTOR,
        )


def _gravity_left_out(borne: Borne) -> bool:
    """Whether the efforts contain what motion takes but not gravity."""
    efforts, fit = borne.efforts, borne.apart
    _, coupled, gravity, _ = np.abs(fit.coefficients)
    told = efforts.share(borne.coupled) * (np.abs(fit.certainty[1]) > CERTAIN)
    told[told < COUPLED] = 0.0
    heavy = efforts.share(borne.gravity)
    heavy[heavy < HEAVY] = 0.0
    if not told.any() or np.count_nonzero(heavy) < 2 or fit.explained.mean() < FITS:
        return False
    there = np.average(gravity, weights=heavy)
    if there >= LEFT_OUT * np.average(coupled, weights=told):
        return False
    lost = fit.explained - efforts.fit(borne.own, borne.coupled, efforts.sign).explained
    return bool(np.average(lost, weights=heavy) <= GONE or there <= THERE)


def _turned(borne: Borne, joints: tuple[str, ...]) -> tuple[list[Remark], bool]:
    """Joints with efforts of the wrong sign: negative coefficients of the rigid-body effort and of friction or own inertia.

    Also whether each such coefficient is so large that no other cause is needed.
    """
    efforts, apart = borne.efforts, borne.apart
    whole = efforts.fit(borne.total, efforts.sign)
    sure, sure_of_friction = whole.certainty
    sure_of_own = apart.certainty[0] * (efforts.share(borne.own) > OWN)
    right = (sure_of_friction > CERTAIN) | (sure_of_own > CERTAIN)
    negative = (sure_of_friction < -CERTAIN) | (sure_of_own < -CERTAIN)
    described = efforts.share(borne.total)
    told = (apart.explained > TOLD) & (described > MUTE * np.median(described))
    wrong = (sure < -CERTAIN) & negative & ~right & told
    if not wrong.any():
        return [], False
    named = [joint for joint, one in zip(joints, wrong | ~right.any(), strict=True) if one]
    rules = "-1" if len(named) == len(joints) else f"{named[0]}=-1"
    remark = Remark(
        listed(named),
        f"The efforts of {listed(named)} have the wrong sign: they would make inertia and friction negative.",
        f"Pass --effort-factor {rules} (node: effort_factors), or mend the driver.",
    )
    return [remark], bool((whole.coefficients[0, wrong] < -HARDLY).all())


def _fit(effort: np.ndarray, columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """A `Fit` of one joint: columns (R,) and a constant."""
    matrix = np.stack([*columns, np.ones_like(effort)], axis=1)
    coefficients, certainty = np.zeros((2, matrix.shape[1]))
    size = np.linalg.norm(matrix, axis=0)
    seen = size > 1e-9 * np.sqrt(len(effort))
    scaled = matrix[:, seen] / size[seen]
    gram = scaled.T @ scaled
    if len(effort) < LEAST_ROWS or not seen.any() or np.linalg.cond(gram) > 1e10:
        return coefficients[:-1], certainty[:-1], 0.0
    found = np.linalg.solve(gram, scaled.T @ effort)
    left = float(np.mean((effort - scaled @ found) ** 2))
    doubt = np.sqrt(left * np.diagonal(np.linalg.inv(gram)))
    coefficients[seen] = found / size[seen]
    certainty[seen] = found / np.maximum(doubt, 1e-12 * np.linalg.norm(effort))
    return coefficients[:-1], certainty[:-1], 1.0 - left / max(float(np.var(effort)), 1e-300)
