"""Numbers, units and names of the report."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from report_cases import examined, fourier_motion, rendered, worn
from report_page import Page

from bdnn_ros.cli.diagnose import verdict_lines
from bdnn_ros.diagnosis.diagnose import Examination
from bdnn_ros.diagnosis.result import Diagnosis, Finding, Quantity, Rival
from bdnn_ros.effects.registry import EFFECTS, variants
from bdnn_ros.report import words
from bdnn_ros.robot import Robot


def finding(effect: str, joint: str | None = "j1", link: str | None = None, **values: float) -> Finding:
    units = {p.name: p.unit for p in EFFECTS[effect].parameters}
    quantities = {name: Quantity(value, 0.01, units[name]) for name, value in values.items()}
    return Finding(effect, joint, link, quantities, 0.5, 0.9, (), "A sentence.")


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (1.29345, 0.03, "1.29 ± 0.06 N·m"),
        (1.29345, 0.01, "1.293 ± 0.020 N·m"),
        (-0.5, 0.0051, "−0.500 ± 0.010 N·m"),
        (1234.5, 51.0, "1234 ± 100 N·m"),
        (1.29345, 0.0, "1.29 N·m"),
        (2.0, float("inf"), "2.00 N·m"),
    ],
)
def test_a_value_has_as_many_digits_as_its_uncertainty_supports(value: float, std: float, text: str) -> None:
    assert words.with_spread(Quantity(value, std, "N*m")) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (3.14159, "3.14"),
        (12345.6, "12346"),
        (0.00123, "0.00123"),
        (-2.5, "−2.50"),
        (1e-9, "1.00e−09"),
    ],
)
def test_numbers(value: float, text: str) -> None:
    assert words.number(value) == text


def test_no_probability_is_a_certainty() -> None:
    assert "99" in words.probability(1.0) and ">" in words.probability(1.0)
    assert "<" in words.probability(0.0)
    assert words.probability(0.5).split("\N{NO-BREAK SPACE}") == ["50", "%"]


def test_every_effect_has_a_title_that_can_start_a_line() -> None:
    for name in EFFECTS:
        title = words.title(name)
        assert title[0].isupper() and not title.lower().startswith(("a ", "an ")) and "_" not in title


def test_a_name_with_variants_stands_for_all_of_them() -> None:
    assert words.title("drift") == "Drift"


def test_an_unknown_effect_goes_by_its_name() -> None:
    assert words.title("magnetic_pull") == "Magnetic pull"


def test_places() -> None:
    assert words.named(finding("payload", None, "hand")) == "Payload at hand"
    assert words.named(finding("base_tilt", None)) == "Tilted base"
    assert words.named(finding("effort_delay", None)) == "Effort delay at all joints"
    assert words.named(Rival("coulomb_friction", "j2", None, 0.1)) == "Coulomb friction at j2"


def test_a_tie_of_places_leaves_no_doubt_of_the_effect() -> None:
    rivals = (Rival("payload", None, "wrist", 0.32), Rival("link_inertia", None, "hand", 0.02))
    tied = replace(finding("payload", None, "hand"), probability=0.66, rivals=rivals)
    assert words.certainty(tied) == (pytest.approx(0.98), "that it is here")
    assert words.certainty(replace(tied, rivals=rivals[1:])) == (0.66, "")


def test_what_may_be_part_of_more_is_there_in_any_case() -> None:
    drift = Rival("drift", "j2", None, 0.89, "viscous")
    named = replace(finding("viscous_friction", "j2"), probability=0.11, rivals=(drift,))
    assert words.certainty(named) == (pytest.approx(1.0), "that it is no more than that")
    for other in (replace(drift, variant="coulomb"), replace(drift, joint="j3")):
        assert words.certainty(replace(named, rivals=(other,))) == (0.11, "")


def test_another_that_drifts_at_the_same_joint_leaves_no_doubt_of_the_place() -> None:
    rival = Rival("drift", "j2", None, 0.19, "viscous")
    drifts = replace(finding("drift", "j2"), variant="coulomb", probability=0.8, rivals=(rival,))
    assert words.certainty(drifts) == (pytest.approx(0.99), "that it is Coulomb friction")
    assert [words.named(one) for one in (drifts, rival)] == [
        "Drifting Coulomb friction at j2",
        "Drifting viscous friction at j2",
    ]
    assert words.certainty(replace(drifts, rivals=(replace(rival, joint="j3"),)))[1] == "that it is here"


def test_amounts_name_the_parameter_where_there_are_several_or_no_unit() -> None:
    assert words.amounts(finding("coulomb_friction", coulomb=1.3)) == ["1.300 ± 0.020 N·m"]
    assert words.amounts(finding("load_dependent_friction", ratio=0.1)) == ["ratio 0.100 ± 0.020"]
    assert len(words.amounts(finding("stribeck_friction", coulomb=1.0, static=2.0, velocity=0.1))) == 3
    payload = finding("payload", None, "hand", mass=1.0, com_x=0.0, com_y=0.0, com_z=0.1)
    assert words.amounts(payload) == ["1.000 ± 0.020 kg"]


def parameter(effect: str, name: str):
    """A parameter of an effect by its name."""
    return next(one for kind in variants(effect) for one in kind.parameters if one.name == name)


def test_an_interval_stays_within_what_is_possible() -> None:
    quantity = Quantity(0.01, 0.05, "N*m")
    within = words.estimate("coulomb", quantity, parameter("coulomb_friction", "coulomb"))
    assert within[1] == "0.00 to 0.11"
    assert words.estimate("coulomb", quantity, None)[1] == "−0.09 to 0.11"


def test_what_the_motion_does_not_show_has_no_number() -> None:
    """On a planar arm, a push across its plane may be anything."""
    force, point = parameter("external_wrench", "force_y"), parameter("external_wrench", "point_x")
    across = Quantity(0.0, 3.8e4, "N")
    assert words.estimate("force_y", across, force) == ("–", "not shown by this motion")
    pushed = Quantity(-42.3, 21.8, "N")
    assert words.estimate("force_y", pushed, force) == ("−42", "−85 to 0")
    heavy = parameter("link_inertia", "mass")
    assert words.estimate("mass", Quantity(200.0, 8.0, "kg"), heavy)[0] == "200"
    placed = Quantity(0.0, 1e-6, "m")
    assert words.estimate("point_x", placed, point) == ("0", "–")


def test_an_interval_of_what_became_less_is_below_nothing() -> None:
    mass = Quantity(-1.0, 0.01, "kg")
    assert words.estimate("mass", mass, parameter("payload", "mass"))[1] == "−1.020 to −0.980"


@pytest.mark.parametrize(
    ("value", "interval"),
    [(-11.9, "−12.9 to −10.9"), (-9.9, "−10.0 to −8.9"), (9.9, "8.9 to 10.0"), (12.1, "11.1 to 13.1")],
)
def test_an_interval_holds_its_own_value(value: float, interval: str) -> None:
    """The rest of a preloaded spring may lie beyond what a specification takes."""
    rest = parameter("joint_spring", "rest")
    assert words.estimate("rest", Quantity(value, 0.5, "rad"), rest)[1] == interval


def test_the_centre_of_a_payload_that_no_motion_shows_has_no_number() -> None:
    height = parameter("payload", "com_z")
    assert words.estimate("com_z", Quantity(0.0, 0.13, "m"), height)[1] == "not shown by this motion"
    assert words.estimate("com_z", Quantity(0.0, 0.03, "m"), height)[1] != "not shown by this motion"
    assert "com_z ? m" in EFFECTS["payload"].sentence(
        "hand", {"mass": 1.0, "com_x": 0.0, "com_z": float("nan")}
    )


def test_what_is_less_than_described_is_called_so() -> None:
    def found(viscous: float) -> Finding:
        quantity = {"viscous": Quantity(viscous, 0.01, "N*m*s/rad")}
        return Finding("viscous_friction", "joint", None, quantity, 0.5, 0.99, (), "")

    assert [words.cause(found(value)) for value in (0.3, -0.3)] == [
        "Viscous friction",
        "Less viscous friction",
    ]
    spring = finding("joint_spring", "joint", stiffness=3.0, rest=-11.9)
    assert words.cause(spring) == "Spring"
    assert words.cause(finding("joint_spring", "joint", stiffness=-3.0, rest=-11.9)) == "Less spring"
    assert words.cause(found(-0.3), found(-0.1)) == "Less viscous friction"
    assert words.cause(found(-0.3), found(0.2)) == "More or (negative) less viscous friction"
    gap = finding("backlash", gap=-0.01, crossing=0.01)  # how far it is across is no amount of it
    assert words.cause(gap) == "Less backlash"
    both = finding("asymmetric_friction", positive=-0.116, negative=0.711)
    assert words.cause(both) == "More or (negative) less asymmetric Coulomb friction"
    assert words.kinds([found(-0.3), found(-0.1), found(0.2)]) == (
        "Less viscous friction at 2 places, viscous friction at 1 place"
    )


def test_what_drifts_is_counted_by_what_it_is() -> None:
    def drifting(variant: str) -> Finding:
        return replace(
            finding("drift", "joint", start_value=1.0, end_value=2.0, start=0.0, end=9.0), variant=variant
        )

    assert words.kinds([drifting("coulomb"), drifting("offset"), drifting("coulomb")]) == (
        "Drifting Coulomb friction at 2 places, drifting effort offset at 1 place"
    )


def test_a_filtered_velocity_is_no_cause_of_the_efforts_error() -> None:
    """Beside a cause it is not counted; alone it is what was found, though the simulation's efforts agree."""
    viscous, filtered = finding("viscous_friction", viscous=1.0), finding("velocity_filter", cutoff=9.0)

    def told(*findings: Finding, verdict: str = "explained") -> tuple[str, str]:
        diagnosis = SimpleNamespace(
            findings=findings, verdict=verdict, gain=0.0, gain_interval=(-0.1, 0.1), slight=(), also=()
        )
        return words.headline(diagnosis), words.claim(diagnosis)

    assert told(viscous, filtered) == told(viscous)
    headline, claim = told(filtered)
    assert headline.startswith("One root cause: ") and claim.startswith("The simulation predicts")
    assert told(filtered, filtered)[0] == (
        "The reported velocity is low-passed at 2 joints, and no effort needs a cause"
    )
    assert told(filtered, verdict="cannot_tell")[0] == "The simulation is off, and no cause stands out"


def test_what_is_left_beside_the_causes_is_told_with_its_place_and_size() -> None:
    """Of 0.1 % at one wrist it was said that the causes explain part of the error."""
    told = SimpleNamespace(
        slight=(),
        also=(),
        findings=(finding("viscous_friction", viscous=1.0),),
        verdict="partly_explained",
        unexplained_share=0.003,
        above=("j5", "j2"),
        endless=False,
    )
    assert words.claim(told) == (
        "With this cause and the links corrected, 0.3 % of the simulation's squared error is left above the noise, at j5, j2."
    )
    told.unexplained_share = 1e-4
    assert "less than 0.1 % of the earlier model's" in words.claim(told, since=True)
    told.above = ()
    assert words.claim(told).endswith("most of what the extended model mends has no name.")
    told.endless = True
    assert words.claim(told) == "This cause explains the error; what is told as a push may be another cause."


@pytest.mark.parametrize(
    ("verdict", "found"), [("explained", (finding("viscous_friction"),)), ("nothing_wrong", ())]
)
def test_not_every_effort_is_predicted_to_the_noise_where_more_is_left_somewhere(
    verdict: str, found: tuple[Finding, ...]
) -> None:
    told = SimpleNamespace(
        findings=found, verdict=verdict, gain=0.0, gain_interval=(0.0, 0.0), slight=(), also=()
    )
    plain = words.claim(told)
    told.slight = ("j2", "j4")
    assert "j2, j4" in words.claim(told) and "every" not in words.claim(told)
    assert "more" not in plain and ("every" in plain) == bool(found)


def test_beside_an_earlier_model_changes_are_told() -> None:
    told = SimpleNamespace(
        findings=(finding("viscous_friction", viscous=1.0),), verdict="explained", slight=(), also=()
    )
    assert words.claim(told).startswith("With this cause and ")
    assert words.claim(told, since=True).startswith("With this change and ")


@pytest.mark.parametrize(("least", "shown"), [(-0.001, False), (0.1, True)])
def test_where_nothing_is_surely_gained_on_an_earlier_model_no_change_is_claimed(
    least: float, shown: bool
) -> None:
    """A model that was identified is never without any error: that it disagrees was said of a gain of -0.1 to 21.4 %."""
    told = Diagnosis({}, "cannot_tell", (), {}, 0.1, (least, 0.2), 0.3, (), "Some is left.", (), (), ("j1",))
    later = SimpleNamespace(diagnosis=told, model=object())
    said = (verdict_lines(later)[0], words.headline(told, since=True), words.claim(told, since=True))
    claims = ("disagrees", "has changed", "errs by more")
    for one, claimed in zip(said, claims, strict=True):
        assert (claimed in one) == shown and (one.startswith("No change ") and "can be shown" in one) != shown
    assert "disagrees" in verdict_lines(SimpleNamespace(diagnosis=told, model=None))[0]


@pytest.mark.parametrize("findings", [(), (finding("velocity_filter", cutoff=9.0),)])
def test_a_simulation_that_needs_corrections_without_a_name_is_not_called_right(
    findings: tuple[Finding, ...],
) -> None:
    """Links a tenth off were most of the error, and the lead said that the simulation predicts the effort."""
    verdict = "explained" if findings else "nothing_wrong"
    off = SimpleNamespace(findings=findings, verdict=verdict, gain=0.958, gain_interval=(0.95, 0.96))
    assert "predicts" not in words.claim(off)
    assert words.claim(off).startswith("No cause is needed beyond")
    assert words.claim(off).endswith("takes 95.8\N{NO-BREAK SPACE}% off the simulation's error.")
    assert "earlier model's error" in words.claim(off, since=True)
    right = SimpleNamespace(
        findings=findings, verdict=verdict, gain=0.2, gain_interval=(0.07, 0.29), slight=(), also=()
    )
    assert words.claim(right).startswith("The simulation predicts")


@pytest.fixture(scope="module")
def rubbing() -> Examination:
    robot = Robot.bundled("arm2")
    spec = "coulomb_friction@arm2_joint1:coulomb=1"
    return examined(robot, worn(robot, [spec], fourier_motion(robot, 15.0)), [spec])


def test_a_comparison_with_an_earlier_model_is_told_as_one(rubbing: Examination) -> None:
    alone, compared = (
        Page(rendered(one)).words for one in (rubbing, replace(rubbing, model=SimpleNamespace()))
    )
    assert "Root causes identified" in alone and "Evidence for each cause" in alone
    assert "Changes identified" in compared and "Evidence for each change" in compared
    assert "cause" not in compared[: compared.index("How it was computed")].lower()


def test_an_interval_below_nothing_has_a_minus(rubbing: Examination) -> None:
    doubtful = replace(rubbing, diagnosis=replace(rubbing.diagnosis, gain_interval=(-0.019, 0.253)))
    assert "interval: −1.9 % to 25.3 %" in Page(rendered(doubtful)).words


def test_a_gain_where_no_cause_is_needed_is_said_to_be_of_what_has_no_name(rubbing: Examination) -> None:
    right = replace(rubbing, diagnosis=replace(rubbing.diagnosis, verdict="nothing_wrong", findings=()))
    alone, named = (Page(rendered(one)).words for one in (right, rubbing))
    assert "less effort error, by what has no name; 95 %" in alone
    assert "less effort error; 95 %" in named
