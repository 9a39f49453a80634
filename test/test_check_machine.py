"""`make setup` says in one line what the machine lacks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parent.parent / "scripts" / "check_machine.py"


def check(path: str) -> subprocess.CompletedProcess[str]:
    """Run the check with a search path for programs."""
    command = [sys.executable, "-S", str(SCRIPT)]
    return subprocess.run(command, env={"PATH": path}, capture_output=True, text=True, check=False)


def test_a_machine_that_built_the_environment_lacks_nothing() -> None:
    done = check("/usr/local/bin:/usr/bin:/bin")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_missing_tools_are_named_in_one_line_with_the_remedy(tmp_path: Path) -> None:
    done = check(str(tmp_path))
    assert done.returncode == 1
    assert done.stderr == "missing: make g++; install with: sudo apt-get install make g++\n"
