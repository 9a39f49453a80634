"""URDF files are read in the encoding that they declare."""

from __future__ import annotations

import pytest

from bdnn_ros.errors import RobotError
from bdnn_ros.robot import Robot
from bdnn_ros.robot.urdf_file import text_of

PLAIN = Robot.bundled("arm2").urdf
BODY = PLAIN[PLAIN.index("<robot") :].replace("arm2_joint1", "épaule")


def first_line(encoding: str) -> str:
    return f"<?xml version='1.0' encoding='{encoding}' ?>\n"


@pytest.mark.parametrize(
    ("declared", "encoding"),
    [
        ("ISO-8859-1", "latin-1"),
        ("windows-1252", "cp1252"),
        ("UTF-8", "utf-8"),
        ("utf-8", "utf-8-sig"),
        ("UTF-16", "utf-16"),
        (None, "utf-8"),
    ],
)
def test_the_declared_encoding_counts(declared, encoding, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes(((first_line(declared) if declared else "") + BODY).encode(encoding))
    assert text_of(path) == (first_line("UTF-8") if declared else "") + BODY
    robot = Robot.from_file(path)
    assert robot.joints == ("épaule", "arm2_joint2")
    assert Robot.from_urdf(robot.urdf.encode().decode()).joints == robot.joints


@pytest.mark.parametrize("line", ["", first_line("UTF-8"), first_line("klingon")])
def test_another_encoding_than_declared_is_said_with_what_to_do(line, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes((line + BODY).encode("latin-1"))
    with pytest.raises(
        RobotError, match=r"arm.urdf is no text in the encoding (UTF-8|KLINGON). Save it as UTF-8, or"
    ):
        Robot.from_file(path)


def test_a_file_that_is_not_there_is_a_matter_of_its_path(tmp_path):
    with pytest.raises(RobotError, match=r"cannot be read .* Check the path"):
        text_of(tmp_path / "none.urdf")
