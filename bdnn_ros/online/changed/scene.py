"""Regressor columns, typical sizes and statistics of a robot's residuals, for detecting changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from bdnn_ros.physical.parameters import PER_JOINT, Parameters, of_robot, prior
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.robot.bodies import LIGHTEST, heaviness
from bdnn_ros.robot.mounting import STANDARD_GRAVITY
from bdnn_ros.signals import Signals

BLOCK_SECONDS = 0.25
"""Length of a block [s]: a push is constant so long."""
LEVER = 0.15
"""Typical distance of a payload's centre from its link's origin [m]."""
GYRATION = 0.17
"""Typical distance of its mass from there, for the second moments about that origin [m]."""
FRICTION = 0.3
"""Typical change of friction, as a share of the joint's effort scale."""

Kind = Literal["payload", "friction", "push"]


@dataclass(frozen=True)
class Block:
    """Statistics of a short stretch of residuals, weighted by their noise.

    Attributes:
        start, end: [s].
        gram, moment: of the robot's P base parameters, (P, P) and (P,).
        pull_gram: of the wrenches on each body, (n, 6, 6).
        pull_moment: (n, 6).
        cross: wrench against parameters, (n, 6, P).
        energy: Σ w r².
        count: values of all joints, whatever each of them counts: small ones are as large beside their doubt as others.
    """

    start: float
    end: float
    gram: np.ndarray
    moment: np.ndarray
    pull_gram: np.ndarray
    pull_moment: np.ndarray
    cross: np.ndarray
    energy: float
    count: float


class Scene:
    """Columns and typical sizes of one robot.

    Args:
        robot: its description.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.width = robot.width
        belief = prior(robot)
        self.scale = belief.effort_scale
        ridge = 1e-12 * np.diag(np.diagonal(belief.covariance))
        self.information = inverse(belief.covariance + ridge)[0]
        self.links = [robot.moving_link(joint) for joint in robot.joints]
        lightest = LIGHTEST * heaviness(robot.inertials)
        self.load = float(np.mean(np.maximum(robot.inertials[:, 0], lightest)))
        velocity = robot.limits.usual_velocity
        self._friction = FRICTION * np.stack([self.scale / velocity, self.scale, self.scale / 3.0])

    def columns(self, signals: Signals, rows: np.ndarray) -> np.ndarray:
        """Low-passed columns of the base parameters, (R, n, P)."""
        robot, n = self.robot, self.width
        own = np.zeros((len(signals), n, PER_JOINT, n))
        each = np.arange(n)
        terms = (signals.acceleration, signals.velocity, signals.sign, np.ones_like(signals.position))
        for k, values in enumerate(terms):
            own[:, each, k, each] = values
        regressor = robot.regressor(signals.position, signals.velocity, signals.acceleration)
        columns = np.concatenate([regressor, own.reshape(len(signals), n, PER_JOINT * n)], axis=2)
        return signals.smooth_at(columns, rows)

    def pulls(self, signals: Signals, rows: np.ndarray) -> np.ndarray:
        """Columns of a wrench on each body, (R, n, n, 6); they hardly vary within the low-pass, so they are not filtered."""
        jacobians = [self.robot.link_jacobian(signals.position[rows], link) for link in self.links]
        return np.asarray(-np.stack(jacobians, axis=1).transpose(0, 3, 1, 2))

    def changed(self, kind: Kind, target: int) -> tuple[np.ndarray, np.ndarray]:
        """Which base parameters a payload or friction changes, and the prior covariance of that change."""
        n = self.width
        if kind == "payload":
            moments = [1.0, *[LEVER] * 3, *[GYRATION**2] * 6]
            return target * PER_LINK + np.arange(PER_LINK), np.diag((self.load * np.array(moments)) ** 2)
        index = n * PER_LINK + np.array([1, 2, 3]) * n + target
        return index, np.diag(self._friction[:, target] ** 2)

    @property
    def wrench(self) -> np.ndarray:
        """Prior covariance of a push, (6, 6)."""
        return np.diag([self.weight**2] * 3 + [(LEVER * self.weight) ** 2] * 3)

    @property
    def weight(self) -> float:
        """Mean weight of a link [N]."""
        return -STANDARD_GRAVITY[2] * self.load


def blocks(
    scene: Scene,
    signals: Signals,
    rows: np.ndarray,
    residual: np.ndarray,
    noise: np.ndarray,
    certain: np.ndarray | None = None,
) -> list[Block]:
    """Statistics of residuals (R, n) [N·m] at the chosen samples, in blocks of time.

    Args:
        noise: standard deviation of one row, widened for the rows' correlation, (n,) [N·m].
        certain: what each row counts for each joint, from 0 to 1, (R, n); None for all alike.
    """
    certain = np.ones(residual.shape) if certain is None else certain
    scale = np.sqrt(certain) / noise
    columns = scene.columns(signals, rows)
    pull = scene.pulls(signals, rows)
    time = signals.time[rows]
    number = np.floor((time - time[0]) / BLOCK_SECONDS + 1e-9).astype(int)
    result = []
    for k in np.unique(number):
        inside = number == k
        phi = (columns[inside] * scale[inside, :, None]).reshape(-1, columns.shape[2])
        r = (residual[inside] * scale[inside]).ravel()
        w = (pull[inside] * scale[inside, :, None, None]).reshape(-1, scene.width, 6).transpose(1, 0, 2)
        result.append(
            Block(
                float(time[inside][0]),
                float(time[inside][-1]),
                phi.T @ phi,
                phi.T @ r,
                np.swapaxes(w, 1, 2) @ w,
                np.swapaxes(w, 1, 2) @ r,
                np.swapaxes(w, 1, 2) @ phi,
                float(r @ r),
                float(r.size),
            )
        )
    return result


def inverse(matrix: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse of a positive-definite matrix, and the logarithm of its determinant."""
    size = np.sqrt(np.diagonal(matrix))
    factor, lower = cho_factor(matrix / np.outer(size, size), lower=True, check_finite=False)
    result = cho_solve((factor, lower), np.eye(len(size)), check_finite=False) / np.outer(size, size)
    log_determinant = 2.0 * float(np.log(np.diagonal(factor)).sum() + np.log(size).sum())
    return 0.5 * (result + result.T), log_determinant


def base_parameters(robot: Robot, offset: np.ndarray) -> np.ndarray:
    """The P base parameters of an identified robot, (P,)."""
    own = of_robot(robot)
    return Parameters(own.inertials, own.armature, own.viscous, own.coulomb, offset).vector()
