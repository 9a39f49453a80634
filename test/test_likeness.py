"""Whether a model is of this arm: another's with the same names is refused, a corrected description's is not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from bdnn_cases import black_box, scales
from live_support import real_robot

from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.dynamics import BDNN, BDNNOnPrior
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import ModelFileError
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.likeness import require_arm
from bdnn_ros.online.serving import nominal
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")
TURNED = Robot.from_urdf(ARM.urdf, tuple(reversed(ARM.joints)))
NUMBERS = r"-?[\d.]+(?:e-?\d+)?"


def scaled(share: float) -> Robot:
    """The same arm with all its lengths so many times as long."""

    def longer(match: re.Match[str]) -> str:
        return 'xyz="' + " ".join(f"{share * float(value):.9g}" for value in match[1].split()) + '"'

    def origin(match: re.Match[str]) -> str:
        return re.sub(r'xyz="([^"]*)"', longer, match[0])

    return Robot.from_urdf(re.sub(r"<origin[^>]*>", origin, ARM.urdf))


def changed(pattern: str, text: str) -> Robot:
    urdf, count = re.subn(pattern, text, ARM.urdf, count=1)
    assert count == 1
    return Robot.from_urdf(urdf)


@pytest.mark.parametrize("robot", [ARM, TURNED], ids=["own order", "another order"])
@pytest.mark.parametrize("share", [0.5, 0.95, 1.03, 2.0])
def test_an_arm_of_another_size_is_another(robot, share):
    with pytest.raises(
        ModelFileError, match=r"kept is a model of another arm: its arm6_joint\d sits or turns"
    ):
        require_arm(nominal(scaled(share)), robot, "kept")


def test_what_else_makes_another_arm():
    axis = re.search(r'<axis xyz="([^"]*)"', ARM.urdf)[1]
    back = " ".join(f"{-float(value):g}" for value in axis.split())
    others = [changed(f'<axis xyz="{axis}"', f'<axis xyz="{back}"')]
    others.append(changed('type="revolute"', 'type="prismatic"'))
    for other in others:
        with pytest.raises(ModelFileError, match="another arm"):
            require_arm(nominal(other), ARM, "kept")


@pytest.mark.parametrize("robot", [ARM, TURNED], ids=["own order", "another order"])
def test_the_same_arm_may_be_calibrated_weighed_and_set_up_otherwise(robot):
    heavier = re.sub(rf'<mass value="({NUMBERS})"', lambda m: f'<mass value="{2.0 * float(m[1])}"', ARM.urdf)
    learned = replace(real_robot(ARM).tilted(0.1, 0.2), zeros=np.full(ARM.width, 0.1))
    link = re.search(r'<link name="([^"]*)"', ARM.urdf)[1]
    cell = '<link name="cell"/><joint name="stand" type="fixed"><parent link="cell"/>'
    cell += f'<child link="{link}"/><origin xyz="1 2 0.5"/></joint></robot>'
    standing = Robot.from_urdf(ARM.urdf.replace("</robot>", cell))
    for other in (scaled(1.004), Robot.from_urdf(heavier), learned, standing):
        require_arm(nominal(other), robot, "kept")


def test_a_joint_that_stood_elsewhere_makes_no_other_arm():
    """One identified with the first joint held where a bag had it."""
    rest = ARM.joints[1:]
    held = Robot.from_urdf(ARM.urdf + "\n", rest, {ARM.joints[0]: 0.4})
    require_arm(nominal(held), Robot.from_urdf(ARM.urdf, rest), "kept")


def on(prior: Dynamics) -> BDNNOnPrior:
    """Networks on a prior that have learned nothing yet."""
    ones = np.ones(len(prior.joints))
    return BDNNOnPrior(PriorCore(prior, LocalNetworks.silent(ones, ones), None, 0.05 * ones))


def test_models_of_every_kind_are_looked_at():
    far = scaled(1.2)
    for model in (ExtendedModel(far, (), np.ones(6)), on(far), on(nominal(far))):
        with pytest.raises(ModelFileError, match="another arm"):
            require_arm(model, ARM, "kept")
    for model in (
        ExtendedModel(ARM, (), np.ones(6)),
        on(ARM),
        on(nominal(ARM)),
        black_box(ARM.joints, scales(6), hidden=4),
        BDNN(on(far).core),  # axes learned from motion alone are nobody's description
    ):
        require_arm(model, ARM, "kept")
