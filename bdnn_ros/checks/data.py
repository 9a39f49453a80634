"""What recordings leave open or what is odd about them, each with a sentence on what to do."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from bdnn_ros.checks.believed import further_off
from bdnn_ros.checks.conventions import breaches
from bdnn_ros.checks.description import doubts
from bdnn_ros.checks.efforts import braked, saturated, unread
from bdnn_ros.checks.handling import handled
from bdnn_ros.checks.pushed import pushed
from bdnn_ros.checks.rattled import rattled
from bdnn_ros.checks.setup import tilted, zeros_off
from bdnn_ros.checks.velocities import CERTAIN, PERIODS, SHORTEST_DELAY, odd_velocity
from bdnn_ros.errors import listed
from bdnn_ros.physical.combinations import WORDS, Combination, combinations
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import JOINT_NAMES, Parameters, Prior, Spread, prior, usual_motion
from bdnn_ros.physical.remark import Remark
from bdnn_ros.physical.structure import LEAD
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, mended, prepare

UNKNOWN = 0.5
"""A parameter whose standard deviation is still this share of what it was before is hardly known."""
MATTERS = 0.02
"""Inertias that are hardly known are worth a word where they may make this share of a joint's effort."""
ILL_CONDITIONED = 100.0
"""Condition number above which parameters are hard to tell apart (Gautier and Khalil, IJRR 1992)."""
HOPELESS = 1e5
"""The condition number is not told beyond, nor a delay: all there is may be a joint that turns round now and then."""
MOST_ROWS = 2000
"""Samples that the condition is found from."""
BEYOND = 0.05
"""A joint that leaves its range by this share of it is another, or in another unit."""
EXAMPLES = 3
REMEDIES = {
    "armature": "Let it accelerate harder.",
    "viscous": "Let it move at several speeds, up to its usual one.",
    "coulomb": "Let it move slowly both ways.",
}


def check(
    recordings: Sequence[Recording],
    robot: Robot,
    model: PhysicalModel,
    cutoff: float | None = None,
    spread: Spread | None = None,
    disturbed: bool = False,
) -> list[Remark]:
    """Remarks on recordings and the model identified from them.

    Args:
        robot: the simulation's, the prior of the model.
        model: identified from the recordings.
        cutoff: of the low-pass [Hz].
        spread: that the model was identified with.
        disturbed: joints that are left out move so that these feel it: their efforts break no convention by that.
    """
    signals = [prepare(recording, cutoff) for recording in recordings]
    value = condition(robot, signals)
    oddities, broken = _oddities(recordings, robot, signals, disturbed)
    found = [
        *doubts(robot),
        # tilt and zeros are found by efforts that are taken to go with the description
        *([] if broken else (*tilted(model), *zeros_off(model))),
        *further_off(robot, model, spread),
        *unexcited(robot, model, spread),
        *conditioned(value),
    ]
    if value < HOPELESS:
        found += delayed(model, recordings)
    if not disturbed:
        found += chain.from_iterable(map(pushed, recordings, signals, [robot] * len(signals)))
    return found + oddities


def check_data(
    recordings: Sequence[Recording], robot: Robot, cutoff: float | None = None, told: Collection[str] = ()
) -> list[Remark]:
    """Remarks on recordings alone, whatever model is made of them.

    Args:
        robot: the simulation's.
        cutoff: of the low-pass [Hz].
        told: joints of whose reported velocity a finding tells already.
    """
    signals = [prepare(recording, cutoff) for recording in recordings]
    oddities, _ = _oddities(recordings, robot, signals, told=told)
    return [*doubts(robot), *conditioned(condition(robot, signals)), *oddities]


def _oddities(
    recordings: Sequence[Recording],
    robot: Robot,
    signals: Sequence[Signals],
    disturbed: bool = False,
    told: Collection[str] = (),
) -> tuple[list[Remark], bool]:
    """What is odd about each recording, and whether one does not go with the description."""
    found: list[Remark] = []
    mismatched = False
    for recording, one in zip(recordings, signals, strict=True):
        broken = list(breaches(replace(one, effort=None) if disturbed else one, robot))
        mismatched |= bool(broken)
        breaching = ", ".join(breach.about for breach in broken).split(", ")
        found += [
            *broken,
            *([] if disturbed else handled(recording, one, robot)),
            *(remark for remark in beyond(recording, robot) if remark.about not in breaching),
            *unread(recording),
            *braked(recording, robot),
            *rattled(recording),
            *saturated(recording, robot),
            *odd_velocity(recording, one, told),
        ]
    return found, mismatched


def unexcited(robot: Robot, model: PhysicalModel, spread: Spread | None = None) -> Iterator[Remark]:
    """Parameters that the motion hardly determines."""
    belief = prior(robot, spread)
    before = Parameters.from_vector(np.sqrt(np.diagonal(belief.covariance)))
    shares = {kind: getattr(model.std, kind) / getattr(before, kind) for kind in JOINT_NAMES[:-1]}
    alike: dict[tuple[str, ...], list[str]] = {}
    for k, joint in enumerate(robot.joints):
        kinds = tuple(kind for kind, share in shares.items() if share[k] > UNKNOWN)
        alike.setdefault(kinds, []).append(joint)
    for kinds, joints in alike.items():
        if kinds:
            what = listed(WORDS[kind][0] for kind in kinds)
            remedy = " ".join(REMEDIES[kind] for kind in kinds)
            yield Remark(listed(joints), f"The motion says little of the {what} of {listed(joints)}.", remedy)
    yield from _open_inertias(robot, model, belief)


def _open_inertias(robot: Robot, model: PhysicalModel, belief: Prior) -> Iterator[Remark]:
    """Whether inertias left open would matter if the robot moved over a wider range or faster."""
    found = _of_bodies(robot)
    spread = np.array([one.std(model.covariance) for one in found])
    before = np.array([one.std(belief.covariance) for one in found])
    unknown = np.flatnonzero(spread > UNKNOWN * before)
    if not len(unknown):
        return
    columns = _columns(robot, *usual_motion(robot), found)[..., unknown] / belief.effort_scale[:, None]
    weights = np.array([found[k].weights for k in unknown])
    covariance = weights @ model.covariance @ weights.T
    share = np.sqrt(np.mean(np.einsum("tjk,kl,tjl->tj", columns, covariance, columns), axis=0))
    joint = int(np.argmax(share))
    if share[joint] > MATTERS:
        each = np.sqrt(np.mean(columns[:, joint] ** 2, axis=0)) * spread[unknown]
        order = unknown[np.argsort(-each)][:EXAMPLES]
        names = "; ".join(found[k].words.split(", with")[0] for k in order)
        yield Remark(
            "",
            f"{len(unknown)} of {len(found)} inertial parameters are hardly known; on wider or faster motion "
            f"they may make {100.0 * share[joint]:.0f} % of the effort of {robot.joints[joint]}, above all "
            f"{names}.",
            "Move all joints at once, over their whole range and faster; bdnn excite plans such a motion.",
        )


def conditioned(value: float) -> Iterator[Remark]:
    """A remark if this condition number means that parameters are hard to separate."""
    if value > ILL_CONDITIONED:
        size = f"{value:.0f}" if value < HOPELESS else f"above {HOPELESS:.0f}"
        yield Remark(
            "",
            f"Parameters are hard to tell apart on this motion: its condition number is {size}.",
            "Move all joints at once, each with another rhythm and quickly, as `bdnn excite` does; below 100 is good.",
        )


def condition(robot: Robot, signals: Sequence[Signals]) -> float:
    """Condition number of the regressor of the base parameters, columns normalised."""
    count = sum(len(one) for one in signals)
    step = max(count // MOST_ROWS, 1)
    q, v, a = (
        np.concatenate([getattr(one, name)[::step] for one in signals])
        for name in ("position", "velocity", "acceleration")
    )
    kept = _columns(
        robot, q, v, a, [one for one in combinations(robot) if one.unit.startswith("kg")]
    ).reshape(q.size, -1)
    length = np.linalg.norm(kept, axis=0)
    return float(np.linalg.cond(kept / np.maximum(length, 1e-12)))


def _of_bodies(robot: Robot) -> list[Combination]:
    """The identifiable combinations of the bodies."""
    inertial = [one for one in combinations(robot) if one.unit.startswith("kg")]
    return [one for one in inertial if not one.words.startswith(WORDS["armature"][0])]


def _columns(
    robot: Robot,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    found: Sequence[Combination],
) -> np.ndarray:
    """Effort per unit of each combination of bodies and rotors, (N, n, len(found))."""
    rotors = np.einsum("tj,jk->tjk", acceleration, np.eye(robot.width))
    columns = np.concatenate([robot.regressor(position, velocity, acceleration), rotors], axis=-1)
    weights = np.array([one.weights for one in found])
    return np.asarray(columns @ np.linalg.pinv(weights[:, : columns.shape[-1]]))


def delayed(model: PhysicalModel, recordings: Sequence[Recording]) -> Iterator[Remark]:
    """A remark if effort and motion are shifted in time."""
    period = 1.0 / min(recording.rate for recording in recordings)
    known = model.lead_std < UNKNOWN * LEAD
    lead = model.lead - model.lag
    if known and abs(lead) > max(PERIODS * period, SHORTEST_DELAY, CERTAIN * model.lead_std):
        side = "ahead of" if lead > 0.0 else "behind"
        yield Remark(
            "",
            f"The effort is {1e3 * abs(lead):.1f} ms {side} the motion.",
            "Stamp position and effort where they are measured; the model allows for it.",
        )


def beyond(recording: Recording, robot: Robot) -> Iterator[Remark]:
    """Joints with positions far outside the described range, apart from outliers that are repaired."""
    lower, upper = robot.limits.lower, robot.limits.upper

    def left(position: np.ndarray) -> np.ndarray:
        excess = np.maximum(lower - position.min(axis=0), position.max(axis=0) - upper)
        return np.flatnonzero(excess > BEYOND * (upper - lower))

    if not len(left(recording.position)):
        return
    position = mended(recording).position
    low, high = position.min(axis=0), position.max(axis=0)
    for k in left(position):
        yield Remark(
            robot.joints[k],
            f"{recording.name}: {robot.joints[k]} moves from {low[k]:.3g} to {high[k]:.3g}, its limits are "
            f"{lower[k]:.3g} and {upper[k]:.3g}.",
            "Check its unit (radians, metres), its zero, and that this is the robot's description.",
        )
