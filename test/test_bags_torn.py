"""Bags with commands and descriptions that cannot be decoded: these are left out and told of, as joint states are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_cases import (
    EPOCH,
    MULTI_ARRAY,
    PENDULUM,
    SECOND,
    STRING,
    Message,
    command,
    motion,
    states,
    text,
    write_bag,
)

from bdnn_ros import bags
from bdnn_ros.errors import BagError

TORN = command((1.0,))[:9]


def commanded(*sent: bytes) -> list[Message]:
    """Joint states, and a command every tenth of a second from the first on."""
    told = states(replace(motion(samples=50), effort=None))
    return [
        *told,
        *(("/u", MULTI_ARRAY, EPOCH + k * SECOND // 10 - 1, data) for k, data in enumerate(sent)),
    ]


def test_a_command_that_cannot_be_decoded_is_left_out(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", commanded(command((1.0,)), TORN, command((2.0,))))
    again = bags.read(path, bags.Selection(effort="command"))
    np.testing.assert_array_equal(again.require_effort()[:, 0], np.repeat([1.0, 2.0], (20, 30)))
    said = "1 of 3 commands on /u cannot be decoded (A message of 9 bytes ends too early); left out."
    assert any(said in note for note in again.notes)
    played = bags.read_to_play(path, "/joint_states", "/u")
    np.testing.assert_array_equal(played.commands, [[1.0], [2.0]])
    assert any(said in note for note in played.recording.notes)


def test_commands_of_which_none_can_be_decoded_are_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", commanded(TORN, TORN))
    for read in (
        lambda: bags.read(path, bags.Selection(effort="command")),
        lambda: bags.read_to_play(path, "/joint_states", "/u"),
    ):
        with pytest.raises(BagError, match="no message on /u can be decoded"):
            read()


@pytest.mark.parametrize("whole", [True, False])
def test_a_description_that_cannot_be_decoded_is_left_out(tmp_path: Path, whole: bool) -> None:
    torn = ("/robot_description", STRING, EPOCH + 1, text(PENDULUM)[:99])
    held = [("/robot_description", STRING, EPOCH, text(PENDULUM))] * whole
    path = write_bag(tmp_path / "bag", [*held, torn, *states(motion(samples=50))])
    again = bags.read(path)
    assert again.urdf == bags.read_description(path) == (PENDULUM if whole else None)
    assert any("a robot description on /robot_description cannot be decoded" in note for note in again.notes)
