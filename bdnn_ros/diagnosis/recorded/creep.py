"""Creeping dry friction: it builds up gradually with velocity, or early, as in simulators that regularise it.

Otherwise it passes for viscous friction, hysteresis or a drift, and fits to it have wrong sizes. The velocity at which
friction is complete and its lead are found beforehand, joint by joint; every law of dry friction then reverses accordingly
(`Signals.creep`). In MuJoCo it is (q̈ + b q̇) / R, clipped: early by 1 / b, and gradual where it is large beside the joint's
inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_array

from bdnn_ros.aside import in_two
from bdnn_ros.checks.sampling import lowest, some, telling
from bdnn_ros.diagnosis.recorded.bodies import of_bodies
from bdnn_ros.diagnosis.recorded.residuals import basis, projected_out
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.bristles import bristles
from bdnn_ros.effects.drift import DriftingCoulomb
from bdnn_ros.effects.friction import DryFriction, LoadDependentFriction
from bdnn_ros.effects.registry import Installed
from bdnn_ros.errors import listed
from bdnn_ros.recording import Recording, further
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import along
from bdnn_ros.signals import Signals
from bdnn_ros.signals.signals import friction_direction

SHARES = tuple(0.005 * 1.35**k for k in range(22))
"""Velocities tried, relative to the joint's root mean square velocity: the loss has several, steep minima."""
EXACTLY = 3e-4
"""Relative tolerance of that velocity: a small error of large friction passes for a cause."""
ALIKE = 0.3
"""Relative difference of onsets that makes no practical difference."""
SEEN = 0.03
"""Friction that is complete below this share of the usual velocity counts as immediate."""
SMEARED = 3.0
"""So does, for notes, what is complete below this many standard deviations of the velocity's noise."""
FAST = 0.95
"""Quantile of speed that must exceed the velocity at which friction is complete: what never is complete is not seen."""
FASTEST = 0.99
"""The same beside another joint whose friction creeps, if this one's clearly does: less time above it is enough."""
EARLY = 0.006
"""Least lead that counts as early [s]; less is left to the regression's nuisance of sticking."""
BREAKAWAYS = tuple(0.001 * 2.0**k for k in range(8))
"""Breakaway distances tried for pre-sliding friction instead [rad]."""
FALLS = tuple(0.02 * 2.0**k for k in range(6))
"""Velocities tried for friction that falls (Stribeck) instead, relative to the usual velocity."""
CLEARLY = 1.3
"""Friction creeps if this many times less is left unexplained than by any law that reverses at once."""
LIKELY = 1.03
"""The same beside another joint whose friction creeps."""
MOST_DISTURBED = 0.5
"""If something pushes for a larger share of time, too little is left to see friction by."""
MOST_ROWS = 1000
LEADS = tuple(0.002 * k for k in range(11))
"""Leads tried [s]."""
ROUNDS = 2
"""Alternations between velocities and lead."""
TURNING = (DryFriction, LoadDependentFriction, DriftingCoulomb)
"""Laws that reverse with velocity; pre-sliding friction reverses with displacement."""
AT_ONCE = (0.0, 0.0, 0.0)
TINY = 1e-30
Creep = tuple[float, float, float]
"""Velocities at which friction is complete, ahead and back [rad/s], and its lead [s]."""


def creeping(signals: Signals, robot: Robot, disturbed: np.ndarray | None = None) -> np.ndarray | None:
    """Velocities at which each joint's dry friction is complete, ahead and back [rad/s], and its lead [s], (n, 3).

    Zero where friction is immediate or the joint does not move; None if no joint's creeps. Disturbed samples, (N,) bool, are
    left out.
    """
    inside = signals.interior & telling(signals).any(axis=1)
    rows = some(np.flatnonzero(inside if disturbed is None else inside & ~disturbed), MOST_ROWS)
    if not len(rows):
        return None
    smoothing = signals.smoothing_at(rows)
    bodies = of_bodies(signals, robot)
    bodies = (smoothing @ bodies.reshape(len(bodies), -1)).reshape(-1, *bodies.shape[1:])
    load = np.abs(robot.rigid_effort(signals.position, signals.velocity, signals.acceleration))
    moving = np.flatnonzero(further(signals.position, signals.position_noise)).tolist()
    softening = signals.softening_at(rows)
    joints = [_Joint.of(signals, smoothing, softening, bodies[:, j], load[:, j], j) for j in moving]
    found = np.array(in_two(lambda joint: joint.creep(), joints))
    if not found.any():
        return None
    early = float(np.median(found[found.any(axis=1), 2]))
    at_once = np.flatnonzero(~found.any(axis=1)).tolist()
    for k, likely in zip(at_once, in_two(lambda k: joints[k].likely(early), at_once), strict=True):
        found[k] = likely
    result = np.zeros((signals.width, 3))
    result[moving] = found
    return result


def undisturbed(signals: Signals, robot: Robot, disturbed: np.ndarray) -> Signals:
    """The motion with the onset of friction found outside disturbances; unchanged if that is about the same.

    Args:
        disturbed: samples at which something pushes, (N,) bool, which hides how friction comes on.
    """
    if not disturbed.any() or disturbed.mean() > MOST_DISTURBED:
        return signals
    found = creeping(signals, robot, disturbed)
    was, now = (np.zeros((signals.width, 3)) if c is None else c for c in (signals.creep, found))
    return signals if np.allclose(was, now, rtol=ALIKE, atol=0.0) else replace(signals, creep=found)


@dataclass(frozen=True)
class _Joint:
    """A joint's effort beside bodies, zeros, base, rotor, fluid friction, offset and lead, for fits of dry friction.

    Attributes:
        softening: passes columns (N, k) through both low-passes at some rows of the motion, (R, k).
        load: magnitude of the bodies' effort, (N,) [N·m], with which dry friction may grow.
        spanned: orthonormal basis of all causes but dry friction, (R, b).
        target: effort with these projected out, (R,).
    """

    signals: Signals
    softening: Callable[[np.ndarray], np.ndarray]
    joint: int
    load: np.ndarray
    spanned: np.ndarray
    target: np.ndarray

    @classmethod
    def of(
        cls,
        signals: Signals,
        smoothing: csr_array,
        softening: Callable[[np.ndarray], np.ndarray],
        bodies: np.ndarray,
        load: np.ndarray,
        joint: int,
    ) -> _Joint:
        """The joint of a motion.

        Args:
            smoothing: the low-pass at some rows of the motion, (R, N).
            bodies: columns of errors of bodies, zeros and base, low-passed, at the rows, (R, k).
        """
        assert signals.effort is not None
        v, effort = signals.velocity[:, joint], signals.effort[:, joint]
        own = [signals.acceleration[:, joint], v, np.abs(v) * v, np.ones_like(v), signals.derivative(effort)]
        spanned = basis(np.concatenate([bodies, smoothing @ np.stack(own, axis=1)], axis=1))
        return cls(signals, softening, joint, load, spanned, projected_out(smoothing @ effort, spanned))

    def creep(self) -> Creep:
        """How its dry friction comes on."""
        usual = self._usual
        begun = [(usual * share, usual * share, lead) for lead in LEADS[::5] for share in SHARES]
        found = self._best(begun)
        if self._left_by(found) > self._left_by(AT_ONCE) - np.log(CLEARLY):
            return AT_ONCE
        found = self._refined(found, apart=False)
        if found[0] > SEEN * usual:
            found = self._apart(found)
        if self._left_by(found) > self._left_by_others() - np.log(CLEARLY):
            return AT_ONCE
        return found if self._is_seen(found) else AT_ONCE

    def likely(self, early: float) -> Creep:
        """The onset given another joint's lead, by weaker evidence: what regularises one joint regularises all."""
        found = self._lowest((0.0, 0.0, early), (0, 1))
        better = min(self._left_by(AT_ONCE), self._left_by_others()) - self._left_by(found)
        seen = self._is_seen(found) if better < np.log(CLEARLY) else self._is_seen(found, FASTEST)
        return found if seen and better > np.log(LIKELY) else AT_ONCE

    def _is_seen(self, creep: Creep, fast: float = FAST) -> bool:
        """Whether an onset makes a difference, and friction is complete in all but a share of the time."""
        all_at = max(creep[:2])
        makes = all_at > SEEN * self._usual or creep[2] > EARLY
        return bool(makes and all_at < np.quantile(self._speed, fast))

    @cached_property
    def _speed(self) -> np.ndarray:
        """Its speed, (N,) [rad/s]."""
        return np.abs(self.signals.velocity[:, self.joint])

    @cached_property
    def _usual(self) -> float:
        """Its root mean square velocity [rad/s]."""
        return float(np.sqrt(np.mean(self._speed**2)))

    def _apart(self, alike: Creep) -> Creep:
        """An onset that differs ahead and back, if that leaves clearly less than the same onset for both."""
        slow = [self._usual * share for share in SHARES[::2] if share > SEEN]
        begun = self._best([alike, *((ahead, back, alike[2]) for ahead in slow for back in slow)])
        apart = self._refined(begun, apart=True)
        return apart if self._left_by(apart) < self._left_by(alike) - np.log(CLEARLY) else alike

    def _best(self, creeps: Sequence[Creep]) -> Creep:
        """The one of some onsets that leaves least."""
        return creeps[int(np.argmin(self._left(self._ways(creeps))))]

    def _left_by(self, creep: Creep) -> float:
        return float(self._left(self._ways([creep]))[0])

    def _left_by_others(self) -> float:
        """Log mean square left by the best law that is immediate, pre-sliding or falling."""
        bent = [bristles(self.signals, self.joint, breakaway) for breakaway in BREAKAWAYS]
        falling = [self._left_falling(self._usual * share) for share in FALLS]
        return float(min(*self._left(np.stack(bent, axis=1)), *falling))

    def _refined(self, near: Creep, apart: bool) -> Creep:
        """The onset that leaves least near a given one: the same ahead and back, or apart."""
        for _ in range(ROUNDS):
            for ways in ((0,), (1,)) if apart else ((0, 1),):
                near = self._lowest(near, ways)
            ahead, back, _ = near
            left = self._left(self._ways([(ahead, back, lead) for lead in LEADS]), in_time=True)
            near = ahead, back, float(np.interp(lowest(left), range(len(LEADS)), LEADS))
        return near

    def _lowest(self, near: Creep, ways: Sequence[int]) -> Creep:
        """The onset that leaves least over the velocity ahead (0), back (1) or both."""

        def moved(log_velocity: float) -> Creep:
            ahead, back = (float(np.exp(log_velocity)) if k in ways else near[k] for k in range(2))
            return ahead, back, near[2]

        def left(*log_velocities: float) -> np.ndarray:
            # parabolic near its minimum, unlike its logarithm
            return np.exp(self._left(self._ways([moved(one) for one in log_velocities])))

        tried = np.log(self._usual * np.array(SHARES))
        heights = np.pad(left(*tried), 1, constant_values=np.inf)
        valleys = np.flatnonzero((heights[1:-1] < heights[:-2]) & (heights[1:-1] <= heights[2:]))
        ends = ((tried[max(k - 1, 0)], tried[min(k + 1, len(tried) - 1)]) for k in valleys)
        exactly = {"xatol": EXACTLY}
        found = [
            minimize_scalar(lambda x: left(x)[0], bounds=each, method="bounded", options=exactly)
            for each in ends
        ]
        return moved(min(found, key=lambda one: float(one.fun)).x)

    def _left(self, ways: np.ndarray, in_time: bool = False) -> np.ndarray:
        """Log mean squares left by dry friction of free size in either direction and free lead.

        Args:
            ways: directions of friction, each of which is tried, (N, m).
            in_time: without a lead.
        """
        own = self._own(self._of(ways)[: 3 if in_time else 4])
        left = [projected_out(self.target, basis(own[..., i])) for i in range(ways.shape[1])]
        return np.log(np.maximum(np.mean(np.square(left), axis=1), TINY))

    def _left_falling(self, velocity: float) -> float:
        """The same for immediate friction that falls with a velocity [rad/s]; it may only be larger while slow."""
        way = self._ways([AT_ONCE])
        v = self.signals.velocity[:, self.joint, None]
        own = self._own([*self._of(way), way * np.exp(-((v / max(velocity, TINY)) ** 2))])[..., 0]
        size = _fitted(own, self.target)
        falls = size[-1] * (size[0] + size[1]) > 0.0
        left = self.target - own @ size if falls else projected_out(self.target, basis(own[:, :-1]))
        return float(np.log(max(float(np.mean(left**2)), TINY)))

    def _of(self, ways: np.ndarray) -> list[np.ndarray]:
        """Components of dry friction for some directions (N, m), (N, m) each; the last is a lead."""
        early = self.signals.derivative(ways)
        return [np.maximum(ways, 0.0), np.minimum(ways, 0.0), self.load[:, None] * ways, early]

    def _own(self, columns: Sequence[np.ndarray]) -> np.ndarray:
        """k columns (N, m) behind both low-passes, other causes projected out, (R, k, m)."""
        soft = self.softening(np.concatenate(columns, axis=1))
        return projected_out(soft, self.spanned).reshape(len(soft), len(columns), -1)

    def _ways(self, creeps: Sequence[Creep]) -> np.ndarray:
        """Directions of friction for some onsets, (N, m)."""
        one = slice(self.joint, self.joint + 1)
        motion = self.signals.velocity[:, one], self.signals.acceleration[:, one]
        return friction_direction(*motion, self.signals.rate, np.array(creeps))


def _fitted(columns: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Least squares of a target (R,) on columns (R, k), scaled alike; zero for an empty column."""
    size = np.linalg.norm(columns, axis=0)
    scale = np.where(size > 0.0, size, 1.0)
    return np.asarray(np.linalg.lstsq(columns / scale, target, rcond=1e-9)[0] / scale)


def remarked(
    recordings: Sequence[Recording], signals: Signals, robot: Robot, effects: Iterable[Term | Installed]
) -> list[Recording]:
    """The recordings with a note on creeping dry friction, where there is any to speak of.

    Args:
        robot: may have described friction.
        effects: others that are known to act.
    """
    if signals.creep is None:
        return list(recordings)
    all_at = signals.creep[:, :2].max(axis=1)
    dry = robot.coulomb > 0.0
    dry[[one.target for one in effects if isinstance(one.effect, TURNING)]] = True
    least = np.maximum(SEEN * np.sqrt(np.mean(signals.velocity**2, axis=0)), SMEARED * signals.velocity_noise)
    seen = np.flatnonzero(dry & (all_at > least))
    if not len(seen):
        return list(recordings)
    units = [along("rad/s", slides) for slides in robot.slides]
    where = listed([f"{robot.joints[j]} (all there at {all_at[j]:.2g} {units[j]})" for j in seen])
    said = (
        f"dry friction comes on little by little with the velocity at {where}, as in a simulator that regularises it "
        "or where noise of the position hides when the joint turns round; "
        "it is taken as it is, and its size is what it comes to"
    )
    return [replace(one, notes=(*one.notes, f"{one.name}: {said}.")) for one in recordings]
