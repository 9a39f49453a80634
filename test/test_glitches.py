"""Readings that stand out alone are replaced and told; what may be real is kept."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from reading_cases import glitched

from bdnn_ros import bags
from bdnn_ros.cli.main import main
from bdnn_ros.effects.registry import parse_spec
from bdnn_ros.recording import Recording
from bdnn_ros.robot import Robot
from bdnn_ros.signals.glitches import without_glitches
from bdnn_ros.simulation.simulate import simulate


def swing(noise: float = 0.01) -> Recording:
    """Two joints that swing, with friction that turns over where they do."""
    time = np.arange(4000) / 500.0
    position = np.stack([np.sin(2.0 * time), 0.5 * np.cos(3.0 * time)], axis=1)
    velocity = np.gradient(position, time, axis=0)
    rng = np.random.default_rng(0)
    effort = np.sign(velocity) + position + noise * rng.standard_normal(position.shape)
    return Recording(
        time, ("a", "b"), position + 1e-5 * rng.standard_normal(position.shape), velocity, effort
    )


@pytest.mark.parametrize("field, length", [("effort", 1), ("effort", 2), ("position", 1), ("velocity", 2)])
def test_readings_that_stand_out_alone_are_replaced_and_told(field, length):
    recording = swing()
    wrong = getattr(recording, field).copy()
    wrong[1000 : 1000 + length, 1] += 8.0
    mended = without_glitches(replace(recording, **{field: wrong}))
    values, right = getattr(mended, field), getattr(recording, field)
    np.testing.assert_array_equal(
        np.delete(values, [1000, 1001], axis=0), np.delete(right, [1000, 1001], axis=0)
    )
    assert np.abs(values[1000:1002] - right[1000:1002]).max() < 0.05
    assert mended.notes == (
        f"recording: {length} reading{'s' * (length > 1)} of b stood out alone ({field}); "
        "replaced by the median of the readings around. Check the driver and its bus.",
    )


@pytest.mark.parametrize("lasting", [3, 50])
def test_what_lasts_or_is_no_more_than_noise_steps_and_rounding_is_kept(lasting):
    recording = swing()
    pushed = recording.require_effort().copy()
    pushed[1000 : 1000 + lasting] += 8.0
    for kept in (
        recording,
        replace(recording, effort=pushed),
        replace(
            recording,
            effort=np.round(recording.require_effort(), 1),
            position=np.round(recording.position, 2),
        ),
        replace(recording, effort=np.zeros_like(pushed), velocity=None),
        recording.part(slice(0, 30)),
    ):
        assert without_glitches(kept) is kept


def test_impacts_of_a_loose_gear_are_kept():
    robot = Robot.bundled("arm2")
    loose = parse_spec("backlash@arm2_joint2:gap=0.02", robot)
    recording = simulate(robot, [loose], seed=1, duration=20.0).recording
    assert without_glitches(recording) is recording


def test_a_command_says_what_it_replaced_and_what_was_not_measured(tmp_path, capsys):
    robot = Robot.bundled("arm2")
    recording = glitched(simulate(robot, seed=3, duration=15.0).recording)
    effort = recording.require_effort() * [1.0, 0.0]
    bag = bags.write(replace(recording, effort=effort), tmp_path / "bag")
    assert main(["diagnose", str(bag), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr()
    notes = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["notes"]
    for words, printed in (("stood out alone", told.err), ("arm2_joint2 never changes", told.out)):
        assert words in printed
        assert sum(words in note for note in notes) == 1
