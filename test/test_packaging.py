"""What a ROS 2 machine expects of both packages: index, executables, manifests, interfaces, one version."""

from __future__ import annotations

import ast
import importlib
import os
import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from ament_index_python import packages as ament
from catkin_pkg.package import parse_package

import bdnn_ros
from bdnn_ros.nodes import parameters

ROOT = Path(__file__).resolve().parent.parent
EXECUTABLES = ["bdnn", "identification_node", "replay_node"]
PACKAGES = {"bdnn_ros": ROOT, "bdnn_interfaces": ROOT / "bdnn_interfaces"}

HEADER = {"header": "std_msgs/Header"}
ANSWER = {"success": "boolean", "message": "string"}


def doubles(names: str) -> dict[str, str]:
    """Return fields of type float64[]."""
    return dict.fromkeys(names.split(), "sequence<double>")


def strings(names: str) -> dict[str, str]:
    """Return fields of type string."""
    return dict.fromkeys(names.split(), "string")


JOINT_NAMES = {"joint_names": "sequence<string>"}
VERSION = {"model_version": "uint64"}
MESSAGES = {
    "DynamicsEstimate": {
        **HEADER,
        **JOINT_NAMES,
        **doubles("position velocity acceleration effort_measured effort_estimate effort_std"),
        **doubles("inertial coriolis gravity friction learned mass_matrix"),
        **VERSION,
    },
    "Finding": {
        **strings("effect joint link"),
        "parameter_names": "sequence<string>",
        "units": "sequence<string>",
        **doubles("values stds"),
        "share": "double",
        "probability": "double",
        "rivals": "sequence<string>",
        "sentence": "string",
    },
    "Findings": {
        **HEADER,
        "verdict": "string",
        "findings": "sequence<bdnn_interfaces/Finding>",
        "gain": "double",
        "gain_low": "double",
        "gain_high": "double",
        "advice": "sequence<string>",
    },
}
SERVICES = {
    "InverseDynamics": (
        {**JOINT_NAMES, **doubles("position velocity acceleration")},
        {
            **ANSWER,
            **JOINT_NAMES,
            **doubles("effort effort_std mass_matrix coriolis gravity friction"),
            **VERSION,
        },
    ),
    "ForwardDynamics": (
        {**JOINT_NAMES, **doubles("position velocity effort")},
        {**ANSWER, **JOINT_NAMES, **doubles("acceleration"), **VERSION},
    ),
    "Diagnose": ({"window": "double"}, {**ANSWER, "findings": "bdnn_interfaces/Findings"}),
    "SaveModel": (strings("name"), ANSWER),
    "LoadModel": (strings("name"), ANSWER),
}


@pytest.fixture
def index(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a sourced environment sets: the ament index of this virtual environment, in front."""
    known = os.environ.get("AMENT_PREFIX_PATH")
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(filter(None, [sys.prefix, known])))


@pytest.mark.usefixtures("index")
@pytest.mark.parametrize("package", PACKAGES)
def test_package_is_in_the_ament_index(package: str) -> None:
    share = Path(ament.get_package_share_directory(package))
    assert (share / "package.xml").is_file()
    assert Path(ament.get_package_prefix(package)) == Path(sys.prefix)


@pytest.mark.usefixtures("index")
@pytest.mark.parametrize("directory", ["launch", "config"])
def test_installed_files_are_those_of_the_repository(directory: str) -> None:
    installed = Path(ament.get_package_share_directory("bdnn_ros"), directory)
    expected = {file.name for file in (ROOT / directory).glob("*.*")}
    assert expected
    assert {file.name for file in installed.glob("*.*")} >= expected


@pytest.mark.usefixtures("index")
@pytest.mark.parametrize("name", EXECUTABLES)
def test_ros2_run_finds_the_executable(name: str) -> None:
    executable = Path(ament.get_package_prefix("bdnn_ros"), "lib", "bdnn_ros", name)
    assert os.access(executable, os.X_OK)
    assert os.access(Path(sys.prefix, "bin", name), os.X_OK)


@pytest.mark.parametrize("name", EXECUTABLES)
def test_entry_point_is_there(name: str) -> None:
    (entry,) = metadata.entry_points(group="console_scripts", name=name)
    assert callable(entry.load())


@pytest.mark.parametrize("folder", ["bin", "lib/bdnn_ros"])
def test_command_runs_in_a_bare_environment(folder: str, tmp_path: Path) -> None:
    bare = {"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"}
    command = [str(Path(sys.prefix, folder, "bdnn")), "--help"]
    done = subprocess.run(command, env=bare, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "identify" in done.stdout


def test_one_version_everywhere() -> None:
    manifests = {parse_package(str(folder)).version for folder in PACKAGES.values()}
    installed = {metadata.version(package) for package in PACKAGES}
    assert manifests | installed == {bdnn_ros.__version__}


@pytest.mark.parametrize(
    ("package", "build_type"), [("bdnn_ros", "ament_python"), ("bdnn_interfaces", "ament_cmake")]
)
def test_manifest_is_valid(package: str, build_type: str) -> None:
    manifest = parse_package(str(PACKAGES[package]))
    assert manifest.name == package
    assert manifest.package_format == 3
    assert manifest.get_build_type() == build_type
    assert manifest.licenses == ["Apache-2.0"]


def test_manifest_names_the_messages_that_the_nodes_import() -> None:
    depends = {depend.name for depend in parse_package(str(ROOT)).exec_depends}
    sources = "\n".join(file.read_text(encoding="utf-8") for file in (ROOT / "bdnn_ros/nodes").glob("*.py"))
    imported = set(
        re.findall(r"^\s*(?:from|import) (\w+_(?:msgs|srvs|interfaces)|rclpy)\b", sources, re.MULTILINE)
    )
    assert imported
    assert imported <= depends


@pytest.mark.parametrize("file", sorted((ROOT / "launch").glob("*.py")), ids=lambda file: file.name)
def test_launch_files_set_parameters_that_the_nodes_have(file: Path) -> None:
    known = {
        "identification_node": {setting.name for setting in parameters.IDENTIFICATION},
        "replay_node": {setting.name for setting in parameters.REPLAY},
    }
    calls = [
        call for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))) if isinstance(call, ast.Call)
    ]
    nodes = [
        given
        for given in ({k.arg: k.value for k in call.keywords} for call in calls)
        if "executable" in given
    ]
    assert nodes
    for given in nodes:
        settings = [one for one in ast.walk(given["parameters"]) if isinstance(one, ast.Dict)]
        keys = {ast.literal_eval(key) for one in settings for key in one.keys if key is not None}
        assert (
            keys - {"use_sim_time"}
            and keys - {"use_sim_time"} <= known[ast.literal_eval(given["executable"])]
        )


def test_torch_comes_without_cuda() -> None:
    if not metadata.version("torch").endswith("+cpu"):
        pytest.skip("pip found no CPU build of torch for this Python")
    names = {distribution.metadata["Name"].lower() for distribution in metadata.distributions()}
    assert not {name for name in names if name.startswith(("nvidia-", "cuda-", "triton"))}


@pytest.mark.parametrize("name", MESSAGES)
def test_message_has_the_fields_of_the_contract(name: str) -> None:
    message = getattr(importlib.import_module("bdnn_interfaces.msg"), name)
    assert message.get_fields_and_field_types() == MESSAGES[name]


@pytest.mark.parametrize("name", SERVICES)
def test_service_has_the_fields_of_the_contract(name: str) -> None:
    service = getattr(importlib.import_module("bdnn_interfaces.srv"), name)
    request, response = SERVICES[name]
    assert service.Request.get_fields_and_field_types() == request
    assert service.Response.get_fields_and_field_types() == response


def test_there_is_no_other_interface() -> None:
    generated = {file.stem for kind in ("msg", "srv") for file in (ROOT / "bdnn_interfaces" / kind).iterdir()}
    assert generated == MESSAGES.keys() | SERVICES.keys()
