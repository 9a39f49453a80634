"""What a cause removes, and whether that is worth a name."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bdnn_ros.diagnosis.judging.identifiability import Judgement
from bdnn_ros.diagnosis.regression.gains import Removal, held_out_gain, noticeable, removed
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.result import Quantity
from bdnn_ros.diagnosis.telling import naming
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.effects.registry import get
from bdnn_ros.robot import Robot

EVERY = np.ones((9, 1), bool)
"""Rows of a joint that moves all the time."""


def test_a_finding_is_worth_a_name_where_it_takes_much_or_most_of_the_rest():
    lasting, brief, scale = False, True, np.array([1.0, 10.0])
    assert noticeable(lasting, np.array([0.03, 0.0]) ** 2, np.array([0.05, 0.5]), scale)
    assert not noticeable(lasting, np.array([0.03, 0.0]) ** 2, np.array([0.07, 0.5]), scale)
    assert noticeable(lasting, np.array([0.0, 0.11]) ** 2, np.array([0.5, 0.1]), scale)
    assert not noticeable(lasting, np.array([0.0, 0.11]) ** 2, np.array([0.5, 0.12]), scale)
    assert noticeable(brief, np.array([0.0, 0.06]) ** 2, np.array([0.5, 0.05]), scale)
    assert not noticeable(lasting, np.array([0.0, 0.06]) ** 2, np.array([0.5, 0.05]), scale)
    assert not noticeable(brief, np.array([0.01, 0.01]) ** 2, np.array([0.02, 0.005]), scale)
    assert not noticeable(brief, np.array([-0.03, 0.0]), np.array([0.0, 0.0]), scale)


@pytest.mark.parametrize(
    "name, worth", [("backlash", True), ("coulomb_friction", False), ("external_wrench", False)]
)
def test_what_acts_for_moments_again_and_again_is_judged_by_those(name, worth):
    """4 % of the effort in a twentieth of the rows is 0.9 % of it in all of them."""
    part = np.where(np.arange(4000) % 100 < 5, 0.04, 0.0)[:, None]
    left, (removal,) = removal_of(name, part, [np.ones((4000, 1), bool)])
    assert removal.noticeable == worth
    assert removal.less[0] == pytest.approx(np.mean((left + part) ** 2) - np.mean(left**2))


@pytest.mark.parametrize("until, worth", [(400, True), (3000, False)])
def test_a_push_over_most_of_a_recording_is_not_brief(until, worth):
    """It must remove 1 % of the effort, as all else that is more than the rest, not half a percent."""
    part = np.where(np.arange(4000) < until, 0.008, 0.0)[:, None]
    _, (removal,) = removal_of("external_wrench", part, [np.arange(4000)[:, None] < 400], 0.005)
    assert removal.noticeable == removal.brief == worth


def test_a_push_came_and_went_where_it_hardly_acts():
    part = np.where(np.arange(4000) < 400, 0.04, 0.0)[:, None]
    stretches = [np.arange(4000)[:, None] >= start for start in (380, 300)]
    _, (elsewhere, here) = removal_of("external_wrench", part, stretches)
    assert not elsewhere.there and here.there


def removal_of(name, part, stretches, noise=0.02):
    """What is left by an effect whose effort is known, and what it removes in some rows."""
    left = noise * np.random.default_rng(0).standard_normal((4000, 1))
    pool = SimpleNamespace(
        terms=[SimpleNamespace(effect=get(name))],
        whole=SimpleNamespace(),
        residual_of_all=lambda: left,
        coefficients=lambda fit, chosen: np.ones(1),
    )
    equations = SimpleNamespace(
        columns=SimpleNamespace(of=lambda term: part[:, :, None]),
        rows=SimpleNamespace(effort_scale=np.ones(1)),
    )
    (removals,) = removed(equations, pool, left, *stretches)
    return left, removals


@pytest.mark.parametrize(
    "name, less, steady, told",
    [
        ("backlash", 0.0, True, False),
        ("external_wrench", 0.0, False, False),
        ("external_wrench", 0.1, False, True),
        ("lasting external_wrench", 0.0, True, False),
        ("lasting external_wrench", 0.1, False, False),
        ("coulomb_friction", 0.0, True, False),
        ("coulomb_friction", 0.1, True, True),
        ("coulomb_friction", 0.1, False, False),
    ],
)
def test_what_lasts_is_named_only_where_it_helps_throughout(monkeypatch, name, less, steady, told):
    """On blocks that were not fitted to; all that is named helps in the rows that were held out."""
    lasting, _, name = name.rpartition(" ")
    estimate = SimpleNamespace(term=Term(get(name), 0), shown=True)
    removal = Removal(np.array([less]), less > 0.0, True, get(name).brief and not lasting)
    findings, _ = findings_of(monkeypatch, estimate, removal, Judgement(1.0, 0.0, (), steady))
    assert (findings == [estimate]) is told


@pytest.mark.parametrize(
    "less, nothing, doubtful", [(0.2, 0.01, True), (0.2, 0.6, False), (0.1, 0.01, False)]
)
def test_what_is_large_and_not_known_well_enough_for_a_name_is_no_all_clear(
    monkeypatch, less, nothing, doubtful
):
    """However surely it is there: then the simulation is wrong, and nobody can say what is."""
    estimate = SimpleNamespace(term=Term(get("coulomb_friction"), 0), shown=False, there=False)
    removal = Removal(np.array([less]), True, True, False)
    told = findings_of(monkeypatch, estimate, removal, Judgement(1.0 - nothing, nothing, ()))
    assert told == ([], doubtful)


@pytest.mark.parametrize("nothing, doubtful", [(0.01, True), (0.2, False)])
def test_what_is_surely_there_is_no_all_clear_though_it_is_small_and_its_size_is_not_known(
    monkeypatch, nothing, doubtful
):
    estimate = SimpleNamespace(term=Term(get("payload"), 0, "arm2_link1"), shown=False, there=True)
    removal = Removal(np.array([0.1]), True, True, False)
    told = findings_of(monkeypatch, estimate, removal, Judgement(1.0 - nothing, nothing, ()))
    assert told == ([], doubtful)


@pytest.mark.parametrize("less, share", [(0.3, 0.3), (1.5, 1.0)])
def test_no_cause_removes_more_of_the_error_than_there_is(monkeypatch, less, share):
    """Two that work against each other may each leave more than the simulation did where it goes alone."""
    shares: list[float] = []
    estimate = SimpleNamespace(term=Term(get("backlash"), 0), shown=True)
    removal = Removal(np.array([less]), True, True, True)
    told = Judgement(1.0, 0.0, ())
    findings_of(monkeypatch, estimate, removal, told, lambda *finding: shares.append(finding[3]))
    assert shares == [pytest.approx(share)]


def test_a_share_counts_every_row_alike(monkeypatch):
    """As the gain does: of a joint that moves a third of the time a third of the rows are there."""
    shares: list[float] = []
    usable = np.ones((9, 2), bool)
    usable[np.arange(9) % 3 > 0, 1] = False
    estimate = SimpleNamespace(term=Term(get("coulomb_friction"), 0), shown=True)
    removal = Removal(np.array([0.9, 0.3]), True, True, False)
    findings_of(
        monkeypatch, estimate, removal, Judgement(1.0, 0.0, ()), lambda *one: shares.append(one[3]), usable
    )
    assert shares == [pytest.approx((2 * 0.9 + 1 * 0.3) / 3)]  # of 2 and 1 held-out rows


@pytest.mark.parametrize("blocks", [1, 3, 20])
def test_the_gain_of_a_few_held_out_blocks_has_an_interval(blocks):
    """One block drawn again and again is always the same; its pieces are not."""
    draw = np.random.default_rng(1)
    count = 1200
    block = np.repeat(np.arange(blocks), count // blocks)
    target, extended = draw.standard_normal((count, 2)), 0.5 * draw.standard_normal((count, 2))
    held = np.ones((count, 2), bool)
    held[::7, 1] = False
    gain, (low, high) = held_out_gain(
        SimpleNamespace(rows=SimpleNamespace(block=block, target=target)), extended, held
    )
    left, before = (np.sqrt(np.sum(np.where(held, one, 0.0) ** 2)) for one in (extended, target))
    assert gain == pytest.approx(1.0 - left / before)
    assert 0.005 < high - gain < 0.1 and 0.005 < gain - low < 0.1


@pytest.mark.parametrize("pushed", [True, False])
def test_the_gain_of_what_moves_or_is_pushed_once_is_as_well_known_as_of_what_always_does(pushed):
    """Three draws in ten lack the one of twelve blocks in which all of the error is: they have no gain at all."""
    draw, block = np.random.default_rng(1), np.repeat(np.arange(12), 100)
    once, shape = block == 5, (len(block), 2)
    extended, held = 0.1 * draw.standard_normal(shape), np.ones(shape, bool)
    target = extended + 2.0 * np.outer(once, [0.0, 1.0])
    if not pushed:
        held[:, 1] = once
    where = once if pushed else None
    gain, (low, high) = held_out_gain(
        SimpleNamespace(rows=SimpleNamespace(block=block, target=target)), extended, held, where
    )
    assert 0.7 < low < gain < high < low + 0.1


@pytest.mark.parametrize(
    "own, other, told",
    [
        (0.3, "hysteresis", True),
        (0.01, "hysteresis", False),
        (0.01, "stribeck_friction", True),
    ],
)
def test_what_is_hardly_as_likely_as_its_rivals_has_no_name(monkeypatch, own, other, told):
    """What a likelier law contains is there in either case, whether the rest of that law is borne out or not."""
    rivals = ((Term(get(other), 0), 1.0 - own),)
    estimate = SimpleNamespace(term=Term(get("coulomb_friction"), 0), shown=True)
    removal = Removal(np.array([0.2]), True, True, False)
    findings, doubtful = findings_of(monkeypatch, estimate, removal, Judgement(own, 0.0, rivals))
    assert (findings == [estimate]) is told and doubtful is not told


@pytest.mark.parametrize("std, told", [(0.3, True), (2.0, False)])
def test_that_something_pushed_is_told_only_where_it_is_known_when(monkeypatch, std, told):
    """Though no part of its wrench is known."""
    times = {"start": Quantity(3.0, 0.01, "s"), "end": Quantity(4.5, std, "s")}
    term = Term(get("external_wrench", "link"), 0, "arm2_link1")
    push = SimpleNamespace(term=term, shown=False, possible=True, quantities=times)
    removal = Removal(np.array([0.2]), True, True, True)
    findings, _ = findings_of(monkeypatch, push, removal, Judgement(1.0, 0.0, ()))
    assert (findings == [push]) is told


@pytest.mark.parametrize(
    "name, changing, told",
    [("external_wrench", False, False), ("external_wrench", True, True), ("coulomb_friction", False, True)],
)
def test_no_constant_push_is_named_where_much_is_left(monkeypatch, name, changing, told):
    """A tool that rubs pushed one link with 220 N, said a diagnosis that left four fifths of the error."""
    term = Term(get(name, "link") if name == "external_wrench" else get(name), 0)
    estimate = SimpleNamespace(term=term, shown=True)
    removal = Removal(np.array([0.5]), True, True, term.effect.timed)
    judgement = Judgement(1.0, 0.0, (), changing=changing)
    findings, _ = findings_of(monkeypatch, estimate, removal, judgement, poor=True)
    assert (findings == [estimate]) is told


@pytest.mark.parametrize(
    "name, told, named_so",
    [("cogging", 0.2, True), ("cogging", 0.3, False), ("coulomb_friction", 0.3, True)],
)
def test_a_law_beside_which_inputs_tell_much_is_not_the_one(monkeypatch, name, told, named_so):
    """A bump at a place was cogging, an offset and a push at once; what every joint has may be there besides."""
    estimate = SimpleNamespace(term=Term(get(name), 0), shown=True)
    removal = Removal(np.array([0.5]), True, True, False)
    findings, _ = findings_of(monkeypatch, estimate, removal, Judgement(1.0, 0.0, ()), told=told)
    assert (findings == [estimate]) is named_so


def findings_of(
    monkeypatch,
    estimate,
    held_out,
    judgement,
    tell=lambda robot, estimate, judgement, share: estimate,
    usable=EVERY,
    poor=False,
    told=0.0,
):
    """What is told of one term by what it removes where it was held out; a little of all rows besides."""
    ever = Removal(np.array([0.1]), True, True, held_out.brief)
    monkeypatch.setattr(naming, "removed", lambda *rows: [(held_out, ever)])
    monkeypatch.setattr(naming, "leftover", lambda fitted, every, one: False)
    monkeypatch.setattr(naming, "beyond_links", lambda equations, error, estimate: True)
    monkeypatch.setattr(naming, "_finding", tell)
    target, scale = np.ones(usable.shape), np.ones(usable.shape[1])
    equations = SimpleNamespace(usable=usable, rows=SimpleNamespace(target=target, effort_scale=scale))
    test = np.arange(9) < 2
    attempt = SimpleNamespace(
        test=test, judgements=[judgement], fitted=SimpleNamespace(link_error=0.05), extended=None
    )
    doubts = naming.Doubts(np.zeros(1, bool), np.array([poor]), np.array([told]))
    case = Case([], Robot.bundled("arm2"), equations, attempt, [estimate], SimpleNamespace())
    case.__dict__.update(at_ends=set(), always=set())
    names = naming.named(case, doubts)
    assert names.silent == ([] if names.findings or names.unknown else [0])
    return names.findings, names.doubtful or bool(names.unknown)
