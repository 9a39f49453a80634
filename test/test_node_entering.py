"""What a node is before it is one: its modules are imported, and Ctrl-C may come meanwhile."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
INTERRUPTED = """import os, signal, time
os.kill(os.getpid(), signal.SIGINT)
time.sleep(10)
"""


@pytest.mark.parametrize("node", ["identification_node", "replay_node"])
def test_ctrl_c_while_a_node_is_imported_ends_it_without_a_word(tmp_path: Path, node: str) -> None:
    (tmp_path / "rclpy.py").write_text(INTERRUPTED)
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    program = f"""import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # not as whoever started the tests has it
from bdnn_ros.nodes.{node} import main
sys.exit(main())
"""
    words = [sys.executable, "-c", program]
    ended = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "")
