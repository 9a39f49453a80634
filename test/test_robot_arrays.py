"""What a robot and a model identified for it take: lists, shapes that fit together, and no changes of their arrays."""

from __future__ import annotations

import copy
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from bdnn_ros.errors import UsageError
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6").with_joint_parameters(np.full(6, 0.1), np.full(6, 0.2), np.full(6, 0.3))
MODELS = [ARM, PhysicalModel(ARM, np.full(6, 0.4), np.eye(6 * 14), np.ones(6))]
ASKED = {
    "inverse_dynamics": 3,
    "forward_dynamics": 3,
    "mass_matrix": 1,
    "gravity": 1,
    "coriolis": 2,
    "friction": 2,
}


@pytest.mark.parametrize("model", MODELS, ids=["robot", "model"])
@pytest.mark.parametrize(("name", "count"), ASKED.items())
def test_they_take_lists_and_broadcast_or_refuse(model, name: str, count: int) -> None:
    ask = getattr(model, name)
    values = np.random.default_rng(0).uniform(-1.0, 1.0, (count, 5, 6))
    np.testing.assert_array_equal(ask(*values.tolist()), ask(*values))
    for one in range(count if count > 1 else 0):
        mixed = [value if k == one else value[0] for k, value in enumerate(values)]
        full = [value if k == one else np.tile(value[0], (5, 1)) for k, value in enumerate(values)]
        np.testing.assert_allclose(ask(*mixed), ask(*full), rtol=1e-12)
        wrong = [value[:, :4] if k == one else value for k, value in enumerate(values)]
        with pytest.raises(UsageError, match=r"\(5, 4\).* do not fit 6 joints"):
            ask(*wrong)
    for wrong in (values[..., :5], values[..., :1], np.zeros((count, 0)), np.zeros(count)):
        with pytest.raises(UsageError, match="do not fit 6 joints"):
            ask(*wrong)
    if count > 1:
        with pytest.raises(UsageError, match=r"\(5, 6\), \(4, 6\)"):
            ask(values[0], values[1][:4], *values[2:])


@pytest.mark.parametrize("renewed", [copy.copy, copy.deepcopy])
def test_their_arrays_cannot_be_changed(renewed) -> None:
    given = np.full(6, 0.1)
    robot = renewed(ARM.with_joint_parameters(given))
    given[0] = 5.0  # the caller's own stays the caller's
    for array in (robot.inertials, robot.armature, robot.viscous, robot.coulomb, robot.gravity_vector):
        assert not array.flags.writeable
    for array in (robot.limits.lower, robot.limits.upper, robot.limits.velocity, robot.limits.effort):
        assert not array.flags.writeable
    assert robot.armature[0] == 0.1
    model = renewed(MODELS[1])
    with pytest.raises(ValueError, match="read-only"):
        model.covariance[0, 0] = 2.0
    with pytest.raises(ValueError, match="read-only"):
        robot.inertials[0] *= 2.0


def test_threads_that_share_a_robot_do_not_read_each_others_work() -> None:
    """Pinocchio leaves derivatives and placements in a memory of its own, and a thread may be stopped before it reads them."""
    robot = Robot.bundled("arm7")
    motions = np.random.default_rng(0).standard_normal((2, 3, 300, 7))

    def asked(motion: np.ndarray) -> np.ndarray:
        turned = robot.link_motion(motion[0], "arm7_link7")[1].ravel()
        return np.concatenate([turned, np.ravel(robot.effort_derivatives(*motion))])

    alone = [asked(motion) for motion in motions]
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            together = list(pool.map(asked, [*motions, *motions]))
    finally:
        sys.setswitchinterval(usual)
    for got, want in zip(together, [*alone, *alone], strict=True):
        np.testing.assert_array_equal(got, want)
