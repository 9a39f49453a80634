"""What a service is asked, before any of it is computed."""

from __future__ import annotations

import re

import pytest

from bdnn_ros.errors import UsageError
from bdnn_ros.nodes.conversions import requested

pytestmark = pytest.mark.ros
JOINTS = ("a", "b")


@pytest.mark.parametrize(
    ("names", "position", "said"),
    [
        (["c", "c", "a"], [0.0, 0.0, 0.0], "Unknown joint c; the model has a, b."),
        (["b", "a"], [0.0, 1e300], "position of a is 1e+300, as no robot's can be."),
        (["b", "a"], [-1.1e12, 0.0], "position of b is -1.1e+12, as no robot's can be."),
        ([], [0.0, float("nan")], "position of b is not finite."),
        ([], [float("-inf"), 0.0], "position of a is not finite."),
    ],
)
def test_what_no_robot_can_be_asked_is_refused(names: list[str], position: list[float], said: str) -> None:
    """Streams leave out the same numbers."""
    with pytest.raises(UsageError, match=f"^{re.escape(said)}$"):
        requested(JOINTS, names, {"position": position})


def test_a_request_in_any_order_is_taken_in_the_model_s() -> None:
    index, fields = requested(JOINTS, ["b", "a"], {"position": [1e12, 2.0]})
    assert index.tolist() == [1, 0] and fields["position"].tolist() == [2.0, 1e12]
