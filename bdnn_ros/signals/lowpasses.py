"""Low-passes that signals had passed before they were recorded, and what is left of them once their passband is restored."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

LEAST_GAIN = 0.1
"""What was let through less than this is not restored: there is more noise in it than signal."""
ENOUGH = 5.0
"""Frequencies up to here are given back [Hz]: beyond, a robot's motion holds less than its noise."""
GRID = 1 << 14
"""Samples of the longest kernel."""
TAIL = 1e-3
"""Share of a kernel's sum of magnitudes that is cut off at its ends."""


@dataclass(frozen=True)
class Lowpass:
    """A low-pass without delay: a Butterworth filter of an order run both ways, or a Gaussian (order 0).

    Attributes:
        cutoff: where its gain is one half [Hz]; of one way, -3 dB.
    """

    cutoff: float
    order: int = 2

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """Share of each frequency [Hz] that is let through, the shape of `frequency`."""
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
    """What a low-pass becomes where all that it let through well enough is given back (Wiener, 1949).

    Attributes:
        lowpass: that the signals had passed.
    """

    lowpass: Lowpass

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """Share of each frequency [Hz] that is let through in the end."""
        power, noise = self.lowpass.gain(frequency) ** 2, _noise(self.lowpass)
        return np.asarray(power * (1.0 + noise) / (power + noise))

    @property
    def edge(self) -> float:
        """Where its gain is -3 dB [Hz]."""
        frequency = np.linspace(0.0, 10.0 * self.lowpass.cutoff, 10_001)
        return float(frequency[int(np.argmax(self.gain(frequency) < np.sqrt(0.5)))])


@dataclass(frozen=True)
class Restoring:
    """What gives back what a low-pass took, as far as it let anything through."""

    lowpass: Lowpass

    def gain(self, frequency: np.ndarray) -> np.ndarray:
        """What each frequency [Hz] is multiplied with."""
        gain, noise = self.lowpass.gain(frequency), _noise(self.lowpass)
        return np.asarray(gain * (1.0 + noise) / (gain**2 + noise))


Response = Lowpass | Restored | Restoring


def _noise(lowpass: Lowpass) -> float:
    """Share of noise in power at which half of a frequency is given back: at `ENOUGH`, or where too little was let through."""
    return max(float(lowpass.gain(np.array([ENOUGH]))[0]), LEAST_GAIN) ** 2


@lru_cache(maxsize=128)
def kernel_of(response: Response, rate: float) -> np.ndarray:
    """Symmetric kernel (K,) of a gain, to be convolved with even samples; it keeps constants as the gain does."""
    kernel = np.fft.fftshift(np.fft.irfft(response.gain(np.fft.rfftfreq(GRID, 1.0 / rate))))
    reach = max(_reach(kernel, TAIL), 2)
    kept = kernel[GRID // 2 - reach : GRID // 2 + reach + 1]
    kept = kept * (float(response.gain(np.zeros(1))[0]) / kept.sum())
    kept.flags.writeable = False
    return np.asarray(kept)


def reach_of(response: Response, rate: float, share: float) -> int:
    """How many samples about each one what becomes of it hangs on, but for a share of the kernel."""
    return _reach(kernel_of(response, rate), share)


def _reach(kernel: np.ndarray, share: float) -> int:
    """Half the length of a symmetric kernel (K,) beyond which less than a share of it lies."""
    half = np.abs(kernel[len(kernel) // 2 :])
    beyond = np.cumsum(half[::-1])[::-1]
    within = np.flatnonzero(beyond < share * beyond[0])
    return int(within[0]) if len(within) else len(half) - 1
