"""The layouts for PlotJuggler and Foxglove show fields that the node publishes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from bdnn_interfaces.msg import DynamicsEstimate, Findings

pytestmark = pytest.mark.ros

CONFIG = Path(__file__).resolve().parent.parent / "config"
TOPICS = {
    "/identification_node/estimate": DynamicsEstimate,
    "/identification_node/effort_estimate": JointState,
    "/identification_node/findings": Findings,
    "/joint_states": JointState,
    "/diagnostics": DiagnosticArray,
}
PARTS = {"effort_measured", "effort_estimate", "inertial", "coriolis", "gravity", "friction", "learned"}


def field(path: str, separator: str) -> str:
    """The field of a path as `TOPIC.FIELD[INDEX]`; fails where the topic or the field is not there."""
    topic, _, rest = path.rpartition(separator)
    assert topic in TOPICS, path
    match = re.fullmatch(r"(\w+)\[\d+\]", rest)
    assert match, path
    assert match[1] in TOPICS[topic].get_fields_and_field_types(), path
    return match[1]


def entries(value: Any, key: str) -> Iterator[Any]:
    """Values of a key, however deep."""
    if isinstance(value, dict):
        for name, inner in value.items():
            if name == key:
                yield inner
            yield from entries(inner, key)
    elif isinstance(value, list):
        for inner in value:
            yield from entries(inner, key)


def test_foxglove():
    layout = json.loads((CONFIG / "foxglove.json").read_text())
    paths = [path["value"] for paths in entries(layout, "paths") for path in paths]
    assert {field(path, ".") for path in paths} == PARTS
    shown = [*entries(layout, "topicPath"), *entries(layout, "topicToRender")]
    assert shown and set(shown) <= set(TOPICS)
    placed = [x for key in ("first", "second") for x in entries(layout["layout"], key) if isinstance(x, str)]
    assert set(placed) == set(layout["configById"])


def test_plotjuggler():
    root = ElementTree.parse(CONFIG / "plotjuggler.xml").getroot()
    curves = [curve.attrib["name"] for curve in root.iter("curve")]
    assert {field(curve, "/") for curve in curves} == PARTS
    assert {topic.attrib["name"] for topic in root.iter("topic")} <= set(TOPICS)
    for splitter in root.iter("DockSplitter"):
        assert len(splitter) == int(splitter.attrib["count"]) == len(splitter.attrib["sizes"].split(";"))
