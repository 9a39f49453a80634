"""What is said beside a diagnosis: loads that were taken up, ties that no motion settles, how much is left and where."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_cases import equations_of

from bdnn_ros.cli.diagnose import verdict_lines
from bdnn_ros.diagnosis.diagnose import diagnose, examine
from bdnn_ros.diagnosis.judging.identifiability import Judgement
from bdnn_ros.diagnosis.judging.posterior import Estimate
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.result import Finding, Quantity
from bdnn_ros.diagnosis.search.leads import lead_and_delays
from bdnn_ros.diagnosis.sentences import Kind, Note
from bdnn_ros.diagnosis.telling.advice import advice
from bdnn_ros.diagnosis.telling.endless import loads
from bdnn_ros.diagnosis.telling.left import unexplained
from bdnn_ros.diagnosis.telling.naming import Named, beyond_links
from bdnn_ros.diagnosis.telling.notes import (
    mostly_lead,
    mostly_links,
    of_recording,
    uncompared,
    unknown,
    unnamed,
)
from bdnn_ros.diagnosis.telling.outcome import Outcome
from bdnn_ros.diagnosis.telling.telling import _advice
from bdnn_ros.diagnosis.telling.unexplained import Remainder
from bdnn_ros.effects.registry import get, parse_spec
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.simulate import simulate

ARM = Robot.bundled("arm6")
TIME = np.linspace(0.0, 30.0, 300)
RAIL = """<robot name="rail"><link name="base"/>
<link name="cart"><inertial><mass value="3"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="100"/></joint></robot>"""


@pytest.mark.slow
def test_what_the_extended_model_mends_without_a_name_is_told_by_its_reason():
    """Links that are a little off, or efforts that are read a sample or two late: neither is a cause."""

    def said(recording):
        told = verdict_lines(examine([recording], ARM))
        assert told[0].startswith("Nothing wrong was found")
        return [line for line in told if "the extended model mends" in line]

    recording = Scenario(ARM, seed=4, duration=20.0, rate=200.0).run()[0].recording
    assert said(recording) == []  # an effort that is held leads by half a sample
    (of_lead,) = said(replace(recording, effort=np.roll(recording.effort, 2, axis=0)))
    assert float(of_lead.split(" ms")[0].split()[-1]) == pytest.approx(7.5, abs=0.5) and "too late" in of_lead
    (of_links,) = said(Scenario(ARM, seed=6, duration=20.0, wrong=0.05).run()[0].recording)
    assert of_links.startswith("Errors of the links' masses and inertias")


def said_of(notes: Iterable[Note], since: bool = False) -> list[str]:
    return [note.sentence(since) for note in notes]


def pull(force: tuple[float, float, float], start: float, end: float) -> Finding:
    values = {"start": start, "end": end, **dict(zip(("force_x", "force_y", "force_z"), force, strict=True))}
    parameters = {name: Quantity(value, 0.1, "") for name, value in values.items()}
    return Finding("external_wrench", None, "arm6_link6", parameters, 0.5, 1.0, (), "", "link")


@pytest.mark.parametrize(
    ("force", "start", "end", "said"),
    [
        ((0.3, -0.2, -9.81), 12.0, 30.0, "from 12.0 s on, as a load of 1 kg would that was taken up"),
        ((0.0, 0.0, -4.905), 0.0, 20.0, "until 20.0 s, as a load of 0.5 kg would that was put down"),
        ((0.0, 0.0, -9.81), 12.0, 20.0, ""),
        ((0.0, 0.0, -9.81), 0.0, 30.0, ""),
        ((0.0, 0.0, 9.81), 12.0, 30.0, ""),
        ((9.81, 0.0, -9.81), 12.0, 30.0, ""),
    ],
    ids=["taken up", "put down", "a push", "there all the time", "upwards", "aside"],
)
def test_a_push_that_may_be_a_load_is_said_to(force, start, end, said):
    notes = said_of(loads(ARM, [pull(force, start, end)], TIME))
    assert len(notes) == bool(said) and all(said in note for note in notes)


@pytest.mark.parametrize(
    ("start", "end", "said"),
    [
        (4.0, 10.0, "from 4.0 s to 10.0 s, as a load of 1 kg would that was taken up"),
        (11.0, 15.0, "from 11.0 s to 15.0 s, as a load of 1 kg would that was put down"),
        (11.0, 20.0, "from 11.0 s to 20.0 s, all through some of the recordings, as a load of 1 kg"),
        (4.0, 20.0, "from 4.0 s to 20.0 s, as a load of 1 kg would that was taken up"),
        (0.0, 4.0, "until 4.0 s, as a load of 1 kg would that was put down"),
        (24.0, 30.0, "from 24.0 s on, as a load of 1 kg would that was taken up"),
        (12.0, 15.0, ""),
        (0.0, 30.0, ""),
    ],
)
def test_a_load_may_be_of_one_of_several_recordings(start, end, said):
    """Each has ends of its own, from 0 to 10 s, 11 to 20 s and 21 to 30 s."""
    time = np.concatenate([np.linspace(begin, last, 90) for begin, last in ((0, 10), (11, 20), (21, 30))])
    notes = said_of(loads(ARM, [pull((0.0, 0.0, -9.81), start, end)], time, (0.0, 11.0, 21.0)))
    assert len(notes) == bool(said) and all(said in note for note in notes)


@pytest.mark.slow
def test_a_load_that_is_taken_up_is_told_so():
    """By its weight: nothing but the recording's end tells it from a hand that pulls down."""
    weight = parse_spec("external_wrench@arm6_link6:start=9,end=100,force_z=-6", ARM)
    lines = verdict_lines(examine([simulate(ARM, [weight], seed=3, duration=20.0).recording], ARM))
    (note,) = [line for line in lines if "taken up" in line]
    assert "from 9.0 s on" in note and "0.61 kg" in note


def advised(term: Term, *rivals: Term, robot: Robot = ARM, **values: float) -> list[str]:
    coefficients = np.zeros(0)
    if values:
        coefficients, _ = term.effect.coefficients(term.effect.with_defaults(values))
    nothing = np.zeros((len(coefficients), len(coefficients)))
    found = Estimate(term, coefficients, nothing, nothing, nothing)
    judgement = Judgement(0.4, 0.0, tuple((rival, 0.3) for rival in rivals))
    return advice([found], [judgement], robot, lambda one: one.link or robot.joints[one.target])


def test_which_link_was_touched_is_no_matter_of_motion():
    wrench = get("external_wrench", "link")
    (said,) = advised(Term(wrench, 5, "arm6_link6"), Term(wrench, 4, "arm6_link5"))
    assert said == "Whether arm6_link6 or arm6_link5 was pushed, no motion shows: look where it was touched."


def test_what_lasts_is_told_from_a_push_that_is_over_without_contact():
    """A motion of another kind would show neither whether it had been there; its other rivals a motion does tell."""
    push, link = (
        Term(get("external_wrench", "link"), 4, "arm6_link5"),
        Term(get("link_inertia"), 5, "arm6_link6"),
    )
    again = "record the same motion again without contact."
    for one, other in ((push, link), (link, push)):
        (said,) = advised(one, other)
        assert said.startswith(f"To tell {one.title} at {one.link} from {other.title} at") and said.endswith(
            again
        )
    past, lasting = advised(link, push, Term(get("armature"), 5))
    assert past.endswith(again) and "rotor" not in past
    assert "rotor" in lasting and "bdnn excite" in lasting and "wrench" not in lasting


def carried(link: int) -> Term:
    return Term(get("payload"), link - 1, f"arm6_link{link}")


def test_what_hangs_at_the_centre_of_a_wrist_has_to_be_looked_for():
    """Two joints turn about that point, the one before them does not; and a point beside it is told by motion."""
    said = advised(carried(6), carried(5), carried(4), carried(3), mass=1.5)
    assert said[0].startswith("Whether arm6_link6 or arm6_link5 or arm6_link4 carries the payload, no motion")
    assert said[1].startswith("To tell a payload at arm6_link6 from a payload at arm6_link3")
    (said,) = advised(carried(6), carried(5), carried(4), mass=1.5, com_x=0.05)
    assert "arm6_link5 or a payload at arm6_link4" in said and "bdnn excite" in said


def test_no_motion_is_promised_for_what_is_no_finding():
    """`bdnn excite` reads findings alone."""
    offset, spring = Term(get("effort_offset"), 2), Term(get("joint_spring"), 2)
    nothing = np.zeros((0, 0))
    found = [Estimate(offset, np.zeros(0), nothing, nothing, nothing)] * 2
    judgements = [Judgement(0.4, 0.0, ((spring, 0.3),))] * 2
    named, unnamed = advice(found, judgements, ARM, lambda one: ARM.joints[one.target], [1])
    assert named == unnamed[:-1] + "; `bdnn excite --for diagnosis.json` makes such a motion."
    assert unnamed.startswith("To tell an effort offset at arm6_joint3 from a spring, record poses")


def test_an_offset_beside_dry_friction_is_uneven_friction_whatever_the_motion():
    offset, uneven = Term(get("effort_offset"), 2), Term(get("asymmetric_friction"), 2)
    rubbing = replace(ARM, coulomb=np.full(6, 0.1))
    (said,) = advised(offset, uneven, robot=rubbing)
    assert said.startswith(
        "Whether dry friction at arm6_joint3 is uneven or its effort has an offset, no motion"
    )
    (other,) = advised(offset, uneven, robot=replace(ARM, coulomb=np.zeros(6)))
    assert "bdnn excite" in other


def test_a_link_that_never_turns_has_to_be_weighed():
    robot = Robot.from_urdf(RAIL)
    link, rotor = Term(get("link_inertia"), 0, "cart"), Term(get("armature"), 0)
    (said,) = advised(link, rotor, robot=robot)
    assert said.startswith("No motion of this robot tells") and "a known load" in said
    (other,) = advised(Term(get("link_inertia"), 5, "arm6_link6"), Term(get("armature"), 5))
    assert "bdnn excite" in other


def test_what_has_no_name_is_told_by_whether_the_model_holds_it():
    offset, push = Term(get("effort_offset"), 0), Term(get("external_wrench", "link"), 5, "arm6_link6")
    held, left = said_of(unnamed([(offset, "arm6_joint1"), (push, "arm6_link6")], 0.004))
    assert held.endswith("in the extended model, which it helps: an effort offset at arm6_joint1.")
    assert "not in the extended model" in left and left.endswith("something that pushes at arm6_link6.")
    assert not list(unnamed([], 0.0))
    (held,) = said_of(unnamed([(offset, "arm6_joint1")], 0.34), since=True)
    assert held.endswith("an effort offset at arm6_joint1 (34 % of the earlier model's squared error).")


def test_a_payload_whose_mass_may_be_nothing_is_told_as_a_centre_of_mass_first():
    """A link that was a twentieth off read as a finding, a payload."""
    mass = {"mass": Quantity(1.02, 1.67, "kg")}
    found = SimpleNamespace(term=Term(get("payload"), 1, "forearm"), quantities=mass)
    (said,) = said_of(unknown([(found, "forearm", True)]))
    first, other = said.split("a centre of mass of forearm that is elsewhere than in the model, or ")
    assert "payload" not in first and other.startswith(
        "a payload at forearm, mass 1 ± 2 kg, which may be nothing, or a rotor's inertia"
    )
    (said,) = said_of(unknown([(found, "forearm", False)]))
    assert (
        "payload" not in said
        and "inertia of forearm beyond the model's, as a rotor that moves it has" in said
    )
    assert not list(unknown([]))


@pytest.mark.parametrize(("late", "kept"), [([0], -4e-3), ([0, 1], -2e-3)])
def test_a_lead_stays_where_joints_without_a_delay_show_it(late, kept):
    """A delay of a tenth of a millisecond at one joint halved that of all others in the extended model."""
    terms = [Term(get("effort_delay"), joint) for joint in late]
    equations = SimpleNamespace(
        rigid=np.zeros((1, 2, 3)), nuisances=SimpleNamespace(hold=2e-3), rows=SimpleNamespace(width=2)
    )
    pool = SimpleNamespace(
        equations=equations, terms=terms, coefficients=lambda fit, chosen: np.array([3e-3])
    )
    fit = SimpleNamespace(coefficients=np.array([0.0, 0.0, 0.0, -4e-3]), terms=range(len(terms)))
    lead, moved = lead_and_delays(pool, fit)
    assert lead == pytest.approx(kept)
    for taken in moved.values():  # the sum of both is what was measured
        assert lead + taken == pytest.approx(-4e-3)


@pytest.mark.parametrize(
    ("values", "weighs", "there"),
    [
        ({"mass": 0.5, "com_x": 0.2}, True, True),
        ({"mass": 0.02, "com_x": 0.02}, False, False),
        ({"mass": 0.0, "turning": 0.2}, False, True),
    ],
    ids=["a payload", "a link that is a little off", "a rotor"],
)
def test_what_a_link_may_be_off_by_anyway_is_not_surely_there(values, weighs, there):
    equations = equations_of((), "arm6")
    payload = Term(get("payload"), 2, "arm6_link3").shaped(dict.fromkeys(("com_x", "com_y", "com_z"), 0.0))
    mass, turning = values["mass"], values.get("turning", 0.0)
    coefficients = np.array([mass, mass * values.get("com_x", 0.0), 0, 0, 0, 0, 0, 0, 0, turning])
    known = 1e-6 * np.eye(10)
    found = Estimate(payload, coefficients, known, known, known)
    assert beyond_links(equations, 0.02, found) is there
    assert beyond_links(equations, 0.02, found, but_rotor=True) is weighs
    unsure = replace(found, doubting=100.0 * np.eye(10))
    assert not beyond_links(equations, 0.02, unsure)


def left(share, remainder, above=(), named=True, slight=(), since=None) -> str:
    """The sentence on what is left; beside an earlier model (`since`) of one of which no change can be shown."""
    case = SimpleNamespace(share_left=share, remainder=remainder, earlier=since)
    outcome = SimpleNamespace(case=case, above=above, slight=slight, causes=["a cause"] * named)
    outcome.verdict, outcome.surely = "cannot_tell" if since else "explained", 0.0
    return unexplained(outcome).sentence(bool(since))


@pytest.mark.parametrize(
    ("share", "above", "said"),
    [
        (
            0.031,
            ("j2",),
            "3.1 % of the simulation's squared error is left above the noise, at j2; no position",
        ),
        (
            0.0001,
            ("j1", "j3"),
            "Less than 0.1 % of the simulation's squared error is left above the noise, at j1, j3;",
        ),
        (0.0, (), "What is left looks like noise"),
    ],
)
def test_what_is_left_is_told_with_its_place(share, above, said):
    remainder = Remainder(np.ones(3), {}, np.zeros((1, 3)))
    assert left(share, remainder, above).startswith(said)
    depends = replace(remainder, inputs={joint: {"j1.velocity": 1.0} for joint in above or ("j1",)})
    assert "; it depends on j1.velocity" in left(0.1, depends, above)


def test_what_is_left_is_told_to_depend_on_what_it_does_where_it_is_left():
    """Inputs of joints at which no more than noise is left were told of those at which more is."""
    inputs = {"j1": {"j1.load": 0.2, "time": 0.3}, "j2": {"j2.load": 9.0}}
    remainder = Remainder(np.ones(3), inputs, np.zeros((1, 3)))
    assert left(0.1, remainder, ("j3", "j1")).endswith(
        "left above the noise, at j3, j1; at j1 it depends on time, j1.load."
    )
    assert "; no position" in left(0.1, remainder, ("j3",))
    assert "; it depends on j2.load, time, j1.load." in left(0.0, remainder)


def test_an_earlier_model_is_not_blamed_for_what_it_left_before():
    """Where no change can be shown, a large share would read as a large fault."""
    remainder = Remainder(np.ones(3), {}, np.zeros((1, 3)))
    since = SimpleNamespace(model=None)
    said = left(0.943, remainder, ("j2",), False, (), since)
    assert said.startswith("The earlier model does not describe this motion down to its noise")
    assert "or not: 94.3 % of its squared error is left above that, at j2; no position" in said
    quiet = left(0.943, remainder, (), False, (), since)
    assert quiet.startswith("What is left looks like noise")


def test_joints_are_told_in_the_order_of_what_is_left():
    near, left = np.array([False, True, False]), np.array([0.1, 5.0, 3.0])
    case = SimpleNamespace(robot=SimpleNamespace(joints=("j1", "j2", "j3")), left=left, extended=left)
    case.near = lambda error: near
    assert Outcome(case).above == ("j3", "j1")


def test_all_of_an_error_that_is_hardly_more_than_noise_may_be_left():
    """Nothing is named, and nothing wrong: a share of next to nothing would frighten."""
    remainder = Remainder(np.ones(3), {}, np.zeros((1, 3)), ("j2",))
    said = left(0.3, remainder, named=False)
    assert said.startswith("What is left is hardly more than noise, in bursts at j2")
    assert "30.0 %" in left(0.3, remainder, ("j2",), named=False)


@pytest.mark.parametrize(
    ("named", "said"),
    [
        (True, "Less than 0.1 % of the simulation's squared error is left above the noise, at j2"),
        (False, "What is left is small, but more than twice the noise at j2"),
    ],
)
@pytest.mark.parametrize("bursts", [(), ("j1",)])
def test_what_is_twice_the_noise_is_told_with_its_place_though_it_is_little(named, said, bursts):
    """A joint at seven times its floor was said to look like noise, or to be hardly more."""
    remainder = Remainder(np.ones(3), {}, np.zeros((1, 3)), bursts)
    told = left(0.0, remainder, (), named, ("j2",))
    assert told.startswith(said) and "; no position" in told
    elsewhere = replace(remainder, inputs={"j1": {"j1.load": 1.0}})
    assert left(0.0, elsewhere, (), named, ("j2",)) == told


def test_that_links_errors_make_up_most_is_said_where_they_do():
    def said(share: float, far_off: bool) -> list[str]:
        return said_of(mostly_links(SimpleNamespace(by_links=share, far_off=far_off)))

    (note,) = said(0.74, False)
    assert "74 % of the simulation's squared error" in note and "wrong units" not in note
    (note,) = said(1.71, True)  # causes may undo some of it
    assert "100 % of" in note and "wrong units" in note
    assert said(0.3, True) == []


@pytest.mark.parametrize(
    ("by_lead", "gained", "lead", "told"),
    [(0.7, 0.9, -4e-3, True), (0.3, 0.9, -4e-3, False), (0.06, 0.1, -4e-3, False), (0.7, 0.9, 2e-3, False)],
    ids=["most", "less than half", "hardly anything", "of a hold"],
)
def test_a_lead_that_makes_up_most_of_what_is_gained_is_told_beside_causes(by_lead, gained, lead, told):
    case = SimpleNamespace(
        by_lead=by_lead,
        gained=gained,
        lead=lead,
        equations=SimpleNamespace(nuisances=SimpleNamespace(hold=2e-3)),
        earlier=None,
    )
    notes = said_of(mostly_lead(case))
    assert len(notes) == told
    assert not told or notes[0].startswith("Efforts are stamped 4.0 ms too late for the motion")


@pytest.mark.slow
def test_links_that_are_wrong_beside_a_small_cause_are_told_of():
    """What their corrections take is said where the verdict is read."""
    cause = "coulomb_friction@arm6_joint3:coulomb=1.5"
    simulated, _ = Scenario(ARM, effects=(cause,), seed=3, wrong=0.1).run()
    examination = examine([simulated.recording], ARM)
    assert [finding.effect for finding in examination.diagnosis.findings] == ["coulomb_friction"]
    (told,) = (line for line in verdict_lines(examination, []) if "masses and inertias make up" in line)
    assert f"make up {100.0 * examination.by_links:.0f} % of the simulation's squared error" in told


def test_the_base_and_the_zero_of_a_joint_that_turns_all_of_it_take_a_level():
    tilt, first, second = Term(get("base_tilt"), -1), *(Term(get("position_offset"), k) for k in (0, 1))
    arm = Robot.bundled("arm2")
    for term, rival in ((tilt, first), (first, tilt)):
        (said,) = advised(term, rival, robot=arm)
        assert said.startswith("Whether the base is tilted or the zero of arm2_joint1 is off, no motion")
    (said,) = advised(second, tilt, robot=arm)
    assert said.startswith("To tell a position offset at arm2_joint2 from a tilted base, record")


def test_what_is_beyond_the_term_that_it_settles_into_is_shown_by_its_own_motion():
    """A gap that is never crossed is a wrong zero: poses do not show it, a load that changes its sign does."""
    zero, gap = Term(get("position_offset"), 1), Term(get("backlash"), 1)
    for term, rival in ((zero, gap), (gap, zero)):
        (said,) = advised(term, rival, robot=ARM)
        assert f"record {gap.effect.shown_by}; " in said


@pytest.mark.parametrize("measured", [True, False])
def test_a_joint_is_told_to_be_alone_where_it_moves_alone_or_is_measured_alone(measured):
    made = simulate(Robot.bundled("arm2"), seed=1, duration=12.0, rate=100.0).recording
    one = np.array([1.0, 0.0])
    if measured:
        made = replace(made, position=made.position * one, velocity=None)
    else:
        made = replace(made, effort=made.require_effort() * one)
    (alone,) = (one for one in diagnose([made], Robot.bundled("arm2")).noted if one.kind is Kind.ALONE)
    told = alone.sentence(False)
    assert ("Only arm2_joint1 moves" in told and "Move several" in told) == measured
    assert ("Record the efforts of arm2_joint2, too" in told) != measured


def test_a_joint_that_moves_briefly_is_not_told_to_stand():
    """Of 100 s it moved for two, none of which was held out."""
    usable = np.ones((1000, 2), dtype=bool)
    usable[34:, 1] = False
    signals = SimpleNamespace(at_rest=~usable, cutoff=5.0, own=None, raw_rate=100.0, rate=10.0)
    equations = SimpleNamespace(
        motion=SimpleNamespace(signals=signals),
        usable=usable,
        alone=0,
        rows=SimpleNamespace(moving=np.array([100.0, 3.4])),
    )
    arm = Robot.bundled("arm2")
    (alone,) = said_of(of_recording(arm, equations))
    assert alone.startswith("Only arm2_joint1 has an effort that was measured in motion for more than 5 %")
    held = usable & (np.arange(1000) >= 800)[:, None]
    (brief,) = uncompared(arm, usable, held)
    assert brief == Note(Kind.NOT_HELD_OUT, {"joints": ["arm2_joint2"]})
    usable[:, 1] = False
    (still,) = said_of(uncompared(arm, usable, held & usable))
    assert "arm2_joint2 is compared: it does not move" in still
    assert said_of(of_recording(arm, equations))[0].startswith("Only arm2_joint1 moves: ")
    assert not list(uncompared(arm, usable[:, :1], usable[:, :1]))


@pytest.mark.parametrize("longest, said", [(11.2, True), (20.4, False)])
def test_too_little_motion_is_told_as_what_there_is_and_what_is_needed(longest, said):
    """That no joint moved for longer read as if the robot stood still."""
    signals = SimpleNamespace(cutoff=2.5, own=None)
    equations = SimpleNamespace(
        motion=SimpleNamespace(signals=signals),
        alone=None,
        rows=SimpleNamespace(moving=np.array([3.0, longest])),
    )
    told = said_of(of_recording(Robot.bundled("arm2"), equations))
    assert bool(told) == said
    assert all(note.startswith("There are 11 s of motion") and " 20 s are needed" in note for note in told)


@pytest.mark.parametrize(
    ("verdict", "since", "said"),
    [
        ("cannot_tell", None, ("No cause stands out in this motion: record more",)),
        ("cannot_tell", object(), ("Identify the earlier model from more motion",)),
        ("nothing_wrong", None, ()),
    ],
)
def test_where_nothing_can_be_told_there_is_something_to_do(verdict, since, said):
    """Though nothing is in doubt that a motion of its own would settle."""
    case = SimpleNamespace(found=[], attempt=SimpleNamespace(judgements=[]), robot=ARM, earlier=since)
    outcome = Outcome(case)
    names = Named([], False, [], [], [], 0.0, 0.0)
    outcome.__dict__.update(names=names, verdict=verdict, alike=None)
    told = _advice(outcome)
    assert len(told) == len(said) and all(map(str.startswith, told, said))
