"""Identification from samples: of a known robot, live as offline, saved and loaded."""

from dataclasses import replace

import numpy as np
import pytest
from cli_cases import two_armed

from bdnn_ros.errors import RecordingError, UsageError
from bdnn_ros.models import load_model, save_model
from bdnn_ros.online.identifier import Identifier
from bdnn_ros.physical.consistency import feasible
from bdnn_ros.physical.couplings import Coupling
from bdnn_ros.physical.possible import Possible
from bdnn_ros.physical.selection import choose
from bdnn_ros.physical.structure import Structure, layout
from bdnn_ros.recording import Recording
from bdnn_ros.robot import PER_LINK, Robot
from bdnn_ros.scores import score_model
from bdnn_ros.signals import prepare
from bdnn_ros.signals.preparing import usual_cutoff


def wrong(robot, share=0.2, seed=0):
    """The same robot with other masses, by up to this share."""
    generator = np.random.default_rng(seed)
    return robot.with_inertials(robot.inertials * (1.0 + share * generator.uniform(-1, 1, (robot.width, 1))))


def motion(robot, duration=10.0, rate=200.0, seed=0, noise=0.0, start=0.0):
    """A recording of a robot that follows a sum of sines."""
    generator = np.random.default_rng(seed)
    time = start + np.arange(0.0, duration, 1.0 / rate)
    frequency = generator.uniform(0.2, 1.2, (4, robot.width)) * 2.0 * np.pi
    phase = generator.uniform(0.0, 2.0 * np.pi, (4, robot.width))
    angle = frequency * time[:, None, None] + phase
    size = 0.3 / frequency
    position = (size * np.sin(angle) * 3.0).sum(axis=1) - 0.5
    velocity = (size * frequency * np.cos(angle) * 3.0).sum(axis=1)
    acceleration = -(size * frequency**2 * np.sin(angle) * 3.0).sum(axis=1)
    effort = robot.inverse_dynamics(position, velocity, acceleration)
    effort = effort + noise * effort.std(axis=0) * generator.normal(size=effort.shape)
    return Recording(time, robot.joints, position, None, effort, name="motion")


@pytest.fixture(scope="module")
def real():
    robot = Robot.bundled("arm6")
    n = robot.width
    return wrong(robot, seed=1).with_joint_parameters(np.full(n, 0.1), np.full(n, 2.0), np.full(n, 1.0))


def test_a_wrong_urdf_is_put_right_within_seconds(real):
    model = Identifier(Robot.bundled("arm6")).fit([motion(real, noise=0.01)])
    signals = prepare(motion(real, seed=5))
    measured = signals.smooth(signals.effort)[signals.interior]
    predicted = signals.smooth(model.predict(signals))[signals.interior]
    nmse = ((measured - predicted) ** 2).mean(axis=0) / measured.var(axis=0)
    assert nmse.mean() < 1e-3
    np.testing.assert_allclose(model.robot.coulomb, 1.0, atol=0.1)
    np.testing.assert_allclose(model.robot.viscous, 2.0, atol=0.2)


@pytest.mark.slow
def test_how_samples_are_packed_makes_no_difference(real):
    recording = motion(real, duration=6.0, noise=0.01)
    whole = Identifier(Robot.bundled("arm6")).fit([recording])
    live = Identifier(Robot.bundled("arm6"))
    for k in range(0, len(recording), 7):
        live.feed(recording.time[k : k + 7], recording.position[k : k + 7], recording.effort[k : k + 7])
    live.finish()
    live.settle()
    again = live.model(iterations=10)
    np.testing.assert_allclose(again.parameters.vector(), whole.parameters.vector(), rtol=1e-6, atol=1e-9)


def test_several_recordings_are_one_identification(real):
    parts = [motion(real, 4.0, seed=seed) for seed in range(3)]
    identifier = Identifier(Robot.bundled("arm6"))
    model = identifier.fit(parts)
    assert identifier.samples == sum(len(part) for part in parts)
    np.testing.assert_allclose(model.robot.coulomb, 1.0, atol=0.1)


@pytest.mark.slow
def test_a_gap_is_not_bridged(real):
    first, second = motion(real, 4.0), motion(real, 4.0, seed=3, start=9.0)
    joined = Recording(
        np.concatenate([first.time, second.time]),
        first.joints,
        np.concatenate([first.position, second.position]),
        None,
        np.concatenate([first.effort, second.effort]),
    )
    for pause in (0.0, 1e9):
        later = replace(joined, time=np.where(joined.time < 9.0, joined.time, joined.time + pause))
        model = Identifier(Robot.bundled("arm6")).fit([later])
        np.testing.assert_allclose(model.robot.coulomb, 1.0, atol=0.1)


@pytest.mark.slow
def test_recordings_of_other_rates_have_cutoffs_of_their_own(real):
    """That of the first was kept as if asked for, and slower ones were refused."""
    parts = [motion(real, 8.0, rate, seed=k) for k, rate in enumerate((200.0, 15.0, 100.0))]
    identifier = Identifier(Robot.bundled("arm6"))
    cutoffs = []
    for k, part in enumerate(parts):
        identifier.feed(part.time + 100.0 * k, part.position, part.effort)
        cutoffs.append(identifier.stream.cutoff)
        identifier.finish()
    np.testing.assert_allclose(cutoffs, [usual_cutoff(rate) for rate in (200.0, 15.0, 100.0)])
    assert identifier.stream.left_out == 0
    model = Identifier(Robot.bundled("arm6")).fit(parts)
    np.testing.assert_allclose(model.robot.coulomb, 1.0, atol=0.1)
    with pytest.raises(UsageError, match="20 Hz does not fit"):
        Identifier(Robot.bundled("arm6"), cutoff=20.0).fit(parts)


def test_the_mass_matrix_is_positive_definite_after_one_second(real):
    model = Identifier(Robot.bundled("arm6")).fit([motion(real, 1.0, noise=0.05)])
    M = model.mass_matrix(np.random.default_rng(0).uniform(-3, 3, (200, 6)))
    assert np.linalg.eigvalsh(M).min() > 0.0


def test_a_saved_model_answers_as_before(real, tmp_path):
    model = Identifier(Robot.bundled("arm6")).fit([motion(real, 4.0)])
    again = load_model(save_model(tmp_path, model))
    signals = prepare(motion(real, 2.0, seed=2))
    np.testing.assert_array_equal(again.predict(signals), model.predict(signals))
    assert again.version == model.version
    assert again.table() == model.table()


@pytest.mark.slow
def test_an_effort_that_is_ahead_is_told_from_inertia(real):
    recording = motion(real, 20.0, rate=500.0)
    ahead = np.stack([np.interp(recording.time + 0.004, recording.time, e) for e in recording.effort.T], 1)
    model = Identifier(Robot.bundled("arm6")).fit(
        [Recording(recording.time, recording.joints, recording.position, None, ahead)]
    )
    np.testing.assert_allclose(model.lead, 0.004, atol=3e-4)
    np.testing.assert_allclose(model.robot.viscous, 2.0, atol=0.05)
    np.testing.assert_allclose(model.robot.coulomb, 1.0, atol=0.05)


def test_dynamics_agree_with_one_another(real):
    model = Identifier(Robot.bundled("arm6")).fit([motion(real, 4.0)])
    generator = np.random.default_rng(0)
    q, v, a = generator.normal(size=(3, 20, 6))
    effort = model.inverse_dynamics(q, v, a)
    np.testing.assert_allclose(model.forward_dynamics(q, v, effort), a, atol=1e-8)
    parts = np.einsum("nij,nj->ni", model.mass_matrix(q), a) + model.coriolis(q, v) + model.gravity(q)
    np.testing.assert_allclose(parts + model.friction(q, v), effort, atol=1e-8)


@pytest.mark.slow
def test_a_motor_that_turns_with_two_joints_is_found_where_both_are_of_a_kind_and_move():
    """Of a gripper that holds still a coupling would tell whatever the wrist's friction gives it to explain."""
    robot = Robot.bundled("arm6")
    recording = motion(robot, noise=0.01)
    speed = np.gradient(recording.position, recording.time, axis=0)[:, 4:].sum(axis=1, keepdims=True)
    effort = recording.effort.copy()
    effort[:, 4:] += 0.2 * np.tanh(speed / 0.01) + 0.1 * speed
    identifier = Identifier(robot)
    identifier.fit([replace(recording, effort=effort)])
    assert identifier.structure.couplings == (Coupling(4, 1),)
    plain = Structure.plain(identifier.belief)
    without = layout(plain, identifier.belief)
    for kinds in ([1, 1, 1, 1, 1, 2], [1, 1, 1, 1, 0, 0]):
        assert choose(identifier.sums.evidence, plain, without, kinds).couplings == ()
    still = recording.position.copy()
    still[:, 5] = 0.3
    identifier = Identifier(robot)
    identifier.fit([replace(recording, position=still, effort=effort)])
    assert identifier.structure.couplings == ()


def sprung(robot, joint, stiffness, seed):
    """The motion of a robot with a spring at one joint."""
    recording = motion(robot, seed=seed, noise=0.002)
    effort = recording.effort.copy()
    effort[:, joint] += stiffness * (recording.position[:, joint] + 0.3)
    return replace(recording, effort=effort)


@pytest.mark.parametrize(("joint", "stiffness"), [(1, 60.0), (2, 20.0), (4, 1.2)])
def test_a_spring_is_learned_though_it_is_far_more_than_the_joints_friction(joint, stiffness):
    """What is learned was believed to be of the order of friction: such springs left a seventh of the effort and more."""
    robot = Robot.bundled("arm6")
    real = wrong(robot, 0.05, seed=1)
    model = Identifier(robot).fit([sprung(real, joint, stiffness, 0)])
    assert score_model(model, [prepare(sprung(real, joint, stiffness, 5))]).nrmse_mean < 0.04


def test_what_no_body_does_is_not_sought_in_bodies_and_rotors_that_cannot_exist():
    """A rotor of negative inertia does what a spring does along a sine; those that can exist leave it all."""
    robot = Robot.bundled("arm6")
    identifier = Identifier(robot)
    identifier.fit([sprung(robot, 4, 0.6, 0)])
    evidence = identifier.sums.evidence
    plain = Structure.plain(evidence.belief)
    posterior = evidence.solve(layout(plain, evidence.belief), 10)
    possible = Possible.of(evidence, posterior)
    assert feasible(possible.inertials.reshape(6, PER_LINK))
    assert (posterior.mean[posterior.layout.positive] < 0.0).any(), "the trap is not there"
    assert possible.unexplained[4] and (possible.left >= possible.least).all()
    kinds = [1] * 6
    assert choose(evidence, plain, posterior.layout, kinds, possible.inertials).groups[4] == ("position",)


def test_after_a_change_terms_are_chosen_as_soon_as_at_first(monkeypatch):
    """However long the stream was before: the thresholds have doubled with it."""
    robot, settled = Robot.bundled("arm2"), []
    monkeypatch.setattr(Identifier, "settle", lambda identifier: settled.append(identifier.chunks))
    identifier, start = Identifier(robot, settle_at=4), 0.0
    for _ in range(2):
        recording = motion(robot, duration=20.0, start=start)
        identifier.feed(recording.time, recording.position, recording.effort)
        identifier.finish()
        identifier, start = identifier.restarted(identifier.belief), start + 100.0
    assert settled == [4, 8, 16, 24, 28, 36]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("share", [0.0, 1.0], ids=["off", "held"])
def test_a_simulated_robot_that_stands_still_without_any_noise_leaves_no_error_and_learning_goes_on(share):
    """What is left is nothing, but no joint is known better than its sensors and rounding let it be."""
    robot = Robot.bundled("arm6")
    recording = motion(robot, 12.0)
    position = np.full_like(recording.position, 0.3)
    effort = np.tile(share * robot.gravity(position[0]), (len(position), 1))
    model = Identifier(robot).fit([replace(recording, position=position, effort=effort)])
    assert np.isfinite(model.parameters.vector()).all()


def test_no_motion_no_effort_other_joints_are_refused(real):
    identifier = Identifier(Robot.bundled("arm6"))
    with pytest.raises(RecordingError, match="No motion"):
        identifier.model()
    recording = motion(real, 2.0)
    silent = Recording(recording.time, recording.joints, recording.position)
    with pytest.raises(RecordingError, match="no effort"):
        identifier.fit([silent])
    with pytest.raises(UsageError, match="other joints"):
        Identifier(Robot.bundled("arm7")).fit([recording])


@pytest.mark.parametrize("seed", range(3))
def test_a_tilted_base_is_found_beside_wrong_bodies(real, seed, tmp_path):
    """Else the bodies learn what holds in no other pose."""
    generator = np.random.default_rng(seed)
    tilt = generator.choice([-1.0, 1.0], 2) * np.radians(generator.uniform(1.5, 6.0, 2))
    urdf = Robot.bundled("arm6")
    mounted = real.tilted(*tilt)
    model = Identifier(urdf).fit([motion(mounted, duration=15.0, seed=seed, noise=0.01)])
    np.testing.assert_allclose(model.tilt, tilt, atol=np.radians(0.1))
    assert (np.abs(np.subtract(model.tilt, tilt)) < 4.0 * np.array(model.tilt_std)).all()
    signals = prepare(motion(mounted, seed=seed + 10))
    measured = signals.smooth(signals.effort)[signals.interior]
    left = measured - signals.smooth(model.predict(signals))[signals.interior]
    assert ((left**2).mean(axis=0) / measured.var(axis=0)).mean() < 1e-3
    loaded = load_model(save_model(tmp_path, model))
    assert loaded.tilt == model.tilt and loaded.tilt_std == model.tilt_std


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_zeros_that_are_off_are_found_beside_wrong_bodies(seed, tmp_path):
    """Of joints that are not parallel to the next one, whose zero its body could nearly stand for."""
    generator, urdf = np.random.default_rng(seed), Robot.bundled("arm7")
    zeros = np.zeros(7)
    off = generator.choice([1, 2, 3], 1 + seed % 2, replace=False)
    zeros[off] = generator.choice([-1.0, 1.0], len(off)) * generator.uniform(0.03, 0.1, len(off))
    rubbing = wrong(urdf, seed=1).with_joint_parameters(*np.outer([0.1, 2.0, 1.0], np.ones(7)))
    real = replace(rubbing, zeros=zeros)
    model = Identifier(urdf).fit([motion(real, duration=15.0, seed=seed, noise=0.01)])
    assert {joint for joint, *_ in model.zeros} == {*off.tolist()}
    for joint, value, std in model.zeros:
        assert abs(value - zeros[joint]) < min(4.0 * std, 2e-3)
    signals = prepare(motion(real, seed=seed + 10))
    measured = signals.smooth(signals.effort)[signals.interior]
    left = measured - signals.smooth(model.predict(signals))[signals.interior]
    assert ((left**2).mean(axis=0) / measured.var(axis=0)).mean() < 1e-3
    loaded = load_model(save_model(tmp_path, model))
    assert loaded.zeros == model.zeros and (loaded.robot.zeros == model.robot.zeros).all()


@pytest.mark.slow
def test_what_is_known_of_the_setup_is_kept_and_found_anew_as_motion_goes_on():
    """Whatever else a few seconds seem to show: a live model's zeros are those of all its motion."""
    urdf, zeros = Robot.bundled("arm7"), 0.07 * np.eye(7)[3]
    rubbing = wrong(urdf, seed=1).with_joint_parameters(*np.outer([0.1, 2.0, 1.0], np.ones(7)))
    recording = motion(replace(rubbing, zeros=zeros), duration=24.0, seed=4, noise=0.01)
    identifier, told = Identifier(urdf, settle_at=16), []
    for rows in np.array_split(np.arange(len(recording)), 24):
        if identifier.feed(recording.time[rows], recording.position[rows], recording.effort[rows]):
            told.append((identifier.chunks, identifier.model()))
    late = [model for chunks, model in told if chunks >= 8]
    assert len(late) > 10
    for model in late:
        assert [joint for joint, *_ in model.zeros] == [3]
        np.testing.assert_allclose(model.robot.zeros, zeros, atol=5e-3)


def test_two_arms_on_a_torso_are_one_robot():
    described = two_armed()
    worn = wrong(described, seed=2).with_joint_parameters(*np.outer([0.02, 0.5, 0.3], np.ones(5)))
    model = Identifier(described).fit([motion(worn, duration=15.0, noise=0.01)])
    assert not model.leans and not model.zeros and feasible(model.robot.inertials)
    assert score_model(model, [prepare(motion(worn, seed=5))]).nmse_mean < 1e-3


def test_what_one_joint_alone_bears_is_no_setup(real):
    """A spring about a vertical axis pulls as gravity does on a base that leans."""
    recording = motion(real, duration=15.0, noise=0.01)
    effort = recording.effort.copy()
    effort[:, 0] += 30.0 * np.sin(recording.position[:, 0] + 0.3)
    model = Identifier(Robot.bundled("arm6")).fit([replace(recording, effort=effort)])
    assert model.tilt == (0.0, 0.0) and not model.leans and not model.zeros


@pytest.mark.slow
def test_a_robot_that_is_set_up_as_described_is_not_said_to_be_otherwise(real):
    for seed in range(3):
        model = Identifier(Robot.bundled("arm6")).fit([motion(real, seed=seed, noise=0.02)])
        assert model.tilt == (0.0, 0.0) and not model.leans and not model.zeros


def test_a_base_that_leans_is_found_however_long_the_recording_is(monkeypatch):
    """Not all motion of a long one is kept, and how the robot is set up was then never asked."""
    monkeypatch.setattr("bdnn_ros.online.identifier.MOST_KEPT", 8)
    robot = Robot.bundled("arm6")
    leaning = robot.tilted(0.1, 0.15)
    identifier = Identifier(robot)
    model = identifier.fit([motion(leaning, 16.0, noise=0.003)])
    assert len(identifier._kept) < identifier.chunks and model.leans
    np.testing.assert_allclose(model.robot.gravity_vector, leaning.gravity_vector, atol=0.02)


def test_it_beats_at_every_step_of_what_takes_long():
    """Of many joints, one choice of terms takes minutes: whoever watches must not take that for a hang."""
    arm = Robot.bundled("arm2")
    recording, beats = motion(arm, 14.0, noise=0.01), [0]

    def beat() -> None:
        beats[0] += 1

    identifier = Identifier(arm, settle_at=8, beat=beat)
    steps = []
    for rows in np.array_split(np.arange(len(recording)), 56):
        before, chunks = beats[0], identifier.chunks
        identifier.feed(recording.time[rows], recording.position[rows], recording.effort[rows])
        if identifier.chunks > chunks:
            steps.append(beats[0] - before)
    assert max(steps) > 8 and min(steps) >= 1, steps
    other, before = identifier.restarted(identifier.belief), beats[0]
    assert len(recording) == identifier.samples
    other.finish()
    assert beats[0] > before
