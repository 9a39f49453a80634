"""Which terms of a fit have a name."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.telling.naming import _with_its_sample
from bdnn_ros.effects.registry import get


@pytest.mark.parametrize(
    ("name", "value", "tells"), [("delay", 0.0025, False), ("delay", 0.006, True), ("armature", 0.0025, True)]
)
def test_half_a_sample_is_no_delay(name, value, tells):
    """Whether an effort is of a sample's start, middle or end is its driver's matter: at 200 Hz 2.5 ms."""
    effect = get("effort_delay" if name == "delay" else name)
    coefficients, shape = effect.coefficients({name: value})
    known = np.eye(1)
    estimate = Estimate(Term(effect, 0, None, tuple(shape.items())), coefficients, known, known, known)
    equations = SimpleNamespace(motion=SimpleNamespace(signals=SimpleNamespace(raw_rate=200.0)))
    assert _with_its_sample(estimate, equations) is not tells
