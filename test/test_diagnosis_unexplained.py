"""What is left is noise, or it is said what it depends on."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_cases import coloured, equations_of, white

from bdnn_ros.diagnosis.diagnose import diagnose
from bdnn_ros.diagnosis.regression.equations import Equations
from bdnn_ros.diagnosis.telling.predicting import Predictor
from bdnn_ros.diagnosis.telling.unexplained import describe
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.simulate import simulate

J1, J2 = "arm2_joint1", "arm2_joint2"
STD = 0.05


@pytest.fixture(scope="module")
def equations() -> Equations:
    return equations_of(duration=40.0)


def rows(equations: Equations, values: np.ndarray) -> np.ndarray:
    """Working samples (N,) as rows (R,), low-passed."""
    return equations.motion.signals.smooth(values)[equations.rows.samples]


@pytest.mark.parametrize("seed", range(4))
def test_noise_depends_on_nothing(equations, seed):
    noise, _ = white(equations, STD, seed)
    remainder = describe(equations, noise)
    assert remainder.inputs == {} and remainder.bursts == ()
    assert not remainder.predicted.any()
    np.testing.assert_allclose(remainder.floor, STD, rtol=0.1)


@pytest.mark.parametrize(
    "key, of",
    [
        (f"{J1}.position", lambda m: np.sin(9.0 * m.position[:, 0])),
        (f"{J1}.velocity", lambda m: np.exp(-np.abs(m.velocity[:, 0]) / 0.2) * m.signals.sign[:, 0]),
        (f"{J2}.position", lambda m: np.cos(2.0 * m.position[:, 1])),
        (f"{J2}.acceleration", lambda m: m.acceleration[:, 1]),
        ("time", lambda m: (m.time - m.time.mean()) / np.ptp(m.time)),
        ("time", lambda m: (np.exp(-m.time / 10.0) - 0.3) * m.velocity[:, 0]),
    ],
)
def test_what_it_depends_on_is_named_first(equations, key, of):
    noise, _ = white(equations, STD, 5)
    signal = rows(equations, of(equations.motion))
    signal = 4.0 * STD * (signal - signal.mean()) / signal.std()
    residual = noise.copy()
    residual[:, 0] += signal
    remainder = describe(equations, residual)
    assert next(iter(remainder.depends_on())) == key
    assert [*remainder.inputs] == [J1]
    assert remainder.floor[1] == pytest.approx(STD, rel=0.1)
    missed = remainder.floor[0] ** 2 - STD**2  # learning from 40 s of noisy rows costs some of the signal
    assert -0.01 < missed / np.mean(signal**2) < 0.06
    good = equations.usable[:, 0]
    assert np.corrcoef(remainder.predicted[good, 0], signal[good])[0, 1] > 0.95
    assert not remainder.predicted[:, 1].any()


@pytest.mark.parametrize(
    "keys, of",
    [
        (("position", "velocity"), lambda q, v: np.sin(2.0 * q[:, 0]) * np.sign(v[:, 0])),
        (("velocity", "velocity"), lambda q, v: v[:, 0] * v[:, 1]),
        (("velocity", "position"), lambda q, v: v[:, 0] * np.sin(2.0 * q[:, 1])),
        (("position",), lambda q, v: np.exp(-(((q[:, 0] - np.median(q[:, 0])) / 0.1) ** 2))),
    ],
)
def test_what_two_inputs_do_together_is_no_noise(equations, keys, of):
    """Nor is what happens at a place: neither is a sum of functions of single inputs that are smooth."""
    noise, _ = white(equations, STD, 5)
    signal = rows(equations, of(equations.motion.position, equations.motion.velocity))
    signal = 8.0 * STD * (signal - signal.mean()) / signal.std()
    residual = noise.copy()
    residual[:, 0] += signal
    scale = np.full(2, 20.0 * STD)
    remainder = describe(replace(equations, rows=replace(equations.rows, effort_scale=scale)), residual)
    other = J1 if keys == ("position", "velocity") else J2
    of_joints = {f"{joint}.{key}" for joint, key in zip((J1, other), keys, strict=False)}
    assert set(remainder.depends_on()) == of_joints
    assert remainder.floor[0] ** 2 - STD**2 < 0.15 * np.mean(signal**2)
    assert remainder.floor[1] == pytest.approx(STD, rel=0.1)


@pytest.mark.parametrize("seed", range(2))
def test_no_pair_predicts_noise_by_chance(equations, seed):
    """However much of the effort it is."""
    quiet = replace(equations, rows=replace(equations.rows, effort_scale=np.full(2, STD)))
    assert describe(quiet, white(equations, STD, seed)[0]).inputs == {}
    assert describe(quiet, coloured(equations, np.array([0.8]), STD, seed)).inputs == {}


def test_what_it_depends_on_is_told_of_the_joints_that_it_is_asked_of(equations):
    """By what it predicts there: of a weak joint a large share of its effort was told before much of a strong one's."""
    noise, _ = white(equations, STD, 5)
    of_first, of_second = (rows(equations, np.sin(9.0 * equations.motion.position[:, k])) for k in (0, 1))
    residual = noise + np.stack([10.0 * of_second, 4.0 * of_first], axis=1)
    scale = np.where(np.arange(2) == 0, 1e3, 1.0)  # the first joint is the strong one
    remainder = describe(replace(equations, rows=replace(equations.rows, effort_scale=scale)), residual)
    first, second = f"{J2}.position", f"{J1}.position"
    assert [*remainder.depends_on().items()][:2] == [(first, J1), (second, J2)]
    assert next(iter(remainder.depends_on((J2,)).items())) == (second, J2)
    assert first not in remainder.depends_on((J2,))


def test_joints_that_are_far_apart_in_the_list_are_tried():
    """So that neither their order, nor a branch, nor a second gripper changes what is noise."""
    arm = equations_of(robot="arm6", duration=40.0)
    noise, _ = white(arm, STD, 8)
    other = np.roll(np.arange(arm.rows.width), 3)
    signal = 10.0 * STD * rows(arm, np.sin(3.0 * arm.motion.position[:, other]))
    remainder = describe(arm, noise + signal)
    names = arm.motion.signals.joints
    assert set(remainder.depends_on()) == {f"{name}.position" for name in names}
    assert (remainder.floor**2 - STD**2 < 0.06 * np.mean(signal**2, axis=0)).all()


def test_slow_noise_is_not_predicted_by_chance():
    """Few of its values are independent, so that the best of many inputs looks like it, on held-out blocks, too."""
    arm = equations_of(robot="arm6", duration=40.0)
    for seed in range(2):
        remainder = describe(arm, coloured(arm, np.array([0.8]), STD, seed))
        assert remainder.inputs == {}


def test_no_order_of_inputs_changes_what_predicts():
    groups, value, block = chance(20)
    value = value + 2.0 * np.sin(groups["7"][:, 0])
    there, back = (
        Predictor(some, value, np.ones(len(value), bool), block).predicted()
        for some in (groups, dict(reversed(groups.items())))
    )
    assert list(there[1]) == list(back[1]) == ["7"]
    np.testing.assert_allclose(there[0], back[0], atol=1e-9)


def test_of_many_inputs_none_predicts_noise_by_chance():
    """The best of them suits the blocks that it is chosen by, but not those that are held out."""
    groups, value, block = chance(60)
    predicted, _ = Predictor(groups, value, np.ones(len(value), bool), block).predicted()
    assert np.mean((value - predicted) ** 2) > 0.95 * np.mean(value**2)


def chance(count: int) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Inputs that say nothing of a value, by name, the value, and blocks of its rows."""
    rng = np.random.default_rng(3)
    groups = {str(k): rng.standard_normal((200, 6)) for k in range(count)}
    return groups, rng.standard_normal(200), np.arange(200) // 10


def test_the_floor_is_never_above_what_is_left(equations):
    noise, _ = white(equations, STD, 6)
    residual = noise + rows(equations, equations.motion.velocity[:, 1])[:, None]
    remainder = describe(equations, residual)
    for j in range(2):
        assert remainder.floor[j] <= np.sqrt(np.mean(residual[equations.usable[:, j], j] ** 2)) + 1e-12


def test_what_comes_in_bursts_is_no_noise(equations):
    """A push whose times or place are wrong, a gap that is crossed: nothing predicts it, and between them it is calm."""
    noise, _ = white(equations, STD, 7)
    residual = noise.copy()
    residual[len(noise) // 4 : len(noise) // 3, 1] += 10.0 * STD
    remainder = describe(equations, residual)
    assert remainder.bursts == (J2,)
    np.testing.assert_allclose(remainder.floor, STD, rtol=0.25)
    assert remainder.floor[0] == pytest.approx(STD, rel=0.1)


def test_nothing_left_at_all(equations):
    remainder = describe(equations, np.zeros_like(equations.rows.target))
    assert remainder.inputs == {} and not remainder.floor.any()


@pytest.mark.parametrize("size, seconds, said", [(1.0, 1.0, (J2,)), (0.1, 1.0, ()), (1.0, 0.1, ())])
def test_what_a_joint_bears_at_rest_is_seen_where_it_is_large_and_lasts(equations, size, seconds, said):
    usable = equations.usable.copy()
    usable[len(usable) // 2 : len(usable) // 2 + 200, 1] = False
    resting = replace(equations, rows=replace(equations.rows, usable=usable))
    residual = np.zeros_like(equations.rows.target)
    time = equations.rows.time
    begun = time[len(usable) // 2 + 20]
    residual[(time >= begun) & (time < begun + seconds)] = size * equations.rows.effort_scale
    assert describe(resting, residual).resting == said


def test_noise_that_is_as_large_is_not_what_a_joint_bears_at_rest(equations):
    usable = equations.usable.copy()
    usable[len(usable) // 2 : len(usable) // 2 + 200, 1] = False
    loud = np.sign(np.sin(0.02 * np.arange(len(usable))))[:, None] * equations.rows.effort_scale
    assert describe(replace(equations, rows=replace(equations.rows, usable=usable)), loud).resting == ()


def test_a_recording_that_has_more_noise_than_another_has_no_bursts(equations):
    """As one along a faster motion may; what comes in bursts within one still does."""
    noise, _ = white(equations, STD, 3)
    time = equations.rows.time
    begun = float(time[0]), float(np.median(time))
    two = copy(equations)
    two.use_motion(replace(equations.motion, signals=replace(equations.motion.signals, begun=begun)))
    noise[time >= begun[1]] *= 5.0
    remainder = describe(two, noise)
    assert remainder.bursts == ()
    np.testing.assert_allclose(remainder.floor, STD * np.sqrt(13.0), rtol=0.1)
    noise[(time % 8.0 < 0.5), 1] += 40.0 * STD
    assert describe(two, noise).bursts == (J2,)


def test_bursts_that_the_steps_of_an_encoder_make_are_noise(equations):
    noise, _ = white(equations, STD, 7)
    residual = noise.copy()
    residual[len(noise) // 4 : len(noise) // 3, 1] *= 8.0
    assert describe(equations, residual).bursts == (J2,)
    still = describe(equations, residual, stepping=np.array([0.0, 10.0 * STD]))
    assert still.bursts == ()
    usual = np.sqrt(np.mean(residual[equations.usable[:, 1], 1] ** 2))
    assert still.floor[1] == pytest.approx(usual, rel=0.05)
    assert describe(equations, residual, stepping=np.array([10.0 * STD, STD])).bursts == (J2,)


def test_names_of_joints_may_hold_dots(equations):
    """As namespaces make them: `arm.joint1` is a neighbour of `arm.joint2`, and none of `arm`."""
    noise, _ = white(equations, STD, 0)
    noise[:, 1] += rows(equations, 0.1 * equations.motion.load[:, 0])
    plain = describe(equations, noise)
    signals = replace(equations.motion.signals, joints=("arm.joint1", "arm.joint2"))
    other = copy(equations)
    other.use_motion(replace(equations.motion, signals=signals))
    dotted = describe(other, noise)
    assert next(iter(plain.depends_on())) == f"{J1}.load"
    assert [*dotted.depends_on()] == [key.replace("arm2_", "arm.") for key in plain.depends_on()]


@pytest.mark.parametrize(
    "of, verdict, inputs",
    [
        (lambda q, v, t: 0.0 * t, "nothing_wrong", ()),
        (lambda q, v, t: np.sin(2.0 * np.pi * 1.3 * t), "cannot_tell", ()),
        (lambda q, v, t: v[:, 0] * v[:, 1], "cannot_tell", (f"{J1}.velocity", f"{J2}.velocity")),
        (
            lambda q, v, t: np.exp(-(((q[:, 1] - np.median(q[:, 1])) / 0.1) ** 2)),
            "cannot_tell",
            (f"{J2}.position",),
        ),
    ],
)
def test_what_the_library_does_not_hold_is_neither_named_nor_noise(of, verdict, inputs):
    """A hum, a product of velocities, a bump at a place: a fifth of an effort was no error, or cogging and a push."""
    simulated = simulate(Robot.bundled("arm2"), duration=25.0, seed=4)
    recording, joint = simulated.recording, 1 if inputs == (f"{J2}.position",) else 0
    effort = recording.require_effort().copy()
    added = of(simulated.position, simulated.velocity, recording.time)
    effort[:, joint] += 0.25 * effort[:, joint].std() * added / max(float(added.std()), 1e-9)
    diagnosis = diagnose([replace(recording, effort=effort)], Robot.bundled("arm2"))
    assert diagnosis.verdict == verdict
    assert {finding.effect for finding in diagnosis.findings} <= {"coulomb_friction", "viscous_friction"}
    assert set(diagnosis.unexplained_depends_on) == set(inputs)
