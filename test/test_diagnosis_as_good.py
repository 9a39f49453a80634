"""A tie with a richer law: another motion is advised only where this one has not shown yet that the plainer law will do."""

from __future__ import annotations

import pytest
from diagnosis_cases import equations_of, white

from bdnn_ros.diagnosis.judging.identifiability import Judgement
from bdnn_ros.diagnosis.judging.posterior import estimates
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.diagnosis.telling.advice import advice
from bdnn_ros.diagnosis.telling.as_good import at_most
from bdnn_ros.effects.registry import get
from bdnn_ros.robot import Robot

ARM = Robot.bundled("arm2")


def advised(uneven: float, one_way: bool = False, noise: float = 0.02, law: str = "asymmetric_friction"):
    """The advice on Coulomb friction of 0.3 N·m that is so much more one way [N·m], and its rival, along a motion."""
    spec = f"asymmetric_friction@arm2_joint2:positive={0.3 + uneven},negative=0.3"
    equations = equations_of([spec], duration=40.0)
    left, model = white(equations, noise * float(equations.rows.effort_scale[1]))
    equations = equations.with_target(equations.rows.target + left)
    if one_way:
        velocity = equations.motion.velocity[equations.rows.samples]
        equations.use_rows(equations.usable & (velocity > 0.5 * velocity.max(axis=0)))
    pool, rival = Pool(equations, model, [Term(get("coulomb_friction"), 1)], 0.02), Term(get(law), 1)
    rival = rival.shaped(rival.shapes(equations.motion)[0])
    (said,) = advice(
        estimates(pool, pool.whole),
        [Judgement(0.8, 0.0, ((rival, 0.2),))],
        ARM,
        lambda one: ARM.joints[one.target],
        at_most=lambda one, rival: at_most(equations, pool, one, rival),
    )
    return said


def test_what_a_motion_has_shown_to_be_as_good_takes_no_other():
    said = advised(0.0)
    assert said.startswith("What asymmetric Coulomb friction at arm2_joint2 would do beyond Coulomb friction")
    assert "record" not in said and "excite" not in said


def test_what_a_motion_would_have_shown_is_told_by_its_size():
    """The same motion once more was advised after it had been made."""
    said = advised(0.0, noise=0.4)
    assert said.startswith("Asymmetric Coulomb friction of a usual size at arm2_joint2 would have shown")
    assert "Only a far longer recording" in said and "excite" not in said


@pytest.mark.parametrize(
    "otherwise",
    [{"one_way": True}, {"noise": 10.0}, {"law": "stribeck_friction"}, {"uneven": 0.3, "noise": 0.4}],
)
def test_what_a_motion_has_not_shown_takes_another(otherwise):
    """Friction that goes one way only, that hides in noise, a shape that other motions may show, and what seems to be there."""
    said = advised(**{"uneven": 0.0, **otherwise})
    assert said.startswith("To tell Coulomb friction at arm2_joint2 from") and "bdnn excite" in said
