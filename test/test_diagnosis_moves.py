"""The moves of a search: what one term gives way to, and what it is not taken for."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import equations_of, term, white

from bdnn_ros.diagnosis.judging.identifiability import judge, plainer
from bdnn_ros.diagnosis.judging.posterior import estimates
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.odds import contains, log_odds
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search import moves as moving
from bdnn_ros.diagnosis.search.candidates import Candidates, acting_per_measured
from bdnn_ros.diagnosis.search.moves import Moves
from bdnn_ros.diagnosis.search.search import Search
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.diagnosis.search.settling import anew
from bdnn_ros.diagnosis.telling.advice import advice
from bdnn_ros.effects.registry import get, parse_spec, variants
from bdnn_ros.robot import Robot
from bdnn_ros.robot.axes import spins

ROTORS = ("armature@arm6_joint1:armature=0.15", "armature@arm6_joint2:armature=0.15")


def test_one_body_gives_way_to_the_rotors_of_two_joints(monkeypatch):
    """No single rotor explains as much as a payload far out on the second link does."""
    robot, equations = Robot.bundled("arm6"), equations_of(ROTORS, robot="arm6")
    candidates = Candidates.of(robot)
    terms = [t for t in candidates.terms if t.effect.name == "armature"]
    terms += [
        t.shaped({"com_x": 0.4, "com_y": -0.2, "com_z": 0.2})
        for t in candidates.terms
        if (t.effect.name, t.link) == ("payload", "arm6_link2")
    ]
    pool = Pool(equations, Noise(np.zeros((6, 3)), 0.03 * equations.rows.effort_scale), terms, 0.02)
    start, moves = [len(terms) - 1], Moves(equations, candidates)

    def ended() -> set[str]:
        other, chosen = moves.descend(pool, list(start), 0.0)
        return {f"{other.terms[c].effect.name}@{other.terms[c].target}" for c in chosen}

    assert ended() == {"armature@0", "armature@1"}
    monkeypatch.setattr(Moves, "_regrow", lambda self, pool, chosen, least: (pool, chosen))
    assert "payload@1" in ended(), "the trap is not there"


def test_a_spring_does_not_give_way_to_a_scale_of_what_it_does(monkeypatch):
    """The load of a joint that carries little is its spring: scaled, that would explain itself."""
    robot, spec = Robot.bundled("arm6"), "joint_spring@arm6_joint6:stiffness=0.5,rest=0.3"
    equations, candidates = equations_of([spec], robot="arm6"), Candidates.of(robot)
    terms = [
        t for t in candidates.terms if t.target == 5 and t.effect.name in ("joint_spring", "effort_scale")
    ]
    noise = Noise(np.zeros((6, 3)), 0.1 * equations.rows.effort_scale)
    spring = next(c for c, t in enumerate(terms) if t.effect.name == "joint_spring")
    pool = Pool(equations, noise, terms, 0.02)
    equations.update_load(*candidates.load(equations, pool, pool.fit([spring])))
    pool, moves = Pool(equations, noise, terms, 0.02), Moves(equations, candidates)
    assert moves._replace(pool, [spring]) == [spring]
    monkeypatch.setattr(moves, "score_beside", lambda pool, rest, one: moves.score(pool, [*rest, one]))
    assert moves._replace(pool, [spring]) == [1 - spring], "the trap is not there"


def test_friction_enters_with_the_delay_that_it_needs(monkeypatch):
    """Friction that a delay shifts makes plain errors larger without it, and the delay says nothing without the friction."""
    robot, place = Robot.bundled("arm6"), "arm6_joint2"
    specs = (f"coulomb_friction@{place}:coulomb=2", f"effort_delay@{place}:delay=0.05")
    equations, candidates = equations_of(specs, robot="arm6"), Candidates.of(robot)
    named = [t for t in candidates.terms if t.effect.name in ("coulomb_friction", "effort_delay")]
    terms = [t.shaped(t.effect.shapes(equations.motion, 1)[0]) for t in named if t.target == 1]
    search = Search(equations, candidates, lambda said: None)
    pool, moves = Pool(equations, search._start()[0], terms, 0.02), Moves(equations, candidates)
    assert sorted(moves._add(pool, [], 0.0)[1]) == [0, 1]
    monkeypatch.setattr(Moves, "_with_partner", lambda self, pool, grown, chosen: None)
    assert moves._add(pool, [], 0.0)[1] == [], "the trap is not there"


def test_nothing_more_is_tried_once_nothing_could_reach_what_is_wanted(monkeypatch):
    """All that is left, together and for nothing, bounds what adding can come to."""
    equations = equations_of(("viscous_friction@arm2_joint1:viscous=1", "base_tilt:pitch_deg=3"))
    terms = [t for t in Candidates.of(Robot.bundled("arm2")).terms if t.effect.name.endswith("s_friction")]
    terms += [Term(get("base_tilt"), -1).shaped({"roll_deg": 0.0, "pitch_deg": 3.0})]
    pool = Pool(equations, Noise(np.zeros((2, 3)), 0.01 * equations.rows.effort_scale), terms, 0.02)
    moves, tilt = Moves(equations, Candidates.of(Robot.bundled("arm2"))), len(terms) - 1
    tried: list[int] = []
    monkeypatch.setattr(moves, "pays", lambda pool, grown, candidate: tried.append(candidate) or True)
    without = pool.evidence_bound([c for c in range(len(terms)) if c != tilt])
    for wanted, trials in ((without - 1.0, True), (without + 1.0, False)):
        tried.clear()
        moves._add(pool, [], 0.0, [tilt], wanted)
        assert bool(tried) == trials


@pytest.mark.parametrize(
    "gained, better",
    [
        ([3.0] * 19 + [-800.0], True),
        ([3.0] * 18 + [-800.0] * 2, False),
        ([0.0] * 19 + [-800.0], False),
        ([3.0, -3.5] * 10, False),
        ([3.0] * 8 + [0.0] * 11 + [-800.0], False),
        ([0.0] * 19 + [60.0], False),
        ([3.0] * 12 + [-1.0] * 8, True),
    ],
)
def test_a_single_block_has_no_veto(gained, better):
    """Something else may have happened in one; what gains in most of the others is borne out all the same."""
    without = np.array(gained)
    pool = SimpleNamespace(
        held_out=lambda chosen: 0.0 * without if chosen else without, disbelief=lambda chosen: 0.0
    )
    equations = SimpleNamespace(rows=SimpleNamespace(block=np.arange(20), blocks=20))
    moves = Moves(equations, Candidates.of(Robot.bundled("arm2")))
    assert moves.predicts_better(pool, (0,), ()) is better


@pytest.mark.parametrize(
    ("law", "left", "pays"),
    [("joint_elasticity", 1.1, False), ("joint_elasticity", 0.9, True), ("viscous_friction", 1.1, True)],
)
def test_a_soft_gear_that_only_trades_with_a_blur_does_not_pay(monkeypatch, law, left, pays):
    """Either is curvature of the load, which a heavy joint's encoder makes enough of; in the extended model is no blur."""
    for name in ("unbelievable", "leftover"):
        monkeypatch.setattr(moving, name, lambda *asked: False)
    monkeypatch.setattr(Moves, "predicts_better", lambda self, pool, one, other: True)
    equations = equations_of()
    whole = np.ones_like(equations.rows.target)
    pool = SimpleNamespace(
        terms=[Term(get("effort_offset"), 0), Term(get(law), 1)],
        sure=whole > 0.0,
        fit=tuple,
        residual=lambda fit, blur=True: whole * (1.0 if len(fit) < 2 else left if not blur else 0.5),
    )
    assert Moves(equations, Candidates.of(Robot.bundled("arm2"))).pays(pool, (0, 1), 1) is pays


@pytest.mark.parametrize(("end", "vetoes"), [(8.0, False), (23.0, True)])
def test_blocks_of_a_brief_push_have_no_veto(end, vetoes):
    """Once one of them is held out the others hardly know the push; one that lasts they do."""
    push = f"external_wrench@arm2_joint1:start=4.5,end={end},torque=4"
    equations = equations_of([push], duration=40.0)
    time = equations.rows.time
    pushed = np.unique(equations.rows.block[(time > 5.0) & (time < 7.5)])
    gained = np.full(equations.rows.blocks, 3.0)
    gained[pushed] = -800.0
    pool = SimpleNamespace(
        held_out=lambda chosen: 0.0 * gained if len(chosen) > 1 else gained,
        disbelief=lambda chosen: 0.0,
        terms=[term(push, Robot.bundled("arm2"))[0]],
    )
    moves = Moves(equations, Candidates.of(Robot.bundled("arm2")))
    assert len(pushed) > 1 and moves.predicts_better(pool, (0, 1), (0,)) is not vetoes


def test_what_a_payload_costs_goes_by_what_its_link_carries():
    """Not by the order in which joints are given."""
    straight = np.array([2, 1, 0])
    links = [Term(get("payload"), k, f"link{k}") for k in range(3)]
    first, inner, last = (log_odds(term, {}, straight) for term in links)
    assert first > inner > last
    assert [log_odds(term, {}, straight[::-1]) for term in links] == [last, inner, first]
    assert log_odds(links[0], {}, np.array([0])) == last


def test_a_delay_of_all_joints_says_what_a_delay_of_one_does():
    delay = get("effort_delay")
    assert contains(Term(delay, -1), Term(delay, 2))
    assert not contains(Term(delay, 2), Term(delay, -1)) and not contains(Term(delay, -1), Term(delay, -1))
    assert not contains(Term(delay, 1), Term(delay, 2))
    assert contains(Term(get("stribeck_friction"), 1), Term(get("coulomb_friction"), 1))
    assert not contains(Term(get("stribeck_friction"), 1), Term(get("coulomb_friction"), 0))


@pytest.mark.parametrize("extra, named", [(0.02, "stribeck_friction"), (0.006, "coulomb_friction")])
def test_friction_that_only_falls_where_a_joint_dwells_has_to_be_worth_a_name(extra, named):
    robot = Robot.bundled("arm2")
    spec = f"stribeck_friction@arm2_joint2:coulomb=0.05,static={0.05 + extra},velocity=0.05"
    equations, (law, coefficients) = equations_of([spec]), term(spec, robot)
    falls = equations.columns.of(law)[:, 1, 1]
    equations.rows.dwelling[:, 1] |= np.abs(falls) > 1e-3 * np.abs(falls).max()
    terms = [law, term("coulomb_friction@arm2_joint2:coulomb=0.05", robot)[0]]
    pool = Pool(equations, Noise(np.zeros((2, 3)), 0.02 * equations.rows.effort_scale), terms, 0.02)
    fit = pool.fit([0])
    assert pool.coefficients(fit, 0) == pytest.approx(coefficients, abs=0.01)
    (told,) = plainer(Selection(pool, (0,), fit)).terms
    assert told.effect.name == named


def test_a_shape_that_only_seems_to_fit_better_is_not_taken():
    """A gain lets other terms leave their bounds; all of them together have to be the likelier for it."""
    robot = Robot.bundled("arm2")
    spec = "stribeck_friction@arm2_joint2:coulomb=0.05,static=0.15,velocity=0.15"
    equations, (true, _) = equations_of([spec]), term(spec, robot)
    wrong = true.shaped({"velocity": 0.3})

    def sought(have: Term, seems: Term) -> Term:
        pool = Pool(equations, Noise(np.zeros((2, 3)), 0.02 * equations.rows.effort_scale), [have], 0.02)
        asked = SimpleNamespace(anew=lambda equations, pool, rest, one: pool.replacing({one: seems}))
        return anew(asked, equations, pool).terms[0]

    assert sought(true, wrong) == true and sought(wrong, true) == true


def test_a_ripple_is_sought_anew_without_the_spring_that_led_it_astray():
    """A slow ripple of the wrong length and a spring bear each other out."""
    specs = ("cogging@arm2_joint1:amplitude=3,periods_per_rev=5.6,phase=1",)
    equations, candidates = equations_of(specs), Candidates.of(Robot.bundled("arm2"))
    terms = [Term(get("joint_spring"), 0), Term(get("cogging"), 0).shaped({"periods_per_rev": 3.0})]
    search = Search(equations, candidates, lambda text: None)
    pool = Pool(equations, Noise(np.zeros((2, 3)), 0.05 * equations.rows.effort_scale), terms, 0.05)
    selection = Selection(pool, (0, 1), pool.whole)
    found = search._without(selection, search._at_own_noise(pool, (0, 1)))
    assert found is not None
    (ripple,) = found.terms
    assert dict(ripple.shape)["periods_per_rev"] == pytest.approx(5.6, abs=0.05)


@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_a_drift_that_goes_nowhere_is_plain_friction(slope):
    """A few rows may have told of it; with all of them it is Coulomb friction, or it is a drift."""
    ends = f"start_value={0.3 - slope},end_value={0.3 + slope},end=12"
    equations = equations_of(
        (f"drift@arm2_joint1:of=coulomb,{ends}", "viscous_friction@arm2_joint2:viscous=0.1")
    )
    terms = [
        Term(next(v for v in variants("drift") if v.variant == "coulomb"), 0),
        Term(get("viscous_friction"), 1),
        Term(get("coulomb_friction"), 0),
    ]
    terms[0] = terms[0].shaped(terms[0].effect.shapes(equations.motion, 0)[0])
    pool = Pool(equations, Noise(np.zeros((2, 3)), 1e-3 * equations.rows.effort_scale), terms, 0.02)
    moves = Moves(equations, Candidates.of(Robot.bundled("arm2")))
    assert set(moves.reconsidered(pool, [0, 1])) == ({0, 1} if slope else {1, 2})


def test_friction_that_was_found_is_not_in_what_an_effort_scale_scales():
    """Where a joint does little but rub, a load that held its friction would explain it once more."""
    equations = equations_of()
    motion, robot = equations.motion, equations.motion.robot
    friction = 0.3 * motion.signals.sign
    own = robot.drive_effort(motion.velocity, motion.acceleration, motion.signals.sign)
    found = motion.with_load(motion.load + friction, own + friction)
    scale = get("effort_scale")
    np.testing.assert_allclose(scale.columns(found, 1, {}), scale.columns(motion, 1, {}), atol=1e-12)
    assert np.abs(found.load - motion.load).max() > 0.2


def test_a_gear_carries_what_acts_and_not_what_is_measured_of_it():
    """What bends it, and the side on which it lies where it is loose, follow the sign and size of that."""
    motion = equations_of().motion
    drive, scale = 0.3 * motion.signals.sign, np.array([0.6, 1.5])
    measured = replace(motion, signals=replace(motion.signals, effort=motion.signals.effort / scale))
    known = measured.with_load(motion.load, drive, scale)
    np.testing.assert_allclose(known.gear_load, motion.signals.effort - drive, atol=1e-12)


@pytest.mark.parametrize(
    "spec", ["viscous_friction@arm2_joint2:viscous=0.2", "effort_offset@arm2_joint2:offset=0.2"]
)
def test_what_is_beside_a_wrong_effort_scale_is_told_as_it_acts(spec):
    """It is measured in the sensor's wrong unit."""
    specs = ("effort_scale@arm2_joint2:scale=0.8", spec)
    equations = equations_of(specs)
    terms = [Term(get(spec.split("@")[0]), 1) for spec in specs]
    pool = Pool(equations, Noise(np.zeros((2, 3)), 1e-3 * equations.rows.effort_scale), terms, 1e-4)
    fit = pool.fit([0, 1])
    assert acting_per_measured(pool, fit, 1) == pytest.approx(0.8, rel=1e-3)
    assert acting_per_measured(pool, fit, 0) == 1.0
    (told,) = estimates(pool, fit)[1].quantities.values()
    assert told.value == pytest.approx(0.8 * 0.2, rel=1e-3)


def test_rivals_are_tried_by_how_far_they_are_behind_within_all_bounds(monkeypatch):
    """A rival that seems far ahead because another term would leave its bound must not crowd out one that is near."""
    specs = ("hysteresis@arm2_joint1:force=0.2,breakaway=0.01", "quadratic_drag@arm2_joint1:drag=0.3")
    robot, equations = Robot.bundled("arm2"), equations_of(specs)
    others = ["viscous_friction@arm2_joint1:viscous=1", "joint_spring@arm2_joint1:stiffness=1"]
    pool = Pool(equations, white(equations, 0.02)[1], [term(s, robot)[0] for s in (*specs, *others)], 0.02)
    search = Search(equations, Candidates.of(robot), lambda text: None)
    tried = []
    monkeypatch.setattr(search.moves, "score", lambda pool, chosen: 100.0)
    monkeypatch.setattr(
        search.moves, "rivals", lambda pool, rest, one: [(3, -1e6), (2, 12.0)] if one == 1 else []
    )
    monkeypatch.setattr(search.moves, "score_beside", lambda pool, rest, rival: {2: 95.0, 3: -400.0}[rival])
    monkeypatch.setattr(search, "_first_better", lambda now, others: tried.extend(make() for make in others))
    assert search._behind_rivals(Selection(pool, (0, 1), pool.fit((0, 1))), pool) is None
    assert [[t.effect.name for t in one.terms] for one in tried] == [["hysteresis", "viscous_friction"]]


@pytest.mark.parametrize("since", [(), None])
def test_less_inertia_of_a_link_that_only_spins_may_be_its_rotors(since):
    """An earlier model shares it out among both blindly; a description without a rotor leaves only the link."""
    robot, spec = Robot.bundled("arm6"), "link_inertia@arm6_link1:scale=0.3"
    assert [spins(robot, joint) for joint in range(6)] == [True] + [False] * 5
    assert not spins(robot.tilted(0.1, 0.0), 0)
    equations = equations_of([spec], "arm6")
    candidates = Candidates.shown_by(equations, since)
    both = {("link_inertia", 0), ("armature", 0)}
    terms = [t for t in candidates.terms if (t.effect.name, t.target) in both]
    terms = [t.shaped(t.shapes(equations.motion)[0]) for t in terms]
    pool = Pool(equations, Noise(np.zeros((6, 3)), 1e-4 * equations.rows.effort_scale), terms, 1e-5)
    link = [t.effect.name for t in terms].index("link_inertia")
    search = Search(equations, candidates, lambda said: None, link_errors=(1e-5,) * 3)
    (judged,) = judge(search, Selection(pool, (link,), pool.fit((link,))))
    assert judged.nothing < 1e-6
    rotors = tuple(pair for pair in judged.rivals if pair[0].effect.name == "armature")
    assert [p for _, p in rotors] == [judged.probability] * (since is not None)
    found = SimpleNamespace(term=pool.terms[link], values={})
    said = advice([found], [replace(judged, rivals=rotors)], robot, lambda one: robot.joints[one.target])
    assert [one.startswith("No motion of this robot tells") for one in said] == [True] * len(rotors)
    sentence = parse_spec(spec, robot).sentence(robot)
    assert "0.3 times the inertia" in sentence and "kg" not in sentence


@pytest.mark.parametrize(
    "hidden, pair, one",
    [
        ("asymmetric_friction@arm2_joint1:positive=1.4,negative=0.6", "effort_offset", True),
        ("coulomb_friction@arm2_joint1:coulomb=1", "viscous_friction", False),
    ],
)
def test_two_causes_that_are_one_by_as_many_numbers_are_joined_late(hidden, pair, one):
    """An offset beside dry friction is uneven friction, which is rarer than either, but not than both; no law with a shape is."""
    specs = [hidden] if one else [hidden, "viscous_friction@arm2_joint1:viscous=0.6"]
    equations, candidates = equations_of(specs, duration=30.0), Candidates.of(Robot.bundled("arm2"))
    wanted = ("coulomb_friction", pair, "asymmetric_friction", "stribeck_friction", "hysteresis")
    shapes = {"stribeck_friction": {"velocity": 0.1}, "hysteresis": {"breakaway": 0.01}}
    own = [t for t in candidates.terms if t.target == 0 and t.effect.name in wanted]
    own = [t.shaped(shapes.get(t.effect.name, {})) for t in own]
    terms = sorted(own, key=lambda t: wanted.index(t.effect.name))
    pool = Pool(equations, Noise(np.zeros((2, 3)), 0.02 * equations.rows.effort_scale), terms, 0.02)
    joined = Moves(equations, candidates).joined(pool, [0, 1])
    assert [pool.terms[c].effect.name for c in joined] == (["asymmetric_friction"] if one else [*wanted[:2]])
