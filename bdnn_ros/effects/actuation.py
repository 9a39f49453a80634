"""Drives and effort sensors: how the measured effort differs from the one that acts, and what drive and joint add.

The effort that acts is `scale · measured(t - delay) + offset`, so the measured effort is
`(acting(t + delay) - offset) / scale`, and the columns below are written for the measured effort.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from types import MappingProxyType

import numpy as np

from bdnn_ros.effects.base import NONE_HELD, Change, Effect, Held, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import printed

GAUTIER = (
    "Gautier, Briot, Global identification of joint drive gains and dynamic parameters of "
    "robots, JDSMC 136(5), 2014"
)

FINEST = 2000.0
"""Most periods per revolution, or per 2 pi metres (a pitch of 3 mm), that are considered."""
LEAST_HALVES, LEAST_PERIODS = 4, 4
"""On a prismatic joint: fewest half periods along the stroke, and least number of periods to try."""
BLURRED = 4.0
"""Highest ripple frequency at a joint's usual speed, per cut-off of the low-pass: slower moments show such a ripple."""
SHORTEST = 1e-3
"""Least stroke [rad, m] and speed [rad/s, m/s] to divide by: on a joint at rest a spring is an offset."""
HARDLY = 0.05
"""An effect of an earlier model counts as gone if a change leaves no more than this share of it."""
SAME_RIPPLE = 0.002
"""Ripples whose periods differ by no more than this share are the same."""


class EffortOffset(Effect):
    """A constant that acts in addition to the measured effort: a sensor's bias, or a drive's offset."""

    name = "effort_offset"
    title = "an effort offset"
    on = "joint"
    parameters = (Parameter("offset", "N*m", plausible=(-0.4, 0.4), of_effort=True),)
    linear = ("offset",)
    equation = "-offset (effort that acts = measured + offset)"
    confused_with = ("joint_spring", "asymmetric_friction", "base_tilt", "external_wrench")
    shown_by = "poses whose gravity has both signs, and both directions of motion"
    source = GAUTIER
    at_sensor = True
    constant = True
    coefficient_bounds = ((-np.inf, np.inf),)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.offset[target] += values["offset"]

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.joint_column(target, -np.ones(len(motion.time)))

    def sentence(self, where: str, values: Values) -> str:
        if not self.before:
            return super().sentence(where, values)
        (had,), change, unit = self.before, values["offset"], printed(self.parameters[0].unit_at(self.slides))
        if abs(had + change) <= HARDLY * abs(had):
            return f"{where} no longer has the effort offset of the model, {had:.3g} {unit}."
        return f"The effort offset of {where} differs from the model's by {change:+.3g} {unit}."


class EffortScale(Effect):
    """A wrong torque constant: `scale` times the measured effort acts.

    Its column leaves out the drive effort found beyond the robot's own friction and rotor inertia: it was identified in the
    same wrong unit, and scaling it too would count it twice.
    """

    name = "effort_scale"
    title = "a wrong effort scale"
    on = "joint"
    parameters = (Parameter("scale", "-", 0.2, 5.0, plausible=(0.75, 1.3)),)
    equation = "(1 / scale - 1) * effort (effort that acts = scale * measured)"
    confused_with = ("link_inertia", "payload", "load_dependent_friction", "armature")
    shown_by = "all joints together, so that the inertia that neighbours see tells the joint's own scale"
    source = GAUTIER
    at_sensor = True
    coefficient_bounds = ((1.0 / 5.0 - 1.0, 1.0 / 0.2 - 1.0),)
    coefficient_spread = 0.3
    of_load = True

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.scale[target] *= values["scale"]

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.joint_column(target, motion.known_load[:, target])

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"scale": 1.0 / (1.0 + float(coefficients[0]))}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([1.0 / values["scale"] - 1.0]), {}

    def sentence(self, where: str, values: Values) -> str:
        acts = "acts in the model" if self.before else "is measured"
        return f"{where} acts with {values['scale']:.3g} times the effort that {acts}."


class EffortDelay(Effect):
    """An effort that acts `delay` after its stamp, on one joint or on all alike.

    Linear in the delay while it is short; the shape `at` [s] is the delay at which the columns, secants from no delay, are
    exact.
    """

    name = "effort_delay"
    title = "an effort delay"
    on = "all"
    also_on = ("joint",)
    parameters = (Parameter("delay", "s", 0.0, 0.2, plausible=(0.004, 0.03)),)
    equation = "effort(t + delay) - effort(t)"
    confused_with = ("armature", "viscous_friction", "velocity_filter")
    shown_by = "fast changes of effort: high frequencies, reversals of acceleration"
    source = (
        "Swevers, Verdonck, De Schutter, Dynamic model identification for industrial robots, IEEE "
        "CSM 27(5), 2007"
    )
    at_sensor = True
    linearised_at = ("at",)
    coefficient_bounds = ((0.0, 0.2),)
    coefficient_spread = 0.03
    of_load = True

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        plant.delay[slice(None) if target < 0 else target] += values["delay"]

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        lead, where = shape["at"], slice(None) if target < 0 else slice(target, target + 1)
        load = motion.measured_load[:, where]
        change = (
            motion.load_rate[:, where] if abs(lead) < 1e-4 else (motion.advanced(load, lead) - load) / lead
        )
        return change[..., None] if target < 0 else motion.joint_column(target, change[:, 0])

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return [{"at": delay} for delay in (0.0, 0.004, 0.008, 0.012, 0.016, 0.02, 0.025, 0.03, 0.04)]

    def relinearised(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"at": float(np.clip(coefficients[0], *self.coefficient_bounds[0]))}

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        return {"delay": float(coefficients[0])}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([values["delay"]]), {"at": values["delay"]}

    def sentence(self, where: str, values: Values) -> str:
        if values["delay"] < 0.0:
            return f"The effort of {where} acts {-1e3 * values['delay']:.3g} ms less after its stamp than in the model."
        when = "later than in the model" if self.before else "after its stamp"
        return f"The effort of {where} acts {1e3 * values['delay']:.3g} ms {when}."


class Cogging(Effect):
    """A ripple over position: magnets and slots, the teeth of a gear, or the lead of a screw.

    Ripples of at least three periods a revolution are considered, or two over the stroke of a prismatic joint: slower ones
    are gravity or springs. On a prismatic joint, `periods_per_rev` counts periods in 2 pi metres. The phase refers to the
    position that the joint reports, including its offset if there is one.
    """

    name = "cogging"
    title = "cogging"
    on = "joint"
    in_drive = True
    winding = True
    parameters = (
        Parameter("amplitude", "N*m", 0.0, plausible=(0.05, 0.3), of_effort=True),
        Parameter("periods_per_rev", "-", 0.5, 5000.0, plausible=(6.0, 36.0)),
        Parameter("phase", "rad", -math.pi, math.pi, plausible=(-math.pi, math.pi), phase=True, default=0.0),
    )
    equation = "amplitude * sin(periods_per_rev * q + phase)"
    confused_with = ("joint_spring", "link_inertia")
    shown_by = "slow motion over a wide range of positions"
    source = (
        "Holtz, Springob, Identification and compensation of torque ripple in high-precision permanent "
        "magnet motor drives, IEEE TIE 43(2), 1996"
    )
    coefficient_bounds = ((-np.inf, np.inf), (-np.inf, np.inf))
    shape_bounds = MappingProxyType({"periods_per_rev": (3.0, FINEST)})
    known: Sequence[Values] | None = None
    """Cogging that an earlier model has at its place; None where the simulation is not replaced by an earlier model."""

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        amplitude, periods, phase = values["amplitude"], values["periods_per_rev"], values["phase"]
        plant.efforts.append(
            (target, lambda time, position, velocity, load: amplitude * math.sin(periods * position + phase))
        )

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        angle = shape["periods_per_rev"] * motion.position[:, target]
        return motion.sharp_column(target, np.sin(angle), np.cos(angle))

    def shown(self, values: Values, stds: Values, most: float = math.inf) -> bool:
        # at the fewest periods tried it is rather gravity, a spring, or an end stop
        fewest, _ = self.shape_bounds["periods_per_rev"]
        return values["periods_per_rev"] - stds["periods_per_rev"] > fewest

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        turning = (*range(3, 25), *range(26, 61, 2))
        periods = _along(motion, target) if motion.robot.slides[target] else turning
        return [{"periods_per_rev": float(p)} for p in periods]

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        sine, cosine = (float(c) for c in coefficients)
        return {
            "amplitude": math.hypot(sine, cosine),
            "periods_per_rev": float(shape["periods_per_rev"]),
            "phase": math.atan2(cosine, sine),
        }

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        sine = values["amplitude"] * math.cos(values["phase"])
        cosine = values["amplitude"] * math.sin(values["phase"])
        return np.array([sine, cosine]), {"periods_per_rev": values["periods_per_rev"]}

    def since(self, robot: Robot, target: int, link: str | None, held: Held = NONE_HELD) -> Effect:
        changed = copy(super().since(robot, target, link, held))
        assert isinstance(changed, Cogging)
        changed.known = held.get(self.name, ())
        return changed

    def change(self, values: Values) -> Change:
        # an earlier model may contain the ripple under no name
        return "more" if self.known is None else "both"

    def sentence(self, where: str, values: Values) -> str:
        found, shape = self.coefficients(values)
        for one in self.known or ():
            had, other = self.coefficients(one)
            same = math.isclose(*(each["periods_per_rev"] for each in (shape, other)), rel_tol=SAME_RIPPLE)
            if same and np.linalg.norm(had + found) <= HARDLY * np.linalg.norm(had):
                unit = printed(self.parameters[0].unit_at(self.slides))
                return f"{where} no longer has the cogging of the model, of {one['amplitude']:.3g} {unit}."
        return super().sentence(where, values)


def _along(motion: Motion, target: int) -> list[float]:
    """Periods (per 2 pi m) to try on a prismatic joint: in steps of half a period per stroke, up to what the low-pass removes.

    Some are always tried, even if on a short stroke all are finer than that.
    """
    half = math.pi / max(float(np.ptp(motion.position[:, target])), SHORTEST)
    speed = float(np.sqrt(np.mean(motion.velocity[:, target] ** 2)))
    finest = min(FINEST, BLURRED * 2.0 * math.pi * motion.signals.cutoff / max(speed, SHORTEST))
    most = max(int(finest / half), LEAST_HALVES + LEAST_PERIODS - 1)
    return [half * count for count in range(LEAST_HALVES, most + 1)]


class JointSpring(Effect):
    """A spring across the joint: a balancer, a cable, a hose.

    Its rest refers to the position that the joint reports, including its offset if there is one.
    """

    name = "joint_spring"
    title = "a spring"
    on = "joint"
    parameters = (
        Parameter("stiffness", "N*m/rad", 0.0, plausible=(0.1, 0.6), of_effort=True),
        Parameter("rest", "rad", -10.0, 10.0, plausible=(-1.0, 1.0), default=0.0),
    )
    equation = "stiffness * (q - rest)"
    confused_with = ("effort_offset", "link_inertia", "cogging")
    shown_by = "the whole range of positions of the joint, in poses of different gravity"
    source = "Herder, Energy-free systems: statically balanced spring mechanisms, PhD thesis, TU Delft, 2001"
    coefficient_bounds = ((0.0, np.inf), (-np.inf, np.inf))
    contains = ("effort_offset",)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        stiffness, rest = values["stiffness"], values["rest"]
        plant.across.append((target, lambda time, position, velocity, load: stiffness * (position - rest)))

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return motion.joint_column(target, motion.position[:, target], np.ones(len(motion.time)))

    def spread(self, typical: np.ndarray, motion: Motion, target: int) -> np.ndarray:
        """Typical both for its variation as the joint moves and for its mean, however far from zero the joint's range lies."""
        position = motion.position[:, target]
        size, middle = float(np.sqrt(np.mean(position**2))), float(np.mean(position))
        if not size:  # a joint that stays at zero, a gripper's say
            return typical
        stiffness = typical[0] * size / max(float(np.std(position)), SHORTEST)
        return np.array([stiffness, np.hypot(typical[1], middle * stiffness)])

    def values(self, coefficients: np.ndarray, shape: Values) -> dict[str, float]:
        stiffness = float(coefficients[0])
        rest = -float(coefficients[1]) / stiffness if abs(stiffness) > 1e-9 else 0.0
        return {"stiffness": stiffness, "rest": rest}

    def coefficients(self, values: Values) -> tuple[np.ndarray, dict[str, float]]:
        return np.array([values["stiffness"], -values["stiffness"] * values["rest"]]), {}
