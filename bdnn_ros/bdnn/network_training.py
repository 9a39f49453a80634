"""Training of H and R networks alone, in both directions: effort from motion, and motion from effort.

The inverse loss fixes the scale of H, which rollouts leave open; rollouts, by `backtracking`, correct small effort errors
that would accumulate. Small networks are finally polished by L-BFGS on all samples at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.optimize import minimize

from bdnn_ros.bdnn.backtracking import Windows, discrete_gradient, flat
from bdnn_ros.bdnn.cores import NetworkCore
from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.bdnn.field import Field
from bdnn_ros.bdnn.samples import Samples, samples_of, scales_of
from bdnn_ros.signals import Signals

BATCH = 256
RATE = 1e-2
"""Adam's learning rate at the start; it falls to nothing like a cosine."""
FORWARD_WEIGHT = 0.1
FORWARD_EVERY = 24
"""Steps between two with rollouts."""
WINDOWS, WINDOW_STEPS = 32, 10
SAME_RATE = 0.01
"""Recordings whose working rates differ by less than this share have one step."""
WARM_STEPS = 100
POLISH_JOINTS = 3
POLISH_SHARE = 0.4
"""Share of the budget from which robots of few joints are polished."""
POLISH_SAMPLES = 6000
LOOKS = 50
"""How often the held-out error is looked at."""
SLICE = 100
"""Steps of one piece of work."""


def hidden_units(joints: int) -> int:
    """Hidden units of each network, as found sufficient by measurement."""
    return 32 if joints <= POLISH_JOINTS else 128


class NetworkTraining:
    """Adam on batches, then L-BFGS where it helps; the weights with the best held-out error are kept."""

    def __init__(
        self,
        train: Sequence[Signals],
        validation: Sequence[Signals],
        rng: np.random.Generator,
    ) -> None:
        self._joints, self._rng = train[0].joints, rng
        samples, judge = samples_of(train), samples_of(validation)
        scales = scales_of(samples)
        n = samples.width
        field = Field.random(scales, hidden_units(n), rng)
        self._samples, self._judge = samples, judge
        self._weights = field.vector().astype(np.float32)
        self._field = field.astype(np.float32).with_vector(self._weights)
        self._columns = [x.astype(np.float32) for x in _columns(samples)]
        self._moments = np.zeros((2, self._weights.size), np.float32)
        self._rollouts = Rollouts(train, scales.velocity)
        self._steps, self._looked = 0, 0.0
        self._best, self._best_weights = np.inf, self._weights.copy()
        self.stage = "batches"

    @property
    def finished(self) -> bool:
        """Whether the training is complete."""
        return self.stage == "finished"

    @property
    def told(self) -> str:
        """The present stage, for a progress line."""
        return f"{self.stage}: step {self._steps}, held-out error {100.0 * self._best:.3g} %"

    def model(self) -> BDNN:
        """The networks with the best held-out error."""
        field = Field(self._field.h, self._field.r, self._field.scales).astype(np.float64)
        return BDNN(NetworkCore(self._joints, field.with_vector(self._best_weights.astype(np.float64))))

    def advance(self, used: Callable[[], float]) -> None:
        """Do one step; `used` returns the share of the budget that is spent."""
        polish = len(self._joints) <= POLISH_JOINTS
        end = POLISH_SHARE if polish else 1.0
        if self.stage == "batches":
            for _ in range(SLICE):
                self._step(min(used() / end, 1.0))
            if used() - self._looked > 1.0 / LOOKS or used() > 0.98 * end:
                self._look()
                self._looked = used()
            if used() >= 0.98 * end:
                self.stage = "polish" if polish else "finished"
        else:
            self._polish(used)
            self.stage = "finished"

    def _step(self, progress: float) -> None:
        """One step of Adam (Kingma and Ba, ICLR 2015)."""
        rows = self._rng.integers(len(self._samples), size=BATCH)
        _, gradient = effort_loss(self._field, [values[rows] for values in self._columns])
        if self._steps % FORWARD_EVERY == 0:
            self._add_forward(gradient)
        self._steps += 1
        first, second = self._moments
        first += 0.1 * (gradient - first)
        second += 0.001 * (gradient * gradient - second)
        unbias = np.sqrt(1.0 - 0.999**self._steps) / (1.0 - 0.9**self._steps)
        rate = RATE * 0.5 * (1.0 + np.cos(np.pi * progress)) * min(1.0, self._steps / WARM_STEPS)
        self._weights -= np.float32(rate * unbias) * first / (np.sqrt(second) + np.float32(1e-8))

    def _add_forward(self, gradient: np.ndarray) -> None:
        """Add the gradient of some rollouts; a diverging one must not dominate the rest."""
        windows = self._rollouts.draw(WINDOWS, self._rng)
        if windows is None:
            return
        with np.errstate(over="ignore", invalid="ignore"):
            _, forward = discrete_gradient(self._field, windows)
            size = float(np.linalg.norm(forward))
        if 0.0 < size < np.inf:
            gradient += min(FORWARD_WEIGHT * FORWARD_EVERY, float(np.linalg.norm(gradient)) / size) * forward

    def _look(self) -> None:
        """Keep the weights if their held-out error is the best so far."""
        error = self._held_out(self._field)
        if error < self._best:
            self._best, self._best_weights = error, self._weights.copy()

    def _held_out(self, field: Field) -> float:
        columns = [x.astype(field.h.hidden_bias.dtype) for x in _columns(self._judge)]
        return effort_loss(field, columns)[0]

    def _polish(self, used: Callable[[], float]) -> None:
        """L-BFGS in double precision, until time is up."""
        field = self._field.astype(np.float64)
        columns = _columns(self._samples.some(POLISH_SAMPLES, self._rng))

        def look(weights: np.ndarray) -> None:
            error = self._held_out(field.with_vector(weights))
            if error < self._best:
                self._best, self._best_weights = error, weights.copy()
            if used() > 0.99:
                raise _TimeUp

        try:
            options = {"maxiter": 100_000, "maxfun": 1_000_000, "maxcor": 30, "ftol": 1e-12, "gtol": 1e-9}
            minimize(
                lambda w: effort_loss(field.with_vector(w), columns),
                self._best_weights.astype(np.float64),
                jac=True,
                method="L-BFGS-B",
                callback=look,
                options=options,
            )
        except _TimeUp:
            pass

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able information to resume the training."""
        arrays = {"weights": self._weights, "moments": self._moments, "best_weights": self._best_weights}
        best = float(self._best) if np.isfinite(self._best) else None
        return arrays, {
            "steps": self._steps,
            "stage": self.stage,
            "best": best,
            "rng": self._rng.bit_generator.state,
        }

    def restore(self, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> None:
        """Resume from a state of the same data."""
        self._weights[:], self._moments[:] = arrays["weights"], arrays["moments"]
        self._best_weights = arrays["best_weights"].copy()
        self._best = np.inf if info["best"] is None else float(info["best"])
        self._steps, self.stage = int(info["steps"]), str(info["stage"])
        self._rng.bit_generator.state = info["rng"]


class _TimeUp(Exception):
    """The budget is spent."""


class Rollouts:
    """Random windows of measured motion to roll out from; those drawn together have one rate and thus one step."""

    def __init__(self, parts: Sequence[Signals], velocity: np.ndarray) -> None:
        self._states = [np.concatenate([s.position, s.velocity], axis=1).astype(np.float32) for s in parts]
        self._efforts = [np.asarray(s.effort, np.float32) for s in parts]
        self._velocity = velocity
        length = 2 * WINDOW_STEPS
        starts: dict[float, list[tuple[int, int]]] = {}
        for k, s in enumerate(parts):
            rate = next((known for known in starts if abs(s.rate / known - 1.0) < SAME_RATE), s.rate)
            missing = np.append(0, np.cumsum(~s.seen.all(axis=1)))  # it moves all joints, not its own alone
            starts.setdefault(rate, []).extend(
                (k, start)
                for rows in s.segments
                for start in range(rows.start, rows.stop - length)
                if missing[start] == missing[start + length + 1]
            )
        self._starts = [(2.0 / rate, np.array(found)) for rate, found in starts.items() if found]

    def draw(self, count: int, rng: np.random.Generator) -> Windows | None:
        """Some windows with two working samples per step; None if no segment is long enough."""
        if not self._starts:
            return None
        step, starts = self._starts[0]
        if len(self._starts) > 1:
            sizes = np.array([len(found) for _, found in self._starts])
            step, starts = self._starts[rng.choice(len(sizes), p=sizes / sizes.sum())]
        span = np.arange(2 * WINDOW_STEPS + 1)
        chosen = starts[rng.integers(len(starts), size=count)]
        states = np.stack([self._states[k][start + span] for k, start in chosen], axis=1)
        efforts = np.stack([self._efforts[k][start + span] for k, start in chosen], axis=1)
        # an error of position weighs like the velocity's error that made it within the window
        horizon = step * WINDOW_STEPS
        weights = np.concatenate([1.0 / (self._velocity * horizon) ** 2, 1.0 / self._velocity**2])
        return Windows(states, efforts, step, weights.astype(np.float32))


def effort_loss(field: Field, columns: Sequence[np.ndarray]) -> tuple[float, np.ndarray]:
    """Mean squared error of the effort over its scale, and its gradient by all weights.

    Args:
        columns: state (B, 2n), acceleration, direction, effort, and where that counts: 1, or 0 (B, n).
    """
    state, acceleration, direction, effort, seen = columns
    done = field.effort(state, acceleration, direction)
    error = (done.effort - effort) / field.scales.effort * seen
    count = max(int(np.count_nonzero(seen)), 1)
    gradient = field.effort_gradient(done, error * ((2.0 / count) / field.scales.effort))
    return float(np.mean(error * error)) * (error.size / count), flat(gradient)


def _columns(samples: Samples) -> list[np.ndarray]:
    state = np.concatenate([samples.position, samples.velocity], axis=1)
    return [state, samples.acceleration, samples.direction, samples.effort, samples.seen]
