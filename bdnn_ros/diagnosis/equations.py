"""The joints' equations of motion as one linear regression, with noise that is coloured.

Row k of joint j says: measured effort - effort of the URDF = Y_j(k) · (error of the links) + columns of effects · coefficients
+ noise. Both sides are low-passed alike and thinned to the rate the low-pass leaves, then each joint's rows are whitened by an
autoregressive model of its own residual, so that sums of squares are log likelihoods.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bdnn_ros.effects.base import Effect, Motion
from bdnn_ros.errors import RecordingError
from bdnn_ros.physical.parameters import feasible_pseudo_inertia, inertial_parameters, pseudo_inertia
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import Signals

ROWS_PER_CUTOFF = 2.5
"""Rows per second and Hz of cut-off: what the twice low-passed signals still carry."""
NOISE_ORDER = 3
"""Order of the autoregressive noise model."""
TYPICAL_SHARE = 0.3
"""Prior spread of an effect: its contribution is about this share of the effort it acts on."""
BLOCK_SECONDS = 2.0
"""Held-out blocks are about this long."""


@dataclass(frozen=True)
class Term:
    """An effect at its place, with the shape its columns are made with."""

    effect: Effect
    target: int
    link: str | None = None
    shape: tuple[tuple[str, float], ...] = ()

    @property
    def place(self) -> tuple[str, str, int, str | None]:
        """What it is and where, without the shape."""
        return (self.effect.name, self.effect.variant, self.target, self.link)

    def shaped(self, shape: dict[str, float]) -> Term:
        """The same effect with another shape."""
        return Term(self.effect, self.target, self.link, tuple(sorted(shape.items())))


@dataclass(frozen=True)
class Noise:
    """Autoregressive noise of each joint: e[k] = sum_i a[j, i] e[k-i] + std[j] · white."""

    coefficients: np.ndarray
    std: np.ndarray


@dataclass
class Equations:
    """Rows of the regression, before whitening.

    Attributes:
        motion: the motion at the working rate, with the robot of the URDF and the load estimate.
        simulated: the simulation's effort at the working rate, (N, n) [N·m].
        rows: which working samples are rows, (R,).
        target: measured effort minus the simulation's, (R, n) [N·m].
        usable: rows that count, (R, n) bool: not a segment's end, not a joint at rest.
        block: held-out block of each row, (R,) int, starting at 0.
        runs: rows of each gap-free piece.
        rigid: columns of the links' relative errors, (R, n, n * PER_LINK), one unit = an error of 100 %.
        relative: from those relative errors to inertial parameters, (n * PER_LINK, n * PER_LINK).
        effort_scale: spread of each joint's effort, (n,) [N·m].
    """

    motion: Motion
    simulated: np.ndarray
    rows: np.ndarray
    target: np.ndarray
    usable: np.ndarray
    block: np.ndarray
    runs: list[slice]
    rigid: np.ndarray
    relative: np.ndarray
    effort_scale: np.ndarray
    _columns: dict[Term, np.ndarray] = field(default_factory=dict)
    _nuisances: np.ndarray | None = None

    @property
    def width(self) -> int:
        """Number of joints n."""
        return self.target.shape[1]

    @property
    def blocks(self) -> int:
        """Number of held-out blocks."""
        return int(self.block.max()) + 1

    def reduced(self, values: np.ndarray) -> np.ndarray:
        """Values at the working rate (N, ...) as rows: low-passed and thinned, (R, ...)."""
        smooth, result = self.motion.signals.smooth, np.zeros((len(self.rows), *values.shape[1:]))
        for j in range(values.shape[1]):
            if values[:, j].any():
                result[:, j] = smooth(values[:, j])[self.rows]
        return result

    def columns(self, term: Term) -> np.ndarray:
        """Columns of a term as rows, (R, n, k) [N·m per unit]."""
        if term not in self._columns:
            raw = term.effect.columns(self.motion, term.target, dict(term.shape), term.link)
            self._columns[term] = self.reduced(raw)
        return self._columns[term]

    @property
    def nuisances(self) -> np.ndarray:
        """What is never a finding: columns of a lead and a blur of the effort against the motion, (R, n, 2).

        The first is the load's rate: an effort that is held for a sample leads by half of one. The second is its curvature:
        it weighs down what noise of the position adds at high frequencies, and stands for a slow effort sensor.
        """
        if self._nuisances is None:
            rate = self.motion.load_rate
            self._nuisances = self.reduced(np.stack([rate, self.motion.derivative(rate)], axis=-1))
        return self._nuisances

    @property
    def nuisance_spread(self) -> np.ndarray:
        """Prior standard deviations of the lead [s] and of the blur [s²], (2,)."""
        signals = self.motion.signals
        return np.array([1.0 / signals.raw_rate, signals.kernel_std**2])

    def relieve(self, load: np.ndarray, robot: Robot | None = None) -> None:
        """Take better estimates of the load, (N, n), and of the bodies, and forget columns of old ones."""
        motion = self.motion if robot is None else self.motion.with_robot(robot)
        self.motion = motion.with_load(load)
        self._columns = {
            term: kept
            for term, kept in self._columns.items()
            if not (term.effect.of_load or (term.effect.of_bodies and robot is not None))
        }
        self._nuisances = None

    def spread(self, columns: np.ndarray) -> np.ndarray:
        """Prior standard deviation of coefficients of columns (R, n, k), (k,)."""
        power = np.sqrt(
            np.mean(np.where(self.usable[..., None], columns / self.effort_scale[:, None], 0.0) ** 2, axis=0)
        )
        strongest = power.max(axis=0)
        return TYPICAL_SHARE / np.maximum(strongest, 1e-9)

    def without_trends(self, values: np.ndarray) -> np.ndarray:
        """Rows (R, n) less a straight line in every block."""
        result = values.astype(float).copy()
        for b in range(self.blocks):
            rows = np.flatnonzero(self.block == b)
            if len(rows) > 4:
                slope = np.linspace(-1.0, 1.0, len(rows))
                result[rows] -= values[rows].mean(axis=0)
                result[rows] -= np.outer(slope, slope @ result[rows] / (slope @ slope))
        return result

    def whiten(self, values: np.ndarray, noise: Noise) -> np.ndarray:
        """Rows (R, n, ...) in units of their noise; unusable ones are zero."""
        order = noise.coefficients.shape[1]
        result = np.zeros_like(values, dtype=float)
        shape = (1, self.width) + (1,) * (values.ndim - 2)
        for run in self.runs:
            piece = values[run]
            if len(piece) <= order:
                continue
            white = piece[order:].astype(float).copy()
            for lag in range(1, order + 1):
                white -= noise.coefficients[:, lag - 1].reshape(shape) * piece[order - lag : len(piece) - lag]
            result[run.start + order : run.stop] = white
        keep = self.counted(order) / noise.std
        return result * keep.reshape(keep.shape + (1,) * (values.ndim - 2))

    def counted(self, order: int = NOISE_ORDER) -> np.ndarray:
        """Rows whose whole noise history is usable, (R, n) bool."""
        counted = np.zeros_like(self.usable)
        for run in self.runs:
            good = self.usable[run]
            if len(good) <= order:
                continue
            history = np.ones((len(good) - order, self.width), bool)
            for lag in range(order + 1):
                history &= good[order - lag : len(good) - lag]
            counted[run.start + order : run.stop] = history
        return counted

    def noise_of(self, residual: np.ndarray, floor: np.ndarray, steady: bool = False) -> Noise:
        """Noise model of a residual (R, n), by least squares on its own past (Yule-Walker with usable rows only)."""
        if steady:
            residual = self.without_trends(residual)
        coefficients = np.zeros((self.width, NOISE_ORDER))
        std = np.empty(self.width)
        counted = self.counted()
        for j in range(self.width):
            now, past = [], []
            for run in self.runs:
                inside = np.arange(run.start + NOISE_ORDER, run.stop)
                inside = inside[counted[inside, j]]
                now.append(residual[inside, j])
                past.append(
                    np.stack([residual[inside - lag, j] for lag in range(1, NOISE_ORDER + 1)], axis=1)
                )
            y, x = np.concatenate(now), np.concatenate(past)
            if len(y) < 10 * NOISE_ORDER:
                std[j] = max(float(np.sqrt(np.mean(residual[:, j] ** 2))), floor[j])
                continue
            ridge = 1e-3 * float(np.sum(y**2)) + 1e-18
            a = np.linalg.solve(x.T @ x + ridge * np.eye(NOISE_ORDER), x.T @ y)
            coefficients[j] = _stable(a)
            std[j] = max(float(np.sqrt(np.mean((y - x @ coefficients[j]) ** 2))), floor[j])
        return Noise(coefficients, std)


def build(signals: Signals, robot: Robot, simulated: np.ndarray | None = None) -> Equations:
    """The regression of a motion against a robot's simulation.

    Args:
        signals: motion with effort, joints in the robot's order.
        robot: what the simulation believes.
        simulated: the effort the simulation predicts, (N, n) [N·m]; None takes the robot's rigid bodies, armature and
            friction.

    Raises:
        RecordingError: no joint moves, or no effort.
    """
    if signals.effort is None:
        raise RecordingError("The recording carries no effort.", "Record one, or use --effort command.")
    resting = signals.at_rest
    if resting.all(axis=1).mean() > 0.98:
        raise RecordingError(
            "No joint moves in this recording.", "Move the joints, each over a good part of its range."
        )
    step = max(round(signals.rate / (ROWS_PER_CUTOFF * signals.cutoff)), 1)
    rows = np.concatenate([np.arange(s.start, s.stop, step) for s in signals.segments])
    rows = rows[signals.interior[rows]]
    owner = np.zeros(len(signals), int)
    for k, segment in enumerate(signals.segments):
        owner[segment] = k
    edges = [0, *(np.flatnonzero(np.diff(owner[rows])) + 1).tolist(), len(rows)]
    runs = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]

    if simulated is None:
        simulated = nominal_effort(robot, signals)
    motion = Motion(signals, robot, simulated)
    target = signals.smooth(signals.effort - simulated)[rows]
    relative = relative_inertials(robot)
    rigid = signals.smooth(motion.regressor)[rows] @ relative
    usable = ~resting[rows]
    block = (signals.time[rows] - signals.time[rows[0]]) // BLOCK_SECONDS
    _, block = np.unique(block, return_inverse=True)
    effort = signals.smooth(signals.effort)[rows]
    scale = np.maximum(np.std(effort, axis=0), 1e-3 * max(float(np.std(effort)), 1e-9))
    return Equations(motion, simulated, rows, target, usable, block.astype(int), runs, rigid, relative, scale)


def nominal_effort(robot: Robot, signals: Signals) -> np.ndarray:
    """Effort of a robot's bodies, armature and friction along a motion, (N, n) [N·m]."""
    rigid = robot.rigid_effort(signals.position, signals.velocity, signals.acceleration)
    drives = robot.armature * signals.acceleration + robot.viscous * signals.velocity
    return np.asarray(rigid + drives + robot.coulomb * signals.sign)


def relative_inertials(robot: Robot) -> np.ndarray:
    """Map from relative errors of each link to its inertial parameters, (n * PER_LINK, n * PER_LINK).

    Of each link's ten units the first scales mass and inertia together, the next three move the centre of mass, one unit by
    the link's size (root mean square distance of its mass from the joint's frame), and the last six change the inertia about
    the centre by its own size. So an error of 0.1 is "10 % off" in each of these senses.
    """
    result = np.zeros((robot.width * PER_LINK, robot.width * PER_LINK))
    for i, values in enumerate(robot.inertials):
        pseudo = feasible_pseudo_inertia(pseudo_inertia(values))
        mass = float(pseudo[3, 3])
        centre = pseudo[:3, 3] / mass
        size = float(np.sqrt(np.trace(pseudo[:3, :3]) / mass))
        spread = float(np.trace(pseudo[:3, :3]) - mass * centre @ centre)
        columns = [pseudo]
        for axis in np.eye(3):
            step = np.zeros((4, 4))
            step[:3, :3] = mass * (np.outer(centre, axis) + np.outer(axis, centre))
            step[:3, 3] = step[3, :3] = mass * axis
            columns.append(step * size / np.sqrt(3.0))
        for row in range(3):
            for column in range(row + 1):
                step = np.zeros((4, 4))
                step[row, column] = step[column, row] = spread / 3.0
                columns.append(step)
        rows = slice(i * PER_LINK, (i + 1) * PER_LINK)
        result[rows, rows] = np.stack([inertial_parameters(column) for column in columns], axis=1)
    return result


def _stable(a: np.ndarray) -> np.ndarray:
    """Autoregressive coefficients with every pole drawn inside radius 0.98."""
    poles = np.roots(np.concatenate([[1.0], -a]))
    radius = np.abs(poles)
    if (radius <= 0.98).all():
        return a
    poles = np.where(radius > 0.98, poles * 0.98 / np.maximum(radius, 1e-12), poles)
    return np.asarray(-np.real(np.poly(poles))[1:])
