"""Lets pip build the interfaces into an environment that holds ROS 2's wheels; colcon uses CMakeLists.txt."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py

from distutils.command.install_data import install_data  # isort: skip (setuptools brings its own)

NAME = "bdnn_interfaces"
SOURCE = Path(__file__).resolve().parent


class BuildInterfaces(build_py):
    """Generates and compiles the interfaces with CMake and picks up the Python package that comes out."""

    def run(self) -> None:
        stage = staging_folder(self)
        build = stage.parent
        shutil.rmtree(build, ignore_errors=True)  # a CMake cache of another environment misleads
        environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix, "CMAKE_PREFIX_PATH": sys.prefix}
        cmake = shutil.which("cmake", path=os.path.join(sys.prefix, "bin")) or "cmake"
        definitions = [
            f"-DCMAKE_INSTALL_PREFIX={stage}",
            "-DCMAKE_BUILD_TYPE=Release",
            f"-DPython3_EXECUTABLE={sys.executable}",
            "-DBUILD_TESTING=OFF",
        ]
        for arguments in (
            ["-S", str(SOURCE), "-B", str(build), *definitions],
            ["--build", str(build), "--parallel", str(os.cpu_count() or 1)],
            ["--install", str(build)],
        ):
            subprocess.run([cmake, *arguments], check=True, env=environment)
        (package,) = stage.glob(f"l*/python*/*-packages/{NAME}")
        shutil.copytree(package, Path(self.build_lib, NAME), dirs_exist_ok=True)


class InstallInterfaces(install_data):
    """Ships all that is not Python as it lies below the prefix: libraries, headers and the ament index."""

    def run(self) -> None:
        stage = staging_folder(self)
        for file in sorted(path for path in stage.rglob("*") if path.is_file()):
            relative = file.relative_to(stage)
            if not any(part.startswith("python") for part in relative.parts):
                self.data_files.append((str(relative.parent), [str(file)]))
        super().run()


class InterfaceDistribution(Distribution):
    """A distribution that is compiled, so that its wheel is tied to the platform and the Python version."""

    def has_ext_modules(self) -> bool:
        return True

    def has_pure_modules(self) -> bool:
        return True

    def has_data_files(self) -> bool:
        return True


def staging_folder(command: build_py | install_data) -> Path:
    """Return the folder that CMake installs into, one for each platform and Python version."""
    return Path(command.get_finalized_command("build").build_temp, "stage").resolve()


setup(
    name=NAME,
    version="0.1.0",
    description="Messages and services of bdnn_ros.",
    license="Apache-2.0",
    maintainer="bdnn_ros developers",
    maintainer_email="dev@example.com",
    python_requires=">=3.10",
    packages=[],
    data_files=[],
    distclass=InterfaceDistribution,
    cmdclass={"build_py": BuildInterfaces, "install_data": InstallInterfaces},
    zip_safe=False,
)
