"""What the description says of single links, also where frames without mass stand between them."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from bdnn_ros.effects.plant import Plant
from bdnn_ros.effects.registry import get, parse_spec
from bdnn_ros.errors import UsageError
from bdnn_ros.robot import Robot
from bdnn_ros.robot.links import described_inertial, link_inertial


def lumped(link: str, keep_mass: bool = True) -> Robot:
    """The bundled arm6 with a link's mass on a child that is fixed to it, turned and moved; or without that mass."""
    root = ElementTree.fromstring(Robot.bundled("arm6").urdf)
    frame = root.find(f"link[@name='{link}']")
    assert frame is not None
    inertial = frame.find("inertial")
    assert inertial is not None
    frame.remove(inertial)
    if keep_mass:
        ElementTree.SubElement(root, "link", name="shell").append(inertial)
        joint = ElementTree.SubElement(root, "joint", name="bolts", type="fixed")
        ElementTree.SubElement(joint, "parent", link=link)
        ElementTree.SubElement(joint, "child", link="shell")
        ElementTree.SubElement(joint, "origin", xyz="0.1 0 0.2", rpy="0.3 0 1")
    return Robot.from_urdf(ElementTree.tostring(root, encoding="unicode"))


def test_a_bare_frame_bears_what_is_fixed_to_it() -> None:
    robot = lumped("arm6_link3")
    body, described = link_inertial(robot, "arm6_link3")
    assert body == 2
    np.testing.assert_array_equal(described, robot.inertials[2])
    np.testing.assert_allclose(link_inertial(robot, "shell")[1], described, atol=1e-12)
    heavier = robot.with_inertials(2.0 * robot.inertials)
    np.testing.assert_array_equal(link_inertial(heavier, "arm6_link3")[1], described)


def test_a_scaled_frame_scales_all_that_it_bears() -> None:
    robot = lumped("arm6_link6")
    scaled = parse_spec("link_inertia@arm6_link6:scale=1.5", robot)
    assert scaled.values["nominal_mass"] == pytest.approx(0.365)
    plant = Plant(robot)
    scaled.install(plant)
    np.testing.assert_allclose(plant.robot.inertials[5], 1.5 * robot.inertials[5], atol=1e-12)


def test_what_weighs_nothing_is_no_candidate_for_another_weight() -> None:
    bare = lumped("arm6_link3", keep_mass=False)
    assert not described_inertial(bare, "arm6_link3")[1].any()
    with pytest.raises(UsageError, match="'arm6_link3' has no mass"):
        link_inertial(bare, "arm6_link3")
    links = [link for _, link in get("link_inertia").places(bare)]
    assert links == [f"arm6_link{k}" for k in (1, 2, 4, 5, 6)]
    assert len(get("payload").places(bare)) == 6
    assert (5, "arm6_link6") in get("link_inertia").places(lumped("arm6_link6"))
