"""Networks of what named causes leave: what they see, what they add, and how they are stored."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.bdnn.rest import HIDDEN, QUANTITIES, Input, RestNetwork, effort_of

INPUTS = (
    Input(0, "position", -1.0, 1.0, 1.0),
    Input(1, "velocity", -2.0, 2.0, 0.7),
    Input(1, "load", -5.0, 5.0, 2.0),
)


def motion(count: int = 40) -> list[np.ndarray]:
    """Position, velocity, direction and load of two joints, within what the networks have seen."""
    rng = np.random.default_rng(0)
    position, velocity, load = (rng.uniform(-1.0, 1.0, (count, 2)) for _ in range(3))
    return [position, velocity, np.sign(velocity), load]


def taught() -> RestNetwork:
    network = RestNetwork.silent(1, INPUTS)
    return network.with_weights(np.random.default_rng(1).normal(size=len(network.output_weights)))


def test_a_silent_one_adds_nothing_and_every_feature_has_its_penalty():
    for some in ([one] for one in INPUTS):
        network = RestNetwork.silent(0, some)
        assert network.features(*motion()).shape == (40, len(network.penalties))
    network = RestNetwork.silent(1, INPUTS)
    assert network.features(*motion()).shape == (40, len(network.penalties))
    assert not effort_of([network], *motion()).any()


def test_it_adds_to_its_joint_alone_for_any_shape_of_arguments():
    network, given = taught(), motion()
    both = effort_of([network, network], *given)
    assert not both[:, 0].any()
    np.testing.assert_allclose(both[:, 1], 2.0 * network.effort(*given))
    one = effort_of([network], *(values[7] for values in given))
    np.testing.assert_allclose(one[1], network.effort(*given)[7])


def test_it_depends_on_its_inputs_and_on_nothing_else():
    network, given = taught(), motion()
    before = network.effort(*given)
    for place, joint in ((0, 1), (1, 0), (2, 0), (3, 0)):
        other = [values.copy() for values in given]
        other[place][:, joint] = 0.3
        np.testing.assert_array_equal(network.effort(*other), before)


def test_beyond_what_it_has_seen_it_says_what_it_does_at_the_end():
    network, given = taught(), motion()
    assert not network.beyond(given[0], given[1], given[3]).any()
    given[0][:, 0] = 1.0
    at_end = network.effort(*given)
    given[0][:, 0] = 1.7
    np.testing.assert_allclose(network.effort(*given), at_end)
    assert network.beyond(given[0], given[1], given[3]).all()


def test_what_is_stored_comes_back():
    network = taught()
    arrays, info = network.to_state()
    back = RestNetwork.from_state(arrays, info, 2)
    np.testing.assert_array_equal(back.effort(*motion()), network.effort(*motion()))
    assert back.inputs == network.inputs and {one.quantity for one in back.inputs} == set(QUANTITIES)


@pytest.mark.parametrize(
    "fault",
    [
        lambda arrays, info: info["inputs"][0].__setitem__(1, "acceleration"),
        lambda arrays, info: info["inputs"][0].__setitem__(0, 2),
        lambda arrays, info: info.__setitem__("inputs", []),
        lambda arrays, info: info.__setitem__("joint", -1),
        lambda arrays, info: arrays.__setitem__("hidden_bias", np.zeros(HIDDEN - 1)),
        lambda arrays, info: arrays.pop("output_weights"),
    ],
)
def test_what_does_not_fit_is_refused(fault):
    arrays, info = taught().to_state()
    fault(arrays, info)
    with pytest.raises((KeyError, TypeError, ValueError)):
        RestNetwork.from_state(arrays, info, 2)


def test_an_input_may_be_of_a_slide():
    """The phase of its position runs over half a turn from one end of what was seen to the other."""
    slide = replace(INPUTS[0], low=0.0, high=0.2, scale=np.pi / 0.2)
    network = RestNetwork.silent(0, [slide])
    at_ends = network.features(np.array([[0.0, 0.0], [0.2, 0.0]]), *(np.zeros((2, 2)) for _ in range(3)))
    np.testing.assert_allclose(at_ends[:, 2], [1.0, -1.0])
