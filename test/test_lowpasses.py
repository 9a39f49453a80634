"""Low-passes before a recording, and what gives back what they took, are what their equations say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from bdnn_ros.signals.kernels import convolved
from bdnn_ros.signals.lowpasses import Lowpass, Restored, Restoring, kernel_of, reach_of

RATE = 200.0
FREQUENCIES = np.linspace(0.0, 12.0, 61)
LOWPASSES = [Lowpass(cutoff, order) for cutoff in (1.0, 3.0, 8.0) for order in range(5)]


def heard(kernel: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """Gain of a symmetric kernel."""
    lags = (np.arange(len(kernel)) - len(kernel) // 2) / RATE
    return np.cos(2.0 * np.pi * np.outer(frequencies, lags)) @ kernel


@pytest.mark.parametrize("lowpass", LOWPASSES, ids=str)
def test_the_gain_is_one_half_at_the_cutoff_and_3_db_down_at_the_edge(lowpass):
    if lowpass.order:
        assert lowpass.gain(np.array([lowpass.cutoff])) == pytest.approx(0.5)
        assert lowpass.gain(np.array([lowpass.edge])) == pytest.approx(np.sqrt(0.5))
    else:
        ratio = np.log(lowpass.gain(np.array([lowpass.cutoff, lowpass.edge])))
        assert ratio == pytest.approx(np.log([0.5, np.sqrt(0.5)]))
    assert lowpass.gain(np.zeros(1)) == pytest.approx(1.0)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_it_is_a_butterworth_filter_run_both_ways(order):
    time = np.arange(0.0, 60.0, 1.0 / RATE)
    sos = butter(order, 3.0, fs=RATE, output="sos")
    kernel = kernel_of(Lowpass(3.0, order), RATE)
    rng = np.random.default_rng(order)
    wave = sum(np.sin(2.0 * np.pi * (f * time + rng.uniform())) for f in (0.3, 1.1, 2.9, 4.7))
    inner = slice(2000, -2000)
    np.testing.assert_allclose(convolved(wave, kernel)[inner], sosfiltfilt(sos, wave)[inner], atol=0.01)


@pytest.mark.parametrize("lowpass", LOWPASSES, ids=str)
def test_what_is_left_is_what_was_let_through_and_given_back(lowpass):
    left, back = Restored(lowpass), Restoring(lowpass)
    np.testing.assert_allclose(left.gain(FREQUENCIES), lowpass.gain(FREQUENCIES) * back.gain(FREQUENCIES))
    assert np.all(np.diff(left.gain(FREQUENCIES)) <= 0.0)
    assert left.gain(np.zeros(1)) == pytest.approx(1.0)
    assert left.edge > 0.98 * lowpass.edge  # of wide ones little is given back, so that noise stays
    assert left.gain(np.array([left.edge])) == pytest.approx(np.sqrt(0.5), abs=0.02)
    assert back.gain(FREQUENCIES).max() < 6.0  # noise is not raised without bound


@pytest.mark.parametrize("lowpass", LOWPASSES, ids=str)
@pytest.mark.parametrize("become", [lambda one: one, Restored, Restoring], ids=["itself", "left", "back"])
def test_a_kernel_has_the_gain_it_was_made_of(lowpass, become):
    kernel = kernel_of(become(lowpass), RATE)
    np.testing.assert_allclose(kernel, kernel[::-1], atol=1e-15)
    np.testing.assert_allclose(heard(kernel, FREQUENCIES), become(lowpass).gain(FREQUENCIES), atol=0.03)
    assert kernel.sum() == pytest.approx(1.0)
    assert 0 < reach_of(become(lowpass), RATE, 0.01) <= len(kernel) // 2


def test_convolution_goes_on_beyond_the_ends_and_takes_values_of_any_shape():
    kernel = kernel_of(Lowpass(2.0), RATE)
    still = np.broadcast_to(np.arange(6.0).reshape(1, 2, 3), (40, 2, 3))
    np.testing.assert_allclose(convolved(still, kernel), still, atol=1e-12)  # shorter than the kernel, too
    values = np.random.default_rng(0).standard_normal((900, 2))
    half = len(kernel) // 2
    by_hand = np.convolve(
        np.pad(values[:, 1], half, mode="reflect", reflect_type="odd"), kernel, mode="valid"
    )
    np.testing.assert_allclose(convolved(values, kernel)[:, 1], by_hand, atol=1e-12)
    line = np.linspace(-1.0, 4.0, 500)[:, None]
    np.testing.assert_allclose(convolved(line, kernel), line, atol=1e-12)
