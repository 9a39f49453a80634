"""What is worth a name: how much it does, when it acts, and whether a simpler law says as much."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import equations_of

from bdnn_ros.diagnosis.judging import identifiability, simplified
from bdnn_ros.diagnosis.judging.attempt import Attempt
from bdnn_ros.diagnosis.judging.identifiability import Judgement, folded, likelier, plainer, weighed
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.diagnosis.telling.naming import Doubts
from bdnn_ros.diagnosis.telling.outcome import Outcome
from bdnn_ros.effects.registry import get, variants
from bdnn_ros.robot import Robot


def test_a_finding_gives_way_to_a_rival_that_is_likelier():
    one, other, third = Term(get("hysteresis"), 0), Term(get("cogging"), 0), Term(get("armature"), 1)
    sure = Judgement(0.98, 0.0, ())
    assert told_of([one, other, third], (0, 2), Judgement(0.01, 0.0, ((other, 0.97),)), sure) == {
        "cogging",
        "armature",
    }
    assert told_of([one, other, third], (0, 2), Judgement(0.3, 0.0, ((other, 0.6),)), sure) == {
        "cogging",
        "armature",
    }
    assert told_of([one, other, third], (0, 2), Judgement(0.51, 0.0, ((other, 0.49),)), sure) is None
    assert told_of([one, other, third], (0, 2), Judgement(0.01, 0.9, ()), sure) is None
    assert told_of([one, other, third], (0, 2), Judgement(0.02, 0.9, ((other, 0.08),)), sure) is None


def test_a_push_does_not_give_way_to_one_that_is_a_toss_against_it():
    one, other = (Term(get("external_wrench"), 0, f"arm2_link{k}") for k in (1, 2))
    assert told_of([one, other], (0,), Judgement(0.4, 0.0, ((other, 0.6),))) is None
    plainly = Judgement(0.02, 0.0, ((other, 0.97),))
    assert told_of([one, other], (0,), plainly) == {"external_wrench"}, (
        "or it would be named with no probability"
    )


@pytest.mark.parametrize("needed", [True, False])
def test_what_takes_the_place_of_a_law_keeps_the_part_of_it_that_it_needs(needed):
    """Drag beside Coulomb friction may look like a Stribeck law: that has the Coulomb friction in itself."""
    names = ("stribeck_friction", "quadratic_drag", "coulomb_friction")
    terms = [Term(get(name), 0) for name in names]
    judgement = Judgement(0.06, 0.0, ((terms[1], 0.94),))
    told = {"quadratic_drag", "coulomb_friction"} if needed else {"quadratic_drag"}
    assert told_of(terms, (0,), judgement, worth={2: 1.0 if needed else -1.0}) == told


@pytest.mark.parametrize(
    "probabilities, borne_out, told",
    [
        ((0.6, 0.4), False, "coulomb_friction"),
        ((0.9, 0.1), False, None),
        ((0.4, 0.6), False, "coulomb_friction"),
    ],
)
@pytest.mark.parametrize("law", ["stribeck_friction", "hysteresis"])
def test_a_law_is_named_only_where_it_is_plainly_likelier_than_a_part_of_it(
    law, probabilities, borne_out, told
):
    terms = [Term(get(law), 0), Term(get("coulomb_friction"), 0)]
    judgement = Judgement(probabilities[0], 0.0, ((terms[1], probabilities[1]),))
    assert told_of(terms, (0,), judgement, borne_out=borne_out) == (told and {told})


@pytest.mark.parametrize("likely, told", [(0.51, None), (0.79, None), (0.9, {"backlash"})])
def test_what_another_settles_into_gives_way_to_it_only_where_that_is_plainly_likelier(likely, told):
    """A gap that the motion hardly crosses is a wrong zero: seen from the gap's side the zero is named."""
    zero, gap = Term(get("position_offset"), 0), Term(get("backlash"), 0)
    assert told_of([zero, gap], (0,), Judgement(1.0 - likely, 0.0, ((gap, likely),))) == told


@pytest.mark.parametrize(
    "probabilities, borne_out, beyond, told",
    [
        ((0.4, 0.6), True, 0.1, None),
        ((0.1, 0.9), False, 0.1, None),
        ((0.1, 0.9), True, 0.1, "stribeck_friction"),
        ((0.1, 0.9), True, 0.005, None),
        ((0.01, 0.99), False, 0.1, None),
    ],
)
def test_a_plainly_likelier_law_takes_over_where_held_out_blocks_bear_it_out(
    monkeypatch, probabilities, borne_out, beyond, told
):
    """And where it says more than nobody would name."""
    monkeypatch.setattr(identifiability, "_beyond", lambda pool, fit, one, part: beyond)
    terms = [Term(get("coulomb_friction"), 0), Term(get("stribeck_friction"), 0), Term(get("armature"), 1)]
    judgement = Judgement(probabilities[0], 0.0, ((terms[1], probabilities[1]),))
    found = told_of(terms, (0, 2), judgement, Judgement(0.98, 0.0, ()), borne_out=borne_out)
    assert found == (told and {told, "armature"})


@pytest.mark.parametrize(
    "beyond, own, listed", [(0.005, 0.95, ["cogging"]), (0.1, 0.05, ["drift", "cogging"])]
)
def test_a_richer_law_that_hardly_says_more_is_no_rival(monkeypatch, beyond, own, listed):
    """Where it is the likelier one the plain law would be named with no probability."""
    monkeypatch.setattr(identifiability, "_beyond", lambda pool, fit, one, part: beyond)
    terms = [Term(get(name), 0) for name in ("viscous_friction", "cogging")]
    terms.append(Term(next(v for v in variants("drift") if v.variant == "viscous"), 0))
    judgement = Judgement(0.05, 0.0, ((terms[2], 0.9), (terms[1], 0.05)))
    pool = SimpleNamespace(terms=terms, fit=lambda chosen: tuple(chosen))
    (found,) = folded(SimpleNamespace(pool=pool, chosen=(0,)), [judgement])
    assert found.probability == pytest.approx(own)
    assert [rival.effect.name for rival, _ in found.rivals] == listed


def test_what_says_the_same_is_listed_however_many_others_are():
    """The error of the link that a payload hangs on, not that of any other link."""
    load, same, other = (
        Term(get(name), joint, f"arm2_link{joint + 1}")
        for name, joint in (("payload", 1), ("link_inertia", 1), ("link_inertia", 0))
    )
    others = [(Term(get("armature"), joint), 0.1 + 0.01 * joint) for joint in range(8)]
    listed = identifiability._listed(load, [(same, 0.0), (other, 0.0), *others])
    assert listed == (*others[:2:-1], (same, 0.0))
    assert not identifiability._listed(load, [(other, 0.0)])


@pytest.mark.parametrize("better", [True, False])
def test_a_term_is_steady_where_blocks_that_had_no_say_bear_it_out(better):
    asked = []
    moves = SimpleNamespace(predicts_better=lambda pool, one, other: asked.append((one, other)) or better)
    pool = SimpleNamespace(terms=[Term(get("armature"), joint) for joint in range(8)])
    selection = SimpleNamespace(pool=pool, chosen=(4, 7))
    found = weighed(SimpleNamespace(moves=moves), selection, [Judgement(1.0, 0.0, ())] * 2)
    assert asked == [((4, 7), [7]), ((4, 7), [4])]
    assert [one.steady for one in found] == [better, better]


@pytest.mark.parametrize("there", [None, "coulomb_friction", "asymmetric_friction"])
@pytest.mark.parametrize("shown", [False, True])
def test_a_law_that_is_not_shown_is_told_as_what_it_settles_into(monkeypatch, shown, there):
    """Unless that is told already, or a law that contains it."""
    names = ["viscous_friction", "hysteresis", *[there] * bool(there)]
    told, refitted = told_plainly(
        monkeypatch, names, "coulomb_friction@arm2_joint1:coulomb=0.3", {"breakaway": 0.001}, shown
    )
    wanted = names if shown else ["viscous_friction", there or "coulomb_friction"]
    assert [t.effect.name for t in refitted.terms] == [t.effect.name for t in told.fitted.terms] == wanted
    assert len(told.judgements) == len(wanted)
    if not (shown or there):
        assert told.judgements[1].probability == pytest.approx(0.9)
        assert [rival.effect.name for rival, _ in told.judgements[1].rivals] == ["viscous_friction"]


@pytest.mark.parametrize(
    "beyond, wanted",
    [((2.9, 9.0), "coulomb_friction"), ((9.0, 1.9), "coulomb_friction"), ((3.1, 2.1), "hysteresis")],
)
def test_a_law_that_says_hardly_more_than_what_it_settles_into_is_told_as_that(monkeypatch, beyond, wanted):
    """However well it is known itself: by all rows, and by those where no joint dwells."""
    names = ["viscous_friction", "hysteresis"]
    truth, shape = "coulomb_friction@arm2_joint1:coulomb=0.3", {"breakaway": 0.001}
    told, refitted = told_plainly(monkeypatch, names, truth, shape, True, beyond)
    for pool in (told.fitted, refitted):
        assert [t.effect.name for t in pool.terms] == ["viscous_friction", wanted]


def test_a_gap_that_is_not_shown_is_told_as_the_zero_that_fits(monkeypatch):
    told, refitted = told_plainly(
        monkeypatch, ["armature", "backlash"], "position_offset@arm2_joint1:offset=0.2", {"crossing": 0.01}
    )
    for pool in (told.fitted, refitted):
        assert [t.effect.name for t in pool.terms] == ["armature", "position_offset"]
        assert dict(pool.terms[1].shape)["at"] == pytest.approx(0.2, abs=0.02)
        assert pool.coefficients(pool.whole, 1)[0] == pytest.approx(0.2, abs=0.02)


def test_where_no_joint_dwells_shapes_of_dry_friction_are_found_anew_beside_all_else():
    equations = equations_of([])
    equations.rows = replace(
        equations.rows, dwelling=np.arange(len(equations.rows.samples))[:, None] % 50 == [-1, 0]
    )
    counted = equations.usable.copy()
    names = ("coulomb_friction@1", "armature@1", "stribeck_friction@0")
    terms = [Term(get(name), int(joint)) for name, joint in (one.split("@") for one in names)]
    terms[2] = terms[2].shaped({"velocity": 0.1})
    pool = Pool(equations, Noise(np.zeros((2, 1)), 0.01 * equations.rows.effort_scale), terms, 0.05)
    seen = []

    def refined(equations, pool, fit, one):
        seen.append((one, fit.terms))
        return pool.terms[one]

    simplified._exact(SimpleNamespace(refined=refined), equations, pool)
    assert seen == [(0, (0, 1, 2)), (1, (0, 1, 2))]
    np.testing.assert_array_equal(equations.usable, counted & ~equations.rows.dwelling)


def told_plainly(monkeypatch, names, truth, shape, shown=False, beyond=(np.inf, np.inf)):
    """The attempt and the pool that are told of some laws of the first joint, the second of this shape."""
    equations = equations_of([truth])
    terms = [Term(get(name), 0) for name in names]
    terms[1] = terms[1].shaped(shape)
    pool = Pool(equations, Noise(np.zeros((2, 1)), 0.01 * equations.rows.effort_scale), terms, 0.05)
    plain = Term(get(terms[1].effect.settles_into), 0)
    judgements = [Judgement(0.7, 0.0, ((plain, 0.2), (terms[0], 0.1))) for _ in terms]
    attempt = Attempt(np.zeros(len(equations.rows.samples), bool), judgements, pool, equations.rows.target)
    law = terms[1].effect.name
    monkeypatch.setattr(
        simplified,
        "estimates",
        lambda pool, fit: [SimpleNamespace(term=t, shown=shown or t.effect.name != law) for t in pool.terms],
    )
    candidates = Candidates.of(equations.motion.robot)
    surely = simplified._surely(*([one] * len(terms) for one in beyond))
    told, refitted, found = simplified._plain(candidates, equations, attempt, pool, surely)
    assert len(found) == len(refitted.terms)
    return told, refitted


def told_of(terms, chosen, *judgements, borne_out=True, worth=MappingProxyType({})):
    """What is told once the likelier has taken its place; None where nothing gives way.

    Args:
        worth: what terms add to a score; the others nothing.
    """
    pool = SimpleNamespace(terms=terms, fit=lambda chosen: tuple(chosen))
    moves = SimpleNamespace(
        predicts_better=lambda pool, one, other: borne_out,
        score=lambda pool, chosen: sum(worth.get(c, 0.0) for c in chosen),
    )
    better = likelier(SimpleNamespace(moves=moves), SimpleNamespace(pool=pool, chosen=chosen), judgements)
    return None if better is None else {terms[c].effect.name for c in better.chosen}


@pytest.mark.parametrize(
    "spec, law",
    [
        ("asymmetric_friction@arm2_joint1:positive=0.3,negative=0.299", "coulomb_friction"),
        ("asymmetric_friction@arm2_joint1:positive=0.3,negative=0.1", "asymmetric_friction"),
        ("hysteresis@arm2_joint1:force=0.1,breakaway=0.0005", "coulomb_friction"),
        ("hysteresis@arm2_joint1:force=0.3,breakaway=0.05", "hysteresis"),
        ("viscous_friction@arm2_joint1:viscous=0.3", "viscous_friction"),
        ("backlash@arm2_joint1:gap=0.0002,crossing=0.0005", "backlash"),
    ],
)
def test_a_law_gives_way_to_a_part_of_it_that_says_as_much(spec, law):
    """However surely it is the better one: nobody would name the difference."""
    pool, one, _ = pool_with_law(spec)
    (found,) = plainer(Selection(pool, (one,), pool.fit([one]))).terms
    assert found.effect.name == law


@pytest.mark.parametrize("breakaway, told", [(0.001, False), (0.05, True)])
def test_a_law_beside_a_part_of_it_has_to_earn_its_own_name(breakaway, told):
    """Dry friction told as two, which hardly differ, is dry friction."""
    spec = f"hysteresis@arm2_joint1:force=0.15,breakaway={breakaway}"
    pool, law, part = pool_with_law(spec, "coulomb_friction@arm2_joint1:coulomb=0.3")
    chosen = (law, part)
    names = [t.effect.name for t in plainer(Selection(pool, chosen, pool.fit(chosen))).terms]
    assert names == ["hysteresis"] * told + ["coulomb_friction"]


def pool_with_law(spec, *beside):
    """Everything that acts on the first joint, where a law does; and which of it are the law and its Coulomb friction."""
    robot, equations = Robot.bundled("arm2"), equations_of([spec, *beside])
    terms = [t for t in Candidates.of(robot).terms if t.target == 0 and not t.effect.timed]
    terms = [t.shaped(t.effect.shapes(equations.motion, 0, t.link)[0]) for t in terms]
    name, names = spec.partition("@")[0], [t.effect.name for t in terms]
    key, one = {"hysteresis": "breakaway", "backlash": "crossing"}.get(name), names.index(name)
    terms[one] = terms[one].shaped({key: float(spec.rpartition("=")[2])} if key else {})
    noise = Noise(np.zeros((2, 3)), 1e-4 * equations.rows.effort_scale)
    return Pool(equations, noise, terms, 0.02), one, names.index("coulomb_friction")


@pytest.mark.parametrize(
    "extended, named",
    [
        ((0.5, 0.02), True),
        ((1.01, 0.02), True),  # a large joint's error is what it was, a small one's is explained
        ((1.2, 0.02), False),  # as shares of their efforts both together are better, in N·m they are worse
        ((0.5, 0.4), False),
    ],
)
def test_nothing_is_named_where_held_out_errors_grow(extended, named):
    """By share of each joint's effort, or in all: what helps a wrist is no cause where it harms the shoulder."""
    equations, near = equations_of(duration=30.0), np.zeros(2, bool)
    equations.rows = replace(equations.rows, effort_scale=np.array([20.0, 0.5]))
    case = SimpleNamespace(equations=equations, simulation=np.array([1.0, 0.1]), extended=np.array(extended))
    case.predictable, case.near = near, lambda error: near
    unfit = Doubts.of(case).unfit
    assert not unfit.any() if named else unfit.all()
    case.near = lambda error: ~near
    assert not Doubts.of(case).unfit.any()


@pytest.mark.parametrize(
    ("near", "said", "verdict"),
    [(True, True, "explained"), (True, False, "partly_explained"), (False, True, "partly_explained")],
)
def test_causes_explain_a_recording_where_little_is_left_and_little_has_no_name(
    monkeypatch, near, said, verdict
):
    monkeypatch.setattr(Outcome, "_unclear", False)
    case = SimpleNamespace(extended=0.0, near=lambda error: np.array([near]))
    case.attempt = SimpleNamespace(judgements=[])
    known = {"names": SimpleNamespace(unsaid=0.4 if said else 0.6), "doubted": [], "jumps": []}
    for causes, told in (([SimpleNamespace()], verdict), ([], "nothing_wrong" if near else "cannot_tell")):
        outcome = Outcome(case)
        outcome.__dict__.update(known, causes=causes)
        assert outcome.verdict == told
