"""Whether reported velocities are the derivatives of the positions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np

from bdnn_ros.checks.sampling import brisk
from bdnn_ros.errors import listed
from bdnn_ros.physical.remark import Remark
from bdnn_ros.recording import Recording, moving
from bdnn_ros.signals import Signals

PERIODS = 0.75
"""Delays shorter than this many sample periods are those of held commands."""
SHORTEST_DELAY = 0.001
"""Shorter delays are not worth a word [s]."""
CERTAIN = 3.0
"""Standard deviations that make a delay, or a lag of the velocity, certain."""
VELOCITY_GAIN = 0.03
"""Share by which the reported velocity may differ from the position's derivative."""


def odd_velocity(recording: Recording, signals: Signals, told: Collection[str] = ()) -> Iterator[Remark]:
    """Joints whose reported velocity is not the derivative of their position, except those reported elsewhere (`told`)."""
    if signals.reported_velocity is None:
        return
    inside, late = signals.interior, {}
    untold = ~np.isin(signals.joints, list(told))
    for k in np.flatnonzero(untold & moving(recording) & brisk(signals, inside)):
        joint = signals.joints[k]
        v, a = signals.velocity[inside, k], signals.acceleration[inside, k]
        reported = signals.reported_velocity[inside, k]
        basis = np.stack([v, -a], axis=-1)
        gram = basis.T @ basis
        if len(v) < 3 or np.linalg.cond(gram) > 1e12:
            continue
        (gain, slope), residual, *_ = np.linalg.lstsq(basis, reported, rcond=None)
        noise = float(np.sqrt(residual[0] / len(v))) if len(residual) else 0.0
        doubt = noise * float(np.sqrt(np.linalg.inv(gram)[1, 1]))
        lag = slope / gain if abs(gain) > 1e-3 else 0.0
        if abs(gain - 1.0) > VELOCITY_GAIN:
            yield Remark(
                joint,
                f"{recording.name}: the velocity of {joint} is {gain:.2f} times its position's derivative.",
                "Check its unit and sign; it is not used here.",
            )
        elif lag > max(PERIODS / signals.raw_rate, SHORTEST_DELAY) and slope > CERTAIN * doubt:
            late[joint] = float(lag)
    if late:
        ahead = (
            "its position, as behind a low-pass" if len(late) == 1 else "the position, as behind low-passes"
        )
        lags = _between([1e3 * lag for lag in late.values()], 1)
        cutoffs = _between([1.0 / (2.0 * np.pi * lag) for lag in late.values()], 0)
        yield Remark(
            listed(late),
            f"{recording.name}: the velocity of {listed(late)} lags {lags} ms behind {ahead} of {cutoffs} Hz.",
            "It is not used here; a controller that uses it sees the past.",
        )


def _between(values: Sequence[float], digits: int) -> str:
    """One number, or the smallest and the largest if they differ."""
    ends = dict.fromkeys(f"{value:.{digits}f}" for value in (min(values), max(values)))
    return " to ".join(ends)
