"""Command lines that ROS does not understand, of either node: one sentence, no traceback."""

from __future__ import annotations

import subprocess
import sys

import pytest
from live_support import environment

from bdnn_ros.nodes.beginning import told

pytestmark = pytest.mark.ros


def test_an_error_in_a_transition_is_told_of(capsys):
    @told
    def on_configure(state: str) -> str:
        return {"unconfigured": "inactive"}[state]

    assert on_configure("unconfigured") == "inactive" and on_configure.__name__ == "on_configure"
    with pytest.raises(KeyError):
        on_configure("finalized")
    assert "KeyError: 'finalized'" in capsys.readouterr().err


@pytest.mark.parametrize("node", ["identification_node", "replay_node"])
@pytest.mark.parametrize(
    ("arguments", "reason"),
    [(["-p"], "trailing -p flag"), (["-p", "joints"], "'-p joints'"), (["--nonsense"], "--nonsense")],
)
def test_arguments_that_ros_does_not_understand(node, arguments, reason):
    command = [sys.executable, "-m", f"bdnn_ros.nodes.{node}", "--ros-args", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment(88))
    assert done.returncode == 2
    assert done.stdout == "" and done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"{node}: error: ROS cannot start") and reason in done.stderr
