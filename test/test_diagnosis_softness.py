"""Efforts that were low-passed before they were recorded are told, and what is sharp is softened alike; soft gears are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.diagnosis.diagnose import examine
from bdnn_ros.diagnosis.softness import softness
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals import Signals, flattened, prepare
from bdnn_ros.simulation.scenario import Scenario
from bdnn_ros.simulation.simulate import simulate


def lowpassed(recording: Recording, cutoff: float, order: int = 2) -> Recording:
    """All signals behind a zero-phase Butterworth low-pass [Hz]."""
    sos = butter(order, cutoff, fs=recording.rate, output="sos")

    def passed(values: np.ndarray | None) -> np.ndarray | None:
        return None if values is None else sosfiltfilt(sos, values, axis=0)

    position, velocity, effort = map(passed, (recording.position, recording.velocity, recording.effort))
    assert position is not None
    return replace(recording, position=position, velocity=velocity, effort=effort)


def seen(recording: Recording) -> Signals:
    return flattened(prepare(recording), 7.0)


@pytest.mark.parametrize("name, seed", [("arm2", 11), ("arm6", 2), ("arm7", 31)])
@pytest.mark.parametrize("cutoff, order", [(1.5, 2), (3.0, 2), (3.0, 4), (5.0, 2)])
def test_a_lowpass_before_the_recording_is_found(name, seed, cutoff, order):
    robot = Robot.bundled(name)
    recording = Scenario(robot, seed=seed, duration=15.0, worn=True, wrong=0.05).run()[0].recording
    assert softness(seen(recording), robot) is None
    everything = lowpassed(recording, cutoff, order)
    found = softness(seen(everything), robot)
    assert found is not None and found.motion
    assert found.lowpass.cutoff == pytest.approx(cutoff, rel=0.1)
    assert abs(found.lowpass.order - order) <= 1  # of those run both ways
    efforts = softness(seen(replace(recording, effort=everything.effort)), robot)
    assert efforts is not None and efforts.lowpass.cutoff == pytest.approx(cutoff, rel=0.1)
    assert not efforts.motion or cutoff >= 5.0  # these motions have nothing that is faster


@pytest.mark.parametrize(
    "specs",
    [
        [
            "hysteresis@arm2_joint1:force=0.5,breakaway=0.05",
            "hysteresis@arm2_joint2:force=0.05,breakaway=0.05",
        ],
        ["joint_elasticity@arm2_joint1:stiffness=30", "joint_elasticity@arm2_joint2:stiffness=8"],
        ["viscous_friction@arm2_joint1:viscous=1", "coulomb_friction@arm2_joint2:coulomb=0.05"],
        [],
    ],
    ids=["gives way little by little", "soft gears", "friction", "nothing"],
)
def test_what_is_soft_in_the_robot_is_no_lowpass(specs):
    robot = Robot.bundled("arm2")
    effects = [parse_spec(spec, robot) for spec in specs]
    recording = simulate(robot, effects, seed=1, duration=15.0).recording
    assert softness(seen(recording), robot) is None


def test_info_tells_of_it(tmp_path, capsys):
    robot = Robot.bundled("arm2")
    recording = Scenario(robot, seed=11, duration=15.0, worn=True).run()[0].recording
    for one, told in ((recording, False), (lowpassed(recording, 3.0), True)):
        path = bags.write(one, tmp_path / str(told))
        assert main(["info", str(path)]) == 0
        assert ("the efforts were low-passed at about" in capsys.readouterr().out) == told


def test_friction_behind_a_lowpass_is_named_as_what_it_is():
    robot = Robot.bundled("arm2")
    specs = [
        *("coulomb_friction@arm2_joint1:coulomb=0.6", "coulomb_friction@arm2_joint2:coulomb=0.08"),
        *("viscous_friction@arm2_joint1:viscous=0.3", "viscous_friction@arm2_joint2:viscous=0.04"),
    ]
    effects = [parse_spec(spec, robot) for spec in specs]
    recording = simulate(robot, effects, seed=4, duration=30.0).recording
    diagnosis = examine([lowpassed(recording, 2.5)], robot).diagnosis
    assert {(f.effect, f.joint) for f in diagnosis.findings} == {
        (e.effect.name, robot.joints[e.target]) for e in effects
    }
    for finding in diagnosis.findings:
        (truth,) = (
            e for e in effects if (e.effect.name, robot.joints[e.target]) == (finding.effect, finding.joint)
        )
        for name, quantity in finding.parameters.items():
            assert quantity.value == pytest.approx(truth.values[name], rel=0.1)
    assert any("low-passed at about" in note for note in diagnosis.notes)
