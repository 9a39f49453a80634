"""Random effects of a size that matters, for blind tests and for `simulate --hide`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bdnn_ros.effects.backlash import side
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.environment import POINT, TORQUE
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import EFFECTS, Installed, completed, variants
from bdnn_ros.effects.transmission import SOFTEST
from bdnn_ros.errors import DataError
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals

EFFECTS_TRIED, SIZES_TRIED = 60, 40
SIZINGS = 4
"""Further scalings of an effect that is not linear in its size."""
BEYOND_PLAUSIBLE = 1.5
"""Factor by which a parameter may exceed its plausible range to reach the share asked for."""
EFFORT_SHARE = 0.95
"""Largest effort with the effect, as a share of the joint's limit."""
TELLING = 0.05
"""Least part of the effort's spread by which an effect must differ from every simpler one that it contains."""
NEVER_SCALED = ("start", "end", "mass", "nominal_mass", *POINT)
CONTACT = 0.1
"""Largest distance of a contact from the link's origin along each axis [m]."""
LEAST_STIFF = 1.0
"""Least stiffness of an arm's gear [N·m/rad] ([N/m])."""
LEAST_SCALED = 0.2
"""Least relative error of a link's inertia: many links are off by less."""


def draw(
    rng: np.random.Generator,
    motion: Motion,
    names: Sequence[str] = (),
    least: float = 0.05,
    most: float = 0.4,
    beside: Sequence[Installed] = (),
) -> Installed:
    """A random effect at a random place.

    Args:
        motion: what the robot will do; see `planned`.
        names: effects to choose from; empty for all.
        least, most: its contribution (root mean square) per spread of the effort, at the joint where it is
            largest; of a body at the joint that carries most of it.
        beside: effects that are there already; the same effect is not drawn at the same place again.

    Raises:
        UsageError: a name is unknown.
        DataError: none of them reaches the share on this motion.
    """
    taken = {(one.effect.name, one.target, one.link) for one in beside}
    for _ in range(EFFECTS_TRIED):
        choices = variants(str(rng.choice(list(names or EFFECTS))))
        effect = choices[int(rng.integers(len(choices)))]
        places = [place for place in effect.places(motion.robot) if (effect.name, *place) not in taken]
        for _ in range(SIZES_TRIED if places else 0):
            target, link = places[int(rng.integers(len(places)))]
            share = float(np.exp(rng.uniform(np.log(least), np.log(most))))
            found = _sized(effect, target, link, _values(effect, target, motion, link, rng), motion, share)
            if found is not None:
                return found
    raise DataError(
        f"No effect reaches {100 * least:.0f} % of the effort on this motion.", "Ask for a smaller share."
    )


def planned(robot: Robot, time: np.ndarray, motion: Sequence[np.ndarray]) -> Motion:
    """A planned motion as effects see it.

    Args:
        time: evenly spaced stamps, (N,) [s].
        motion: position, velocity, acceleration, (N, n) each.
    """
    position, velocity, acceleration = motion
    drive = robot.drive_effort(velocity, acceleration, np.sign(velocity))
    load = robot.rigid_effort(position, velocity, acceleration) + drive
    rate = 1.0 / float(time[1] - time[0])
    signals = Signals(
        time=time,
        joints=robot.joints,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        effort=None,
        reported_velocity=velocity,
        rate=rate,
        cutoff=min(10.0, rate / 6.0),
        segments=(slice(0, len(time)),),
        position_noise=np.full(robot.width, 1e-6),
        raw_rate=rate,
    )
    return Motion(signals, robot, load, drive)


def contribution(one: Installed, motion: Motion) -> np.ndarray:
    """What an effect adds to the measured effort along a motion, (N, n) [N·m]."""
    coefficients, shape = one.effect.coefficients(one.values)
    columns = one.effect.columns(motion, one.target, shape, one.link)
    return np.asarray(columns @ coefficients)


def _values(
    effect: Effect, target: int, motion: Motion, link: str | None, rng: np.random.Generator
) -> dict[str, float]:
    """Parameters drawn from their plausible ranges; `_sized` scales them afterwards."""
    typical = float(np.std(motion.load[:, target])) if target >= 0 else 1.0
    values: dict[str, float] = {}
    for parameter in effect.parameters:
        low, high = parameter.plausible
        value = float(np.exp(rng.uniform(np.log(low), np.log(high))) if low > 0.0 else rng.uniform(low, high))
        values[parameter.name] = value * (typical if parameter.of_effort else 1.0)
    start, span = float(motion.time[0]), float(motion.time[-1] - motion.time[0])
    if effect.name == "external_wrench":
        begin = rng.uniform(0.1, 0.5)
        values |= {"start": start + begin * span, "end": start + (begin + rng.uniform(0.15, 0.4)) * span}
        values |= _point(effect, motion.robot, link, rng)
    if effect.name == "drift":
        values |= {"start": start, "end": start + span}
        if rng.random() < 0.5:
            values |= {"start_value": values["end_value"], "end_value": values["start_value"]}
    if effect.name == "stribeck_friction":
        values["static"] = values["coulomb"] * rng.uniform(1.5, 3.0)
    if effect.name == "cogging":
        values["periods_per_rev"] = float(round(values["periods_per_rev"]))
    if effect.name == "backlash":
        values["crossing"] = values["gap"]
    return completed(effect, values, motion.robot, link)


def _point(effect: Effect, robot: Robot, link: str | None, rng: np.random.Generator) -> dict[str, float]:
    """Point of its link where a wrench acts: one that a diagnosis tries, or a random one near the origin with a pure force."""
    known = effect.points(robot, link)
    chosen = int(rng.integers(len(known) + (link is not None)))
    if chosen < len(known):
        return known[chosen]
    anywhere = rng.uniform(-CONTACT, CONTACT, len(POINT)).tolist()
    return {**dict(zip(POINT, anywhere, strict=True)), **dict.fromkeys(TORQUE, 0.0)}


def _sized(
    effect: Effect,
    target: int,
    link: str | None,
    values: dict[str, float],
    motion: Motion,
    share: float,
    tries: int = SIZINGS,
) -> Installed | None:
    """The effect scaled to a share of the effort; None if impossible or implausible."""
    if effect.kinematic:
        return Installed(effect, target, link, values)
    coefficients, shape = effect.coefficients(values)
    added = effect.columns(motion, target, shape, link) @ coefficients
    spread = np.maximum(np.std(motion.load, axis=0), 1e-9)
    size = np.sqrt(np.mean(added**2, axis=0))
    # of a body: at the joint where it adds most, as a gram at the last joint is much there but nothing to the arm
    reached = float((size / spread)[np.argmax(size if effect.on_body else size / spread)])
    if reached < 1e-6:
        return None
    scaled = effect.values(coefficients * (share / reached), shape)
    if effect.name == "backlash":  # a wider gap is crossed otherwise
        scaled["crossing"] = scaled["gap"]
        if tries and not 0.9 < share / reached < 1.1:
            return _sized(effect, target, link, scaled, motion, share, tries - 1)
    if _told(effect, target, added, motion) * share / reached < TELLING:
        return None
    peak = np.abs(motion.load + added * (share / reached)).max(axis=0)
    if (peak > EFFORT_SHARE * motion.robot.limits.effort).any() or not _sensible(
        effect, scaled, target, motion
    ):
        return None
    return Installed(effect, target, link, completed(effect, scaled, motion.robot, link))


def _told(effect: Effect, target: int, added: np.ndarray, motion: Motion) -> float:
    """Root mean square, per spread of the effort, of what no single simpler effect contained in it can explain."""
    if target < 0 or not effect.contains:
        return np.inf
    here, spread = added[:, target], max(float(np.std(motion.load[:, target])), 1e-9)
    left = []
    for name in effect.contains:
        simple = variants(name)[0]
        columns = simple.columns(motion, target, simple.shapes(motion, target)[0])[:, target]
        best = np.linalg.lstsq(columns, here, rcond=None)[0]
        left.append(float(np.sqrt(np.mean((here - columns @ best) ** 2))) / spread)
    return min(left)


def _sensible(effect: Effect, values: dict[str, float], target: int, motion: Motion) -> bool:
    for parameter in effect.parameters:
        value, (low, high) = values[parameter.name], parameter.plausible
        if not parameter.lower <= value <= parameter.upper:
            return False
        fixed = parameter.of_effort or parameter.name in NEVER_SCALED
        edge = BEYOND_PLAUSIBLE * max(abs(low), abs(high))
        if effect.name != "payload" and not fixed and abs(value) > edge:
            return False
    if effect.name == "drift":
        change = abs(values["end_value"] - values["start_value"])
        return change > 0.5 * max(abs(values["end_value"]), abs(values["start_value"]))
    if effect.name == "joint_elasticity":
        inertia = np.diagonal(motion.robot.mass_matrix(motion.position[::50]), axis1=1, axis2=2)[
            :, target
        ].max()
        return values["stiffness"] >= LEAST_STIFF and bool(np.sqrt(values["stiffness"] / inertia) >= SOFTEST)
    if effect.name == "backlash":  # one that is never crossed is a wrong zero
        return bool(np.ptp(side(motion, target, values["crossing"])) > 0.0)
    if effect.name == "link_inertia":
        return 0.4 <= values["scale"] <= 2.5 and abs(np.log(values["scale"])) >= np.log1p(LEAST_SCALED)
    if effect.name == "payload":
        # on the first link it is a rotor's inertia by another name
        return target > 0 and values["mass"] <= motion.robot.inertials[:, 0].sum()
    if effect.name == "effort_scale":
        return 0.5 <= values["scale"] <= 2.0
    return True
