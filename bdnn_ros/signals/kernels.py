"""Gaussian kernels: a low-pass and its derivatives, the noise that passes them, and the grid they work on."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy import fft
from scipy.sparse import csr_array

KERNEL_WIDTHS = 4.0
"""Half length of the kernel in standard deviations."""

NOTHING = 1e-18
"""A filter's memory of a sample below this is dropped."""

ROUNDING = 0.05
"""Tolerance within which a rate counts as a multiple of the working rate: 999 and 1001 Hz go together."""


def gaussian_std(cutoff: float) -> float:
    """Standard deviation [s] of the Gaussian kernel whose gain is -3 dB at `cutoff` [Hz]."""
    return float(np.sqrt(np.log(2.0)) / (2.0 * np.pi * cutoff))


def kernel_half(std: float, rate: float) -> int:
    """Number of weights on either side of the middle one in `gaussian_kernel`."""
    return max(int(np.ceil(KERNEL_WIDTHS * std * rate)), 2)


@lru_cache(maxsize=64)
def gaussian_kernel(std: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights of the low-pass and of its first and second derivative, to be convolved with even samples.

    Moments are exact on the grid: the low-pass keeps constants and ramps (a parabola is raised by the
    kernel's variance), and the derivatives of parabolas are exact.
    """
    half = kernel_half(std, rate)
    t = np.arange(-half, half + 1) / rate
    weights = np.exp(-0.5 * (t / std) ** 2)
    weights /= weights.sum()
    first = -t * weights
    first /= -(first * t).sum()
    spread = (weights * t**2).sum()
    second = (t**2 - spread) * weights
    second /= 0.5 * (second * t**2).sum()
    for kept in (weights, first, second):
        kept.flags.writeable = False
    return weights, first, second


def convolved(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Convolution of values (N, ...) with a long symmetric kernel (K,); values are continued by point reflection at the ends."""
    half = len(weights) // 2
    margins = [(half, half)] + [(0, 0)] * (values.ndim - 1)
    padded = np.pad(np.asarray(values, float), margins, mode="reflect", reflect_type="odd")
    size = fft.next_fast_len(len(padded), real=True)  # wrap-around stays in the margin
    kernel = fft.rfft(weights, size).reshape(-1, *[1] * (values.ndim - 1))
    both = fft.irfft(fft.rfft(padded, size, axis=0) * kernel, size, axis=0)
    return np.asarray(both[2 * half : 2 * half + len(values)])


def lagging(values: np.ndarray, lag: float, rate: float) -> np.ndarray:
    """Values (N, ...) at a rate [Hz] after a first-order low-pass of a time constant [s], at rest at the first value."""
    both = 2.0 * lag * rate
    return _first_order(values, 1.0 / (1.0 + both), 1.0 / (1.0 + both), (both - 1.0) / (both + 1.0))


def trailing(values: np.ndarray, lag: float, rate: float) -> np.ndarray:
    """As `lagging`, but exact for input that is linear between samples: for a low-pass that sees the continuous motion."""
    keep = float(np.exp(-1.0 / (lag * rate)))
    weight = lag * rate * (1.0 - keep)
    return _first_order(values, 1.0 - weight, weight - keep, keep)


def _first_order(values: np.ndarray, now: float, before: float, keep: float) -> np.ndarray:
    """Values (N, ...) after y[k] = now · x[k] + before · x[k - 1] + keep · y[k - 1], initially at rest; |keep| < 1.

    By recursive doubling of the stride: importing scipy.signal takes a second.
    """
    x = values - values[:1]
    result, stride = now * x, 1
    result[1:] += before * x[:-1]
    while stride < len(values) and abs(keep) > NOTHING:
        result[stride:] += keep * result[:-stride]
        keep, stride = keep**2, 2 * stride
    return np.asarray(values[:1] + result)


def convolving_at(weights: np.ndarray, samples: np.ndarray, segments: Sequence[slice]) -> csr_array:
    """Convolution with a symmetric kernel (K,) at some samples (R,), segment by segment, as a sparse matrix (R, N).

    Beyond its ends a segment is continued by its first and last value.
    """
    half = len(weights) // 2
    inside = [samples[(samples >= rows.start) & (samples < rows.stop)] for rows in segments]
    taken = [
        np.clip(part[:, None] + np.arange(len(weights)) - half, rows.start, rows.stop - 1)
        for part, rows in zip(inside, segments, strict=True)
    ]
    columns = np.concatenate(taken)
    row = np.repeat(np.arange(len(columns)), len(weights))
    values = np.tile(weights, len(columns))
    return csr_array((values, (row, columns.ravel())), shape=(len(columns), max(s.stop for s in segments)))


def convolved_at(
    values: np.ndarray, weights: np.ndarray, samples: np.ndarray, segments: Sequence[slice]
) -> np.ndarray:
    """`convolving_at` applied to values (N, ...), (R, ...): nearby samples by one dense product, faster for a single use."""
    flat, reach = values.reshape(len(values), -1), np.arange(len(weights)) - len(weights) // 2
    parts = [np.empty((0, flat.shape[1]))]
    for rows in segments:
        inside = samples[(samples >= rows.start) & (samples < rows.stop)]
        for near in np.split(inside, np.flatnonzero(np.diff(inside // len(weights))) + 1):
            if not len(near):
                continue
            taken = np.clip(near[:, None] + reach, rows.start, rows.stop - 1)
            first, width = int(taken[0, 0]), int(taken[-1, -1] - taken[0, 0]) + 1
            places = taken - first + width * np.arange(len(near))[:, None]
            matrix = np.bincount(places.ravel(), np.tile(weights, len(near)), width * len(near))
            parts.append(matrix.reshape(len(near), width) @ flat[first : first + width])
    return np.concatenate(parts).reshape(-1, *values.shape[1:])


def passed_noise(
    noise: np.ndarray, std: float, rate: float, order: int = 0, twiced: bool = False
) -> np.ndarray:
    """Standard deviation of low-passed white noise, or of its derivative, the shape of `noise` [its unit/s^order].

    Args:
        noise: standard deviation of samples before the low-pass.
        std: of the Gaussian kernel [s].
        rate: samples per second [Hz].
        order: 0 for the noise itself, 1 or 2 for its derivatives.
        twiced: after 2 K - K² instead of the kernel K.
    """
    moment = (1.0, 1.0 / 2.0, 3.0 / 4.0)[order]
    if twiced:
        moment *= 4.0 - 4.0 / 1.5 ** (order + 0.5) + 1.0 / 2.0 ** (order + 0.5)
    return np.asarray(noise * np.sqrt(moment / (2.0 * np.sqrt(np.pi) * std ** (2 * order + 1) * rate)))


def even_grid(rate: float, least: float) -> tuple[float, int]:
    """Step of the even grid [s] for samples at a rate [Hz], and how many grid points make one working sample.

    Args:
        least: sufficient number of working samples per second [Hz].
    """
    ratio = rate / least
    if ratio >= 1.0:
        return 1.0 / rate, int(ratio + ROUNDING)
    return 1.0 / (rate * np.ceil(1.0 / ratio - ROUNDING)), 1


def grid_of(rate: float, working: float) -> tuple[float, int]:
    """As `even_grid`, for samples at a rate [Hz] and a given working rate [Hz]."""
    every = max(int(np.ceil(rate / working - ROUNDING)), 1)
    return 1.0 / (working * every), every
