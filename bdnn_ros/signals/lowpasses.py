"""Low-passes that signals had passed before they were recorded, and what remains of them after compensation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

LEAST_GAIN = 0.1
"""Least gain that is compensated: below it there is more noise than signal."""
ENOUGH = 5.0
"""Highest frequency to restore [Hz]: beyond, a robot's motion is below the noise."""
GRID = 1 << 14
"""Samples of the longest kernel."""
TAIL = 1e-3
"""Share of a kernel's sum of magnitudes that is cut off at its ends."""


@dataclass(frozen=True)
class Lowpass:
    """A low-pass without delay: a Butterworth filter of an order run both ways, or a Gaussian (order 0).

    Attributes:
        cutoff: where its gain is one half [Hz], as that of a filter run one way is -3 dB.
    """

    cutoff: float
    order: int = 2

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """Gain at each frequency [Hz], the shape of `frequency`."""
        relative = np.asarray(frequency) / self.cutoff
        if self.order == 0:
            return np.asarray(0.5 ** (relative**2))
        return np.asarray(1.0 / (1.0 + relative ** (2 * self.order)))

    @property
    def edge(self) -> float:
        """Where its gain is -3 dB [Hz]."""
        half = np.sqrt(0.5)
        if self.order == 0:
            return float(self.cutoff * np.sqrt(-np.log2(half)))
        return float(self.cutoff * (1.0 / half - 1.0) ** (0.5 / self.order))


@dataclass(frozen=True)
class Restored:
    """A low-pass after compensation, in its passband, of all that it let through well enough (Wiener, 1949).

    Attributes:
        lowpass: the one that the signals had passed.
    """

    lowpass: Lowpass

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """Overall gain at each frequency [Hz]."""
        power, noise = self.lowpass.gain(frequency) ** 2, _noise(self.lowpass)
        return np.asarray(power * (1.0 + noise) / (power + noise))

    @property
    def edge(self) -> float:
        """Where its gain is -3 dB [Hz]."""
        frequency = np.linspace(0.0, 10.0 * self.lowpass.cutoff, 10_001)
        return float(frequency[int(np.argmax(self.gain(frequency) < np.sqrt(0.5)))])


@dataclass(frozen=True)
class Restoring:
    """The filter that compensates a low-pass as far as it let anything through."""

    lowpass: Lowpass

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """Gain at each frequency [Hz]."""
        gain, noise = self.lowpass.gain(frequency), _noise(self.lowpass)
        return np.asarray(gain * (1.0 + noise) / (gain**2 + noise))


Response = Lowpass | Restored | Restoring


def _noise(lowpass: Lowpass) -> float:
    """Noise-to-signal power at which a frequency is half restored: at `ENOUGH`, or at the least restored gain."""
    return max(float(lowpass.gain(np.array([ENOUGH]))[0]), LEAST_GAIN) ** 2


@lru_cache(maxsize=128)
def kernel_of(response: Response, rate: float) -> np.ndarray:
    """Symmetric kernel (K,) of a filter, to be convolved with even samples; its gain at 0 Hz is exact."""
    kernel = np.fft.fftshift(np.fft.irfft(response.gain(np.fft.rfftfreq(GRID, 1.0 / rate))))
    reach = max(_reach(kernel, TAIL), 2)
    kept = kernel[GRID // 2 - reach : GRID // 2 + reach + 1]
    kept = kept * (float(response.gain(np.zeros(1))[0]) / kept.sum())
    kept.flags.writeable = False
    return np.asarray(kept)


def reach_of(response: Response, rate: float, share: float) -> int:
    """Number of samples on either side that influence a filtered one, but for a share of the kernel's magnitude."""
    return _reach(kernel_of(response, rate), share)


def _reach(kernel: np.ndarray, share: float) -> int:
    """Half length of a symmetric kernel (K,) beyond which less than a share of its magnitude lies."""
    half = np.abs(kernel[len(kernel) // 2 :])
    beyond = np.cumsum(half[::-1])[::-1]
    within = np.flatnonzero(beyond < share * beyond[0])
    return int(within[0]) if len(within) else len(half) - 1
