"""The recipe of docs/on_your_robot.md that makes a bag of a table, and where `bdnn` points to it."""

from __future__ import annotations

import re
import runpy
import textwrap
from pathlib import Path

import numpy as np
import pytest
from bag_cases import EPOCH

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.simulate import simulate

PAGE = Path(__file__).parent.parent / "docs" / "on_your_robot.md"
HEADING = "### Without a bag: from a CSV"


def recipe() -> str:
    """The code under the heading, as it stands there."""
    section = PAGE.read_text(encoding="utf-8").partition(HEADING)[2].partition("\n#")[0]
    (code,) = re.findall(r"(?:^    .*\n|^\n(?=    ))+", section, re.MULTILINE)
    return textwrap.dedent(code)


@pytest.mark.parametrize("epoch", [0, EPOCH])
def test_the_recipe_makes_a_bag_of_a_table(tmp_path, capsys, monkeypatch, epoch):
    arm = Robot.bundled("arm2").urdf.replace("arm2_joint", "joint")
    made = simulate(Robot.from_urdf(arm), [], seed=2, duration=12.0, rate=100.0).recording
    columns = (epoch * 1e-9 + made.time)[:, None], made.position, made.velocity, made.effort
    rows = np.concatenate(columns, axis=1)
    head = "time,q1,q2,v1,v2,tau1,tau2"
    # a logger that wrote a row twice
    np.savetxt(
        tmp_path / "log.csv",
        np.insert(rows, 7, rows[7], axis=0),
        delimiter=",",
        header=head,
        comments="",
        fmt="%.12g",
    )
    (tmp_path / "robot.urdf").write_text(arm)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recipe.py").write_text(recipe())
    runpy.run_path("recipe.py")
    read = bags.read(tmp_path / "log.mcap")
    assert read.joints == ("joint1", "joint2") and read.urdf == arm and not read.notes
    np.testing.assert_allclose(read.time, made.time, atol=1e-2 if epoch else 1e-8)
    for name in ("position", "velocity", "effort"):
        np.testing.assert_allclose(getattr(read, name), getattr(made, name), rtol=1e-9, atol=1e-9)
    assert main(["info", "log.mcap"]) == 0
    assert capsys.readouterr().out.endswith("Fit for identification.\n")


@pytest.mark.parametrize("name", ["log.csv", "log.CSV", "log.txt", "log.npz"])
def test_a_table_is_refused_with_what_makes_a_bag_of_it(tmp_path, capsys, name):
    (tmp_path / name).write_text("time,q1\n0,1\n")
    assert main(["info", str(tmp_path / name)]) == 2
    error = capsys.readouterr().err
    assert "is not a bag" in error and f'docs/on_your_robot.md, "{HEADING.removeprefix("### ")}"' in error
    assert error.count("\n") == 1 and HEADING in PAGE.read_text(encoding="utf-8")
