"""Descriptions that no robot can have are doubted by name; those of real robots are not."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping

import pytest

from bdnn_ros.checks.description import doubts, require_mass, weightless
from bdnn_ros.diagnosis.result import Finding
from bdnn_ros.diagnosis.telling.notes import massless_links
from bdnn_ros.errors import RobotError
from bdnn_ros.robot import BUNDLED, Robot

IDENTITY = {"ixx": "1", "iyy": "1", "izz": "1", "ixy": "0", "ixz": "0", "iyz": "0"}


def changed(link: str, moments: Mapping[str, str]) -> Robot:
    """The bundled arm6 with another inertia of a link."""
    root = ElementTree.fromstring(Robot.bundled("arm6").urdf)
    inertia = root.find(f"link[@name='{link}']/inertial/inertia")
    assert inertia is not None
    inertia.attrib.update(moments)
    return Robot.from_urdf(ElementTree.tostring(root, encoding="unicode"))


def without_mass(*links: str) -> Robot:
    """The bundled arm6 without the inertials of some links."""
    root = ElementTree.fromstring(Robot.bundled("arm6").urdf)
    for link in links:
        element = root.find(f"link[@name='{link}']")
        assert element is not None
        for inertial in element.findall("inertial"):
            element.remove(inertial)
    return Robot.from_urdf(ElementTree.tostring(root, encoding="unicode"))


@pytest.mark.parametrize("name", BUNDLED)
def test_real_robots_are_not_doubted(name: str) -> None:
    assert list(doubts(Robot.bundled(name))) == []


@pytest.mark.parametrize(
    ("robot", "link", "words"),
    [
        (changed("arm6_link2", IDENTITY), "arm6_link2", "inertia of arm6_link2 is the identity matrix"),
        (
            changed("arm6_link3", {**IDENTITY, "ixx": "0.001", "iyy": "0.5", "izz": "0.001"}),
            "arm6_link3",
            "(arm6_link3: 0.001, 0.001, 0.5 kg·m²) one is larger than the other two together",
        ),
        (
            changed("arm6_link5", {"ixx": "2", "iyy": "2", "izz": "2.5"}),
            "arm6_link5",
            "2.5 kg·m² of 1.3 kg (arm6_link5) is a mass 1.4 m away from its centre, and no link is longer than 0.4",
        ),
        (without_mass("arm6_link3"), "arm6_link3", "gives arm6_link3 no mass"),
    ],
    ids=["placeholder", "triangle inequality", "too large", "no mass"],
)
def test_what_no_link_can_have_is_named(robot: Robot, link: str, words: str) -> None:
    (remark,) = doubts(robot)
    assert words in remark.problem
    assert remark.about == link
    assert "<inertial>" in remark.remedy


def with_flange(inertia: str, mass: str = "0") -> Robot:
    """The bundled arm6 with a frame of some inertia fixed to its last link."""
    tensor = " ".join(f'{name}="{inertia if name[1] == name[2] else 0}"' for name in IDENTITY)
    flange = (
        f'<link name="flange"><inertial><mass value="{mass}"/><inertia {tensor}/></inertial></link>'
        '<joint name="bolts" type="fixed"><parent link="arm6_link6"/><child link="flange"/></joint>'
    )
    return Robot.from_urdf(Robot.bundled("arm6").urdf.replace("</robot>", f"{flange}</robot>"))


def test_a_link_without_mass_has_no_inertia() -> None:
    """Such a frame's inertia counts all the same, and passes for a wrong one of the link that it is fixed to."""
    (remark,) = doubts(with_flange("0.1"))
    assert (
        remark.about == "flange"
        and "(flange: 0.1 kg·m²), which counts as one of arm6_link6" in remark.problem
    )
    assert remark.remedy.startswith("Remove the inertia, or give it a mass")
    assert weightless(with_flange("0.1"), "arm6_link6") == ["flange"]
    assert weightless(with_flange("0.1"), "arm6_link5") == []
    for robot in (with_flange("1e-9"), with_flange("0"), with_flange("0.01", "0.5")):
        assert list(doubts(robot)) == [] and weightless(robot, "arm6_link6") == []


def test_a_finding_at_a_link_with_such_a_frame_is_told_of_it() -> None:
    findings = [
        Finding(effect, None, link, {}, 0.1, 0.9, (), "")
        for effect, link in (("link_inertia", "arm6_link6"), ("payload", "arm6_link5"))
    ]
    (note,) = massless_links(with_flange("0.1"), findings)
    said = note.sentence(False)
    assert said.startswith("What is named at arm6_link6 may be no more than the described inertia of flange")


@pytest.mark.parametrize(
    "robot",
    [
        changed("arm6_link6", {"ixx": "0.0001", "iyy": "0.0001", "izz": "0.000204"}),
        changed("arm6_link6", {**IDENTITY, "ixx": "1e-18", "iyy": "-1e-19", "izz": "1e-17"}),
    ],
    ids=["rounded", "a point"],
)
def test_what_is_rounded_or_next_to_nothing_is_not_doubted(robot: Robot) -> None:
    assert list(doubts(robot)) == []


def test_a_robot_that_weighs_nothing_is_said_once() -> None:
    ghost = without_mass(*(f"arm6_link{k}" for k in range(1, 7)))
    (remark,) = doubts(ghost)
    assert "none of the moving links a mass" in remark.problem
    with pytest.raises(RobotError, match="none of the moving links a mass"):
        require_mass(ghost)
    require_mass(without_mass("arm6_link3"))
