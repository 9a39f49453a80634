"""A push that comes twice: told twice, of one link, and either with the other's place among its rivals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import equations_of, term, white

from bdnn_ros.diagnosis.judging.identifiability import judge
from bdnn_ros.diagnosis.pushes.pushes import edges
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.gathering import gathered
from bdnn_ros.diagnosis.search.moves import Moves
from bdnn_ros.diagnosis.search.search import Search
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm6")
TRUSTING = 1e-3
"""Belief in the links that leaves a push to nothing else."""
FIRST = "external_wrench@arm6_link5:start=2,end=4.5,force_x=12,force_z=-6,point_x=0.08,point_z=0.05"
SECOND = "external_wrench@arm6_link5:start=7,end=10,force_x=12,force_z=-6,point_x=0.08,point_z=0.05"
BOTH = "external_wrench@arm6_link5:start=2,end=10,force_x=12,force_z=-6,point_x=0.08,point_z=0.05"
AGAINST = "external_wrench@arm6_joint3:start=4.5,end=7,torque=5"
ELSEWHERE = "external_wrench@arm6_link4:start=4.5,end=7,force_x=-12"


def pool_of(true: list[str], told: list[str]) -> Pool:
    """A pool of what is told on a recording of what is true; the first may act once more."""
    equations = equations_of(true, "arm6")
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    terms = [term(spec, ARM)[0] for spec in told]
    return Pool(equations, model, [*terms, replace(terms[0], again=1)], TRUSTING)


def times_of(pool: Pool, chosen: list[int]) -> list[tuple[str | None, int, float, float]]:
    """Where the chosen push, and when."""
    return sorted((pool.terms[c].link, pool.terms[c].again, *edges(pool.terms[c])) for c in chosen)


@pytest.mark.parametrize("against", [[AGAINST], [ELSEWHERE], [AGAINST, ELSEWHERE]])
def test_two_pushes_are_not_one_as_long_as_both_and_another_against_it(against):
    pool = pool_of([FIRST, SECOND], [BOTH, *against])
    score = Moves(pool.equations, Candidates.of(ARM)).score
    parted, chosen = gathered(pool, list(range(1 + len(against))), ARM, score)
    assert [one[:2] for one in times_of(parted, chosen)] == [("arm6_link5", 0), ("arm6_link5", 1)]
    times = [one[2:] for one in times_of(parted, chosen)]
    np.testing.assert_allclose(times, [(2.0, 4.5), (7.0, 10.0)], atol=5e-3)


@pytest.mark.parametrize("other", [AGAINST, "external_wrench@arm6_joint2:start=4.5,end=7,torque=8"])
def test_one_push_within_the_time_of_another_stays(other):
    pool = pool_of([BOTH, other], [BOTH, other])
    found, chosen = gathered(pool, [0, 1], ARM, Moves(pool.equations, Candidates.of(ARM)).score)
    assert chosen == [0, 1] and edges(found.terms[0]) == pytest.approx((2.0, 10.0), abs=5e-3)


def test_what_pushes_a_link_twice_is_no_rival_of_itself():
    """But where one link was pushed another push may have been at that link, too."""
    told = [
        FIRST,
        "external_wrench@arm6_link6:start=7,end=10,force_x=1",
        "payload@arm6_link2:mass=1",
    ]
    pool = pool_of([FIRST, SECOND], told)
    search = Search(pool.equations, Candidates.of(ARM), lambda text: None)
    again = pool.replacing({3: pool.terms[3].shaped(dict(term(SECOND, ARM)[0].shape))})
    for judgement in judge(search, Selection(again, (0, 3), again.fit((0, 3)))):
        assert all(rival.link != "arm6_link5" for rival, _ in judgement.rivals)
    _, second = judge(search, Selection(pool, (0, 1), pool.fit((0, 1))))
    assert [(rival.link, rival.again) for rival, _ in second.rivals] == [("arm6_link5", 1)]


def test_where_something_pushes_it_may_do_so_once_more():
    pool = pool_of([FIRST, SECOND], [FIRST])
    alone = Pool(pool.equations, pool.noise, pool.terms[:1], TRUSTING)
    shaped = Candidates.of(ARM).shaped(pool.equations, alone, alone.whole)
    (more,) = (one for one in shaped if one.spot == alone.terms[0].spot)
    assert more.again == 1 and edges(more) == pytest.approx((7.0, 10.0), abs=0.1)
