"""Contact with the environment: what pushes a link or a joint between two times."""

from __future__ import annotations

import math
from abc import abstractmethod
from types import MappingProxyType

import numpy as np

from bdnn_ros.effects.base import SHOWN, Effect, Parameter, Values
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.plant import Plant
from bdnn_ros.robot import Robot
from bdnn_ros.robot.links import needed_link
from bdnn_ros.robot.units import along, printed, shown_as

POINT = ("point_x", "point_y", "point_z")
FORCE = ("force_x", "force_y", "force_z")
TORQUE = ("torque_x", "torque_y", "torque_z")
COMPONENTS = FORCE + TORQUE
SHORTEST = 0.3
"""Least duration of a push [s]: the low-pass leaves little of a shorter one."""
MOST_APART = 100.0
"""Largest ratio of the components' prior standard deviations: a component that has little effect is not believed any larger."""
STRONG = 100.0
"""Largest prior standard deviation of a force [N], or the robot's weight where that is more."""
SAME_POINT = 0.005
"""Points nearer to each other than this count as one [m]."""
EDGES = ("start", "end")
"""Its parameters that are moments of the recording [s]."""
WINDOW = (
    Parameter("start", "s"),
    Parameter("end", "s"),
)
HADDADIN = "Haddadin, De Luca, Albu-Schäffer, Robot collisions: a survey, IEEE T-RO 33(6), 2017"


class Push(Effect):
    """Contact with the environment between two times."""

    name = "external_wrench"
    brief = True
    changing = True
    timed = True
    shown_by = "the same motion again without contact"
    source = HADDADIN
    shape_bounds = MappingProxyType({"start": (-np.inf, np.inf), "end": (-np.inf, np.inf)})

    def shape_allowed(self, shape: Values) -> bool:
        return shape["end"] - shape["start"] >= SHORTEST

    def columns(self, motion: Motion, target: int, shape: Values, link: str | None = None) -> np.ndarray:
        return window(motion, shape)[:, None, None] * (self.pulls(motion, target, link) @ self.mixing(shape))

    @abstractmethod
    def pulls(self, motion: Motion, target: int, link: str | None = None) -> np.ndarray:
        """Columns of a contact without end, before they are mixed (see `mixing`), (N, n, K)."""

    @abstractmethod
    def mixing(self, shape: Values) -> np.ndarray:
        """Weights of `pulls` in the columns, (K, k)."""


class ExternalWrench(Push):
    """A constant force and torque of the environment on a link, in the base's axes, between two times.

    It acts at a point fixed to the link; a diagnosis tries the origin of the frame, the centre of mass, and the point where a
    pure force explains most.
    """

    variant = "link"
    title = "an external wrench"
    on = "link"
    parameters = (
        *WINDOW,
        *(Parameter(c, "N", plausible=(-20.0, 20.0), default=0.0) for c in FORCE),
        *(Parameter(c, "N*m", plausible=(-1.0, 1.0), default=0.0) for c in TORQUE),
        *(Parameter(c, "m", -1.0, 1.0, plausible=(0.0, 0.0), default=0.0) for c in POINT),
    )
    linear = COMPONENTS
    equation = "-J_point(q)' * (force, torque) where start <= t < end"
    confused_with = ("payload", "effort_offset", "drift")
    parts = COMPONENTS
    coefficient_bounds = ((-np.inf, np.inf),) * 6
    shape_bounds = MappingProxyType({**Push.shape_bounds, **dict.fromkeys(POINT, (-1.0, 1.0))})

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        wrench, none = np.array([values[c] for c in COMPONENTS]), np.zeros(6)
        start, end = values["start"], values["end"]
        point = np.array([values[c] for c in POINT])
        plant.wrenches.append(
            (needed_link(link), point, lambda time: wrench if start <= time < end else none)
        )

    def shape_allowed(self, shape: Values) -> bool:
        low, high = self.shape_bounds[POINT[0]]
        return super().shape_allowed(shape) and all(low <= shape[axis] <= high for axis in POINT)

    def pulls(self, motion: Motion, target: int, link: str | None = None) -> np.ndarray:
        return motion.soft_pulls(needed_link(link))

    def mixing(self, shape: Values) -> np.ndarray:
        mixed = np.zeros((len(COMPONENTS) + 9, len(COMPONENTS)))
        mixed[: len(COMPONENTS)] = -np.eye(len(COMPONENTS))
        point = np.array([shape[axis] for axis in POINT])
        mixed[len(COMPONENTS) :, :3] = -np.kron(np.eye(3), point[:, None])
        return mixed

    def strength(self, unit: np.ndarray, usual: np.ndarray) -> np.ndarray:
        # relative to the effort of all joints together: a contact's size does not depend on how weak the last joints are
        return np.asarray(np.linalg.norm(unit, axis=0) / np.linalg.norm(usual, axis=0))

    def spread(self, typical: np.ndarray, motion: Motion, target: int) -> np.ndarray:
        spread, robot = np.minimum(typical, MOST_APART * typical.min()), motion.robot
        weight = float(robot.inertials[:, 0].sum() * np.linalg.norm(robot.gravity_vector))
        spread[: len(FORCE)] = np.minimum(spread[: len(FORCE)], max(STRONG, weight))
        return spread

    def displaced(self, force: np.ndarray) -> np.ndarray:
        """As `mixing`, for the effort that a force (3,) [N] adds per metre of the point along each of the link's axes, (K, 3)."""
        return np.vstack([np.zeros((len(COMPONENTS), 3)), -np.kron(force[:, None], np.eye(3))])

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        points = self.points(motion.robot, link)
        return [{**times, **point} for point in points for times in windows(motion)]

    def points(self, robot: Robot, link: str | None) -> list[dict[str, float]]:
        body, rotation, translation = robot.body_of(needed_link(link))
        mass, *moment = robot.inertials[body][:4]
        centre = rotation.T @ (np.array(moment) / max(mass, 1e-9) - translation)
        places = [np.zeros(3)] + [centre] * bool(np.linalg.norm(centre) > SAME_POINT)
        return [dict(zip(POINT, place.tolist(), strict=True)) for place in places]

    def shown(self, values: Values, stds: Values, most: float = math.inf) -> bool:
        return any(abs(values[c]) > SHOWN * stds[c] for c in COMPONENTS)

    def sentence(self, where: str, values: Values) -> str:
        force, torque = (", ".join(shown_as(values[c], digits=2) for c in names) for names in (FORCE, TORQUE))
        point = ", ".join(f"{values[c]:.3g}" for c in POINT)
        return (
            f"Something pushes {where} from {values['start']:.2f} s to {values['end']:.2f} s "
            f"with ({force}) N and ({torque}) N·m at ({point}) m of its frame."
        )


class ExternalTorque(Push):
    """A constant torque of the environment about a joint, between two times."""

    variant = "joint"
    title = "an external torque"
    on = "joint"
    parameters = (*WINDOW, Parameter("torque", "N*m", plausible=(-0.5, 0.5), of_effort=True))
    linear = ("torque",)
    equation = "-torque where start <= t < end"
    confused_with = ("payload", "effort_offset", "drift")
    coefficient_bounds = ((-np.inf, np.inf),)

    def install(self, plant: Plant, target: int, values: Values, link: str | None = None) -> None:
        torque, start, end = values["torque"], values["start"], values["end"]
        plant.across.append(
            (target, lambda time, position, velocity, load: -torque if start <= time < end else 0.0)
        )

    def pulls(self, motion: Motion, target: int, link: str | None = None) -> np.ndarray:
        return motion.joint_column(target, np.ones(len(motion.time)))

    def mixing(self, shape: Values) -> np.ndarray:
        return -np.eye(1)

    def shapes(self, motion: Motion, target: int, link: str | None = None) -> list[dict[str, float]]:
        return windows(motion)

    def sentence(self, where: str, values: Values) -> str:
        verb = "pushes" if self.slides else "turns"
        return (
            f"Something {verb} {where} from {values['start']:.2f} s to {values['end']:.2f} s with "
            f"{values['torque']:.3g} {printed(along('N*m', self.slides))}."
        )


def window(motion: Motion, shape: Values) -> np.ndarray:
    """Share of each sample's period that lies between `start` and `end`, softened as the effort, (N,) in 0 to 1.

    The arm hardly moves while an edge passes the low-pass, so columns may be multiplied by it.
    """
    begun, over = (_past(motion, shape[edge]) for edge in EDGES)
    return motion.signals.soften(begun - over)


def edge_rates(motion: Motion, shape: Values) -> np.ndarray:
    """Change of a push's window per second of delay of its start, and of its end, (N, 2) [1/s]."""
    step = 1.0 / motion.signals.rate
    earlier, later = (
        np.stack([_past(motion, shape[edge] + by) for edge in EDGES], axis=1) for by in (-step, step)
    )
    return motion.signals.soften((later - earlier) * (1.0, -1.0) / (2.0 * step))


def _past(motion: Motion, moment: float) -> np.ndarray:
    """Share of each sample's period that lies after a moment [s], (N,) in 0 to 1."""
    return np.clip((motion.time - moment) * motion.signals.rate + 0.5, 0.0, 1.0)


def windows(motion: Motion) -> list[dict[str, float]]:
    """Time windows to try first: an eighth, a quarter and a half of the recording, half overlapping."""
    begin, duration = float(motion.time[0]), float(motion.time[-1] - motion.time[0])
    result = []
    for share in (0.125, 0.25, 0.5):
        for start in np.arange(0.0, 1.0 - share + 1e-9, share / 2.0):
            result.append({"start": begin + start * duration, "end": begin + (start + share) * duration})
    return result
