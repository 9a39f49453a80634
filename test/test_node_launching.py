"""What the launch files hand to the nodes; stand-ins take the place of launch, which pip does not have."""

from __future__ import annotations

import runpy
import sys
import types
from pathlib import Path
from typing import Any

import pytest
import yaml

from bdnn_ros.nodes import parameters

FILE = Path(__file__).parents[1] / "launch" / "replay.launch.py"
DEFAULTS = {setting.name: setting.default for setting in parameters.IDENTIFICATION}


class Made:
    """Anything of launch, with what it was made of."""

    def __init__(self, *given: Any, **named: Any) -> None:
        self.given, self.named = given, named


@pytest.fixture
def described(monkeypatch) -> list[Any]:
    """What the launch file describes, in its order."""
    for name in (
        "launch",
        "launch.actions",
        "launch.event_handlers",
        "launch.events",
        "launch.substitutions",
        "launch_ros",
        "launch_ros.actions",
        "launch_ros.parameter_descriptions",
    ):
        module = types.ModuleType(name)
        module.__getattr__ = lambda attribute: Made  # type: ignore[method-assign]
        module.__path__ = []
        monkeypatch.setitem(sys.modules, name, module)
    return list(runpy.run_path(str(FILE))["generate_launch_description"]().given[0])


def test_played_commands_can_be_what_is_identified_from(described):
    declared = {
        made.given[0]: made.named["default_value"] for made in described if "default_value" in made.named
    }
    (node,) = (made for made in described if made.named.get("executable") == "identification_node")
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
