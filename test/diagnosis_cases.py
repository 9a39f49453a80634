"""Regressions made by hand for the tests of the diagnosis, and the contract's form of its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from bdnn_ros.diagnosis.regression.building import build
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.regression.noise import Noise
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import EFFECTS, get, parse_spec, variants
from bdnn_ros.physical.links import relative_inertials
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.scores import described_effort
from bdnn_ros.signals import Signals, flattened, prepare
from bdnn_ros.simulation.excitation import fourier

RATE, CUTOFF = 200.0, 5.0


@cache
def signals_of(robot: str = "arm2", duration: float = 12.0, seed: int = 0) -> Signals:
    """A noise-free motion as a diagnosis sees it; its effort is that of the description."""
    arm = Robot.bundled(robot)
    time = np.arange(round(duration * RATE)) / RATE
    plan = fourier(arm, time, np.random.default_rng(seed))
    recording = Recording(time, arm.joints, plan.position, plan.velocity, np.zeros_like(plan.position))
    signals = flattened(prepare(recording), CUTOFF)
    return replace(signals, effort=described_effort(arm, signals), unmeasured=None)


def term(spec: str, robot: Robot) -> tuple[Term, np.ndarray]:
    """An effect with its true shape, and its true coefficients."""
    one = parse_spec(spec, robot)
    coefficients, shape = one.effect.coefficients(one.values)
    return Term(one.effect, one.target, one.link).shaped(shape), coefficients


def equations_of(
    specs: Sequence[str] = (), robot: str = "arm2", errors: np.ndarray | None = None, duration: float = 12.0
) -> Equations:
    """A noise-free regression whose effort holds some effects and some relative errors of the links."""
    arm, signals = Robot.bundled(robot), signals_of(robot, duration)
    assert signals.effort is not None
    motion = Motion(signals, arm, signals.effort)
    effort = signals.effort.copy()
    for spec in specs:
        one, coefficients = term(spec, arm)
        effort += one.effect.columns(motion, one.target, dict(one.shape), one.link) @ coefficients
    if errors is not None:
        effort += motion.regressor @ (relative_inertials(arm) @ errors)
    return build(replace(signals, effort=effort), arm)


def white(equations: Equations, std: float, seed: int = 0) -> tuple[np.ndarray, Noise]:
    """White noise on the rows, (R, n) [N·m], and its model."""
    rng = np.random.default_rng(seed)
    noise = Noise(np.zeros((equations.rows.width, 1)), np.full(equations.rows.width, std))
    return std * rng.standard_normal(equations.rows.target.shape), noise


def coloured(equations: Equations, coefficients: np.ndarray, std: float, seed: int = 0) -> np.ndarray:
    """Autoregressive noise on the rows, (R, n) [N·m]."""
    rng = np.random.default_rng(seed)
    result = std * rng.standard_normal(equations.rows.target.shape)
    for k in range(len(result)):
        for lag, a in enumerate(coefficients, start=1):
            if k >= lag:
                result[k] += a * result[k - lag]
    return result


def check_contract(report: Mapping[str, Any]) -> None:
    """Asserts the contract's form of diagnosis.json; more keys than it names are free."""
    assert (report["format"], report["version"]) == ("bdnn_ros/diagnosis", 1)
    source = report["source"]
    assert all(isinstance(bag, str) for bag in source["bags"]) and isinstance(source["urdf"], str)
    assert isinstance(source["samples"], int)
    assert all(isinstance(source[key], float) for key in ("duration", "rate"))
    assert all(isinstance(joint, str) for joint in source["joints"])
    assert report["verdict"] in ("nothing_wrong", "explained", "partly_explained", "cannot_tell")
    shares = [finding["share"] for finding in report["findings"]]
    assert shares == sorted(shares, reverse=True)
    for finding in report["findings"]:
        _check_finding(finding)
    assert set(report["effort_rmse"]) >= {"simulation", "extended", "noise_floor"}
    for values in report["effort_rmse"].values():
        assert len(values) == len(source["joints"]) and all(v >= 0.0 for v in values)
    low, high = report["gain"]["interval"]
    assert low <= report["gain"]["value"] <= high <= 1.0
    unexplained = report["unexplained"]
    assert unexplained["share"] >= 0.0 and isinstance(unexplained["sentence"], str)
    assert all(isinstance(one, str) for one in unexplained["depends_on"])
    assert all(isinstance(one, str) for one in report["advice"])


def _check_finding(finding: Mapping[str, Any]) -> None:
    assert set(finding) - {"variant"} == {
        *("effect", "joint", "link", "parameters", "share", "probability", "rivals", "sentence")
    }
    assert 0.0 <= finding["share"] <= 1.0
    assert finding["effect"] in EFFECTS and isinstance(finding["sentence"], str)
    assert 0.0 <= finding["probability"] <= 1.0
    names = {p.name for effect in EFFECTS.values() for p in effect.parameters} | {"torque"}
    assert finding["parameters"] and set(finding["parameters"]) <= names
    for quantity in finding["parameters"].values():
        assert set(quantity) == {"value", "std", "unit"}
        assert isinstance(quantity["value"], float) and quantity["std"] >= 0.0
    for one in (finding, *finding["rivals"]):
        _check_place(one)
    for rival in finding["rivals"]:
        assert set(rival) - {"variant"} == {"effect", "joint", "link", "probability"}
        assert 0.0 <= rival["probability"] <= 1.0


def _check_place(one: Mapping[str, Any]) -> None:
    """A joint, a link, or neither for the base and for all joints."""
    on = {get(one["effect"]).on, *get(one["effect"]).also_on}
    assert one.get("variant", "") in {effect.variant for effect in variants(one["effect"])}
    assert not (one["joint"] and one["link"])
    assert one["joint"] or one["link"] or on & {"base", "all"}
