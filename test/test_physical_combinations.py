"""What motion can tell: counted, named, and enough to give the effort."""

import numpy as np

from bdnn_ros.physical.combinations import combinations
from bdnn_ros.physical.parameters import of_robot, parameter_names
from bdnn_ros.robot import PER_LINK, Robot


def test_an_arm_under_gravity_has_as_many_as_the_literature_says():
    """36 of the bodies (Gautier and Khalil 1990), and 4 rotors that are no link's inertia about its axis."""
    robot = Robot.bundled("arm6")
    assert len(combinations(robot)) == 36 + 4 + 3 * robot.width


def test_parameters_that_no_combination_tells_apart_give_the_same_effort():
    robot = Robot.bundled("arm7")
    found = combinations(robot)
    tellable = np.array([combination.weights for combination in found])
    generator = np.random.default_rng(0)
    change = generator.normal(size=tellable.shape[1])
    change -= np.linalg.pinv(tellable) @ (tellable @ change)
    width = robot.width
    q, v, a = generator.normal(size=(3, 20, width))
    bodies, rotors = change[: width * PER_LINK], change[width * PER_LINK :][:width]
    effort = robot.regressor(q, v, a) @ bodies + rotors * a
    np.testing.assert_allclose(effort, 0.0, atol=1e-6)
    assert np.abs(change).max() > 0.1


def test_each_is_named_in_words_with_its_unit():
    robot = Robot.bundled("arm2")
    found = combinations(robot)
    words = [combination.words for combination in found]
    assert len(set(words)) == len(words)
    friction = next(c for c in found if c.words == f"Coulomb friction of {robot.joints[0]}")
    assert friction.unit == "N*m"
    names = parameter_names(robot.joints)
    assert friction.weights[names.index(f"{robot.joints[0]}.coulomb")] == 1.0
    assert any("mass times centre along" in text and ", with " in text for text in words)


def test_value_and_std_follow_the_weights():
    robot = Robot.bundled("arm2")
    parameters = of_robot(robot).vector()
    covariance = np.diag(np.arange(1.0, len(parameters) + 1.0))
    for combination in combinations(robot):
        w = combination.weights
        np.testing.assert_allclose(combination.value(parameters), w @ parameters)
        np.testing.assert_allclose(combination.std(covariance) ** 2, (w**2) @ np.diagonal(covariance))


def test_a_right_angle_written_short_is_one():
    """It is 4e-6 rad off: what that shows, no motion tells."""
    urdf = Robot.bundled("arm7").urdf
    short = urdf.replace("1.57079633", "1.5708")
    assert short != urdf
    words = [c.words for c in combinations(Robot.from_urdf(short))]
    assert len(words) == len(combinations(Robot.from_urdf(urdf)))
    assert not any("e-0" in one for one in words)
