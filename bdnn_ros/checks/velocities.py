"""Whether reported velocities are the derivatives of the positions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

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
ALIKE = 0.1
"""A factor is the one of a wrong sign, or of degrees, to this share: filters and noise take some of it."""
TURNED, DEGREES, OTHER = "turned", "degrees", "other"


def odd_velocity(recording: Recording, signals: Signals, told: Collection[str] = ()) -> Iterator[Remark]:
    """Joints whose reported velocity is not the derivative of their position, except those reported elsewhere (`told`)."""
    if signals.reported_velocity is None:
        return
    inside, gains, late = signals.interior, {}, {}
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
        if _differs(float(gain), _most(v, a, reported)):
            gains[joint] = float(gain)
        elif lag > max(PERIODS / signals.raw_rate, SHORTEST_DELAY) and slope > CERTAIN * doubt:
            late[joint] = float(lag)
    yield from _scaled(recording, gains)
    if late:
        yield _lagging(recording, late)


def _most(v: np.ndarray, a: np.ndarray, reported: np.ndarray) -> float:
    """How many times the position's derivative (N,) the reported velocity (N,) is at most.

    Noise in one makes the ratio too small, noise in the other too large when asked the other way round: the true one is
    between (Frisch 1934). Both without the part that goes with the acceleration (N,), which a lag makes.
    """
    v, reported = (one - a * (a @ one) / (a @ a) for one in (v, reported))
    both = float(v @ reported)
    return float(reported @ reported) / both if both else 0.0


def _differs(gain: float, most: float) -> bool:
    """Whether a velocity is another than the derivative, wherever between these its ratio is."""
    low, high = min(gain, most), max(gain, most)
    return high < 1.0 - VELOCITY_GAIN or low > 1.0 + VELOCITY_GAIN


def _scaled(recording: Recording, gains: Mapping[str, float]) -> Iterator[Remark]:
    """Remarks on velocities that are so many times the position's derivative, of one kind each."""
    kinds: dict[str, list[str]] = {}
    for joint, gain in gains.items():
        kinds.setdefault(_kind(gain), []).append(joint)
    for kind, joints in kinds.items():
        its = "its position's derivative" if len(joints) == 1 else "their positions' derivatives"
        times = f"is {_between([gains[joint] for joint in joints], 2)} times {its}"
        said, remedy = {
            TURNED: (f"has the opposite sign of {its}", "Let the driver turn it; it is not used here."),
            DEGREES: (
                f"{times}, as in degrees",
                "Let the driver report it in the unit rad/s; it is not used here.",
            ),
            OTHER: (times, "Check its unit and sign, and the stamps; it is not used here."),
        }[kind]
        yield Remark(listed(joints), f"{recording.name}: the velocity of {listed(joints)} {said}.", remedy)


def _kind(gain: float) -> str:
    """What a velocity is that is so many times the position's derivative."""
    for kind, factor in ((TURNED, -1.0), (DEGREES, float(np.degrees(1.0)))):
        if abs(gain / factor - 1.0) < ALIKE:
            return kind
    return OTHER


def _lagging(recording: Recording, late: Mapping[str, float]) -> Remark:
    """The remark on velocities that lag behind the position by so much [s]."""
    ahead = "its position, as behind a low-pass" if len(late) == 1 else "the position, as behind low-passes"
    lags = _between([1e3 * lag for lag in late.values()], 1)
    cutoffs = _between([1.0 / (2.0 * np.pi * lag) for lag in late.values()], 0)
    return Remark(
        listed(late),
        f"{recording.name}: the velocity of {listed(late)} lags {lags} ms behind {ahead} of {cutoffs} Hz.",
        "It is not used here; a controller that uses it sees the past.",
    )


def _between(values: Sequence[float], digits: int) -> str:
    """One number, or the smallest and the largest if they differ."""
    ends = dict.fromkeys(f"{value:.{digits}f}" for value in (min(values), max(values)))
    return " to ".join(ends)
