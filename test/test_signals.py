"""Signals: the kernel on functions whose filtered form is known, and the bookkeeping of pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.diagnosis.recorded.joining import concatenated
from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.recording import Recording
from bdnn_ros.signals import DEFAULT_CUTOFF, Signals, flattened, prepare
from bdnn_ros.signals.kernels import gaussian_kernel, gaussian_std, passed_noise
from bdnn_ros.signals.lowpasses import Lowpass

JOINTS = ("a", "b")


def recording(time: np.ndarray, position: np.ndarray, effort: np.ndarray | None = None) -> Recording:
    """A recording of two joints that do the same, or of the columns given."""
    both = np.stack([position, position], axis=1) if position.ndim == 1 else position
    return Recording(time, JOINTS, both, None, effort, name="bag")


def sine(frequency: float, rate: float = 500.0, duration: float = 6.0) -> Recording:
    """A sinusoid of amplitude 1."""
    time = np.arange(0.0, duration, 1.0 / rate)
    return recording(time, np.sin(2.0 * np.pi * frequency * time))


@pytest.mark.parametrize("rate", [60.0, 125.0, 500.0, 5000.0])
def test_the_cut_off_is_where_the_gain_is_minus_three_decibel(rate: float) -> None:
    cutoff = 5.0
    weights, _, _ = gaussian_kernel(gaussian_std(cutoff), rate)
    t = (np.arange(len(weights)) - len(weights) // 2) / rate
    assert np.sum(weights * np.cos(2.0 * np.pi * cutoff * t)) == pytest.approx(
        10 ** (-3.0103 / 20.0), rel=2e-3
    )


def test_polynomials_come_out_as_they_must() -> None:
    time = np.arange(2000) / 250.0
    a, b, c = 0.3, -0.2, 0.05
    signals = prepare(recording(time, a + b * time + c * time**2))
    variance = signals.kernel_std**2
    t = signals.time
    np.testing.assert_allclose(signals.acceleration[:, 0], 2.0 * c, rtol=1e-7)
    np.testing.assert_allclose(signals.velocity[:, 0], b + 2.0 * c * t, atol=1e-9)
    np.testing.assert_allclose(
        signals.position[:, 0], a + b * t + c * (t**2 + variance), rtol=1e-3, atol=1e-6
    )
    ramp = prepare(recording(time, a + b * time))
    np.testing.assert_allclose(ramp.position[:, 0], a + b * ramp.time, atol=1e-12)
    np.testing.assert_allclose(ramp.acceleration, 0.0, atol=1e-8)


@pytest.mark.parametrize("frequency", [0.3, 1.0, 4.0, 9.0])
@pytest.mark.parametrize("rate", [125.0, 500.0, 1000.0])
def test_sinusoids_are_damped_by_the_gaussian(frequency: float, rate: float) -> None:
    signals = prepare(sine(frequency, rate), DEFAULT_CUTOFF)
    omega = 2.0 * np.pi * frequency
    gain = np.exp(-0.5 * (omega * signals.kernel_std) ** 2)
    phase = omega * signals.time
    scale = 4e-3 * gain  # the kernel ends after four standard deviations
    np.testing.assert_allclose(signals.position[:, 0], gain * np.sin(phase), atol=scale)
    np.testing.assert_allclose(signals.velocity[:, 0], gain * omega * np.cos(phase), atol=scale * omega)
    np.testing.assert_allclose(
        signals.acceleration[:, 0], -gain * omega**2 * np.sin(phase), atol=scale * omega**2
    )


def test_effort_and_reported_velocity_pass_the_same_filter() -> None:
    original = sine(3.0)
    velocity = np.cos(original.time)[:, None] * np.ones(2)
    signals = prepare(replace(original, effort=original.position, velocity=velocity))
    assert signals.effort is not None and signals.reported_velocity is not None
    np.testing.assert_allclose(signals.effort, signals.position, atol=1e-12)
    slow = np.exp(-0.5 * signals.kernel_std**2)
    np.testing.assert_allclose(signals.reported_velocity[:, 0], slow * np.cos(signals.time), atol=1e-4)


def test_the_working_rate_is_bounded() -> None:
    assert prepare(sine(1.0, 5000.0)).rate == pytest.approx(200.0, rel=0.01)
    assert prepare(sine(1.0, 500.0)).rate == pytest.approx(250.0, rel=0.01)
    assert prepare(sine(1.0, 999.0)).rate == pytest.approx(prepare(sine(1.0, 1001.0)).rate, rel=0.01)
    assert prepare(sine(1.0, 99.9)).rate == pytest.approx(prepare(sine(1.0, 100.1)).rate, rel=0.01)
    slow = prepare(sine(0.3, 30.0, 30.0))
    assert (slow.cutoff, slow.raw_rate) == pytest.approx((5.0, 30.0))
    assert slow.rate >= 90.0


def test_jittered_stamps_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    even = np.arange(3000) / 500.0
    time = even + rng.uniform(-0.0008, 0.0008, len(even))
    signals = prepare(recording(time, np.sin(4.0 * time)))
    gain = np.exp(-0.5 * (4.0 * signals.kernel_std) ** 2)
    np.testing.assert_allclose(signals.velocity[:, 0], 4.0 * gain * np.cos(4.0 * signals.time), atol=4e-3)
    np.testing.assert_allclose(
        signals.acceleration[:, 0], -16.0 * gain * np.sin(4.0 * signals.time), atol=0.05
    )


def test_a_clock_that_drifts_slightly_does_not_add_up() -> None:
    """Steps within a thousandth of the median, that would be a tenth of a second off in the end."""
    steps = np.where(np.arange(30000) < 20000, 0.002, 0.002 * (1.0 - 9e-4))
    time = np.cumsum(steps)
    signals = prepare(recording(time, np.sin(time)))
    gain = np.exp(-0.5 * signals.kernel_std**2)
    np.testing.assert_allclose(signals.position[:, 0], gain * np.sin(signals.time), atol=1e-5)


def test_nothing_reaches_across_a_gap() -> None:
    time = np.arange(2000) / 500.0
    time[1000:] += 3.0
    position = np.where(np.arange(2000) < 1000, 0.0, 1.0)
    signals = prepare(recording(time, position))
    assert len(signals.segments) == 2
    np.testing.assert_allclose(signals.velocity, 0.0, atol=1e-9)
    assert set(np.round(signals.position[:, 0], 12)) == {0.0, 1.0}
    first, second = signals.segments
    np.testing.assert_array_equal(signals.smooth(signals.position)[first], signals.position[first])
    np.testing.assert_array_equal(signals.smooth(signals.position)[second], signals.position[second])
    assert np.all(np.diff(signals.time)[np.arange(len(signals) - 1) != first.stop - 1] < 0.01)


def test_pieces_too_short_are_left_out() -> None:
    time = np.arange(2000) / 500.0
    time[100:] += 1.0
    time[140:] += 1.0
    signals = prepare(recording(time, np.sin(time)))
    assert len(signals.segments) == 2
    assert not ((signals.time > time[100] - 0.1) & (signals.time < time[139] + 0.1)).any()
    with pytest.raises(RecordingError, match="too short for a low-pass at 10 Hz"):
        prepare(recording(time[100:140], np.sin(time[100:140])))
    with pytest.raises(RecordingError, match="2 samples are too few"):
        prepare(recording(time[:2], time[:2]))


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 251.0, float("nan"), 1e-300, 1e-9])
def test_impossible_cut_offs_are_refused(cutoff: float) -> None:
    with pytest.raises(UsageError, match="does not fit a recording of 500 Hz"):
        prepare(sine(1.0), cutoff)


def test_the_interior_is_where_smoothing_sees_no_edge() -> None:
    signals = prepare(sine(1.0))
    inside = signals.interior
    smoothed = signals.smooth(signals.position)
    gain = np.exp(-0.5 * (2.0 * np.pi * signals.kernel_std) ** 2)
    np.testing.assert_allclose(smoothed[inside], gain * signals.position[inside], atol=2e-3)
    assert 0 < np.count_nonzero(~inside) < 0.05 * len(signals)


def test_short_pieces_have_no_interior() -> None:
    signals = prepare(sine(1.0))
    chosen = np.zeros(len(signals), bool)
    chosen[[0, 1, 2]] = True
    chosen[200:400] = True
    cut = signals.rows(chosen)
    assert not cut.interior[:3].any()
    assert not cut.interior[3]
    assert not cut.interior[-1]
    assert cut.interior[100]


def test_smoothing_both_sides_leaves_the_parameters_unbiased() -> None:
    """tau = inertia·acceleration + viscous·velocity + coulomb·sign + gravity·sin, each a filtered column."""
    rng = np.random.default_rng(5)
    time = np.arange(20000) / 500.0
    q = np.sin(2.0 * time) + 0.4 * np.sin(11.0 * time + 1.0)
    v = 2.0 * np.cos(2.0 * time) + 4.4 * np.cos(11.0 * time + 1.0)
    a = -4.0 * np.sin(2.0 * time) - 48.4 * np.sin(11.0 * time + 1.0)
    truth = np.array([0.7, 0.3, 1.2, 5.0])
    effort = np.stack([a, v, np.sign(v), np.sin(q)], axis=1) @ truth + rng.normal(0.0, 0.2, len(time))
    signals = prepare(
        recording(time, q + rng.normal(0.0, 2e-5, len(time)), np.stack([effort, effort], axis=1))
    )
    assert signals.effort is not None
    columns = np.stack(
        [
            signals.acceleration[:, 0],
            signals.velocity[:, 0],
            signals.sign[:, 0],
            np.sin(signals.position[:, 0]),
        ],
        axis=1,
    )
    inside = signals.interior
    target = signals.smooth(signals.effort[:, 0])[inside]
    found = np.linalg.lstsq(signals.smooth(columns)[inside], target, rcond=None)[0]
    np.testing.assert_allclose(found, truth, rtol=0.02)


def test_smooth_takes_any_trailing_shape() -> None:
    signals = prepare(sine(1.0))
    values = np.random.default_rng(0).normal(size=(len(signals), 2, 3))
    smoothed = signals.smooth(values)
    np.testing.assert_allclose(smoothed[:, 1, 2], signals.smooth(values[:, 1, 2]))
    np.testing.assert_allclose(signals.smooth(np.ones((len(signals), 2))), 1.0)


def test_direction_counts_a_reversal_in_part() -> None:
    signals = prepare(sine(1.0))
    fast = np.abs(signals.velocity) > 0.5
    np.testing.assert_array_equal(signals.direction[fast], np.sign(signals.velocity[fast]))
    assert np.abs(signals.direction).max() <= 1.0
    reversals = np.flatnonzero(np.diff(np.sign(signals.velocity[:, 0])))
    assert np.abs(signals.direction[reversals, 0] + signals.direction[reversals + 1, 0]).max() < 1.0 + 1e-6


def test_a_joint_at_rest_is_seen() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(5000) / 500.0
    position = np.stack([np.where(time < 5.0, 0.0, np.sin(time - 5.0) ** 2), np.sin(time)], axis=1)
    signals = prepare(recording(time, position + rng.normal(0.0, 1e-5, position.shape)))
    still = signals.time < 4.8
    assert signals.at_rest[still, 0].mean() > 0.99
    assert signals.at_rest[~still, 0].mean() < 0.2
    assert signals.at_rest[:, 1].mean() < 0.05


def test_noise_behind_the_low_pass_is_as_predicted() -> None:
    rng = np.random.default_rng(2)
    noise = rng.normal(0.0, 1e-4, (20000, 2))
    signals = prepare(recording(np.arange(20000) / 500.0, noise))
    for order, passed in enumerate((signals.position, signals.velocity, signals.acceleration)):
        expected = passed_noise(np.full(2, 1e-4), signals.kernel_std, 500.0, order)
        np.testing.assert_allclose(passed.std(axis=0), expected, rtol=0.1)
    np.testing.assert_allclose(signals.position_noise, 1e-4, rtol=0.1)


def test_a_joint_held_still_rests_behind_the_flat_low_pass_too() -> None:
    """Twicing lets more noise through: what is slower than that noise is at rest, whatever low-pass follows."""
    rng = np.random.default_rng(4)
    time = np.arange(20000) / 500.0
    noisy = np.stack([0.0 * time, np.sin(time)], axis=1) + rng.normal(0.0, 5e-5, (20000, 2))
    signals = flattened(prepare(recording(time, noisy)), 5.0)
    expected = passed_noise(signals.position_noise, signals.motion_std, 500.0, order=1, twiced=True)
    assert signals.velocity[:, 0].std() == pytest.approx(expected[0], rel=0.1)
    assert signals.at_rest[:, 0].all()
    assert signals.at_rest[:, 1].mean() < 0.05


def test_smoothing_at_some_samples_gives_what_smoothing_gives_there() -> None:
    time = np.arange(1500) / 500.0
    time[700:] += 2.0
    signals = prepare(recording(time, np.sin(time)))
    values = np.random.default_rng(3).standard_normal((len(signals), 2, 3))
    brief = np.where(np.isin(np.arange(len(values)), [350, 358, 359]), 1.0, 0.0)
    for some in (values, values * brief[:, None, None], brief, 0.0 * brief):
        for samples in (np.array([0, 1, 40, 340, 345, 352, 360, len(signals) - 1]), np.arange(len(signals))):
            np.testing.assert_allclose(
                signals.smooth_at(some, samples), signals.smooth(some)[samples], atol=1e-12
            )


@pytest.mark.parametrize("flat", [None, 8.0])
@pytest.mark.parametrize("own", [None, Lowpass(6.0, 2)])
def test_softening_at_some_samples_is_smoothing_what_was_softened(flat, own) -> None:
    time = np.arange(1500) / 500.0
    time[700:] += 2.0
    signals = replace(prepare(recording(time, np.sin(time))), flat=flat, own=own)
    values = np.random.default_rng(3).standard_normal((len(signals), 2))
    samples = np.array([0, 1, 40, 340, 345, 352, 360, len(signals) - 1])
    expected = signals.smooth(signals.soften(values))[samples]
    np.testing.assert_allclose(signals.softening_at(samples)(values), expected, atol=1e-12)


def test_rows_keep_the_pieces_apart() -> None:
    time = np.arange(3000) / 500.0
    time[1500:] += 2.0
    signals = prepare(recording(time, np.sin(time)))
    chosen = np.ones(len(signals), bool)
    chosen[100:110] = False
    cut = signals.rows(chosen)
    assert len(cut) == len(signals) - 10
    assert len(cut.segments) == 3
    for rows in cut.segments:
        assert np.diff(cut.time[rows]).max() < 1.5 / signals.rate
    assert sum(rows.stop - rows.start for rows in cut.segments) == len(cut)
    assert len(signals.rows(np.zeros(len(signals), bool)).segments) == 0
    again = signals.rows(np.ones(len(signals), bool))
    assert again.segments == signals.segments


def test_between_takes_a_window_of_time() -> None:
    signals = prepare(sine(1.0))
    window = signals.between(2.0, 3.0)
    assert window.time.min() >= 2.0
    assert window.time.max() < 3.0
    np.testing.assert_array_equal(
        window.position, signals.position[(signals.time >= 2.0) & (signals.time < 3.0)]
    )


def test_parts_follow_one_another() -> None:
    first, second = prepare(sine(1.0)), prepare(sine(2.0, duration=3.0))
    both = concatenated([first, second])
    assert len(both) == len(first) + len(second)
    assert both.segments == (slice(0, len(first)), slice(len(first), len(both)))
    assert (np.diff(both.time) > 0.0).all()
    np.testing.assert_array_equal(both.velocity[len(first) :], second.velocity)
    np.testing.assert_array_equal(both.smooth(both.position)[: len(first)], first.smooth(first.position))
    assert both.effort is None
    assert concatenated([first]) is first


def test_parts_that_one_kernel_does_not_fit_are_refused() -> None:
    first = prepare(sine(1.0))
    others: list[Signals] = [prepare(sine(1.0, 30.0)), prepare(sine(1.0), 5.0), prepare(sine(1.0, 1000.0))]
    for other in others:
        with pytest.raises(ValueError, match="not prepared alike"):
            concatenated([first, other])
    with pytest.raises(UsageError, match="different joints"):
        concatenated([first, replace(first, joints=("a", "c"))])
