"""The files of an extension, round the whole way: hidden effects, extended URDF, simulation, gap closed."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.extension.effects_file import EffectsFile
from bdnn_ros.extension.extended import ExtendedModel
from bdnn_ros.extension.files import write_model_files
from bdnn_ros.extension.identified import of_physical
from bdnn_ros.extension.unwritten import NETWORKS
from bdnn_ros.physical.couplings import PER_COUPLING, CoupledMotors, Coupling
from bdnn_ros.physical.dictionary import CURVE_FEATURES
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.physical.parameters import PER_JOINT
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import prepare
from bdnn_ros.simulation.sensors import Noise
from bdnn_ros.simulation.simulate import simulate

HIDDEN = {
    "arm2": (
        "coulomb_friction@arm2_joint1:coulomb=0.8",
        "payload@arm2_tool:mass=0.4",
        "joint_spring@arm2_joint2:stiffness=0.5,rest=0.3",
        "base_tilt:pitch_deg=5",
    ),
    "arm7": (
        "viscous_friction@arm7_joint2:viscous=6",
        "armature@arm7_joint4:armature=0.4",
        "effort_scale@arm7_joint6:scale=0.8",
        "effort_delay:delay=0.006",
        "cogging@arm7_joint4:amplitude=1,periods_per_rev=9",
        "asymmetric_friction@arm7_joint1:positive=1,negative=0.6",
        "link_inertia@arm7_link4:scale=1.15",
    ),
}


@pytest.mark.parametrize("name", list(HIDDEN))
def test_simulated_again_the_gap_is_closed(name: str, tmp_path: Path) -> None:
    """The extended URDF with its effects moves as the real robot does, which the nominal one does not."""
    robot = Robot.bundled(name)
    hidden = [parse_spec(spec, robot) for spec in HIDDEN[name]]
    real = robot.with_inertials(robot.inertials * 1.04)
    quiet = Noise.of(0.0)
    truth = simulate(robot, hidden, duration=6.0, rate=200.0, noise=quiet, reality=real)
    model = ExtendedModel(real, tuple(hidden), np.zeros(robot.width))
    write_model_files(model, tmp_path)

    extended = Robot.from_file(tmp_path / "extended.urdf")
    effects = EffectsFile.read(tmp_path / "effects.yaml").effects(extended)
    again = ExtendedModel(extended, tuple(effects), np.zeros(robot.width))
    signals = prepare(truth.recording)
    assert signals.effort is not None
    inside = signals.interior

    def gap(prediction: np.ndarray) -> float:
        return float(np.sqrt(np.mean(signals.smooth(signals.effort - prediction)[inside] ** 2)))

    nominal = gap(robot.inverse_dynamics(signals.position, signals.velocity, signals.acceleration))
    held = 0.5 / signals.raw_rate  # the simulated command is held for a sample, so its stamp leads
    assert gap(replace(again, lead=held).predict(signals)) < 0.02 * nominal
    assert gap(again.predict(signals)) == pytest.approx(gap(model.predict(signals)), rel=1e-3)

    repeated = simulate(extended, effects, noise=quiet, plan=truth.plan)
    assert repeated.recording.effort is not None and truth.recording.effort is not None
    apart = np.sqrt(np.mean((prepare(repeated.recording).effort - signals.effort) ** 2))
    assert apart < 0.05 * nominal


def test_what_no_file_carries_is_named_in_each(tmp_path: Path) -> None:
    """Nothing is called the whole model where an effect says less than it does."""
    robot = Robot.bundled("arm2")
    model = ExtendedModel(robot, (), np.zeros(2))
    cases = {
        "": model,
        "lead of the recorded effort": replace(model, lead=0.01),
        "low-pass": replace(model, lag=0.01),
        "turns round before its joint": replace(model, sticking=(0.0, 0.1)),
        "is all there": replace(model, creep=((0.1, 0.1, 0.0),) * 2),
        "motors that turn with two joints": of_physical(coupled(robot)),
        "the networks learned": model,
    }
    for words, one in cases.items():
        beside = [NETWORKS] if words in NETWORKS and words else []
        write_model_files(one, tmp_path, beside=beside)
        comments = [line for line in (tmp_path / "effects.yaml").read_text().splitlines() if line[0] == "#"]
        mjcf = (tmp_path / "extended.mjcf.xml").read_text().partition("-->")[0]
        for text in (" ".join(comments), mjcf):
            assert words in text
            assert ("model.bdnn" in text) == bool(words), text
        assert ("is the whole model" in " ".join(comments)) == (not words)


def coupled(robot: Robot) -> PhysicalModel:
    """A model of which a motor turns with both joints."""
    count = robot.width * (PER_LINK + PER_JOINT)
    motors = CoupledMotors(
        (Coupling(0, 1),), np.ones((1, PER_COUPLING)), np.zeros((1, CURVE_FEATURES)), np.ones(1)
    )
    return PhysicalModel(robot, np.zeros(2), np.zeros((count, count)), np.ones(2), motors=motors)


def test_files_are_whole_and_readable_by_all(tmp_path: Path) -> None:
    robot = Robot.bundled("arm2")
    model = ExtendedModel(robot, (), np.zeros(2))
    paths = write_model_files(model, tmp_path / "deep" / "er")
    assert [path.name for path in paths] == ["extended.urdf", "extended.mjcf.xml", "effects.yaml"]
    mask = os.umask(0o022)
    os.umask(mask)
    assert all(path.stat().st_mode & 0o777 == 0o666 & ~mask for path in paths)
    assert sorted(os.listdir(tmp_path / "deep" / "er")) == sorted(path.name for path in paths)
    assert EffectsFile.read(paths[2]).effects(robot) == []
