"""What pushes otherwise than constantly: told once, as what it is not, and never as several links that were pushed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import equations_of, term, white

from bdnn_ros.diagnosis.judging.attempt import Attempt, attempted
from bdnn_ros.diagnosis.judging.identifiability import Judgement
from bdnn_ros.diagnosis.judging.posterior import estimates
from bdnn_ros.diagnosis.judging.steadiness import steadied
from bdnn_ros.diagnosis.pushes.pushes import edges
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.search import Search
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.telling import diagnosis_of
from bdnn_ros.diagnosis.telling.unexplained import Remainder
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")
FORCE = {"x": 15.0, "y": -12.0, "z": 10.0}
PIECES = 16


def in_pieces(sizes: Sequence[float], points: Sequence[float] = (0.0,) * PIECES) -> list[str]:
    """A push of link 4 from 5 s to 9 s by pieces that last as long as each other: the size of each, and where it acts [m]."""
    marks = np.linspace(5.0, 9.0, PIECES + 1)
    return [
        f"external_wrench@arm6_link4:start={start},end={end},point_x={point},"
        + ",".join(f"force_{axis}={size * force}" for axis, force in FORCE.items())
        for start, end, size, point in zip(marks[:-1], marks[1:], sizes, points, strict=True)
    ]


MIDDLES = (np.arange(PIECES) + 0.5) / PIECES
HALF_A_SINE = in_pieces(np.sin(np.pi * MIDDLES))
LETS_GO_A_LITTLE = in_pieces(
    np.interp(MIDDLES, [0.0, 0.15, 0.4, 0.5, 0.6, 0.85, 1.0], [0, 1, 1, 0.3, 1, 1, 0])
)
MOVES_ALONG = in_pieces(np.ones(PIECES), 0.4 * MIDDLES - 0.2)
STEADY = [
    "external_wrench@arm6_link3:start=5,end=9,force_x=15,force_y=-12,force_z=10",
    "external_wrench@arm6_link6:start=6,end=8.5,force_x=-10,force_y=8,force_z=12",
]
"""Two constant ones on two links at one time."""
TAKEN_FOR = [
    "external_wrench@arm6_link3:start=5.7,end=8.6,force_x=1",
    "external_wrench@arm6_link2:start=6.2,end=7.7,force_x=1",
    "external_wrench@arm6_joint3:start=5.3,end=8.5,torque=1",
]
"""What a search may take one that changes for."""


def selection_of(true: Sequence[str], chosen: Sequence[str]) -> tuple[Search, Selection]:
    """What a search chose in a recording that holds some pushes, beside pushes of other links."""
    equations = equations_of(true, "arm6")
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    terms = [term(spec, ARM)[0] for spec in chosen]
    links = (term(f"external_wrench@arm6_link{k}:start=5,end=9", ARM)[0] for k in (3, 4, 6))
    pool = Pool(
        equations, model, [*terms, *(t for t in links if t.place not in {o.place for o in terms})], 1e-3
    )
    which = tuple(range(len(terms)))
    return Search(equations, Candidates.of(ARM), lambda text: None), Selection(pool, which, pool.fit(which))


@pytest.mark.parametrize(
    "true, chosen",
    [
        (HALF_A_SINE, ["external_wrench@arm6_link4:start=5.5,end=8.5,force_x=1"]),
        (MOVES_ALONG, TAKEN_FOR),
    ],
)
def test_a_push_that_changes_is_one_on_its_link(true, chosen):
    """However many constant ones of whichever links it was taken for."""
    found, changing = steadied(*selection_of(true, chosen))
    (push,) = found.terms
    (judgement,) = changing.values()
    assert list(changing) == list(found.chosen)
    assert push.link == "arm6_link4" or "arm6_link4" in [rival.link for rival, _ in judgement.rivals]
    start, end = edges(push)
    assert 4.9 < start < 6.0 < 8.0 < end < 9.1
    assert judgement.changing and judgement.nothing < 0.01


def test_an_attempt_ends_with_one_push_and_what_it_leaves(monkeypatch):
    """Several would leave less than can be told."""
    search, selection = selection_of(LETS_GO_A_LITTLE, TAKEN_FOR[:1])
    monkeypatch.setattr(search, "run", lambda first: first)
    equations = search.equations
    attempt = attempted(search, selection, equations.usable, equations.rows.block % 5 == 2)
    (push,), (judgement,) = attempt.fitted.terms, attempt.judgements
    assert push.link == "arm6_link4" and judgement.changing
    time = equations.rows.time
    left = np.abs(attempt.extended).max(axis=1)
    assert left[(time > 6.7) & (time < 7.3)].max() > 5.0 * left[(time < 4.0) | (time > 10.0)].max()


@pytest.mark.parametrize("pushes", [STEADY, STEADY[:1]])
def test_constant_pushes_stay_as_they_are(pushes):
    search, selection = selection_of(pushes, pushes)
    found, changing = steadied(search, selection)
    assert found is selection and not changing


@pytest.mark.parametrize("there_and_back", [True, False])
def test_what_pulls_back_is_no_push_that_changes(there_and_back):
    """Dry friction that is there for a time does so, and whatever else goes with the direction of motion."""
    marks, swings = np.linspace(5.0, 9.0, PIECES + 1), np.sin(3.0 * np.pi * MIDDLES)
    sizes = 8.0 * (swings if there_and_back else np.abs(swings))
    true = [
        f"external_wrench@arm6_joint3:start={start},end={end},torque={size}"
        for start, end, size in zip(marks[:-1], marks[1:], sizes, strict=True)
    ]
    _, changing = steadied(*selection_of(true, ["external_wrench@arm6_joint3:start=5,end=9,torque=1"]))
    assert bool(changing) is not there_and_back


def test_where_something_always_pushes_nothing_tells_whether_it_changes():
    always = ["external_wrench@arm6_link4:start=0,end=12,force_x=1"]
    search, selection = selection_of(HALF_A_SINE, always)
    found, changing = steadied(search, selection)
    assert found is selection and not changing


@pytest.mark.parametrize("changing", [True, False])
def test_a_finding_says_that_it_changes(changing):
    """And what it leaves is explained by nothing, near the noise as the whole recording's may be."""
    _, selection = selection_of(STEADY[:1], STEADY[:1])
    pool = Pool(selection.pool.equations, selection.pool.noise, selection.terms, 1e-3)
    # the noise is the equations' alone: of the last joints it is many times the effort
    equations = replace(
        pool.equations,
        rows=replace(pool.equations.rows, effort_scale=np.maximum(pool.equations.rows.effort_scale, 1.0)),
    )
    nothing = np.zeros_like(equations.rows.target)
    attempt = Attempt(
        equations.rows.block % 5 == 2,
        [Judgement(0.9, 0.0, (), changing=changing)],
        pool,
        pool.residual_of_all(),
    )
    remainder = Remainder(np.full(6, 10.0), {}, nothing)
    diagnosis = diagnosis_of(Case([], ARM, equations, attempt, estimates(pool, pool.whole), remainder))
    (finding,) = diagnosis.findings
    assert ("Its force changes meanwhile" in finding.sentence) is changing
    assert diagnosis.verdict == ("partly_explained" if changing else "explained")
