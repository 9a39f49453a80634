"""Where most is of what corrections of an identified model mend, and how that did before."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from bdnn_ros.diagnosis.judging.attempt import Attempt
from bdnn_ros.diagnosis.recorded.compared import Compared
from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.coloring import noise_of
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.known import Known
from bdnn_ros.diagnosis.sentences import Kind
from bdnn_ros.diagnosis.telling.case import Case
from bdnn_ros.diagnosis.telling.left import error_then, mostly_at
from bdnn_ros.diagnosis.telling.unexplained import Remainder
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import flattened, prepare
from bdnn_ros.simulation.excitation import fourier
from bdnn_ros.simulation.scenario import Scenario

ARM = Robot.bundled("arm2")
SECOND = ARM.joints[1]


def rubbing(seconds: float, *effects: str) -> Recording:
    plan = fourier(ARM, np.arange(round(200.0 * seconds)) / 200.0, np.random.default_rng(round(seconds)))
    return Scenario(ARM, effects, seed=1, worn=True, noise=0.01, plan=plan).run()[0].recording


@cache
def model() -> PhysicalModel:
    return Identifier(ARM).fit([rubbing(20.0)])


@cache
def against(identified: bool) -> Equations:
    """A joint that rubs more than it did, against the model of before with what is not known of it, or without."""
    signals = flattened(prepare(rubbing(15.0, f"coulomb_friction@{SECOND}:coulomb=0.3")), 5.0)
    known = model()
    return build(signals, known.robot, known.predict(signals), Known(known.left_open if identified else None))


def test_most_of_what_is_mended_is_told_with_its_joint():
    equations = against(True)
    noise = noise_of(equations, 0.05 * equations.rows.target, 1e-4 * equations.rows.effort_scale)
    pool, test = Pool(equations, noise, [], 0.1), equations.rows.block % 5 == 2
    attempt = Attempt(test, [], pool, pool.residual_of_all())
    remainder, since = Remainder(np.ones(2), {}, np.zeros((1, 2))), Compared.of(model(), model().robot)
    case = Case((), model().robot, equations, attempt, (), remainder, since)
    (note,) = mostly_at(case, 0.5)
    assert note.values["joint"] == SECOND and note.values["does"].kind is Kind.OF_JOINT
    assert not [*mostly_at(case, 0.05), *mostly_at(replace(case, equations=against(False)), 0.5)]
    times = float(case.simulation[1] / model().noise[1])
    assert f"errs {times:.1f} times as much" in error_then(case, (SECOND,)).sentence(True)
    assert error_then(replace(case, earlier=None), (SECOND,)) == ""
