"""The joints' equations of motion as one linear regression with coloured noise.

Row k of joint j says: measured effort - effort of the URDF = Y_j(k) · (error of the links) + columns of effects · coefficients
+ noise. Both sides are low-passed alike and decimated to the rate the low-pass leaves, then each joint's rows are whitened by
an autoregressive model of its own residual, so that sums of squares are log likelihoods.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from bdnn_ros.diagnosis.regression.echo import Echo
from bdnn_ros.diagnosis.regression.learned import Learned
from bdnn_ros.diagnosis.regression.noise import ORDER, Noise, moving_time, past, whitened
from bdnn_ros.diagnosis.regression.onset import onset_columns, onset_spread
from bdnn_ros.diagnosis.regression.pushing import Pushing
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.regression.unsure import Unsure
from bdnn_ros.effects.environment import Push, window
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.rigid import slots
from bdnn_ros.robot import Robot

CONSTANT_SHARE = 0.9
"""A column whose squared mean exceeds this share of its mean square hardly changes, and is scaled as an offset is."""
TYPICAL_SHARE = 0.3
"""Prior spread of an effect: its contribution is about this share of the effort it acts on."""
USUAL_MASS_ERROR = 0.05
"""Smallest relative error of a described link mass that is believed, as far as twice `link_error` allows."""
STICKING_LEAD = 0.003
"""How far dry friction may lead the direction of a joint that sticks, where friction is all of the effort [s]."""
HARDLY_SEEN = 1e-4
"""Least strength of a column, relative to the strongest: keeps prior spreads of hardly excited coefficients finite."""
HARDLY_USABLE = 0.05
"""A joint hardly moves if less than this share of its rows is usable."""
ALL = slice(None)
BLURS = slice(1, 3)
"""Nuisance columns that blur the effort; before them comes the lead, after them sticking and creeping of the joints."""


@dataclass
class Equations:
    """The regression before whitening.

    Attributes:
        motion: the motion at the working rate, with the robot of the URDF and the load estimate.
        simulated, drive: the simulation's effort, and the part of it that drives take before the gear, both (N, n) [N·m].
        rows, target: which working samples are rows, (R,); measured effort minus the simulation's there, (R, n) [N·m].
        usable: rows that count in fits, (R, n) bool: without segments' ends and joints that rest or stick.
        sticking_doubt: share of each row's low-pass window in which the joint reverses or creeps, so that it may stick, (R, n).
        dwelling: rows in which it creeps for so long that its dry friction appears smaller than it is, (R, n) bool.
        block, runs: held-out block of each row, (R,) int, ascending from 0; rows of each gap-free piece.
        relative, masses: map from U relative link errors to inertial parameters, (n * PER_LINK, U); which are masses, (U,) bool.
        effort_scale, effort_size: standard deviation and root mean square of each joint's effort, (n,) [N·m].
        lead: how far the recorded effort is known to be ahead of the motion [s].
        jointwise, learned: against an identified model, map from the same errors to `COMMON` at every joint, kind by kind,
            (len(COMMON) * n, U), and their effect through learned joint residuals; else None.
        load_friction_factor: factor on efforts by an earlier model's load-dependent friction, (N, n); None without.
        unsure: errors of joint effects that an earlier diagnosis found, the last K of the U errors; else None.
    """

    motion: Motion
    simulated: np.ndarray
    drive: np.ndarray
    rows: np.ndarray
    target: np.ndarray
    usable: np.ndarray
    sticking_doubt: np.ndarray
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
    load_friction_factor: np.ndarray | None = None
    unsure: Unsure | None = None
    _columns: dict[Term, np.ndarray] = field(default_factory=dict)
    _nuisances: np.ndarray | None = None
    _pasts: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict, init=False)
    _whitening: tuple[Noise, tuple[np.ndarray, np.ndarray]] | None = field(default=None, init=False)
    _pushing: dict[tuple[int, str | None], Pushing] = field(default_factory=dict, init=False)
    usable_before_holdout: np.ndarray = field(init=False)
    """`usable` before rows are held out, (R, n) bool: priors are scaled by these also for what acts in held-out rows only."""

    def __post_init__(self) -> None:
        self.usable_before_holdout = self.usable

    @property
    def width(self) -> int:
        """Number of joints n."""
        return self.target.shape[1]

    @property
    def exact(self) -> np.ndarray:
        """Usable rows without dwelling, where dry friction appears smaller than it is, (R, n) bool."""
        return self.usable & ~self.dwelling

    @property
    def alone(self) -> int | None:
        """The only joint that moves, by its usable rows; None where there are several or none."""
        count = np.flatnonzero(self.usable.mean(axis=0) > HARDLY_USABLE)
        return int(count[0]) if len(count) == 1 else None

    @property
    def moving(self) -> np.ndarray:
        """How long each joint moves, (n,) [s]."""
        return moving_time(self.usable_before_holdout, self.motion.time[self.rows])

    @property
    def blocks(self) -> int:
        """Number of held-out blocks."""
        return int(self.block.max()) + 1

    def as_rows(self, values: np.ndarray, borne: bool = True) -> np.ndarray:
        """Values at the working rate (N, ...) low-passed and decimated to rows (R, ...); `borne` ones `with_load_friction`."""
        flat = (self.with_load_friction(values) if borne else values).reshape(len(values), -1)
        acting, result = np.ones(len(flat)) @ np.abs(flat) != 0.0, np.zeros((len(self.rows), flat.shape[1]))
        acting = slice(None) if acting.all() else acting  # without a copy
        if self.lead:
            smooth = self.motion.advanced(self.motion.signals.smooth(flat[:, acting]), self.lead)
            result[:, acting] = smooth[self.rows]
        else:
            result[:, acting] = self._smoothing @ flat[:, acting]
        return result.reshape(len(self.rows), *values.shape[1:])

    def with_load_friction(self, values: np.ndarray) -> np.ndarray:
        """Efforts at the working rate (N, n, ...) multiplied by the load-dependent friction that an earlier model has."""
        factor = self.load_friction_factor
        return values if factor is None else np.einsum("ij,ij...->ij...", factor, values)

    @cached_property
    def _smoothing(self) -> csr_array:
        """The low-pass at the rows, (R, N)."""
        return self.motion.signals.smoothing_at(self.rows)

    def columns(self, term: Term) -> np.ndarray:
        """Columns of a term as rows, (R, n, k) [N·m per unit]."""
        if term not in self._columns:
            self._columns[term] = self.fresh_columns(term)
        return self._columns[term]

    def fresh_columns(self, term: Term, motion: Motion | None = None) -> np.ndarray:
        """Columns of a term, computed anew and not cached; of a motion with another load estimate, if given. See `columns`."""
        effect, shape = term.effect, dict(term.shape)
        added = effect.inertials(self.motion.robot, shape, term.link) if term.link else None
        if added is not None:
            return self.of_body(*added)
        if isinstance(effect, Push):
            return self.pushed(term, window(self.motion, shape), effect.mixing(shape))
        columns = effect.columns(motion or self.motion, term.target, shape, term.link)
        return self.as_rows(columns, borne=not effect.at_sensor)

    def pushed(self, term: Term, weight: np.ndarray, mixing: np.ndarray) -> np.ndarray:
        """Columns of a push with a time window (N,) and mixed as in `Push.mixing`, (K, k), as rows (R, n, k)."""
        effect, place = term.effect, (term.target, term.link)
        assert isinstance(effect, Push)
        if self.lead:
            return self.as_rows(weight[:, None, None] * (effect.pulls(self.motion, *place) @ mixing))
        if place not in self._pushing:
            pulls = self.with_load_friction(effect.pulls(self.motion, *place))
            self._pushing[place] = Pushing.of(pulls, self._smoothing, self.rows)
        return self._pushing[place].at(weight, mixing)

    def of_body(self, body: int, added: np.ndarray) -> np.ndarray:
        """Columns of additions to a body's inertial parameters (PER_LINK, k) as rows, (R, n, k) [N·m per unit]."""
        return np.asarray(self._regressor[:, :, slots(body)] @ added)

    @cached_property
    def rigid(self) -> np.ndarray:
        """Columns of the links' relative errors, and of the joint parameters of an identified model, (R, n, U).

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
        return self.as_rows(self.motion.regressor)

    @property
    def hold(self) -> float:
        """Lead of an effort command that is held for a sample [s], half a period; an average over a sample lags by as much."""
        return 0.5 / self.motion.signals.raw_rate

    @property
    def nuisances(self) -> np.ndarray:
        """Columns that are never findings: a lead, two blurs, sticking of each joint, creep of k joints, (R, n, 3 + n + k).

        Lead: the load's rate, as a held effort leads. Blurs: the load's curvature, as of slow sensors, and that of the bodies'
        effort beyond the motion's frequencies, against noise of the position. Sticking: rates of the directions, as friction
        of a joint that sticks turns before its low-passed velocity. Creep: see `onset_columns`.
        """
        if self._nuisances is None:
            rate = self.motion.load_rate
            general = self.as_rows(np.stack([rate, self.motion.derivative(rate)], axis=-1), borne=False)
            creeping = onset_columns(self.motion.signals, self.as_rows)
            self._nuisances = np.concatenate([general, self._jitter, self._sticking, creeping], axis=2)
        return self._nuisances

    @property
    def sticking(self) -> slice:
        """The nuisance columns of the joints' sticking."""
        return slice(BLURS.stop, BLURS.stop + self.width)

    @cached_property
    def _jitter(self) -> np.ndarray:
        """Curvature of the part of the bodies' effort that is faster than the motion, (R, n, 1) [N·m/s²]."""
        motion = self.motion
        fast = motion.link_load - motion.calmed(motion.link_load)
        return self.as_rows(motion.derivative(motion.derivative(fast)))[..., None]

    @cached_property
    def _sticking(self) -> np.ndarray:
        """Rates of the joints' directions of motion, (R, n, n) [1/s]."""
        rate = self.as_rows(self.motion.derivative(self.motion.signals.sign))
        return np.asarray(rate[:, :, None] * np.eye(self.width))

    @property
    def nuisance_spread(self) -> np.ndarray:
        """Prior standard deviations of lead [s], blurs [s²], sticking [N·m·s] and creep [N·m], (3 + n + k,)."""
        blur, effort = self.motion.signals.kernel_std**2, self.effort_scale
        more = onset_spread(self.motion.signals, self.motion.robot, effort)
        return np.array([0.5 * self.hold, blur, blur, *(STICKING_LEAD * effort), *more])

    def update_load(self, *acting: np.ndarray, bodies: tuple[Robot, np.ndarray] | None = None) -> None:
        """Replace the estimates of the load, arguments as of `Motion.with_load`, and of the bodies, as of `Motion.with_robot`."""
        motion = self.motion if bodies is None else self.motion.with_robot(*bodies)
        self.use_motion(motion.with_load(*acting))

    def use_motion(self, motion: Motion) -> None:
        """Use another estimate of load and bodies along the same motion; cached columns that depend on them are dropped."""
        bodies, self.motion = motion.robot is not self.motion.robot, motion
        self._columns = {
            term: kept
            for term, kept in self._columns.items()
            if not (term.effect.of_load or (term.effect.of_bodies and bodies))
        }
        self._nuisances = None

    def use_rows(self, rows: np.ndarray) -> None:
        """Replace the usable rows, (R, n) bool."""
        self.usable, self._pasts, self._whitening = rows, {}, None

    def link_spread(self, link_error: float) -> np.ndarray:
        """Prior standard deviations of the links' relative errors, (U,).

        At a small link error masses are believed half as well: shapes are drawn to scale, masses are guessed.
        """
        spread = np.where(self.masses, max(link_error, min(2.0 * link_error, USUAL_MASS_ERROR)), link_error)
        if self.unsure is not None:
            spread[self.unsure.last] = 1.0
        return spread

    def spread(self, term: Term, columns: np.ndarray) -> np.ndarray:
        """Prior standard deviation of the coefficients of a term's columns (R, n, k), (k,)."""
        counted = self.usable_before_holdout.astype(float)
        squares = np.einsum("rn,rnk,rnk->nk", counted, columns, columns)
        means = np.einsum("rn,rnk->nk", counted / np.sqrt(np.maximum(counted.sum(axis=0), 1.0)), columns)
        steady = (means**2 > CONSTANT_SHARE * squares) | term.effect.constant
        usual = np.where(steady, self.effort_size[:, None], self.effort_scale[:, None])
        strongest = term.effect.strength(np.sqrt(squares / len(columns)), usual)
        typical = TYPICAL_SHARE / np.maximum(strongest, max(HARDLY_SEEN * strongest.max(), 1e-9))
        return np.maximum(term.effect.spread(typical, self.motion, term.target), term.removable)

    def noise_gain(self, term: Term, width: int) -> np.ndarray:
        """Evidence that noise alone appears to gain through a term's columns, by block, (B, k) [nats per coefficient].

        Columns made from the measured effort contain its noise. The change of variables from noise to equation error removes
        this gain; the regression leaves it out, so it is subtracted.
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
        """Values (R, n, ...) of some joints in units of their noise, as if zero before the first row; zero in unusable rows."""
        if self._whitening is None or self._whitening[0] is not noise:
            self._whitening = noise, noise.whitening(*self._past(noise.order))
        return whitened(values, *(each[rows][:, joints] for each in self._whitening[1]))

    def history(self, order: int = ORDER) -> np.ndarray:
        """Number of usable rows directly before each, at most the order, (R, n); -1 for an unusable row."""
        return self._past(order)[0]

    def recent_sticking_doubt(self, order: int = ORDER) -> np.ndarray:
        """Largest doubt within each row and its noise history, (R, n)."""
        return self._past(order)[1]

    def full(self) -> np.ndarray:
        """Rows whose noise history is usable throughout, (R, n) bool."""
        return self.history() == ORDER

    def _past(self, order: int) -> tuple[np.ndarray, np.ndarray]:
        if order not in self._pasts:
            self._pasts[order] = past(self.usable, self.sticking_doubt, self.runs, order)
        return self._pasts[order]
