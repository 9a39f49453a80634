"""The joints' equations of motion as one linear regression with coloured noise.

Row k of joint j says: measured effort - effort of the URDF = Y_j(k) · (error of the links) + columns of effects · coefficients
+ noise. Both sides are low-passed alike and decimated to the rate the low-pass leaves, then each joint's rows are whitened by
an autoregressive model of its own residual, so that sums of squares are log likelihoods.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bdnn_ros.diagnosis.regression.columns import Columns
from bdnn_ros.diagnosis.regression.decimation import Decimation
from bdnn_ros.diagnosis.regression.echo import Echo
from bdnn_ros.diagnosis.regression.errors import Errors
from bdnn_ros.diagnosis.regression.nuisances import Nuisances
from bdnn_ros.diagnosis.regression.rows import Rows
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.regression.whitening import Whitening
from bdnn_ros.effects.motion import Motion
from bdnn_ros.robot import Robot

CONSTANT_SHARE = 0.9
"""A column whose squared mean exceeds this share of its mean square hardly changes, and is scaled as an offset is."""
TYPICAL_SHARE = 0.3
"""Prior spread of an effect: its contribution is about this share of the effort it acts on."""
HARDLY_SEEN = 1e-4
"""Least strength of a column, relative to the strongest: keeps prior spreads of hardly excited coefficients finite."""
HARDLY_USABLE = 0.05
"""A joint hardly moves if less than this share of its rows is usable."""


@dataclass
class Equations:
    """The regression before whitening.

    Two things change while causes are searched: which rows are usable, and the estimates of the load and the bodies. Each is
    held by the one part whose results depend on it, and that part is replaced as a whole: `whitening` and `columns`.

    Attributes:
        rows: what was measured.
        decimation: makes rows of efforts along the motion.
        errors: independent errors of what is known before: links, and joints if a model was identified.
        columns: columns of terms, by the current estimates of the load and the bodies; at first the simulation's.
        nuisances: columns that are never findings.
        whitening: whitening in the rows that are usable now; at first all `rows.usable`.
    """

    rows: Rows
    decimation: Decimation
    errors: Errors
    columns: Columns = field(init=False)
    nuisances: Nuisances = field(init=False)
    whitening: Whitening = field(init=False)

    def __post_init__(self) -> None:
        self.columns = Columns(self.decimation.simulated, self.decimation)
        self.nuisances = Nuisances(self.decimation)
        self.use_rows(self.rows.usable)

    @property
    def motion(self) -> Motion:
        """The motion at the working rate, with the current estimates of the robot and of the load."""
        return self.columns.motion

    @property
    def usable(self) -> np.ndarray:
        """Rows that are usable now, (R, n) bool."""
        return self.whitening.usable

    @property
    def exact(self) -> np.ndarray:
        """Usable rows without dwelling, where dry friction appears smaller than it is, (R, n) bool."""
        return self.usable & ~self.rows.dwelling

    @property
    def alone(self) -> int | None:
        """The only joint that moves, by its usable rows; None where there are several or none."""
        count = np.flatnonzero(self.usable.mean(axis=0) > HARDLY_USABLE)
        return int(count[0]) if len(count) == 1 else None

    @cached_property
    def rigid(self) -> np.ndarray:
        """Columns of the links' relative errors, and of the joint parameters of an identified model, (R, n, U)."""
        return self.errors.columns(self.columns)

    def use_rows(self, usable: np.ndarray) -> None:
        """Replace the usable rows, (R, n) bool."""
        self.whitening = Whitening(usable, self.rows.sticking_doubt, self.rows.runs)

    def use_motion(self, motion: Motion) -> None:
        """Use another estimate of load and bodies along the same motion."""
        self.columns = self.columns.along(motion)

    def update_load(self, *acting: np.ndarray, bodies: tuple[Robot, np.ndarray] | None = None) -> None:
        """Replace the estimates of the load, arguments as of `Motion.with_load`, and of the bodies, as of `Motion.with_robot`."""
        motion = self.motion if bodies is None else self.motion.with_robot(*bodies)
        self.use_motion(motion.with_load(*acting))

    def with_target(self, target: np.ndarray) -> Equations:
        """The same regression of another target, (R, n) [N·m], on which nothing else here depends."""
        other = copy(self)
        other.rows = replace(self.rows, target=target)
        return other

    def spread(self, term: Term, columns: np.ndarray) -> np.ndarray:
        """Prior standard deviation of the coefficients of a term's columns (R, n, k), (k,)."""
        counted = self.rows.usable.astype(float)
        squares = np.einsum("rn,rnk,rnk->nk", counted, columns, columns)
        means = np.einsum("rn,rnk->nk", counted / np.sqrt(np.maximum(counted.sum(axis=0), 1.0)), columns)
        steady = (means**2 > CONSTANT_SHARE * squares) | term.effect.constant
        usual = np.where(steady, self.rows.effort_size[:, None], self.rows.effort_scale[:, None])
        strongest = term.effect.strength(np.sqrt(squares / len(columns)), usual)
        typical = TYPICAL_SHARE / np.maximum(strongest, max(HARDLY_SEEN * strongest.max(), 1e-9))
        return np.maximum(term.effect.spread(typical, self.motion, term.target), term.removable)

    def noise_gain(self, term: Term, width: int) -> np.ndarray:
        """Evidence that noise alone appears to gain through a term's columns, by block, (B, k) [nats per coefficient].

        Columns made from the measured effort contain its noise. The change of variables from noise to equation error removes
        this gain; the regression leaves it out, so it is subtracted.
        """
        result = np.zeros((self.rows.blocks, width))
        heard = term.effect.echo(self.motion, term.target, dict(term.shape))
        if heard is not None:
            inertia, compliance, cutoff = heard
            full = self.whitening.full()[:, term.target]
            weight = inertia * self._echo.heard(cutoff, inertia * compliance) * full
            result[:, 0] = np.bincount(self.rows.block, weight, self.rows.blocks)
        return result

    @cached_property
    def _echo(self) -> Echo:
        return Echo(self.motion, self.rows.samples, self.rows.runs)
