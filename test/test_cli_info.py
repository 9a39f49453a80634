"""What `bdnn info` says of the velocity, of rare samples and of what does not go with the description; and its last line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import PENDULUM
from cli_cases import swing
from scipy.signal import lfilter

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.simulation.excitation import fourier

ARM = Robot.bundled("arm6")
FIT = "Fit for identification."


def recorded(rate: float = 200.0, duration: float = 20.0) -> Recording:
    """What sensors of a worn arm report along a motion, with its description."""
    generator, n = np.random.default_rng(3), ARM.width
    worn = ARM.with_joint_parameters(np.full(n, 0.1), np.full(n, 2.0), np.full(n, 1.0))
    plan = fourier(ARM, np.arange(0.0, duration, 1.0 / rate), np.random.default_rng(1))
    effort = worn.inverse_dynamics(plan.position, plan.velocity, plan.acceleration)
    effort += 0.002 * np.ptp(effort, axis=0) * generator.normal(size=effort.shape)
    position = plan.position + 2e-5 * generator.normal(size=effort.shape)
    return Recording(plan.time, ARM.joints, position, plan.velocity, effort, urdf=ARM.urdf)


def told(
    recording: Recording, place: Path, capsys: pytest.CaptureFixture[str], status: int = 0
) -> tuple[list[str], str]:
    """The concerns, and the last line printed."""
    path = str(bags.write(recording, place / "bag"))
    capsys.readouterr()
    assert main(["info", path, "--json"]) == status
    concerns = json.loads(capsys.readouterr().out)["concerns"]
    assert main(["info", path]) == status
    return concerns, capsys.readouterr().out.splitlines()[-1]


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (-1.0, "has the opposite sign of its position's derivative. Let the driver turn it"),
        (
            np.degrees(1.0),
            "is 57.30 times its position's derivative, as in degrees. Let the driver report it in the unit rad/s",
        ),
        (0.8, "is 0.80 times its position's derivative. Check its unit"),
    ],
)
@pytest.mark.parametrize("described", [True, False])
def test_a_velocity_that_is_no_derivative_is_told(tmp_path, capsys, factor, said, described):
    plain = recorded() if described else replace(recorded(), urdf=None)
    assert plain.velocity is not None
    factors = np.where(np.arange(ARM.width) == 2, factor, 1.0)
    concerns, _ = told(replace(plain, velocity=factors * plain.velocity), tmp_path, capsys)
    (concern,) = (one for one in concerns if "velocity" in one)
    assert f"the velocity of {ARM.joints[2]} {said}" in concern


def test_a_filtered_velocity_is_told(tmp_path, capsys):
    plain, keep = recorded(), np.exp(-2.0 * np.pi * 8.0 / 200.0)
    assert plain.velocity is not None
    velocity = plain.velocity.copy()
    velocity[:, 1] = lfilter([1.0 - keep], [1.0, -keep], velocity[:, 1])
    concerns, last = told(replace(plain, velocity=velocity), tmp_path, capsys)
    assert [f"velocity of {ARM.joints[1]} lags" in one for one in concerns] == [True] and last == FIT


def test_a_velocity_of_a_good_recording_is_not_spoken_of(tmp_path, capsys):
    plain, generator = recorded(), np.random.default_rng(0)
    velocity = plain.velocity
    assert velocity is not None
    cases = {
        "plain": plain,
        "none": replace(plain, velocity=None),
        "steps": replace(plain, velocity=0.02 * np.round(velocity / 0.02)),
        "counts": replace(plain, position=1e-3 * np.round(plain.position / 1e-3)),
        "noise": replace(plain, velocity=velocity + 0.3 * generator.normal(size=velocity.shape)),
        "rare": plain.part(slice(None, None, 10)),
        "uneven": replace(plain, time=plain.time + 0.45 / 200.0 * generator.uniform(-1, 1, len(plain))),
    }
    for name, recording in cases.items():
        concerns, last = told(recording, tmp_path / name, capsys)
        assert not [one for one in concerns if "velocity" in one], name
        assert last == FIT


@pytest.mark.parametrize("rate", [8.0, 30.0, 60.0, 100.0])
def test_samples_that_are_too_rare_for_what_is_fast_are_told(tmp_path, capsys, rate):
    pendulum = Robot.from_urdf(PENDULUM)
    concerns, last = told(swing(pendulum, 30.0, rate), tmp_path, capsys)
    rare = [one for one in concerns if f"{rate:g} Hz" in one]
    assert len(rare) == (rate < 60.0) and last == FIT
    for one in rare:
        assert "friction" in one and "Record at 100 Hz or more" in one


def test_positions_in_degrees_are_unfit(tmp_path, capsys):
    plain = recorded()
    path = str(
        bags.write(replace(plain, position=np.degrees(plain.position), velocity=None), tmp_path / "bag")
    )
    assert main(["info", path]) == 1
    captured = capsys.readouterr()
    assert "seem to be in degrees" in captured.err and "Fit" not in captured.out


@pytest.mark.parametrize("factor", [1000.0, -1.0])
def test_the_last_line_says_what_has_to_be_put_right_first(tmp_path, capsys, factor):
    plain = recorded()
    assert plain.effort is not None
    concerns, last = told(replace(plain, effort=factor * plain.effort), tmp_path, capsys)
    assert len(concerns) == 1 and "effort" in concerns[0]
    assert last == (
        "Fit for identification once recording and description go together, see above; until then `bdnn diagnose` refuses it."
    )
