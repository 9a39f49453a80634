"""The house keeps its rules: who imports whom, how long files and functions are, and what no module does."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = "bdnn_ros"
ROOT = Path(__file__).resolve().parent.parent
LEVELS = [
    {"aside", "dynamics", "errors", "stamps", "written"},
    {"readings"},
    {"recording"},
    {"robot", "signals"},
    {"efforts", "left_out", "reported", "rollout"},
    {"scores"},
    {"effects", "bdnn", "physical", "bags"},
    {"checks", "simulation"},
    {"diagnosis"},
    {"extension", "excitation"},
    {"likeness", "models"},
    {"online", "report"},
    {"nodes", "cli"},
]
HEIGHT = {room: level for level, rooms in enumerate(LEVELS) for room in rooms}
WITHIN = {  # of rooms in a room; the modules that are not listed stand above them
    "diagnosis": [
        {"sentences"},
        {"result"},
        {"regression"},
        {"recorded"},
        {"pushes"},
        {"search"},
        {"judging"},
        {"telling"},
    ],
    "online": [{"changed", "stream"}],
}
INNER_HEIGHT = {
    room: {part: level for level, parts in enumerate(levels) for part in parts}
    for room, levels in WITHIN.items()
}
ROS_MODULES = {
    "action_msgs",
    "bdnn_interfaces",
    "builtin_interfaces",
    "diagnostic_msgs",
    "geometry_msgs",
    "rcl_interfaces",
    "rclpy",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "trajectory_msgs",
}
UNSAFE_MODULES = {"cloudpickle", "dill", "jsonpickle", "marshal", "pickle", "shelve"}
UNSAFE_BUILTINS = {"compile", "eval", "exec", "__import__"}
UNSAFE_CALLS = {"os.popen", "os.system", "torch.load", "torch.save", "yaml.load", "yaml.unsafe_load"}
MOST_LINES, MOST_LINES_OF_A_FUNCTION = 320, 60
HEAVY_MODULES = {"matplotlib", "pinocchio", "rclpy", "rosbags", "scipy", "torch"}

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
FILES = sorted((ROOT / PACKAGE).rglob("*.py"))


def module_name(file: Path) -> str:
    """Return the dotted name of a module, without `.__init__`."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported_modules(tree: ast.AST, module: str, is_package: bool) -> Iterator[str]:
    """Yield the full name of all that a module imports, wherever in it; `from a import b` counts as `a.b`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = module.split(".")
                kept = parts[: len(parts) - node.level + is_package]
                base = ".".join([*kept, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def room_of(module: str) -> str | None:
    """Return the room of a module of this package; None for the package itself and for other packages."""
    parts = module.split(".")
    return parts[1] if parts[0] == PACKAGE and len(parts) > 1 and parts[1] in HEIGHT else None


def climbs(module: str, imported: str) -> bool:
    """Return whether a module imports from a part of its own room that is not below its own part."""
    parts, others = module.split("."), imported.split(".")
    if len(parts) < 3 or len(others) < 3 or parts[1] != others[1] or parts[2] == others[2]:
        return False
    heights = INNER_HEIGHT.get(parts[1], {})
    return parts[2] in heights and heights.get(others[2], len(heights)) >= heights[parts[2]]


def problems(source: str, module: str, is_package: bool = False) -> list[str]:
    """Return what a module does against the rules, one sentence each."""
    tree = ast.parse(source)
    room = room_of(module)
    found = []
    if module != PACKAGE and room is None:
        found.append(f"{module} is in none of the rooms")
    for name in imported_modules(tree, module, is_package):
        top = name.split(".")[0]
        other = room_of(name)
        if room and other and other != room and HEIGHT[other] >= HEIGHT[room]:
            found.append(f"{module} imports {name}: {room} may only import what is below it")
        if room and room == other and climbs(module, name):
            found.append(f"{module} imports {name}: within {room} it may only import what is below it")
        if top in ROS_MODULES and room != "nodes":
            found.append(f"{module} imports {name}: only nodes may import ROS 2")
        if top in UNSAFE_MODULES:
            found.append(f"{module} imports {name}")
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            shell = any(word.arg == "shell" and ast.unparse(word.value) != "False" for word in node.keywords)
            unsafe_array = any(word.arg == "allow_pickle" for word in node.keywords)
            if called in UNSAFE_BUILTINS | UNSAFE_CALLS or shell or unsafe_array:
                found.append(f"{module} calls {ast.unparse(node)}")
    return found


def long_functions(source: str) -> list[str]:
    """Return the functions that do not fit a screen, docstrings and all, wherever they are."""
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, FUNCTIONS)]
    lengths = [(one.name, (one.end_lineno or one.lineno) - one.lineno + 1) for one in functions]
    return [f"{name} has {length} lines" for name, length in lengths if length > MOST_LINES_OF_A_FUNCTION]


@pytest.mark.parametrize("file", FILES, ids=module_name)
def test_module_keeps_the_rules(file: Path) -> None:
    source = file.read_text(encoding="utf-8")
    assert problems(source, module_name(file), file.name == "__init__.py") == []


@pytest.mark.parametrize("file", FILES, ids=module_name)
def test_module_is_short(file: Path) -> None:
    source = file.read_text(encoding="utf-8")
    assert len(source.splitlines()) <= MOST_LINES
    assert long_functions(source) == []


def test_a_long_function_is_found_wherever_it_is() -> None:
    def source(lines: int) -> str:
        return "class C:\n    async def f(self):\n" + (lines - 1) * "        pass\n"

    assert long_functions(source(MOST_LINES_OF_A_FUNCTION)) == []
    assert long_functions(source(MOST_LINES_OF_A_FUNCTION + 1)) == ["f has 61 lines"]


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("bdnn_ros.errors", "from bdnn_ros import recording"),
        ("bdnn_ros.signals", "from bdnn_ros.robot import Robot"),
        ("bdnn_ros.robot", "import bdnn_ros.effects.friction"),
        ("bdnn_ros.effects.friction", "def f():\n    from ..physical import parameters"),
        ("bdnn_ros.bdnn.training", "from .. import bags"),
        ("bdnn_ros.cli.main", "from bdnn_ros.nodes import identification_node"),
        ("bdnn_ros.online.trainer", "import rclpy.node"),
        ("bdnn_ros.bags", "from sensor_msgs.msg import JointState"),
        ("bdnn_ros.bags", "import pickle"),
        ("bdnn_ros.effects.base", "eval('1')"),
        ("bdnn_ros.bdnn.modelfile", "import torch\ntorch.load('model.pt')"),
        ("bdnn_ros.cli.info", "import subprocess\nsubprocess.run('ls', shell=True)"),
        ("bdnn_ros.helpers", "x = 1"),
        ("bdnn_ros.diagnosis.search.moves", "from bdnn_ros.diagnosis.judging.attempt import attempt"),
        ("bdnn_ros.diagnosis.telling.case", "from bdnn_ros.diagnosis import diagnose"),
        ("bdnn_ros.online.stream.buffer", "from bdnn_ros.online.changed.scene import Scene"),
    ],
)
def test_a_broken_rule_is_found(module: str, source: str) -> None:
    assert problems(source, module)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("bdnn_ros.nodes.conversions", "import rclpy\nfrom bdnn_ros.online.identifier import Identifier"),
        ("bdnn_ros.effects.friction", "from .base import Effect\nfrom bdnn_ros.robot import Robot"),
        ("bdnn_ros.bdnn.networks", "network.eval()"),
        ("bdnn_ros.diagnosis.search.moves", "from bdnn_ros.diagnosis.search.settling import settle"),
        ("bdnn_ros.diagnosis.judging.attempt", "from bdnn_ros.diagnosis.search import search"),
        (
            "bdnn_ros.online.session",
            "from bdnn_ros.online.stream.buffer import Buffer\nfrom bdnn_ros.online import course",
        ),
    ],
)
def test_what_is_allowed_passes(module: str, source: str) -> None:
    assert problems(source, module) == []


def test_the_command_starts_without_heavy_modules() -> None:
    code = f"import sys, bdnn_ros.cli.main; print(*sorted({HEAVY_MODULES!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
