"""Random pieces of motion that start and end at rest within a robot's limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.excitation.bounds import Bounds
from bdnn_ros.simulation.excitation import (
    LONGEST_PERIOD,
    STEEPNESS,
    Trajectory,
    smooth_step,
)

BLEND = 0.8
"""A swing swells from rest, and dies away, over so many seconds."""
SLOWEST = 0.02
"""Slowest steady speed [rad/s]: slower ones drown in the encoder's noise, or stick."""
SMALL_SWING = (0.005, 0.1)
"""Smallest and largest amplitude of small reversals [rad]."""
HIGHEST = (0.6, 1.0, 1.5)
"""Highest harmonics of a swing of all joints, one of these [Hz]."""
SHORTEST_PERIOD = 2.0
"""Least base period of such a swing; above, it is as long as the motion, up to the longest of any Fourier series [s]."""
ABOUT_THE_MIDDLE = 0.25
"""How far from the middle of its range a joint swings about, per range."""
FILLED = (0.7, 1.0)
"""What share of its room a joint's swing fills."""
COARSE = 0.01
"""Spacing at which limits are checked [s]."""
RESERVE = 0.98
"""Share of the room that a piece is fitted to: between the samples looked at it may reach further."""
ATTEMPTS = 10
"""A piece that asks too much effort is drawn smaller so often before it is given up."""


@dataclass(frozen=True)
class Piece:
    """A motion of `duration` [s] about a pose, from rest to rest: sines under an envelope, plus ramps.

    Attributes:
        centre: the pose, (n,) [rad].
        amplitude, frequency, phase: of K sines of each joint, (n, K) [rad, Hz, rad].
        when, speed: at each time `when` (S,) [s] the ramps change their speed to `speed` (S, n) [rad/s].
        blend: how long a change of speed takes [s].
    """

    duration: float
    centre: np.ndarray
    amplitude: np.ndarray
    frequency: np.ndarray
    phase: np.ndarray
    when: np.ndarray
    speed: np.ndarray
    blend: float

    def at(self, time: np.ndarray) -> Trajectory:
        """The motion at times (N,) from its start [s]."""
        position, velocity, acceleration = self._swing(time)
        change = np.diff(self.speed, axis=0, prepend=np.zeros((1, len(self.centre))))
        x = (time[:, None] - self.when) / self.blend
        step, slope, _ = smooth_step(x)
        position = position + self.blend * _step_integral(x) @ change
        return Trajectory(
            time, self.centre + position, velocity + step @ change, acceleration + slope / self.blend @ change
        )

    def _swing(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rate = 2.0 * np.pi * self.frequency
        angle = rate * time[:, None, None] + self.phase
        sine, cosine = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        wave = sine.sum(axis=2), (rate * cosine).sum(axis=2), -(rate**2 * sine).sum(axis=2)
        rising, falling = smooth_step(time / BLEND), smooth_step((self.duration - time) / BLEND)
        w = (rising[0] * falling[0])[:, None]
        dw = ((rising[1] * falling[0] - rising[0] * falling[1]) / BLEND)[:, None]
        ddw = rising[2] * falling[0] - 2.0 * rising[1] * falling[1] + rising[0] * falling[2]
        return (
            w * wave[0],
            w * wave[1] + dw * wave[0],
            w * wave[2] + 2.0 * dw * wave[1] + ddw[:, None] / BLEND**2 * wave[0],
        )

    @property
    def end(self) -> np.ndarray:
        """The pose it ends in, (n,) [rad]."""
        return np.asarray(self.at(np.array([self.duration])).position[0])

    def resized(self, factor: np.ndarray | float) -> Piece:
        """The same piece with each joint's motion scaled by a factor, (n,) or one for all."""
        size = np.broadcast_to(np.asarray(factor, float), self.centre.shape)
        return replace(self, amplitude=self.amplitude * size[:, None], speed=self.speed * size)

    @property
    def coarse(self) -> Trajectory:
        """The motion at the spacing at which limits are checked."""
        return self.at(np.arange(0.0, self.duration + 0.5 * COARSE, COARSE))


def drawn(bounds: Bounds, duration: float, focus: np.ndarray, rng: np.random.Generator) -> Piece | None:
    """A random piece within the limits: joints swing, move back and forth at constant speed, or make small reversals.

    Nearly all joints move in every piece: a joint at rest reveals nothing, not even about its neighbours.

    Args:
        focus: how much each joint matters, (n,), at least one above zero; these do more than swing.

    Returns:
        None where the pose or the motion asks for more effort than there is.
    """
    width = bounds.width
    centre = bounds.lower + rng.beta(1.5, 1.5, width) * (bounds.upper - bounds.lower)
    special = rng.random(width) < 0.15 + 0.5 * focus / focus.max()
    ramping, small = special & (rng.random(width) < 0.6), np.zeros(width, bool)
    small[special & ~ramping] = True
    resting = ~special & (rng.random(width) < 0.1)
    amplitude, frequency, phase = _sines(small, duration, rng)
    when, speed, blend = _ramps(bounds.velocity, duration, rng)
    piece = Piece(
        duration,
        centre,
        amplitude * ~(ramping | resting)[:, None],
        frequency,
        phase,
        when,
        speed * ramping,
        blend,
    )
    share = np.where(ramping | small, 0.0, rng.uniform(0.3, 1.0, width))
    return fitted(bounds, piece, share)


def swinging(bounds: Bounds, duration: float, rng: np.random.Generator) -> Piece | None:
    """A random Fourier series within the limits in which all joints move, from rest to rest; None as of `drawn`."""
    width, period = bounds.width, float(np.clip(duration, SHORTEST_PERIOD, LONGEST_PERIOD))
    harmonics = np.arange(1, max(int(rng.choice(HIGHEST) * period), 2) + 1)
    room = bounds.upper - bounds.lower
    centre = bounds.lower + room * (0.5 + ABOUT_THE_MIDDLE * rng.uniform(-1.0, 1.0, width))
    shape = (width, len(harmonics))
    amplitude = rng.uniform(0.2, 1.0, shape) / harmonics**STEEPNESS
    phase = rng.uniform(0.0, 2.0 * np.pi, shape)
    frequency = np.tile(harmonics / period, (width, 1))
    still = np.zeros((1, width))
    piece = Piece(duration, centre, amplitude, frequency, phase, still[:, 0], still, BLEND)
    return fitted(bounds, piece, rng.uniform(*FILLED, width))


def retouched(bounds: Bounds, piece: Piece, step: float, rng: np.random.Generator) -> Piece | None:
    """A swinging piece with a changed motion of one or two joints and another pose; None as of `drawn`.

    Args:
        step: how far away, about 1.
    """
    width = bounds.width
    moved = rng.random(width) < 1.5 / width
    moved[rng.integers(width)] = True
    away = 0.15 * step * (bounds.upper - bounds.lower) * rng.standard_normal(width)
    shape = piece.amplitude.shape
    other = replace(
        piece,
        centre=np.where(moved, np.clip(piece.centre + away, bounds.lower, bounds.upper), piece.centre),
        amplitude=piece.amplitude
        * np.where(moved[:, None], np.exp(0.4 * step * rng.standard_normal(shape)), 1.0),
        phase=piece.phase + np.where(moved[:, None], 0.8 * step * rng.standard_normal(shape), 0.0),
    )
    return fitted(bounds, other, np.where(moved, rng.uniform(*FILLED, width), 0.0))


def _sines(
    small: np.ndarray, duration: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Amplitudes, frequencies and phases of swings, or of `small` (n,) oscillations, (n, K) each."""
    shape = (len(small), int(rng.integers(2, 6)))
    slowest = 1.0 / duration
    fastest = np.exp(rng.uniform(np.log(1.2 * slowest), np.log(max(2.0, 2.0 * slowest))))
    frequency = rng.uniform(slowest, fastest, shape)
    amplitude = rng.uniform(0.2, 1.0, shape) / frequency**1.5
    frequency[small] = rng.uniform(0.3, 2.0, (int(small.sum()), shape[1]))
    amplitude[small] = 0.0
    least, most = np.log(SMALL_SWING)
    amplitude[small, 0] = np.exp(rng.uniform(float(least), float(most), int(small.sum())))
    return amplitude, frequency, rng.uniform(0.0, 2.0 * np.pi, shape)


def _ramps(
    most: np.ndarray, duration: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, float]:
    """Times (S,), speeds (S, n) and blend time of motions back and forth, each joint near a speed of its own."""
    reversals = int(rng.integers(1, 6))
    least = np.minimum(SLOWEST, 0.5 * most)
    speeds = least * (most / least) ** rng.random(len(most))
    speeds = speeds * np.exp(rng.uniform(-0.7, 0.0, (reversals + 1, len(most))))
    when = np.linspace(0.0, duration, reversals + 2)
    blend = 0.25 * when[1]
    signed = speeds * (-1.0) ** np.arange(reversals + 1)[:, None]
    return np.append(when[:-1], duration - blend), np.vstack([signed, np.zeros(len(most))]), float(blend)


def changed(bounds: Bounds, piece: Piece, rng: np.random.Generator) -> Piece | None:
    """A variation of a piece: pose, amplitudes and tempo slightly changed."""
    width = bounds.width
    moved = piece.centre + 0.15 * (bounds.upper - bounds.lower) * rng.standard_normal(width)
    other = replace(
        piece,
        centre=np.clip(moved, bounds.lower, bounds.upper),
        frequency=piece.frequency * np.exp(0.2 * rng.standard_normal(piece.frequency.shape)),
        phase=piece.phase + 0.5 * rng.standard_normal(piece.phase.shape),
    ).resized(np.exp(0.4 * rng.standard_normal(width)))
    return fitted(bounds, other)


def fitted(bounds: Bounds, piece: Piece, share: np.ndarray | float = 0.0) -> Piece | None:
    """The piece scaled down to keep all limits; None if that is impossible.

    Args:
        share: how much of its room each joint's motion is brought to first, (n,); 0 never enlarges.
    """
    motion = piece.coarse
    away = motion.position - piece.centre
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.minimum(
            (bounds.upper - piece.centre) / np.maximum(away.max(axis=0), 1e-12),
            (bounds.lower - piece.centre) / np.minimum(away.min(axis=0), -1e-12),
        )
        room = np.minimum(room, bounds.velocity / np.abs(motion.velocity).max(axis=0))
        room = np.minimum(room, bounds.acceleration / np.abs(motion.acceleration).max(axis=0))
    room = np.where(np.isfinite(room), room, 1.0) * RESERVE
    piece = piece.resized(np.where(np.asarray(share) > 0.0, share * room, np.minimum(room, 1.0)))
    for _ in range(ATTEMPTS):
        if bounds.kept_by(piece.coarse, 1e-3):
            return piece
        piece = piece.resized(0.8)
    return None


def _step_integral(x: np.ndarray) -> np.ndarray:
    """Integral of the step from 0 to x."""
    inside = np.clip(x, 0.0, 1.0)
    return np.asarray(inside**6 - 3.0 * inside**5 + 2.5 * inside**4 + np.maximum(x - 1.0, 0.0))
