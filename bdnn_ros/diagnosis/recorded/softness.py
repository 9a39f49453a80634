"""Recordings that were low-passed before they were published, by a driver or for a data set.

Steps of dry friction are then softer than the motion implies, which passes for hysteresis, delay, viscous or Stribeck
friction; inertial efforts no longer match the motion either, being nonlinear in it. The low-pass is identified from the
efforts and inverted where it passes any signal; every sharp term is softened by what is left of it. Pre-sliding friction is
soft, too, but by distance, not by time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.checks.sampling import lowest, some, telling
from bdnn_ros.diagnosis.recorded.residuals import NEW, basis, projected_out, regret
from bdnn_ros.diagnosis.regression.building import STICKING_WIDTHS, near_creeping
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals
from bdnn_ros.signals.lowpasses import Lowpass, Response, Restored, Restoring, reach_of

CUTOFFS = tuple(2.0 ** ((k - 1) / 2.0) for k in range(8))
"""Cut-offs of Gaussian low-passes tried [Hz]; higher ones soften less than the diagnosis' own low-pass."""
ORDERS = (0, 1, 2, 3, 4)
"""Orders of low-passes tried near the best Gaussian."""
NEAR = tuple(1.15**k for k in range(-4, 5))
"""Cut-offs tried for each order, relative to the best Gaussian's."""
NEARER = tuple(1.03**k for k in range(-4, 5))
"""Cut-offs tried last, relative to the best of these."""
DECIDED_BEHIND = 3.5
"""Low-pass behind which candidates are compared [Hz]: low, so that noise of the position counts less."""
BETTER = 1.4
"""Efforts are soft if softened steps leave this many times less of their rate of change, mean of the joints."""
TELLING = 2.0
"""And this many times less than no steps at all: at the edges of rest alone, any shape fits the little that shows."""
CLEARLY = 1.1
"""Only efforts were low-passed if recorded motion leaves this many times less than restored motion."""
UNLIKE = 0.1
"""If the joints' mean regret of the best low-pass exceeds this, each is soft in its own way: gears, not a low-pass."""
ENOUGH = 60.0
"""Duration of motion that is examined [s]."""
LEAST = 2.0
"""Joints that move for less time are ignored [s]."""
MOST_ROWS = 3000
TINY = 1e-30
HARDLY, LITTLE = 0.01, 0.05
"""Share of a filter's kernel allowed beyond a segment's ends: to tell low-passes apart, and to compare motion."""
COMPARED = 0.7
"""Highest cut-off behind which motion and effort are compared, relative to the edge of the restored low-pass."""


@dataclass(frozen=True)
class Softness:
    """Low-pass that efforts had passed before they were recorded.

    Attributes:
        lowpass: the low-pass.
        motion: whether the positions had passed it, too.
    """

    lowpass: Lowpass
    motion: bool


def softness(signals: Signals, robot: Robot) -> Softness | None:
    """The low-pass that all efforts of a motion had passed; None if none shows."""
    if signals.time[-1] - signals.time[0] > ENOUGH:
        signals = signals.between(signals.time[0], signals.time[0] + ENOUGH)
    if not telling(signals)[signals.interior].any():
        return None
    changes = _Changes(signals, robot)
    if not len(changes.joints):
        return None
    left = np.array([changes.left(one) for one in (None, *(Lowpass(cutoff, 0) for cutoff in CUTOFFS))])
    sharp, *soft = left.mean(axis=1)
    if sharp - min(soft) <= np.log(BETTER) or regret(left).min() > UNLIKE:
        return None
    if changes.without.mean() - min(soft) <= np.log(TELLING):
        return None
    gaussian = Lowpass(CUTOFFS[0] * (CUTOFFS[1] / CUTOFFS[0]) ** lowest(regret(left[1:])), 0)
    signals = replace(signals, cutoff=min(signals.cutoff, DECIDED_BEHIND))
    found = [_refined(signals, robot, Softness(gaussian, motion)) for motion in (True, False)]
    both, efforts = regret(np.array([_Changes(signals, robot, one).left(one.lowpass) for one in found]))
    return found[int(both - efforts > np.log(CLEARLY))]


def _refined(signals: Signals, robot: Robot, near: Softness) -> Softness:
    """The low-pass near a Gaussian that leaves least: the best cut-off of each order, then finer about these."""
    cutoffs = [near.lowpass.cutoff] * len(ORDERS)
    changes = [_Changes(signals, robot, near)] * len(ORDERS)
    for steps in (NEAR, NEARER):
        each = zip(changes, ORDERS, cutoffs, strict=True)
        tried = np.array([[own.left(Lowpass(c * k, order)) for k in steps] for own, order, c in each])
        regrets = regret(tried.reshape(-1, tried.shape[-1])).reshape(tried.shape[:2])
        ratio = steps[1] / steps[0]
        cutoffs = [c * steps[0] * ratio ** lowest(row) for c, row in zip(cutoffs, regrets, strict=True)]
        found = [replace(near, lowpass=Lowpass(c, order)) for c, order in zip(cutoffs, ORDERS, strict=True)]
        if steps is NEAR:
            changes = [_Changes(signals, robot, one) for one in found]
    return found[int(np.argmin(regrets.min(axis=1)))]


class _Changes:
    """Rates of change of efforts, and how much of them steps of dry friction explain.

    Args:
        own: low-pass of the efforts, applied to inertial efforts as well; None for none.
    """

    def __init__(self, signals: Signals, robot: Robot, own: Softness | None = None) -> None:
        assert signals.effort is not None
        self.signals = signals
        motion = signals if own is None or not own.motion else _moved(signals, Restoring(own.lowpass))
        self.signs = [signals.sign] if motion is signals else [signals.sign, motion.sign]
        response = Lowpass(CUTOFFS[0], 0) if own is None else Restoring(own.lowpass)
        moves = telling(signals) & signals.interior[:, None]
        inside = moves.any(axis=1) & _untouched(signals, response, HARDLY)
        self.rows = some(np.flatnonzero(inside if inside.any() else moves.any(axis=1)), MOST_ROWS)
        # at rest, friction follows the slowly changing load: that is no softness
        free = ~near_creeping(signals, STICKING_WIDTHS)
        # chosen before rows at segment ends are dropped, so that the joints do not depend on the filter
        self.joints = np.flatnonzero((moves & free).sum(axis=0) > LEAST * signals.rate)
        self.seen = free[self.rows]
        borne = robot.regressor(motion.position, motion.velocity, motion.acceleration)
        drives = np.stack([motion.acceleration, motion.velocity], axis=2)
        smooth = np.concatenate([borne, drives], axis=2)
        changes = self._rates(smooth if own is None else signals.through(smooth, own.lowpass))
        effort = self._rates(signals.effort)
        self.others = [basis(changes[self.seen[:, j], j]) for j in self.joints]
        each = zip(self.joints, self.others, strict=True)
        self.target = [projected_out(effort[self.seen[:, j], j], other) for j, other in each]

    def _rates(self, values: np.ndarray) -> np.ndarray:
        return np.asarray(np.gradient(self.signals.smooth(values), axis=0)[self.rows])

    @property
    def without(self) -> np.ndarray:
        """As `left` without steps, (J,)."""
        return np.log([_left(target, np.zeros_like(target)) for target in self.target])

    def left(self, lowpass: Lowpass | None) -> np.ndarray:
        """Log mean square left of each joint's rates by steps behind a low-pass, (J,).

        Steps follow the direction of recorded or restored motion, whichever explains more: restored motion turns at the right
        time but jitters about rest.
        """
        return np.asarray(np.minimum.reduce([self._left(sign, lowpass) for sign in self.signs]))

    def _left(self, sign: np.ndarray, lowpass: Lowpass | None) -> np.ndarray:
        steps = self._rates(sign if lowpass is None else self.signals.through(sign, lowpass))
        each = zip(self.joints, self.others, strict=True)
        own = (projected_out(steps[self.seen[:, j], j], other) for j, other in each)
        return np.log([_left(t, s) for t, s in zip(self.target, own, strict=True)])


def _moved(signals: Signals, response: Response) -> Signals:
    """The signals with their motion passed through a filter."""
    return replace(
        signals,
        position=signals.through(signals.position, response),
        velocity=signals.through(signals.velocity, response),
        acceleration=signals.through(signals.acceleration, response),
    )


def _untouched(signals: Signals, response: Response, share: float) -> np.ndarray:
    """Samples at which at most a share of a filter's kernel lies beyond its segment, (N,) bool; half of short segments."""
    reach = reach_of(response, signals.rate, share)
    inside = np.zeros(len(signals), bool)
    for rows in signals.segments:
        margin = min(reach, (rows.stop - rows.start) // 4)
        inside[rows.start + margin : rows.stop - margin] = True
    return inside


def softened(signals: Signals, own: Softness) -> Signals:
    """The signals with the low-pass inverted where it passes any signal, compared behind no higher a cut-off than remains."""
    restored, restoring = Restored(own.lowpass), Restoring(own.lowpass)
    response = restoring if own.motion else restored
    reported = signals.reported_velocity
    whole = replace(
        _moved(signals, response),
        effort=None if signals.effort is None else signals.through(signals.effort, restoring),
        reported_velocity=None if reported is None else signals.through(reported, response),
        own=restored,
        cutoff=min(signals.cutoff, COMPARED * restored.edge),
    )
    return whole.rows(_untouched(signals, restoring, LITTLE))


def noted(recordings: Sequence[Recording], own: Softness) -> list[Recording]:
    """The recordings with a note on the low-pass that their efforts had passed."""
    return [replace(one, notes=(*one.notes, note(one, own))) for one in recordings]


def note(recording: Recording, own: Softness) -> str:
    """The note on a recording whose efforts had passed a low-pass."""
    what = "motion and efforts were" if own.motion else "efforts were"
    return (
        f"{recording.name}: {what} low-passed at about {own.lowpass.edge:.1f} Hz before they were recorded; what was let "
        "through is given back, and no more is compared. Record them as they are measured: what is fast tells most about "
        "friction and gears."
    )


def _left(target: np.ndarray, steps: np.ndarray) -> float:
    """Mean square that the best non-negative multiple of steps (R,) leaves of a target (R,)."""
    common = max(float(target @ steps), 0.0)
    square = float(target @ target)
    left = max(square - common**2 / max(float(steps @ steps), TINY), NEW * square, TINY)
    return left / len(target)
