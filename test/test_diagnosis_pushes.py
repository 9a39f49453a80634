"""Where a push acts: the point of contact, its link, its times between rows; and one push told as one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import equations_of, signals_of, term, white

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.judging.identifiability import judge
from bdnn_ros.diagnosis.judging.posterior import estimates
from bdnn_ros.diagnosis.pushes import pushes
from bdnn_ros.diagnosis.pushes.between import between_rows
from bdnn_ros.diagnosis.pushes.contact import contact, distance, point_of
from bdnn_ros.diagnosis.pushes.pushes import (
    best_push,
    edges,
    leftover,
    nearest,
    refined_push,
    reshaped,
    throughout,
    together,
    unseen,
)
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.search.candidates import Candidates
from bdnn_ros.diagnosis.search.gathering import gathered
from bdnn_ros.diagnosis.search.moves import Moves
from bdnn_ros.diagnosis.search.search import Search
from bdnn_ros.diagnosis.search.selection import Selection
from bdnn_ros.diagnosis.search.settling import refined
from bdnn_ros.effects.environment import POINT, ExternalWrench
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.robot import Robot
from bdnn_ros.simulation import simulate

ARM = Robot.bundled("arm6")
TRUSTING = 1e-3
"""Belief in the links that leaves a push to nothing else."""


def pool_of(spec: str, others: Sequence[str] = (), std: float = 0.02, seed: int = 0) -> Pool:
    """A pool of some terms on a recording that holds a push."""
    equations = equations_of([spec], "arm6")
    noise, model = white(equations, std, seed)
    equations = equations.with_target(equations.rows.target + noise)
    return Pool(equations, model, [term(other, ARM)[0] for other in others], TRUSTING)


@pytest.mark.parametrize("point", [(0.05, 0.0, 0.09), (-0.08, 0.06, 0.02), (0.0, -0.2, 0.1)])
@pytest.mark.parametrize("link", ["arm6_link4", "arm6_link6"])
def test_a_force_is_found_at_its_point_of_contact(link, point):
    x, y, z = point
    spec = f"external_wrench@{link}:start=3,end=8,force_x=12,force_y=4,force_z=-6,"
    spec += f"point_x={x},point_y={y},point_z={z}"
    pool = pool_of(spec)
    fit = pool.fit(())
    _, found = best_push(pool, fit, term(spec, ARM)[0], ARM)
    force, torque = np.split(pool.gain_of(fit, found)[1], 2)
    np.testing.assert_allclose(point_of(found), point, atol=0.01)
    np.testing.assert_allclose(force, [12.0, 4.0, -6.0], atol=0.3)
    assert np.linalg.norm(torque) < 0.1


def test_a_point_is_found_from_one_at_which_no_force_does_anything():
    """The second link's origin lies on both axes before it: seen from there no direction is the better one."""
    push = "external_wrench@arm6_link2:start=3,end=8,force_x=-12,force_y=9,force_z=-14,point_x=0.09,point_z=-0.03"
    pool = pool_of(push)
    fit, true = pool.fit(()), term(push, ARM)[0]
    origin = true.shaped({**dict(true.shape), **dict.fromkeys(POINT, 0.0)})
    found = contact(pool, fit, origin)
    gains = [pool.gain_of(fit, one)[0] for one in (origin, found, true)]
    assert found is not None and gains[1] > gains[2] - 2.0 > gains[0] + 100.0


def test_a_torque_stays_where_it_is_told_from():
    spec = "external_wrench@arm6_link5:start=3,end=8,force_x=8,torque_x=1.5,torque_y=-2,torque_z=1"
    pool = pool_of(spec)
    _, found = best_push(pool, pool.fit(()), term(spec, ARM)[0], ARM)
    np.testing.assert_array_equal(point_of(found), 0.0)


def test_times_are_found_between_rows():
    spec = "external_wrench@arm6_joint2:start=3.317,end=6.571,torque=8"
    pool = pool_of(spec)
    fit, true = pool.fit(()), dict(term(spec, ARM)[0].shape)
    _, rough = best_push(pool, fit, term(spec, ARM)[0], ARM)
    gain, fine = between_rows(pool, fit, rough, ARM)
    assert gain == pytest.approx(pool.gain_of(fit, fine)[0])
    error = [max(abs(dict(one.shape)[edge] - true[edge]) for edge in true) for one in (rough, fine)]
    assert error[1] < 0.002 < 0.01 < error[0]
    assert pool.gain_of(fit, fine)[0] > pool.gain_of(fit, rough)[0]


def test_a_time_that_no_row_tells_is_not_told_as_certain():
    """The joint rests about the push's end: it may have ended at any time meanwhile."""
    spec = "external_wrench@arm6_joint2:start=3.3,end=6.5,torque=8"
    pool = pool_of(spec, others=[spec])
    equations, push = pool.equations, pool.terms[0]
    assert unseen(pool, push) == {"start": 0.0, "end": 0.0}
    time = equations.rows.time
    equations.use_rows(equations.usable & ((time < 6.2) | (time > 7.0))[:, None])
    pool = Pool(equations, pool.noise, [push], TRUSTING)
    (found,) = estimates(pool, pool.whole)
    assert unseen(pool, push) == pytest.approx({"start": 0.0, "end": 0.8}, abs=0.1)
    stds = found.quantities["start"].std, found.quantities["end"].std
    assert 1.0 / equations.motion.signals.raw_rate < stds[0] < 0.01 and 0.3 < stds[1] < 1.2


@pytest.mark.parametrize("start", [0.0, 3.3])
def test_how_well_a_time_is_known_does_not_hang_on_the_clock(start):
    """Nor is a push that was there from the first row on known to have begun just then."""
    spec = f"external_wrench@arm6_joint2:start={start},end=6.5,torque=8"
    pool = pool_of(spec, others=[spec])
    (found,) = estimates(pool, pool.whole)
    stds = found.quantities["start"].std, found.quantities["end"].std
    assert 1e-4 < stds[1] < 0.01
    assert stds[0] == pytest.approx(stds[1], rel=1.0) if start else stds[0] > 10.0 * stds[1]


def test_how_well_a_point_is_known_does_not_hang_on_its_coordinates():
    spec = "external_wrench@arm6_link6:start=3,end=8,force_z=12,point_x=0.05,point_y=0.04,point_z=0.0"
    pool = pool_of(spec, others=[spec])
    (found,) = estimates(pool, pool.whole)
    assert all(1e-4 < found.quantities[axis].std < 1e-3 for axis in POINT)


def test_times_and_a_point_of_its_own_are_found_together():
    """Each is wrong by what the other is; apart, they stay so."""
    spec = "external_wrench@arm6_link6:start=3.317,end=6.571,force_x=12,force_z=-6,point_x=0.03,point_y=-0.02,point_z=0.05"
    pool = pool_of(spec, std=1e-4)
    fit, true = pool.fit(()), dict(term(spec, ARM)[0].shape)
    _, rough = best_push(pool, fit, term(spec, ARM)[0], ARM)
    _, fine = between_rows(pool, fit, rough, ARM)
    for one, within in ((rough, False), (fine, True)):
        assert (max(abs(dict(one.shape)[name] - value) for name, value in true.items()) < 5e-4) is within


def test_a_push_is_refined_though_other_terms_are_held_at_their_bounds_without_it():
    """Friction would have to push forwards to do what the push does; it is none the less what friction leaves."""
    push = "external_wrench@arm6_link6:start=3.317,end=6.571,force_x=12,force_y=-20,force_z=-6"
    worn = [f"coulomb_friction@arm6_joint{k}:coulomb=0.02" for k in range(1, 7)]
    worn += [f"viscous_friction@arm6_joint{k}:viscous=0.02" for k in range(1, 7)]
    equations = equations_of([push, *worn], "arm6")
    noise, model = white(equations, 1e-3)
    equations = equations.with_target(equations.rows.target + noise)
    pool = Pool(equations, model, [term(spec, ARM)[0] for spec in worn], TRUSTING)
    without, true = pool.whole, term(push, ARM)[0]
    assert (without.coefficients[pool.base :] == 0.0).sum() > 3
    rough = true.shaped({**dict(true.shape), "start": 3.4, "end": 6.5})
    found = dict(refined_push(pool, without, rough, ARM).shape)
    assert max(abs(found[name] - value) for name, value in true.shape) < 1e-3


def test_how_strong_a_push_may_be_does_not_follow_from_how_weak_the_last_joint_is():
    push = term("external_wrench@arm6_link6:start=3,end=8,force_x=12", ARM)[0]
    equations = equations_of([], "arm6")
    columns = equations.columns.of(push)
    usual = equations.spread(push, columns)
    equations.rows = replace(
        equations.rows, effort_scale=equations.rows.effort_scale * np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1e-4])
    )
    np.testing.assert_allclose(equations.spread(push, columns), usual, rtol=0.05)
    assert usual[:3].min() > 1.0


@pytest.mark.parametrize("far", [False, True])
def test_nothing_pushes_a_link_further_from_it_than_a_wrench_may_act(far):
    push = term("external_wrench@arm6_link6:start=3,end=8,force_x=12", ARM)[0]
    assert push.effect.shape_allowed({**dict(push.shape), "point_z": 1.5 if far else 0.5}) is not far


def test_which_link_of_two_that_a_push_says_as_much_of_stays_open():
    """A force on the last joint's axis: no evidence, however large, tells its link from the one before."""
    spec = "external_wrench@arm6_link6:start=3,end=8,force_x=12,force_y=5,force_z=-6,point_z=0.103"
    times = "start=3,end=8,force_x=1"
    pool = pool_of(spec, [f"external_wrench@arm6_link{k}:{times}" for k in (5, 6)], std=1e-3)
    search = Search(pool.equations, Candidates.of(ARM), lambda text: None)
    for one in (0, 1):
        pushed = reshaped(pool, [], ARM)
        (judgement,) = judge(search, Selection(pushed, (one,), pushed.fit((one,))))
        ((rival, probability),) = judgement.rivals
        assert rival.link == pool.terms[1 - one].link and 0.1 < probability < 0.9


@pytest.mark.parametrize(
    ("scores", "best"), [((1e5, 1e5 - 5.0, 0.0), 1), ((1e5, 1e5 - 50.0, 0.0), 0), ((10.0, 5.0, 9.9), 0)]
)
def test_of_links_that_are_a_toss_the_one_whose_middle_was_pushed_is_told(scores, best):
    """A hundredth of a push is a ten-thousandth of its evidence; a torque about a joint is another thing."""
    pool = pool_of(
        "external_wrench@arm6_link6:start=3,end=8,force_x=12,point_z=0.103",
        [
            "external_wrench@arm6_link5:start=3,end=8,force_x=12,point_y=0.1,point_z=0.1",
            "external_wrench@arm6_link6:start=3,end=8,force_x=12,point_z=0.103",
            "external_wrench@arm6_joint5:start=3,end=8,torque=1",
        ],
    )
    assert distance(pool.terms[1], ARM) < 0.01 < distance(pool.terms[0], ARM)
    assert nearest(pool, dict(enumerate(scores)), 0.0, ARM) == best


def test_wrenches_on_neighbours_give_way_to_the_one_that_explains_all():
    times = "start=3,end=8"
    true = f"external_wrench@arm6_link5:{times},force_x=12,force_z=-6,point_x=0.08,point_z=0.05"
    told = [
        f"external_wrench@arm6_link4:{times},force_x=1",
        f"external_wrench@arm6_link6:{times},force_x=1",
        f"external_wrench@arm6_joint3:{times},torque=1",
        "coulomb_friction@arm6_joint1:coulomb=1",
    ]
    pool = pool_of(true, [*told, f"external_wrench@arm6_link5:{times},force_x=1"])
    moves = Moves(pool.equations, Candidates.of(ARM))
    pool, chosen = gathered(pool, [0, 1, 2, 3], ARM, moves.score)
    assert [(pool.terms[c].effect.name, pool.terms[c].target) for c in chosen] == [
        ("coulomb_friction", 0),
        ("external_wrench", 4),
    ]
    np.testing.assert_allclose(point_of(pool.terms[chosen[-1]]), [0.08, 0.0, 0.05], atol=0.01)


def test_two_pushes_at_different_times_stay_two():
    first, second = (
        "external_wrench@arm6_joint2:start=2,end=4,torque=8",
        "external_wrench@arm6_joint4:start=7,end=9,torque=2",
    )
    equations = equations_of([first, second], "arm6")
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    pool = Pool(equations, model, [term(spec, ARM)[0] for spec in (first, second)], TRUSTING)
    _, chosen = gathered(pool, [0, 1], ARM, Moves(equations, Candidates.of(ARM)).score)
    assert sorted(chosen) == [0, 1]


def test_a_push_in_two_pieces_is_told_as_one():
    """One that seems over too early, its point not quite found, and what is left of it, told of another link."""
    true = "external_wrench@arm6_link5:start=3,end=8,force_x=12,force_z=-6,point_x=0.08,point_z=0.05"
    first = "external_wrench@arm6_link5:start=3,end=5,force_x=12,force_z=-6,point_x=0.07,point_z=0.06"
    pool = pool_of(true, [first, "external_wrench@arm6_link4:start=5.1,end=8,force_x=1"])
    pool, chosen = gathered(pool, [0, 1], ARM, Moves(pool.equations, Candidates.of(ARM)).score)
    (push,) = (pool.terms[c] for c in chosen)
    assert push.link == "arm6_link5"
    np.testing.assert_allclose(edges(push), [3.0, 8.0], atol=5e-3)
    np.testing.assert_allclose(point_of(push), [0.08, 0.0, 0.05], atol=2e-3)


def test_two_pushes_that_follow_each_other_stay_two():
    specs = [
        "external_wrench@arm6_link5:start=3,end=5,force_x=12,force_z=-6",
        "external_wrench@arm6_link5:start=5,end=8,force_x=-3,force_y=9",
    ]
    equations = equations_of(specs, "arm6")
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    pool = Pool(equations, model, [term(spec, ARM)[0] for spec in specs], TRUSTING)
    pool, chosen = gathered(pool, [0, 1], ARM, Moves(equations, Candidates.of(ARM)).score)
    times = sorted(edges(pool.terms[c]) for c in chosen)
    np.testing.assert_allclose(times, [(3.0, 5.0), (5.0, 8.0)], atol=0.05)


@pytest.mark.parametrize(
    ("times", "same"), [((3.0, 5.0), True), ((4.0, 6.1), False), ((3.9, 6.0), True), ((6.0, 8.0), False)]
)
def test_pushes_are_together_where_they_last_over_each_other(times, same):
    one, _ = term("external_wrench@arm6_joint2:start=3,end=5,torque=1", ARM)
    other = one.shaped(dict(zip(("start", "end"), times, strict=True)))
    assert together(one, other) is together(other, one) is same
    assert not together(one, term("coulomb_friction@arm6_joint2:coulomb=1", ARM)[0])


@pytest.mark.parametrize(
    ("other", "left"),
    [
        ("external_wrench@arm6_joint3:start=3,end=8,torque=60", True),
        ("external_wrench@arm6_joint3:start=3,end=8,torque=10", False),
        ("external_wrench@arm6_joint3:start=2.6,end=8.3,torque=10", True),
        ("external_wrench@arm6_joint3:start=8,end=11,torque=60", False),
        ("coulomb_friction@arm6_joint3:coulomb=60", False),
    ],
)
def test_what_a_constant_push_leaves_is_no_second_push(other, left):
    """Where the second does a fiftieth of what the first does at its time, or begins and ends with it."""
    small = "external_wrench@arm6_joint4:start=2.5,end=8.5,torque=1"
    equations = equations_of([small, other], "arm6")
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    pool = Pool(equations, model, [term(spec, ARM)[0] for spec in (small, other)], TRUSTING)
    assert [leftover(pool, (0, 1), one) for one in range(2)] == [left, False]


@pytest.mark.parametrize(("lasts", "left"), [(0.3, True), (0.8, False)])
def test_a_moment_of_a_crossing_is_no_push(lasts, left):
    """A gap that is crossed a little later than its model says leaves what a short push would."""
    gap = "backlash@arm2_joint2:gap=0.02,crossing=0.02"
    equations, robot = equations_of([gap]), Robot.bundled("arm2")
    loose, amount = term(gap, robot)
    time = equations.rows.time
    crossed = time[np.argmax(np.abs(equations.columns.of(loose) @ amount)[:, 1])]
    push, _ = term(
        f"external_wrench@arm2_joint1:start={crossed - 0.5 * lasts},end={crossed + 0.5 * lasts},torque=1",
        robot,
    )
    _, model = white(equations, 0.02)
    pool = Pool(equations, model, [loose, push], TRUSTING)
    assert [leftover(pool, (0, 1), one) for one in range(2)] == [False, left]


def test_what_a_creeping_joint_shows_is_no_push(monkeypatch):
    """There dry friction is anything up to that of standing. A joint of this arm creeps for moments only."""
    monkeypatch.setattr(pushes, "RESOLVED", 0.0)
    equations, robot = equations_of(), Robot.bundled("arm2")
    time, speed = equations.motion.time, np.abs(equations.motion.velocity[:, 1])
    inside = (time > 2.0) & (time < 10.0)
    times = {
        left: time[inside][pick(speed[inside])] for left, pick in ((True, np.argmin), (False, np.argmax))
    }
    for left, middle in times.items():
        spec = f"external_wrench@arm2_joint2:start={middle - 0.05},end={middle + 0.05},torque=1"
        equations = equations_of([spec])
        _, model = white(equations, 0.02)
        pool = Pool(equations, model, [term(spec, robot)[0]], TRUSTING)
        assert leftover(pool, (0,), 0) is left


@pytest.mark.parametrize(("lasts", "left"), [(0.28, True), (0.35, False)])
def test_what_is_over_within_the_low_pass_is_no_push(lasts, left):
    spec = f"external_wrench@arm2_joint1:start=5,end={5.0 + lasts},torque=4"
    equations = equations_of([spec])
    _, model = white(equations, 0.02)
    assert leftover(Pool(equations, model, [term(spec, Robot.bundled("arm2"))[0]], TRUSTING), (0,), 0) is left


@pytest.mark.parametrize(("moves", "always"), [((2.0, 9.0), False), ((4.5, 7.5), True)])
def test_what_acts_whenever_its_joint_moves_is_no_push(moves, always):
    """Of a joint that moves now and then, what differs between its moves looks like a push that begins and ends at rest."""
    spec = "external_wrench@arm6_joint3:start=4,end=8,torque=40"
    equations = equations_of([spec], "arm6")
    time = equations.rows.time
    rows = equations.usable.copy()
    rows[:, 2] &= (time > moves[0]) & (time < moves[1])
    equations.use_rows(rows)
    _, model = white(equations, 0.02)
    pool = Pool(equations, model, [term(spec, ARM)[0]], TRUSTING)
    assert throughout(pool, (0,), 0) is always


@pytest.mark.parametrize(("times", "kept"), [("start=3,end=8", False), ("start=8.5,end=10.5", True)])
def test_a_push_that_another_one_needs_beside_it_at_its_time_is_no_gain(times, kept):
    """Two on different links at one time say more than one; either may be what the other leaves."""
    large, small = (
        "external_wrench@arm6_joint3:start=3,end=8,torque=10",
        f"external_wrench@arm6_joint4:{times},torque=1",
    )
    equations = equations_of([large, small], "arm6")
    noise, model = white(equations, 0.02)
    equations = equations.with_target(equations.rows.target + noise)
    alone, both = (
        Pool(equations, model, [term(spec, ARM)[0] for spec in specs], TRUSTING)
        for specs in ([large], [small, large])
    )
    search = Search(equations, Candidates.of(ARM), lambda text: None, (TRUSTING,) * 3)
    assert (search._first_better(alone, [lambda: both]) is not None) is kept


def test_a_point_of_a_link_pulls_by_its_jacobian():
    signals = signals_of("arm6")
    motion = Motion(signals, ARM, np.zeros_like(signals.position))
    point = np.array([0.1, -0.2, 0.3])
    jacobian = ARM.link_jacobian(signals.position, "arm6_link6", point)
    expected = signals.soften(np.swapaxes(jacobian, 1, 2))
    shape = dict(zip(POINT, point.tolist(), strict=True))
    pull = -motion.soft_pulls("arm6_link6") @ ExternalWrench().mixing(shape)
    np.testing.assert_allclose(pull, expected, atol=1e-12)


@pytest.mark.parametrize("lead", [0.0, 0.01])
@pytest.mark.parametrize("passing", [False, True])
@pytest.mark.parametrize(
    "spec",
    [
        "external_wrench@arm6_link4:start=3.0213,end=4.9,force_x=5,point_y=0.1",
        "external_wrench@arm6_link2:start=-1,end=20,torque_z=1",
        "external_wrench@arm6_link6:start=5.9,end=6.3,force_z=5",
        "external_wrench@arm6_joint3:start=0,end=0.4,torque=1",
    ],
)
def test_rows_of_a_push_are_its_columns_behind_the_low_pass(spec, passing, lead):
    """Also across a gap, and where an earlier model has friction in proportion to the load."""
    equations, (one, _) = equations_of([], "arm6"), term(spec, ARM)
    half = len(equations.motion.time) // 2
    signals = replace(equations.motion.signals, segments=(slice(0, half), slice(half, 2 * half)))
    rng = np.random.default_rng(0)
    more = rng.uniform(1.0, 1.5, signals.position.shape) if passing else None
    motion = Motion(signals, ARM, equations.motion.load)
    decimation = replace(equations.decimation, simulated=motion, load_friction_factor=more, lead=lead)
    equations = replace(equations, decimation=decimation)
    columns = one.effect.columns(motion, one.target, dict(one.shape), one.link)
    np.testing.assert_allclose(
        equations.columns.fresh(one), equations.decimation.as_rows(columns), rtol=0.0, atol=1e-12
    )
    assert np.abs(equations.columns.fresh(one)).max() > 0.1


@pytest.mark.slow
def test_a_push_that_no_part_of_is_known_is_told_all_the_same():
    """A single joint shows one torque of it: nothing is wrong would be wrong."""
    robot = Robot.bundled("arm2")
    spec = "external_wrench@arm2_link1:start=8,end=10,force_x=28,force_y=-24,force_z=-12,point_x=-0.05,point_z=-0.02"
    simulated = simulate(robot, [parse_spec(spec, robot)], seed=3, duration=20.0)
    told = diagnose([simulated.recording], robot)
    (push,) = told.findings
    assert push.effect == "external_wrench" and told.verdict == "explained"
    assert push.parameters["start"].value == pytest.approx(8.0, abs=0.1)
    assert push.parameters["end"].value == pytest.approx(10.0, abs=0.1)
    assert all(
        abs(q.value) < 2.0 * q.std for name, q in push.parameters.items() if name[:5] in ("force", "torqu")
    )


@pytest.mark.parametrize("start, better", [(5.0, False), (3.05, True)])
def test_a_push_keeps_its_window_where_another_explains_less_beside_all_else(start, better):
    """Sought where the others stand alone, and bend to do without it, a push may be found in quite another place."""
    spec = "external_wrench@arm6_link6:start={},end=8,force_x=8"
    pool = pool_of(spec.format(3), [spec.format(3.3), "effort_scale@arm6_joint2:scale=0.9"])
    sought = term(spec.format(start), ARM)[0]
    candidates = SimpleNamespace(refined=lambda *pool_of_a_fit: sought)
    moved = refined(candidates, pool.equations, pool, (0, 1), [0])
    assert (moved.terms[0] == sought) is better
    assert (moved is pool) is not better


@pytest.mark.slow
def test_a_push_that_no_held_out_block_saw_has_its_share_of_the_whole_recording():
    robot = Robot.bundled("arm2")
    push = parse_spec("external_wrench@arm2_joint2:torque=1.5,start=7,end=9", robot)
    (finding,) = diagnose([simulate(robot, [push], seed=3, duration=30.0).recording], robot).findings
    assert finding.effect == "external_wrench" and finding.share > 0.9
