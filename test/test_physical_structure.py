"""Where parameters are among the columns, and what they share."""

from dataclasses import replace

import numpy as np
import pytest

from bdnn_ros.physical.columns import smooth_columns, tilting
from bdnn_ros.physical.couplings import Coupling
from bdnn_ros.physical.parameters import prior
from bdnn_ros.physical.presliding import BREAKAWAYS
from bdnn_ros.physical.selection import _best
from bdnn_ros.physical.statistics import Statistics
from bdnn_ros.physical.structure import TILT, Columns, Structure, layout, straightened
from bdnn_ros.recording import Recording
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.signals import prepare


@pytest.fixture(scope="module")
def belief():
    return prior(Robot.bundled("arm2"))


@pytest.fixture(scope="module")
def statistics():
    generator = np.random.default_rng(0)
    count = Columns(2).count
    return Statistics.of(generator.normal(size=(2 * count, 2, count)), generator.normal(size=(2 * count, 2)))


def structures(belief):
    plain = Structure.plain(belief)
    learned = plain.with_joint(0, 2, ("curve", "load")).with_joint(1, 0, ("position",))
    coupled = replace(learned, couplings=(Coupling(0, -1),))
    return plain, learned, coupled, replace(coupled, setup=(0, 1, 3))


@pytest.mark.parametrize("which", range(4), ids=["plain", "learned", "coupled", "set up"])
def test_what_is_gathered_is_the_sum_of_the_regressions(belief, statistics, which):
    chosen = structures(belief)[which]
    own = slice(2 * PER_LINK, None)
    straight = straightened(chosen, statistics.gram[:, own, own])
    made = layout(chosen, belief, straight)
    assert made.shared == 2 * PER_LINK
    assert_gathered(made, statistics, np.array([2.0, 0.5]))


def assert_gathered(made, statistics, weights):
    gram, moment = np.zeros((made.size, made.size)), np.zeros(made.size)
    for joint, (rows, weight) in enumerate(zip(made.parameters, weights, strict=True)):
        part = made.regression(statistics, joint)
        gram[np.ix_(rows, rows)] += weight * part.gram
        moment[rows] += weight * part.moment
    for gathered, expected in zip(made.gathered(statistics, weights), (gram, moment), strict=True):
        np.testing.assert_allclose(gathered, expected, atol=1e-8)


def test_of_one_joint_alone_the_bodies_are_shared_and_no_more():
    """All its columns are in the same place on every joint, itself: what it learns was not found among them."""
    belief = prior(Robot.bundled("arm2", ("arm2_joint1",)))
    count = Columns(1).count
    generator = np.random.default_rng(0)
    sums = Statistics.of(generator.normal(size=(2 * count, 1, count)), generator.normal(size=(2 * count, 1)))
    chosen = Structure.plain(belief).with_joint(0, 0, ("curve", "position"))
    made = layout(chosen, belief, straightened(chosen, sums.gram[:, PER_LINK:, PER_LINK:]))
    assert_gathered(made, sums, np.array([3.0]))


def test_every_parameter_has_a_place_and_a_spread(belief):
    for chosen in structures(belief):
        made = layout(chosen, belief)
        assert made.size == len(belief.mean) + len(made.deviation)
        assert (made.deviation > 0.0).all()
        used = np.unique(np.concatenate(made.parameters))
        np.testing.assert_array_equal(used, np.arange(made.size))
        for columns, parameters in zip(made.columns, made.parameters, strict=True):
            assert len(columns) == len(parameters) == len(set(columns.tolist()))


def test_what_is_straightened_holds_no_friction(belief, statistics):
    """Features less what is taken from them are orthogonal to friction and offset over the motion."""
    _, chosen, *_ = structures(belief)
    own = slice(2 * PER_LINK, None)
    made = layout(chosen, belief, straightened(chosen, statistics.gram[:, own, own]))
    for joint in range(2):
        gram = made.regression(statistics, joint).gram
        features = slice(len(gram) - len(made.straight[joint]), None)
        friction = slice(2 * PER_LINK + 1, 2 * PER_LINK + 4)
        size = np.sqrt(np.diagonal(statistics.gram[joint])[0])
        np.testing.assert_allclose(gram[features, friction] / size**2, 0.0, atol=1e-6)


@pytest.mark.parametrize("angles", [(0.0, 0.0), (0.1, -0.05)])
def test_columns_of_a_tilt_are_what_it_adds_to_the_effort(angles):
    """About the tilt that is known so far, whatever that is."""
    robot = Robot.bundled("arm6").tilted(*angles)
    time = np.arange(0.0, 4.0, 0.01)
    position = 0.5 * np.sin(time[:, None] * np.linspace(1.0, 2.0, 6))
    signals = prepare(Recording(time, robot.joints, position, None, np.zeros_like(position)))
    columns = smooth_columns(robot, signals, tilting(robot))
    where = Columns(6).setup + np.array(TILT)
    for column, step in zip(np.moveaxis(columns[:, :, where], 2, 0), 1e-5 * np.eye(2), strict=True):
        more, less = (robot.tilted(*(np.array(angles) + way * step)) for way in (1.0, -1.0))
        change = more.gravity(signals.position) - less.gravity(signals.position)
        np.testing.assert_allclose(column, change / 2e-5, atol=1e-4 * np.abs(column).max())


def test_columns_of_zeros_are_what_they_add_to_the_effort():
    """About the zeros that are known so far."""
    arm = Robot.bundled("arm6")
    robot = replace(arm, zeros=np.linspace(-0.1, 0.1, 6))
    time = np.arange(0.0, 4.0, 0.01)
    position = 0.5 * np.sin(time[:, None] * np.linspace(1.0, 2.0, 6))
    signals = prepare(Recording(time, robot.joints, position, None, np.zeros_like(position)))
    columns = smooth_columns(robot, signals, tilting(robot))
    motion = signals.velocity * ~signals.at_rest, signals.acceleration * ~signals.at_rest
    for joint, step in enumerate(1e-5 * np.eye(6)):
        off = robot.zeros + step, robot.zeros - step
        more, less = (arm.rigid_effort(signals.position - zeros, *motion) for zeros in off)
        column = columns[:, :, Columns(6).setup + len(TILT) + joint]
        change = (more - less) / 2e-5
        np.testing.assert_allclose(column, change, atol=1e-6 * np.abs(change).max() + 1e-6)


class Told:
    """A joint whose errors on what was left out are given, by breakaway and whether it has a curve."""

    count = 100.0

    def __init__(self, errors):
        self.errors = errors

    def weigh(self, variance):
        pass

    def believe_waves(self, terms, couplings):
        pass

    def error(self, breakaway, groups=(), couplings=()):
        return self.errors.get((breakaway, "curve" in groups), 1.0)


@pytest.mark.parametrize("without, chosen", [(800.0, (0, ())), (0.5, (6, ("curve",)))])
def test_no_curve_hides_a_sharp_direction_behind_a_soft_one(without, chosen):
    softest = len(BREAKAWAYS) - 1
    assert _best(Told({(softest, False): without, (softest, True): 0.3}), ()) == chosen


def test_sums_over_the_first_columns_reach_the_first_parameters(belief):
    """The position's noise is known of bodies and armature alone."""
    made, count = layout(structures(belief)[3], belief), 2 * PER_LINK + 1
    sums = np.random.default_rng(0).normal(size=(2, count, count))
    sums += sums.swapaxes(1, 2)
    expected = np.zeros((count + 1, count + 1))
    for joint, weight in enumerate((2.0, 0.5)):
        rows = np.append(np.arange(count - 1), count - 1 + joint)
        expected[np.ix_(rows, rows)] += weight * sums[joint]
    gathered = made.gathering(count).matrix(sums, np.array([2.0, 0.5]))
    np.testing.assert_allclose(gathered, expected, atol=1e-12)
