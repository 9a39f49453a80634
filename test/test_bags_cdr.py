"""CDR against rosbags' own serializer, for all kinds of names and values."""

from __future__ import annotations

import numpy as np
import pytest
from bag_cases import command, joint_state, text
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from bdnn_ros.bags.cdr import (
    MalformedMessage,
    decode_float64_multi_array,
    decode_string,
    encode_float64_multi_array,
    encode_joint_states,
    encode_string,
    joint_state_layout,
)

NAMES = st.lists(
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20),
    min_size=1,
    max_size=9,
    unique=True,
)
VALUES = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(max_examples=100, deadline=None)
@given(NAMES, st.integers(0, 2**31 * 10**9 - 1), st.booleans(), st.booleans(), st.booleans(), st.data())
def test_joint_states(
    names: list[str], stamp: int, moves: bool, pushes: bool, little: bool, data: st.DataObject
) -> None:
    values = data.draw(arrays.arrays(float, (3, len(names)), elements=VALUES))
    velocity, effort = values[1] if moves else (), values[2] if pushes else ()
    theirs = joint_state(names, values[0], velocity, effort, stamp, little)
    if little:
        ours = encode_joint_states(
            names,
            np.array([stamp]),
            values[:1],
            values[1:2] if moves else None,
            values[2:] if pushes else None,
        )
        assert ours == [theirs]
    layout = joint_state_layout(theirs)
    rows = np.frombuffer(theirs, np.uint8)[None]
    assert layout.names == tuple(names)
    assert layout.matches(rows).all()
    assert layout.stamps(rows).tolist() == [stamp]
    for span, expected in zip(
        (layout.position, layout.velocity, layout.effort), (values[0], velocity, effort), strict=True
    ):
        found = layout.values(rows, span)
        if len(expected):
            assert found is not None
            np.testing.assert_array_equal(found[0], expected)
        else:
            assert found is None


def test_unset_alignment_bytes_and_frames_do_not_matter() -> None:
    names = ("a", "bcd", "ef")
    clean = np.frombuffer(joint_state(names, (1, 2, 3), (4, 5, 6), (7, 8, 9), frame="base"), np.uint8)
    layout = joint_state_layout(clean.tobytes())
    dirty = clean.copy()
    gaps = [k for k in range(4, len(clean)) if k not in layout.fixed and clean[k] == 0]
    dirty[:4] = (0, 1, 77, 77)
    dirty[list(clean.tobytes()).index(ord("b")) :][:4] = np.frombuffer(b"BASE", np.uint8)
    first_name = clean.tobytes().index(b"a\0\0\0", 24)
    dirty[first_name + 2 : first_name + 4] = 99
    assert gaps
    assert layout.matches(dirty[None]).all()
    position = layout.values(dirty[None], layout.position)
    assert position is not None and position.tolist() == [[1.0, 2.0, 3.0]]
    other = clean.copy()
    other[first_name] = ord("z")
    assert not layout.matches(other[None]).any()


@given(st.binary(max_size=120))
def test_any_bytes_are_decoded_or_refused(raw: bytes) -> None:
    for prefix in (b"", b"\x00\x01\x00\x00"):
        for decode in (joint_state_layout, decode_string, decode_float64_multi_array):
            try:
                decode(prefix + raw)
            except MalformedMessage:
                continue


def test_every_cut_is_noticed() -> None:
    whole = joint_state(("a", "bcd"), (1, 2), (3, 4), (5, 6), 7)
    for length in range(len(whole)):
        with pytest.raises(MalformedMessage):
            joint_state_layout(whole[:length])


@given(st.text(st.characters(codec="utf-8", exclude_characters="\0")))
def test_strings(value: str) -> None:
    assert encode_string(value) == text(value)
    assert decode_string(text(value)) == value


@given(arrays.arrays(float, st.integers(0, 8), elements=VALUES), st.lists(st.text(max_size=5), max_size=3))
def test_arrays(values: np.ndarray, labels: list[str]) -> None:
    assert encode_float64_multi_array(values) == command(values)
    labels = [label.replace("\0", "") for label in labels]
    np.testing.assert_array_equal(decode_float64_multi_array(command(values, labels)), values)
