"""Whether a robot repeatedly picks something up and puts it down, so that no single model holds for the recording.

Beside link errors, rotors and friction, a body at the last link is present in some blocks of time and absent in others. Body
and blocks are found alternately: the body by least squares, the blocks by the cheapest sequence (Viterbi).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.checks.sampling import some
from bdnn_ros.effects.rigid import POINT, REACH
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.physical.remark import Remark
from bdnn_ros.recording import Recording
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals, prepare

BLOCK = 0.25
"""Length of a block [s]."""
ROWS = 4000
"""Samples that are looked at, or three a block."""
LINKS_OFF = 0.2
"""Standard deviation of the links' relative errors."""
SWITCH = 4.0
"""What a change costs, in blocks' usual misfits."""
ROUNDS = 10
OFTEN = 3
"""So many times it is there, and as many it is not, or it is one load or a push: what lifts seems a load before and after."""
EXPLAINED = 0.4
"""Share of the squared error that it has to explain: friction of any kind explained up to a quarter of it."""
LEAST_FREE = 10.0
"""Motion without the load that is enough to be looked at by itself [s]."""


@dataclass(frozen=True)
class Handling:
    """A load that is picked up and put down.

    Attributes:
        link: that carries it.
        mass: [kg].
        explained: share of the squared error.
        times: when it is there, start and end [s].
    """

    link: str
    mass: float
    explained: float
    times: tuple[tuple[float, float], ...]

    def there(self, time: np.ndarray) -> np.ndarray:
        """Whether the load is held, or is just being picked up or put down, at increasing times (N,) [s], (N,) bool."""
        there, (starts, ends) = np.zeros(len(time), bool), np.reshape(self.times, (-1, 2)).T
        firsts = np.searchsorted(time, starts - BLOCK)
        lasts = np.searchsorted(time, ends + BLOCK, side="right")
        for first, last in zip(firsts, lasts, strict=True):
            there[first:last] = True
        return there

    @property
    def words(self) -> str:
        """The remark on it."""
        return f"{self.link} picks up about {self.mass:.2g} kg {len(self.times)} times and puts it down again"


def handled(recording: Recording, signals: Signals, robot: Robot) -> Iterator[Remark]:
    """The remark on a load that comes and goes."""
    found = handling(signals, robot)
    if found is not None:
        yield Remark(
            found.link,
            f"{recording.name}: {found.words}: no one model is right of all of it.",
            "Record it with the load all the time, or without.",
        )


def unloaded(recordings: Sequence[Recording], robot: Robot, cutoff: float | None = None) -> list[Recording]:
    """The recordings without the times at which a load was held that comes and goes, with a note."""
    return [_unloaded(recording, handling(prepare(recording, cutoff), robot)) for recording in recordings]


def _unloaded(recording: Recording, found: Handling | None) -> Recording:
    if found is None:
        return recording
    free = recording.part(~found.there(recording.time))
    if free.recorded < LEAST_FREE:
        return recording
    note = (
        f"{recording.name}: {found.words}. What was recorded without it is looked at: {free.recorded:.0f} s "
        f"of {recording.recorded:.0f} s."
    )
    return replace(free, notes=(*recording.notes, note))


def handling(signals: Signals, robot: Robot) -> Handling | None:
    """A load that comes and goes at one of the last links; None without one or without effort."""
    if signals.effort is None or not signals.interior.any():
        return None
    motion = Motion(signals, robot)
    last = np.flatnonzero(robot.carried == 0).tolist()
    found = [one for link in last if (one := _handled(motion, robot, link)) is not None]
    return max(found, key=lambda one: one.explained, default=None)


class Motion:
    """Samples of a motion with the columns of bodies, rotors and friction, in blocks of time."""

    def __init__(self, signals: Signals, robot: Robot) -> None:
        assert signals.effort is not None
        inside = np.flatnonzero(signals.interior)
        blocks = float(np.ptp(signals.time[inside])) / BLOCK if len(inside) else 0.0
        rows = some(inside, max(ROWS, round(3 * blocks)))
        q, v, a = signals.position[rows], signals.velocity[rows], signals.acceleration[rows]
        self.time, self.position, self.effort = signals.time[rows], q, signals.effort[rows]
        self.holds = (signals.standing | signals.hardly_moves)[rows]
        self.block = np.unique((self.time / BLOCK).astype(int), return_inverse=True)[1]
        self.regressor = robot.regressor(q, v, a)
        links, each = self.regressor @ relative_inertials(robot), np.arange(robot.width)
        own = np.zeros((len(rows), robot.width, 4, robot.width))
        for k, values in enumerate((a, v, signals.sign[rows], np.ones_like(q))):
            own[:, each, k, each] = values
        self.columns = np.concatenate([links, own.reshape(*q.shape, -1)], axis=2)
        self.precision = np.zeros(self.columns.shape[2])
        self.precision[: links.shape[2]] = LINKS_OFF**-2
        self.target = signals.effort[rows] - robot.rigid_effort(q, v, a)
        # twice: by the spread of the efforts, then by what bodies and friction leave of them
        self.weight = np.where(
            signals.seen[rows], 1.0 / np.maximum(signals.effort[rows].std(axis=0), 1e-9), 0.0
        )
        left = self.weight * self.left(self.columns, self.precision)[0]
        self.weight = self.weight / np.maximum(np.sqrt(np.mean(left**2, axis=0)), 1e-9)

    def left(self, columns: np.ndarray, precision: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual of the target after columns (R, n, k), (R, n), and their coefficients, (k,)."""
        tall = (columns * self.weight[:, :, None]).reshape(-1, columns.shape[2])
        gram = tall.T @ tall + np.diag(precision)
        size = np.sqrt(np.diagonal(gram)) + 1e-12
        ridge = 1e-9 * np.eye(len(size))
        moment = tall.T @ (self.weight * self.target).ravel()
        coefficients = np.linalg.solve(gram / np.outer(size, size) + ridge, moment / size) / size
        return self.target - columns @ coefficients, coefficients

    def misfit(self, left: np.ndarray) -> np.ndarray:
        """Squared error of each block, (B,)."""
        return np.bincount(self.block, weights=np.sum((self.weight * left) ** 2, axis=1))


def _handled(motion: Motion, robot: Robot, link: int) -> Handling | None:
    body = motion.regressor[:, :, link * PER_LINK : link * PER_LINK + POINT]
    before, _ = motion.left(motion.columns, motion.precision)
    plain = float(motion.misfit(before).sum())
    there = _guessed(motion, body, before, robot.inertials[link])
    precision = np.concatenate([motion.precision, np.zeros(POINT)])
    misfit, load = plain, np.zeros(POINT)
    for _ in range(ROUNDS):
        columns = np.concatenate([motion.columns, body * there[motion.block][:, None, None]], axis=2)
        _, coefficients = motion.left(columns, precision)
        load = coefficients[-POINT:]
        bare = motion.target - motion.columns @ coefficients[:-POINT]
        costs = np.array([motion.misfit(bare), motion.misfit(bare - body @ load)])
        misfit = float(np.where(there, costs[1], costs[0]).sum())
        again = _cheapest(costs, SWITCH * float(np.median(costs.min(axis=0))))
        if (again == there).all():
            break
        there = again
    times = _times(motion, there)
    explained = 1.0 - misfit / max(plain, 1e-30)
    carried = np.linalg.norm(load[1:]) < REACH * load[0]
    often = min(len(times), len(_times(motion, ~there))) >= OFTEN
    if not often or explained < EXPLAINED or not carried:
        return None
    return Handling(robot.moving_link(robot.joints[link]), float(load[0]), explained, times)


def _guessed(motion: Motion, body: np.ndarray, left: np.ndarray, inertial: np.ndarray) -> np.ndarray:
    """Blocks in which the residual looks like additional load, (B,) bool."""
    centre = inertial[1:POINT] / max(float(inertial[0]), 1e-9)
    heavier = (body @ np.array([1.0, *centre])) * motion.weight
    told = np.bincount(motion.block, weights=np.sum(heavier * motion.weight * left, axis=1))
    mass = told / np.maximum(np.bincount(motion.block, weights=np.sum(heavier**2, axis=1)), 1e-12)
    return np.asarray(mass > 0.5 * (np.quantile(mass, 0.1) + np.quantile(mass, 0.9)))


def _cheapest(costs: np.ndarray, change: float) -> np.ndarray:
    """The sequence of two states with the least cost (2, B), each change costing `change`, (B,) bool."""
    total, before = costs[:, 0].copy(), np.zeros((costs.shape[1], 2), int)
    for k in range(1, costs.shape[1]):
        moved = total[::-1] + change
        before[k] = np.where(total <= moved, [0, 1], [1, 0])
        total = np.minimum(total, moved) + costs[:, k]
    state, result = int(np.argmin(total)), np.zeros(costs.shape[1], bool)
    for k in range(costs.shape[1] - 1, -1, -1):
        result[k], state = bool(state), int(before[k, state])
    return result


def _times(motion: Motion, there: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Start and end of runs of blocks [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(int)))
    first = np.searchsorted(motion.block, edges[::2])
    last = np.searchsorted(motion.block, edges[1::2]) - 1
    return tuple(zip(motion.time[first].tolist(), motion.time[last].tolist(), strict=True))
