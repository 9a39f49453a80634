"""Notes by kind, and how their sentences are filled."""

from __future__ import annotations

from pathlib import Path

import pytest

import bdnn_ros
from bdnn_ros.diagnosis.sentences import Kind, Note


def test_a_sentence_is_filled_with_places_shares_and_what_is_compared():
    joints = [f"j{k}" for k in range(10)]
    assert "at j0, j1, j2, j3, j4, j5, j6, j7 ... (10 in all) is far from the earlier model's" in Note(
        Kind.AT_REST, {"joints": joints}
    ).sentence(True)
    beside = Note(Kind.BY_LINKS, {"share": 1.3}).sentence(
        False
    )  # parts that oppose each other may exceed the whole
    assert (
        beside.startswith("Errors of the links' masses and inertias")
        and "100 % of the simulation's" in beside
    )


def test_a_clause_knows_the_values_of_the_whole_and_its_own():
    values = {
        "where": "link6",
        "mass": 1.0,
        "start": 2.0,
        "end": 3.0,
        "when": Note(Kind.BETWEEN, {"end": 4.0}),
    }
    assert "down from 2.0 s to 4.0 s, all through" in Note(Kind.CARRIED, values).sentence(False)


@pytest.mark.parametrize("kind", Kind)
def test_no_sentence_is_told_by_nobody(kind):
    sources = Path(bdnn_ros.__file__).parent.glob("diagnosis/telling/*.py")
    assert any(f"Kind.{kind.name}" in source.read_text(encoding="utf-8") for source in sources)
