"""The repository builds with colcon as ordinary ROS 2 packages."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FILES = ["LICENSE", "colcon_defaults.yaml", "package.xml", "pyproject.toml", "setup.cfg", "setup.py"]
FOLDERS = ["bdnn_interfaces", "bdnn_ros", "config", "launch", "resource", "scripts"]
LEFT_OUT = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of all that colcon needs, named as a clone would be."""
    copy = tmp_path / "bdnn_ros"
    copy.mkdir()
    for name in FILES:
        shutil.copy(ROOT / name, copy / name)
    for name in FOLDERS:
        shutil.copytree(ROOT / name, copy / name, ignore=LEFT_OUT)
    return copy


def run(command: list[str], directory: Path) -> str:
    """Return what a command printed where the virtual environment stands for a ROS 2 installation."""
    variables = {
        "AMENT_PREFIX_PATH": sys.prefix,
        "CMAKE_PREFIX_PATH": sys.prefix,
        "CFLAGS": "-O0",  # what is built is only loaded
        "COLCON_LOG_PATH": str(directory / "log"),
        "PATH": os.pathsep.join([str(Path(sys.prefix, "bin")), os.environ["PATH"]]),
    }
    done = subprocess.run(
        command, cwd=directory, env=os.environ | variables, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_plain_colcon_finds_both_packages(checkout: Path) -> None:
    assert run(["colcon", "list", "--names-only"], checkout).split() == ["bdnn_interfaces", "bdnn_ros"]


@pytest.mark.timeout(400)
def test_colcon_build_makes_packages_that_run(checkout: Path) -> None:
    run(["colcon", "build"], checkout)
    prefix = checkout / "install" / "bdnn_ros"
    assert (prefix / "share/ament_index/resource_index/packages/bdnn_ros").is_file()
    assert (prefix / "share/bdnn_ros/package.xml").is_file()
    for name in ("bdnn", "identification_node", "replay_node"):
        assert os.access(prefix / "lib/bdnn_ros" / name, os.X_OK)
    (bundled,) = prefix.glob("lib/python*/site-packages/bdnn_ros/robots")
    expected = {file.name for file in (ROOT / "bdnn_ros/robots").glob("*.urdf")}
    assert {file.name for file in bundled.glob("*.urdf")} == expected

    sourced = ". install/local_setup.sh && "
    assert "identify" in run(["sh", "-c", sourced + "install/bdnn_ros/lib/bdnn_ros/bdnn --help"], checkout)
    where = (
        "cd / && python -c 'import bdnn_ros, bdnn_interfaces.msg as m; print(bdnn_ros.__file__, m.__file__)'"
    )
    found = run(["sh", "-c", sourced + where], checkout).split()
    assert [Path(file).is_relative_to(checkout / "install") for file in found] == [True, True]
    load = "cd / && python -c 'from bdnn_interfaces.msg import Findings; Findings.__import_type_support__()'"
    run(["sh", "-c", sourced + load], checkout)
