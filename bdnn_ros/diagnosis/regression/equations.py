"""The joints' equations of motion as one linear regression, with noise that is coloured.

Row k of joint j says: measured effort - effort of the URDF = Y_j(k) · (error of the links) + columns of effects · coefficients
+ noise. Both sides are low-passed alike and thinned to the rate the low-pass leaves, then each joint's rows are whitened by an
autoregressive model of its own residual, so that sums of squares are log likelihoods.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from bdnn_ros.diagnosis.regression.echo import Echo
from bdnn_ros.diagnosis.regression.later import later, later_spread
from bdnn_ros.diagnosis.regression.learned import Learned
from bdnn_ros.diagnosis.regression.noise import ORDER, Noise, moved, past, whitened
from bdnn_ros.diagnosis.regression.pushing import Pushing
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.regression.unsure import Unsure
from bdnn_ros.effects.environment import Push, window
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.rigid import slots
from bdnn_ros.robot import Robot

STEADY = 0.9
"""What hardly changes, its mean being so much of its mean square, as friction one way, may be as large as an offset."""
TYPICAL_SHARE = 0.3
"""Prior spread of an effect: its contribution is about this share of the effort it acts on."""
USUAL_MASS_ERROR = 0.05
"""What a description says of a link's mass is hardly ever better than this."""
STICKING_LEAD = 0.003
"""How far dry friction may turn round ahead of a joint that sticks, where it is all of the effort [s]."""
HARDLY_SEEN = 1e-4
"""A coefficient that the motion hardly shows counts as shown by this share of the best: its prior spread stays finite."""
HARDLY_USABLE = 0.05
"""A joint hardly moves where a smaller share of its rows counts."""
ALL = slice(None)
BLURS = slice(1, 3)
"""Which nuisances blur; before them comes a lead, after them each joint's sticking and what creeps."""


@dataclass
class Equations:
    """Rows of the regression, before whitening.

    Attributes:
        motion: the motion at the working rate, with the robot of the URDF and the load estimate.
        simulated, drive: the simulation's effort, and what drives take of it before the gear, both (N, n) [N·m].
        rows, target: which working samples are rows, (R,); measured effort minus the simulation's there, (R, n) [N·m].
        usable: rows that count, (R, n) bool: not a segment's end, not a joint at rest or sticking.
        doubt: share of each row's low-pass in which the joint turns round or creeps, so that it may stick, (R, n).
        dwelling: rows in which it creeps for so long that its dry friction passes for less than it is, (R, n) bool.
        block, runs: held-out block of each row, (R,) int, ascending from 0; rows of each gap-free piece.
        relative, masses: from U relative errors of links to inertial parameters, (n * PER_LINK, U); those of masses, (U,) bool.
        effort_scale, effort_size: spread of each joint's effort, and its root mean square, (n,) [N·m].
        lead: how far the recorded effort is known to be ahead of the motion [s].
        jointwise, learned: where an identified model takes the simulation's place, from the same errors to those of `COMMON`
            at every joint, kind by kind, (len(COMMON) * n, U), and what they do by all else that joints may add; else None.
        passing: how much more effort it takes where an earlier model has friction in proportion to the load, (N, n); else None.
        unsure: what is not known of what an earlier diagnosis found at joints: the last K of the U errors; else None.
    """

    motion: Motion
    simulated: np.ndarray
    drive: np.ndarray
    rows: np.ndarray
    target: np.ndarray
    usable: np.ndarray
    doubt: np.ndarray
    dwelling: np.ndarray
    block: np.ndarray
    runs: list[slice]
    relative: np.ndarray
    masses: np.ndarray
    effort_scale: np.ndarray
    effort_size: np.ndarray
    lead: float = 0.0
    jointwise: np.ndarray | None = None
    learned: Learned | None = None
    passing: np.ndarray | None = None
    unsure: Unsure | None = None
    _columns: dict[Term, np.ndarray] = field(default_factory=dict)
    _nuisances: np.ndarray | None = None
    _pasts: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, init=False)
    _whitening: tuple[Noise, tuple[np.ndarray, np.ndarray]] | None = field(default=None, init=False)
    _pushing: dict[tuple[int, str | None], Pushing] = field(default_factory=dict, init=False)
    ever_usable: np.ndarray = field(init=False)
    """Rows that count unless they are held out, (R, n) bool: what acts only in held-out rows is still believed to be small."""

    def __post_init__(self) -> None:
        self.ever_usable = self.usable

    @property
    def width(self) -> int:
        """Number of joints n."""
        return self.target.shape[1]

    @property
    def exact(self) -> np.ndarray:
        """Rows that count and in which no dry friction passes for less than it is, (R, n) bool."""
        return self.usable & ~self.dwelling

    @property
    def alone(self) -> int | None:
        """The only joint whose rows count; None where others' do, too."""
        count = np.flatnonzero(self.usable.mean(axis=0) > HARDLY_USABLE)
        return int(count[0]) if len(count) == 1 else None

    @property
    def moving(self) -> np.ndarray:
        """How long each joint moves, (n,) [s]."""
        return moved(self.ever_usable, self.motion.time[self.rows])

    @property
    def blocks(self) -> int:
        """Number of held-out blocks."""
        return int(self.block.max()) + 1

    def reduced(self, values: np.ndarray, borne: bool = True) -> np.ndarray:
        """Values at the working rate (N, ...) as rows: low-passed and thinned, (R, ...); of what joints bear, or `borne` not."""
        flat = (self.passed(values) if borne else values).reshape(len(values), -1)
        acting, result = np.ones(len(flat)) @ np.abs(flat) != 0.0, np.zeros((len(self.rows), flat.shape[1]))
        acting = slice(None) if acting.all() else acting  # without a copy
        if self.lead:
            smooth = self.motion.advanced(self.motion.signals.smooth(flat[:, acting]), self.lead)
            result[:, acting] = smooth[self.rows]
        else:
            result[:, acting] = self._smoothing @ flat[:, acting]
        return result.reshape(len(self.rows), *values.shape[1:])

    def passed(self, values: np.ndarray) -> np.ndarray:
        """Efforts that joints bear at the working rate (N, n, ...) with the friction that an earlier model has of them."""
        return values if self.passing is None else np.einsum("ij,ij...->ij...", self.passing, values)

    @cached_property
    def _smoothing(self) -> csr_array:
        """The low-pass at the rows, (R, N)."""
        return self.motion.signals.smoothing_at(self.rows)

    def columns(self, term: Term) -> np.ndarray:
        """Columns of a term as rows, (R, n, k) [N·m per unit]."""
        if term not in self._columns:
            self._columns[term] = self.made(term)
        return self._columns[term]

    def made(self, term: Term, motion: Motion | None = None) -> np.ndarray:
        """Columns as those of `columns`, computed anew and not kept; of a motion with another estimate of the load, if given."""
        effect, shape = term.effect, dict(term.shape)
        added = effect.inertials(self.motion.robot, shape, term.link) if term.link else None
        if added is not None:
            return self.of_body(*added)
        if isinstance(effect, Push):
            return self.pushed(term, window(self.motion, shape), effect.mixing(shape))
        columns = effect.columns(motion or self.motion, term.target, shape, term.link)
        return self.reduced(columns, borne=not effect.at_sensor)

    def pushed(self, term: Term, weight: np.ndarray, mixing: np.ndarray) -> np.ndarray:
        """Columns of a push's place with a weight in time (N,) and mixed as in `Push.mixing`, (K, k), as rows (R, n, k)."""
        effect, place = term.effect, (term.target, term.link)
        assert isinstance(effect, Push)
        if self.lead:
            return self.reduced(weight[:, None, None] * (effect.pulls(self.motion, *place) @ mixing))
        if place not in self._pushing:
            pulls = self.passed(effect.pulls(self.motion, *place))
            self._pushing[place] = Pushing.of(pulls, self._smoothing, self.rows)
        return self._pushing[place].at(weight, mixing)

    def of_body(self, body: int, added: np.ndarray) -> np.ndarray:
        """Columns of what adds to a body's inertial parameters (PER_LINK, k) as rows, (R, n, k) [N·m per unit]."""
        return np.asarray(self._regressor[:, :, slots(body)] @ added)

    @cached_property
    def rigid(self) -> np.ndarray:
        """Columns of the links' relative errors, and of those of an identified model's joints, (R, n, U).

        One unit is an error of 100 %, or a hundred standard deviations of what was identified.
        """
        columns = np.asarray(self._regressor @ self.relative)
        if self.jointwise is not None and self.learned is not None:
            columns += self.learned.columns(self, self.jointwise)
        if self.unsure is not None:
            columns[:, :, self.unsure.last] = self.unsure.columns(self)
        return columns

    @cached_property
    def _regressor(self) -> np.ndarray:
        """Regressor of all inertial parameters as rows, (R, n, n * PER_LINK)."""
        return self.reduced(self.motion.regressor)

    @property
    def hold(self) -> float:
        """How far an effort leads that is held for a sample [s]; a mean over a sample lags by as much."""
        return 0.5 / self.motion.signals.raw_rate

    @property
    def nuisances(self) -> np.ndarray:
        """What is never a finding: columns of a lead, two blurs, each joint's sticking and k that creep, (R, n, 3 + n + k).

        The first is the load's rate: an effort held for a sample leads by half of one. The second is its curvature: slow sensors.
        The third is that of what is faster than the motion: it weighs down the position's noise. Then the rates of directions: a
        joint that sticks leaves slowly, its friction before its low-passed velocity. The last: what creeps may come later.
        """
        if self._nuisances is None:
            rate = self.motion.load_rate
            general = self.reduced(np.stack([rate, self.motion.derivative(rate)], axis=-1), borne=False)
            creeping = later(self.motion.signals, self.reduced)
            self._nuisances = np.concatenate([general, self._jitter, self._sticking, creeping], axis=2)
        return self._nuisances

    @property
    def sticking(self) -> slice:
        """Which nuisances are the joints' sticking."""
        return slice(BLURS.stop, BLURS.stop + self.width)

    @cached_property
    def _jitter(self) -> np.ndarray:
        """Curvature of the bodies' effort as far as it is faster than the motion, (R, n, 1) [N·m/s²]."""
        motion = self.motion
        fast = motion.link_load - motion.calmed(motion.link_load)
        return self.reduced(motion.derivative(motion.derivative(fast)))[..., None]

    @cached_property
    def _sticking(self) -> np.ndarray:
        """Rates of the joints' directions, (R, n, n) [1/s]."""
        rate = self.reduced(self.motion.derivative(self.motion.signals.sign))
        return np.asarray(rate[:, :, None] * np.eye(self.width))

    @property
    def nuisance_spread(self) -> np.ndarray:
        """Prior standard deviations of lead [s], blurs [s²], friction's leads [N·m·s] and coming on [N·m], (3 + n + k,)."""
        blur, effort = self.motion.signals.kernel_std**2, self.effort_scale
        more = later_spread(self.motion.signals, self.motion.robot, effort)
        return np.array([0.5 * self.hold, blur, blur, *(STICKING_LEAD * effort), *more])

    def relieve(self, *acting: np.ndarray, bodies: tuple[Robot, np.ndarray] | None = None) -> None:
        """Take better estimates of the load and what belongs to it, as `Motion.with_load`, and of bodies, as `with_robot`."""
        motion = self.motion if bodies is None else self.motion.with_robot(*bodies)
        self.take(motion.with_load(*acting))

    def take(self, motion: Motion) -> None:
        """Take another estimate of what acts along the same motion; columns made from the old one are forgotten."""
        bodies = motion.robot is not self.motion.robot
        self.motion = motion
        self._columns = {
            term: kept
            for term, kept in self._columns.items()
            if not (term.effect.of_load or (term.effect.of_bodies and bodies))
        }
        self._nuisances = None

    def count(self, rows: np.ndarray) -> None:
        """Let these rows count from now on, (R, n) bool."""
        self.usable, self._pasts, self._whitening = rows, {}, None

    def link_spread(self, link_error: float) -> np.ndarray:
        """Prior standard deviations of the links' relative errors, (U,).

        Of a description that seems a little wrong, masses are believed half as well as shapes: those are drawn to scale.
        """
        spread = np.where(self.masses, max(link_error, min(2.0 * link_error, USUAL_MASS_ERROR)), link_error)
        if self.unsure is not None:
            spread[self.unsure.last] = 1.0
        return spread

    def spread(self, term: Term, columns: np.ndarray) -> np.ndarray:
        """Prior standard deviation of the coefficients of a term's columns (R, n, k), (k,)."""
        counted = self.ever_usable.astype(float)
        squares = np.einsum("rn,rnk,rnk->nk", counted, columns, columns)
        means = np.einsum("rn,rnk->nk", counted / np.sqrt(np.maximum(counted.sum(axis=0), 1.0)), columns)
        steady = (means**2 > STEADY * squares) | term.effect.constant
        usual = np.where(steady, self.effort_size[:, None], self.effort_scale[:, None])
        strongest = term.effect.strength(np.sqrt(squares / len(columns)), usual)
        typical = TYPICAL_SHARE / np.maximum(strongest, max(HARDLY_SEEN * strongest.max(), 1e-9))
        return np.maximum(term.effect.spread(typical, self.motion, term.target), term.gone)

    def echo(self, term: Term, width: int) -> np.ndarray:
        """What noise of the effort alone seems to gain by a term's columns, by block, (B, k) [nats per coefficient].

        Such columns are made from the measured effort. With the noise's own likelihood (a change of variables from noise to
        equation error) they gain nothing from it; without this they would.
        """
        result = np.zeros((self.blocks, width))
        heard = term.effect.echo(self.motion, term.target, dict(term.shape))
        if heard is not None:
            inertia, compliance, cutoff = heard
            weight = inertia * self._echo.heard(cutoff, inertia * compliance) * self.full()[:, term.target]
            result[:, 0] = np.bincount(self.block, weight, self.blocks)
        return result

    @cached_property
    def _echo(self) -> Echo:
        return Echo(self.motion, self.rows, self.runs)

    def whiten(
        self, values: np.ndarray, noise: Noise, joints: np.ndarray | slice = ALL, rows: slice = ALL
    ) -> np.ndarray:
        """Rows (R, n, ...) of some joints, after rows of zeros, in units of their noise; unusable ones are zero."""
        if self._whitening is None or self._whitening[0] is not noise:
            self._whitening = noise, noise.whitening(*self._past(noise.order))
        return whitened(values, *(each[rows][:, joints] for each in self._whitening[1]))

    def history(self, order: int = ORDER) -> np.ndarray:
        """How many usable rows come just before each, at most the order, (R, n); -1 for what is not usable itself."""
        return self._past(order)[0]

    def doubtful(self, order: int = ORDER) -> np.ndarray:
        """The largest doubt in each row and its noise history, (R, n)."""
        return self._past(order)[1]

    def full(self) -> np.ndarray:
        """Rows whose whole noise history is usable, (R, n) bool."""
        return self.history() == ORDER

    def _past(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        if order not in self._pasts:
            self._pasts[order] = past(self.usable, self.doubt, self.runs, order)
        return self._pasts[order]
