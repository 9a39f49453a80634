"""What is told of a change counts from what the earlier model has, however it came to have it."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.recorded.compared import Compared
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.search.candidates import Candidates, _as_change
from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import Installed, from_values, get, parse_spec
from bdnn_ros.extension.effects_file import EffectsFile
from bdnn_ros.extension.extend import extend
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.files import write_model_files
from bdnn_ros.extension.urdf import extended_urdf
from bdnn_ros.models import load_model, save_model
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.robot.units import printed
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm2")
LINK = "arm2_link2"
BODY, (_, WEIGHT) = 1, ARM.inertials[:, 0]


@cache
def recorded(*effects: str) -> Recording:
    return Scenario(ARM, effects, seed=3, duration=24.0, rate=200.0).run()[0].recording


def model_of(*effects: str, robot: Robot = ARM) -> ExtendedModel:
    """The model of a diagnosis that found just these effects."""
    return ExtendedModel(robot, tuple(parse_spec(spec, ARM) for spec in effects), np.full(2, 0.01))


def errors(model: ExtendedModel, recording: Recording) -> np.ndarray:
    """Of a model's effort, root mean square behind the low-pass, (n,) [N·m]."""
    signals = prepare(recording)
    left = signals.smooth(model.predict(signals) - signals.effort)[signals.interior]
    return np.asarray(np.sqrt(np.mean(left**2, axis=0)))


def agrees(model: ExtendedModel, now: tuple[str, ...], tmp_path: Path) -> bool:
    """Whether a model predicts a robot with some effects as well as that one's own does, and the same once it is read again."""
    save_model(tmp_path, model)
    again, recording = load_model(tmp_path), recorded(*now)
    assert errors(again, recording) == pytest.approx(errors(model, recording), rel=1e-9)
    return bool((errors(model, recording) < 1.1 * errors(model_of(*now), recording) + 1e-3).all())


def scaled(scale: float) -> str:
    return f"link_inertia@{LINK}:scale={scale}"


def test_a_link_that_is_as_described_again_weighs_less_than_in_the_earlier_model(tmp_path):
    earlier = model_of(scaled(1.5))
    examination = examine([recorded()], earlier.robot, model=earlier)
    (finding,) = examination.diagnosis.findings
    told = {name: quantity.value for name, quantity in finding.parameters.items()}
    assert (finding.effect, finding.link) == ("link_inertia", LINK)
    assert told == pytest.approx({"mass": WEIGHT, "nominal_mass": 1.5 * WEIGHT, "scale": 1.0 / 1.5}, rel=0.03)
    assert f"weighs {told['mass']:.3g} kg, not {1.5 * WEIGHT:.3g} kg" in finding.sentence
    model = extend(examination)
    assert model.robot.inertials[BODY, 0] == pytest.approx(WEIGHT, rel=0.03)
    written = Robot.from_urdf(extended_urdf(model), ARM.joints)
    assert written.inertials[BODY, 0] == pytest.approx(model.robot.inertials[BODY, 0])
    assert agrees(model, (), tmp_path)


def changed(effect: Effect, known: Compared, link: str | None = None) -> Effect:
    """An effect at the last joint, or on the link that it moves, as a change from what a model has."""
    return _as_change(Term(effect, BODY, link), known.robot, known.held).effect


def heavier(more: float) -> Robot:
    """The arm with a last body that weighs so much more, wherever that sits [kg]."""
    inertials = ARM.inertials.copy()
    inertials[BODY] *= 1.0 + more / WEIGHT
    return ARM.with_inertials(inertials)


@pytest.mark.parametrize(
    ("known", "weighs"),
    [
        (model_of(), WEIGHT),
        (model_of(scaled(1.5)), 1.5 * WEIGHT),
        (model_of(robot=heavier(0.4)), WEIGHT + 0.4),
        (model_of(scaled(1.5), robot=heavier(0.4)), 1.5 * WEIGHT + 0.4),
        (model_of(f"payload@{LINK}:mass=0.7,com_x=0.1", robot=heavier(0.4)), WEIGHT + 0.4),
        (model_of(robot=heavier(-0.99 * WEIGHT)), 0.05 * WEIGHT),
    ],
)
def test_a_link_weighs_what_its_body_weighs_more_but_for_a_payload(known, weighs):
    """By a scaled link, by corrected bodies (of an identified model, too), and by both."""
    assert changed(get("link_inertia"), known.compared(), LINK).kept == pytest.approx(
        {"nominal_mass": weighs}
    )


JOINT = ARM.joints[BODY]


@pytest.mark.parametrize(
    ("spec", "alone", "further"),
    [
        ("effort_scale:scale=1.25", "1.25 times the effort that is measured.", "the effort that acts in the model."),
        ("effort_delay:delay=0.015", "acts 15 ms after its stamp.", "acts 15 ms later than in the model."),
        ("effort_delay:delay=-0.015", "15 ms less after its stamp than in the model.", ""),
        ("position_offset:offset=-0.04", "-0.04 rad off the true one.", "off the one that the model takes for true."),
        ("backlash:gap=0.02", "has a gap of 0.02 rad.", "its transmission's gap is 0.02 rad larger."),
        ("backlash:gap=-0.02", "its transmission's gap is 0.02 rad smaller.", ""),
        ("joint_elasticity:stiffness=500", "has a stiffness of 500 N·m/rad.", "more than in the model, by 0.002 rad/(N·m)."),
        ("joint_elasticity:stiffness=-500", "less than in the model, by 0.002 rad/(N·m).", ""),
    ],
)  # fmt: skip
def test_what_is_told_beside_some_of_it_is_told_as_so_much_further(spec, alone, further):
    """Of sensors and gears: where the earlier model has none of it, and in a simulation's diagnosis, it is all that there is."""
    name, _, number = spec.partition(":")
    parameter, value = number.split("=")
    values, had = ({parameter: one, "crossing": 0.01} for one in (float(value), 2.0 * abs(float(value))))
    held = Installed(get(name), BODY, None, had)
    without, known = (ExtendedModel(ARM, some, np.full(2, 0.01)).compared() for some in ((), (held,)))
    for said, effect in (
        (alone, get(name)),
        (alone, changed(get(name), without)),
        (further or alone, changed(get(name), known)),
    ):
        assert effect.sentence(JOINT, values).endswith(said)


@pytest.mark.parametrize(
    ("known", "values", "said"),
    [
        ("effort_offset:offset=0.81", {"offset": -0.801}, "{} no longer has the effort offset of the model, 0.81 N·m."),
        ("effort_offset:offset=0.81", {"offset": -0.5}, "The effort offset of {} differs from the model's by -0.5 N·m."),
        ("", {"offset": -0.5}, "{} has an effort offset that the model leaves out (offset -0.5 N·m)."),
        (
            "cogging:amplitude=0.2,periods_per_rev=12,phase=0.4",
            {"amplitude": 0.199, "periods_per_rev": 11.999, "phase": 0.41 - math.pi},
            "{} no longer has the cogging of the model, of 0.2 N·m.",
        ),
        (
            "cogging:amplitude=0.2,periods_per_rev=12,phase=0.4",
            {"amplitude": 0.2, "periods_per_rev": 24.0, "phase": 0.4 - math.pi},
            "{} differs from the model in cogging (amplitude 0.2 N·m, periods_per_rev 24, phase -2.74 rad).",
        ),
        (
            "cogging:amplitude=0.2,periods_per_rev=12,phase=0.4",
            {"amplitude": 0.1, "periods_per_rev": 12.0, "phase": 0.4},
            "{} differs from the model in cogging (amplitude 0.1 N·m, periods_per_rev 12, phase 0.4 rad).",
        ),
        ("quadratic_drag:drag=0.2", {"drag": 0.1}, "{} has more quadratic drag than the model (drag 0.1 N·m·s²/rad²)."),
        ("quadratic_drag:drag=0.2", {"drag": -0.2}, "{} has less quadratic drag than the model (drag -0.2 N·m·s²/rad²)."),
    ],
)  # fmt: skip
def test_what_the_earlier_model_has_is_not_told_as_what_it_leaves_out(known, values, said):
    """An offset that was gone was told as being there, and so was a ripple."""
    name, _, numbers = known.partition(":")
    had = {key: float(value) for key, _, value in (one.partition("=") for one in numbers.split(",") if one)}
    held = (Installed(get(name), BODY, None, had),) if known else ()
    effect = changed(get(name or "effort_offset"), ExtendedModel(ARM, held, np.full(2, 0.01)).compared())
    assert effect.sentence(JOINT, values) == said.format(JOINT)


RUBS = 2.0
RUBBED = ARM.with_joint_parameters(coulomb=np.array([0.0, RUBS]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "earlier"), [(RUBBED, None), (ARM, model_of(f"coulomb_friction@{JOINT}:coulomb={RUBS}"))]
)
def test_friction_that_drifts_counts_from_what_is_known_and_is_told_whole(robot, earlier, tmp_path):
    last = 0.4 * RUBS
    now = (f"drift@{JOINT}:of=coulomb,start_value={RUBS},end_value={last},end=24",)
    examination = examine([recorded(*now)], robot, model=earlier)
    (finding,) = examination.diagnosis.findings
    assert (finding.effect, finding.variant, finding.joint) == ("drift", "coulomb", JOINT)
    first, end = (finding.parameters[name].value for name in ("start_value", "end_value"))
    assert (first, end) == pytest.approx((0.0, last - RUBS), abs=0.05)
    assert f"goes from {RUBS + first:.3g} to {RUBS + end:.3g} N·m over the recording" in finding.sentence
    assert finding.sentence.endswith("count from the model's 2 N·m.")
    assert not any("Coulomb friction" in note for note in examination.diagnosis.notes)
    model = extend(examination)
    assert agrees(model, now, tmp_path)
    write_model_files(model, tmp_path)
    file, written = EffectsFile.read(tmp_path / "effects.yaml"), Robot.from_file(tmp_path / "extended.urdf")
    read = ExtendedModel(written, tuple(file.effects(written)), model.noise)
    assert (errors(read, recorded(*now)) < 1.1 * errors(model_of(*now), recorded(*now)) + 1e-2).all()


def test_what_drifts_counts_from_all_that_an_earlier_model_has_of_it():
    """In its robot and beside it, whatever dry friction is called, and an identified model's own offset."""
    worn = RUBBED.with_joint_parameters(viscous=np.array([0.0, 0.3]))
    laws = (f"asymmetric_friction@{JOINT}:positive=1,negative=1.5", f"effort_offset@{JOINT}:offset=0.4")
    extended = model_of(*laws, robot=worn).compared()
    identified = Compared.of(PhysicalModel(worn, np.array([0.0, -0.4]), np.eye(28), np.zeros(2)), worn)
    for known, coulomb in ((extended, 3.0), (identified, RUBS)):
        for variant, had, low in (
            ("coulomb", coulomb, -coulomb),
            ("viscous", 0.3, -0.3),
            ("offset", 0.4, -np.inf),
        ):
            drift = changed(get("drift", variant), known)
            assert drift.coefficient_bounds == ((low, np.inf), (low, np.inf))
            said = drift.sentence(JOINT, {"start_value": 0.1, "end_value": -0.2})
            assert f"goes from {had + 0.1:.3g} to {had - 0.2:.3g} " in said
            assert said.endswith(f"the model's {had:.3g} {printed(drift.parameters[0].unit)}.")


def test_less_friction_that_drifts_is_read_from_a_file():
    values = {"start_value": 0.0, "end_value": -1.2, "start": 0.0, "end": 9.0}
    one = from_values("drift", values, RUBBED, joint=JOINT, variant="coulomb")
    assert one.values == values


@pytest.mark.parametrize("law", ["drift", "asymmetric_friction"])
def test_what_a_law_settles_into_counts_from_what_is_described_as_well(law):
    motion = Motion(prepare(recorded()), RUBBED, np.zeros(0))
    plain = Candidates((), RUBBED).settled(Term(get(law), BODY), motion)
    assert plain is not None and plain.effect.coefficient_bounds == ((-RUBS, np.inf),)
