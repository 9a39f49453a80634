"""What the launch files hand to the nodes; stand-ins take the place of launch, which pip does not have."""

from __future__ import annotations

import runpy
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from bdnn_ros.nodes import parameters

FOLDER = Path(__file__).parents[1] / "launch"
DEFAULTS = {setting.name: setting.default for setting in parameters.IDENTIFICATION}


class Made:
    """Anything of launch, with what it was made of."""

    def __init__(self, *given: Any, **named: Any) -> None:
        self.given, self.named = given, named


@pytest.fixture
def described(monkeypatch) -> Callable[[str], list[Any]]:
    """What a launch file describes, in its order."""
    for name in (
        "launch",
        "launch.actions",
        "launch.event_handlers",
        "launch.events",
        "launch.substitutions",
        "launch_ros",
        "launch_ros.actions",
        "launch_ros.parameter_descriptions",
        "launch_ros.substitutions",
    ):
        module = types.ModuleType(name)
        module.__getattr__ = lambda attribute: Made  # type: ignore[method-assign]
        module.__path__ = []
        monkeypatch.setitem(sys.modules, name, module)
    return lambda name: list(runpy.run_path(str(FOLDER / name))["generate_launch_description"]().given[0])


def defaults(described: list[Any]) -> dict[str, Any]:
    """What stands for each argument that is not given."""
    return {made.given[0]: made.named["default_value"] for made in described if "default_value" in made.named}


def test_played_commands_can_be_what_is_identified_from(described):
    made_of = described("replay.launch.py")
    declared = defaults(made_of)
    (node,) = (made for made in made_of if made.named.get("executable") == "identification_node")
    (given,) = node.named["parameters"]
    assert declared["effort_source"] == DEFAULTS["effort_source"]
    assert [joint for joint in yaml.safe_load(declared["joints"]) if joint] == DEFAULTS["joints"]
    for name in ("effort_source", "joints"):
        (configuration,) = given[name].given
        assert configuration.given == (name,)
    # launch takes no empty list, and knows a list of text by this type alone
    assert (
        yaml.safe_load(declared["joints"]) and str(given["joints"].named["value_type"]) == "typing.List[str]"
    )


@pytest.mark.parametrize(
    "given", [{}, {"use_sim_time": "true"}, {"model_directory": "/models", "use_sim_time": "false"}]
)
def test_a_parameter_file_holds_but_for_what_is_given_beside_it(described, given):
    *declared, late = described("identification.launch.py")
    context = types.SimpleNamespace(launch_configurations={**defaults(declared), **given})
    (node,) = late.named["function"](context)
    file, *others = node.named["parameters"]
    assert file.given == ("params_file",)
    assert [name for each in others for name in each] == list(given)
    assert all(each[name].given[0].given == (name,) for each in others for name in each)
