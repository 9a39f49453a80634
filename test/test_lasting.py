"""What lasts: as an opening by as many samples, however many they are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_opening

from bdnn_ros.signals.kernels import convolved_at, convolving_at
from bdnn_ros.signals.lasting import lasting


@pytest.mark.parametrize("least", [1, 2, 7, 50, 400])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.97, 1.0])
def test_flags_that_are_up_for_less_long_are_taken_down(least: int, share: float) -> None:
    flags = np.random.default_rng(least).random((280, 3)) < share
    np.testing.assert_array_equal(lasting(flags, least), binary_opening(flags, np.ones((least, 1), bool)))


@pytest.mark.parametrize("step", [1, 5, 90])
def test_a_low_pass_at_some_samples_is_the_same_by_dense_and_by_sparse_products(step: int) -> None:
    generator, segments = np.random.default_rng(step), (slice(0, 130), slice(130, 400))
    values, weights = generator.normal(size=(400, 2, 3)), np.hanning(31)
    samples = np.arange(3, 400, step)
    expected = convolving_at(weights, samples, segments) @ values.reshape(400, -1)
    found = convolved_at(values, weights, samples, segments)
    np.testing.assert_allclose(found, expected.reshape(-1, 2, 3), atol=1e-12)
