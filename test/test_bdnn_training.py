"""Training keeps its budget, stops, goes on where it was, and finds what made the efforts."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
from bdnn_cases import random_field, signals, worn
from test_bdnn_dynamics import Opaque

from bdnn_ros.bdnn import chain, chain_training, mechanics, modelfile, training
from bdnn_ros.bdnn.chain_training import ChainTraining
from bdnn_ros.bdnn.cores import PriorCore
from bdnn_ros.bdnn.correction import Task
from bdnn_ros.bdnn.dynamics import BDNNOnPrior
from bdnn_ros.bdnn.local import LocalNetworks
from bdnn_ros.bdnn.local_training import fit_local, sums_of
from bdnn_ros.bdnn.network_training import NetworkTraining, Rollouts, effort_loss
from bdnn_ros.bdnn.networks import Network
from bdnn_ros.bdnn.training import identify
from bdnn_ros.errors import DataError, ModelFileError, RecordingError, UsageError
from bdnn_ros.robot.state import robot_state
from bdnn_ros.scores import score_model
from bdnn_ros.signals import Signals
from bdnn_ros.simulation.perturbation import wrong_robot


class Clock:
    """A clock that passes some time at every look, so that no test depends on the machine."""

    def __init__(self, tick: float = 0.01) -> None:
        self.now, self.tick = 0.0, tick

    def __call__(self) -> float:
        self.now += self.tick
        return self.now


@pytest.fixture(scope="module")
def arm2():
    robot = worn("arm2")
    return robot, signals(robot, 12.0, 0), signals(robot, 4.0, 1), signals(robot, 6.0, 2)


@pytest.fixture(scope="module")
def black_box(arm2):
    _, train, validation, _ = arm2
    return identify(train, validation, budget=20.0, clock=Clock())


def nmse(model: object, test: object) -> np.ndarray:
    return score_model(model, [test]).nmse


def test_a_black_box_is_the_robot(arm2, black_box):
    robot, _, _, test = arm2
    assert black_box.kind == "bdnn"
    assert (nmse(black_box, test) < 2e-3).all()
    q = test.position[::50]
    mass, gravity = robot.mass_matrix(q), robot.gravity(q)
    assert np.linalg.norm(black_box.mass_matrix(q) - mass) < 0.03 * np.linalg.norm(mass)
    assert np.linalg.norm(black_box.gravity(q) - gravity) < 0.02 * np.linalg.norm(gravity)


def test_the_mechanics_of_a_black_box_are_the_robots(arm2, black_box):
    """On held-out poses, part by part, and sound as a machine."""
    robot, _, _, test = arm2
    q, v, a = (values[::25] for values in (test.position, test.velocity, test.acceleration))
    learned, true = mechanics.parts(black_box, q, v, a), mechanics.parts(robot, q, v, a)
    fast = np.abs(v) > 0.2 * np.std(v, axis=0)
    for name, limit in (("inertial", 0.03), ("coriolis", 0.05), ("gravity", 0.02)):
        there = getattr(true, name)
        assert np.linalg.norm(getattr(learned, name) - there) < limit * np.linalg.norm(there), name
    assert np.linalg.norm((learned.friction - true.friction)[fast]) < 0.1 * np.linalg.norm(
        true.friction[fast]
    )
    for energy in (mechanics.kinetic_energy, lambda m, q, v: mechanics.potential_energy(m, q, q[0])):
        here, there = energy(black_box, q, v), energy(robot, q, v)
        assert np.linalg.norm(here - there) < 0.03 * np.linalg.norm(there)
    balance = mechanics.power_balance(black_box, q, v, a)
    np.testing.assert_allclose(balance["left"], 0.0, atol=1e-9 * np.abs(balance["drive"]).max())
    summary = mechanics.consistency(black_box, q.min(axis=0), q.max(axis=0), np.abs(v).max(axis=0))
    assert summary.sound
    least = min(np.linalg.eigvalsh(robot.mass_matrix(q))[:, 0])
    assert summary.smallest_eigenvalue == pytest.approx(least, rel=0.1)


def test_the_same_seed_gives_the_same_model(arm2, black_box):
    _, train, validation, test = arm2
    again = identify(train, validation, budget=20.0, clock=Clock())
    np.testing.assert_array_equal(again.predict(test), black_box.predict(test))


@pytest.mark.slow
def test_a_black_box_learns_what_no_chain_has(arm2):
    robot, *_ = arm2
    extra = lambda q, v: 0.15 * np.sin(8.0 * q) * np.ptp(robot.gravity(q), axis=0)  # noqa: E731
    train, validation, test = (signals(robot, t, s, extra=extra) for t, s in ((24.0, 0), (6.0, 1), (6.0, 2)))
    model = identify(train, validation, budget=40.0, clock=Clock(0.05))
    silent = replace(model, core=replace(model.core, local=LocalNetworks.silent(np.ones(2), np.ones(2))))
    assert nmse(model, test).mean() < 0.2 * nmse(silent, test).mean()


def test_a_wrong_urdf_is_set_right_from_little_motion():
    robot = worn("arm7")
    none = np.zeros(7)
    prior = wrong_robot(robot, 0.2, np.random.default_rng(0)).with_joint_parameters(none, none, none)
    train, validation, test = (signals(robot, t, s) for t, s in ((16.0, 0), (4.0, 1), (8.0, 2)))
    model = identify(train, validation, prior=prior, budget=10.0, clock=Clock())
    assert isinstance(model, BDNNOnPrior)
    assert model.kind == "bdnn_on_prior"
    assert nmse(model, test).mean() < 2e-3
    q = test.position[::40]
    mass = robot.mass_matrix(q)
    assert np.linalg.norm(prior.mass_matrix(q) - mass) > 0.05 * np.linalg.norm(mass)
    assert np.linalg.norm(model.mass_matrix(q) - mass) < 0.02 * np.linalg.norm(mass)


def test_networks_learn_beside_a_prior_that_cannot_be_identified(arm2):
    robot, train, validation, test = arm2
    prior = Opaque(robot.with_joint_parameters(robot.armature, 0.0 * robot.viscous, 0.0 * robot.coulomb))
    model = identify(train, validation, prior=prior, budget=10.0, clock=Clock())
    assert nmse(model, test).mean() < 5e-3
    assert (
        nmse(
            BDNNOnPrior(replace(model.core, local=LocalNetworks.silent(np.ones(2), np.ones(2)))), test
        ).mean()
        > 0.02
    )


@pytest.mark.slow
def test_networks_alone_learn_both_ways(arm2):
    _, train, validation, _ = arm2
    model = identify(train, validation, budget=12.0, architecture="networks", clock=Clock(0.004))
    assert nmse(model, train).mean() < 0.05
    q = train.position[::50]
    assert (np.linalg.eigvalsh(model.mass_matrix(q)) > 0.0).all()
    v, a = train.velocity[::50], train.acceleration[::50]
    np.testing.assert_allclose(model.forward_dynamics(q, v, model.inverse_dynamics(q, v, a)), a, atol=1e-6)


@pytest.mark.parametrize("architecture", ["chain", "networks"])
def test_the_budget_is_kept(arm2, architecture):
    _, train, validation, _ = arm2
    start = time.monotonic()
    identify(train, validation, budget=3.0, architecture=architecture)
    assert time.monotonic() - start < 3.3 + 0.7  # a busy machine may take a little longer


def test_preparing_the_samples_counts_towards_the_budget(arm2, monkeypatch):
    _, train, validation, _ = arm2
    clock, prepare = Clock(), training._training

    def slow(*args: object) -> object:
        clock.now += 10.0
        return prepare(*args)

    monkeypatch.setattr(training, "_training", slow)
    with pytest.raises(DataError, match="too short"):
        identify(train, validation, budget=9.0, clock=clock)


def test_a_short_budget_still_sets_a_urdf_right(arm2):
    """However many recordings there are, and however little of each the time allows."""
    robot, train, _, test = arm2
    pieces = [train.rows((train.time >= k) & (train.time < k + 1.0)) for k in range(12)]
    model = identify(pieces[:10], pieces[10:], wrong_robot(robot, 0.2, np.random.default_rng(0)), budget=0.2)
    assert (nmse(model, test) < 0.01).all()


def test_progress_rises_to_the_end(arm2):
    _, train, validation, _ = arm2
    told: list[tuple[float, str]] = []
    identify(train, validation, budget=20.0, clock=Clock(), progress=lambda *said: told.append(said))
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert all(what for _, what in told)


@pytest.mark.slow
@pytest.mark.parametrize("architecture", ["chain", "networks"])
def test_an_interrupted_training_goes_on(arm2, tmp_path, architecture):
    _, train, validation, test = arm2
    state = tmp_path / "training.state"
    pieces = 0

    def interrupt(*_: object) -> None:
        nonlocal pieces
        pieces += 1
        if pieces == 3:
            raise KeyboardInterrupt

    options = {"budget": 12.0, "architecture": architecture, "state": state}
    with pytest.raises(KeyboardInterrupt):
        identify(train, validation, clock=Clock(), progress=interrupt, **options)
    _, _, info = modelfile.load(state)
    spent = info["spent"]
    assert spent > 0.0
    clock = Clock()
    model = identify(train, validation, clock=clock, **options)
    assert clock.now < 12.0 - spent + 1.5
    assert nmse(model, test).mean() < (2e-3 if architecture == "chain" else 0.5)


def test_a_state_carries_the_whole_training(arm2):
    _, train, validation, _ = arm2
    for make in (ChainTraining, NetworkTraining):
        first, second = (make([train], [validation], np.random.default_rng(0)) for _ in range(2))
        for _ in range(2):
            first.advance(lambda: 0.1)
        second.restore(*first.to_state())
        for one in (first, second):
            one.advance(lambda: 0.2)
        arrays, others = first.to_state()[0], second.to_state()[0]
        assert arrays.keys() == others.keys()
        for key, value in arrays.items():
            np.testing.assert_array_equal(value, others[key])


@pytest.mark.parametrize("kind", ["robot", "opaque"])
def test_a_training_on_a_prior_keeps_what_it_learned(arm2, tmp_path, kind):
    """Its budget may be spent: what was learned within it is the model."""
    robot, train, validation, test = arm2
    plain = robot.with_joint_parameters(robot.armature, 0.0 * robot.viscous, 0.0 * robot.coulomb)
    prior = plain if kind == "robot" else Opaque(plain)
    pieces = 0

    def interrupt(*_: object) -> None:
        nonlocal pieces
        pieces += 1
        if pieces == (2 if kind == "robot" else 1):
            raise KeyboardInterrupt

    options = {"prior": prior, "state": tmp_path / "training.state", "clock": Clock()}
    with pytest.raises(KeyboardInterrupt):
        identify(train, validation, budget=10.0, progress=interrupt, **options)
    at_once = identify(train, validation, budget=1e-3, **options)
    whole = identify(train, validation, budget=10.0, **options)
    again = identify(train, validation, budget=1e-3, **options)
    untouched = identify(train, validation, prior=prior, budget=10.0, clock=Clock())
    assert nmse(at_once, test).mean() < 5e-3
    for model in (whole, again):  # as if nothing had interrupted it
        np.testing.assert_allclose(model.predict(test), untouched.predict(test), rtol=1e-9, atol=1e-9)


def test_the_state_of_another_prior_is_refused(arm2, tmp_path):
    robot, train, validation, _ = arm2
    options = {"state": tmp_path / "training.state", "budget": 5.0}
    identify(train, validation, prior=robot, clock=Clock(), **options)
    with pytest.raises(ModelFileError, match="damaged"):
        identify(train, validation, prior=Opaque(robot), clock=Clock(), **options)


class Saved(Opaque):
    """A prior that is no robot, and whose state is all that it is."""

    kind = "saved"

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, object]]:
        return robot_state(self.robot)


@pytest.mark.parametrize("make", [lambda robot: robot, Saved], ids=["robot", "model"])
def test_the_state_of_another_description_is_refused(arm2, tmp_path, make):
    """What was learned on it was gone on from as if it were on the one that is given now."""
    robot, train, validation, _ = arm2
    options = {"state": tmp_path / "training.state", "budget": 5.0}
    identify(train, validation, prior=make(robot), clock=Clock(), **options)
    for other in (robot.tilted(0.3, 0.2), robot.with_inertials(1.3 * robot.inertials)):
        with pytest.raises(ModelFileError, match=r"that of another prior.* remove it to begin anew"):
            identify(train, validation, prior=make(other), clock=Clock(), **options)
    identify(train, validation, prior=make(worn("arm2")), clock=Clock(), **options)


def test_a_foreign_or_damaged_state_is_refused(arm2, tmp_path):
    _, train, validation, _ = arm2
    foreign = modelfile.save(tmp_path / "foreign.state", "bdnn", {}, {})
    with pytest.raises(ModelFileError, match="not the state"):
        identify(train, validation, state=foreign)
    damaged = modelfile.save(tmp_path / "damaged.state", "training", {}, {"of": "chain", "state": {}})
    with pytest.raises(ModelFileError, match="damaged"):
        identify(train, validation, state=damaged)


def test_nonsense_is_refused_by_name(arm2):
    robot, train, validation, _ = arm2
    with pytest.raises(UsageError, match="budget"):
        identify(train, validation, budget=0.0)
    with pytest.raises(UsageError, match="'deep'"):
        identify(train, validation, architecture="deep")
    with pytest.raises(UsageError, match="held out"):
        identify(train, [])
    with pytest.raises(UsageError, match="do not fit"):
        identify(train, validation, prior=worn("arm6"))
    with pytest.raises(RecordingError, match="no effort"):
        identify(replace(train, effort=None), validation)
    assert robot.joints == train.joints


@pytest.mark.parametrize("count", [14, 18])
def test_networks_of_hardly_any_samples_are_fitted_to_those_there_are_or_silent(arm2, count):
    """Of 14 samples none is far from the ends, of 18 fewer than there are to be blocks of them."""
    robot, train, *_ = arm2
    core = PriorCore(robot, LocalNetworks.silent(np.ones(2), np.ones(2)), None, np.full(2, 0.05))
    few = train.rows(np.arange(len(train)) < count)
    assert np.count_nonzero(few.interior) == {14: 0, 18: 4}[count]
    assert len(sums_of(core, [few])[0]) == np.count_nonzero(few.interior)
    weights = fit_local(core, [few]).output_weights
    assert np.isfinite(weights).all()
    assert count > 14 or not weights.any()


def test_no_time_at_all_is_said(arm2):
    _, train, validation, _ = arm2
    with pytest.raises(DataError, match="too short"):
        identify(train, validation, budget=1e-9, clock=Clock())


def test_a_search_that_finds_nothing_is_said(arm2, monkeypatch):
    _, train, validation, _ = arm2

    def singular(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("bdnn_ros.bdnn.chain.descend", singular)
    with pytest.raises(DataError, match=r"all of \d+ starts broke down"):
        identify(train, validation, budget=1.0, clock=Clock())


def test_a_chain_that_cannot_be_polished_is_taken_as_it_was_found(arm2, monkeypatch):
    _, train, validation, test = arm2
    descend = chain.descend

    def singular(samples, start, steps, give_up):
        if steps == chain_training.POLISH_STEPS:
            raise np.linalg.LinAlgError("Singular matrix")
        return descend(samples, start, steps, give_up)

    monkeypatch.setattr("bdnn_ros.bdnn.chain.descend", singular)
    assert nmse(identify(train, validation, budget=2.0, clock=Clock()), test).mean() < 0.1


def test_the_gradient_of_the_inverse_loss_is_its_slope():
    field = random_field(2)
    rng = np.random.default_rng(0)
    batch = [rng.normal(size=(9, 4)), *rng.normal(size=(3, 9, 2)), rng.uniform(size=(9, 2)) < 0.7]
    _, gradient = effort_loss(field, batch)
    direction, step = rng.normal(size=gradient.size), 1e-6
    ahead, behind = (
        effort_loss(field.with_vector(field.vector() + s * step * direction), batch)[0] for s in (1, -1)
    )
    assert (ahead - behind) / (2.0 * step) == pytest.approx(gradient @ direction, rel=1e-6)


def test_the_gradient_of_the_correction_is_its_slope():
    rng = np.random.default_rng(1)
    root = np.tril(rng.normal(size=(7, 3, 3))) + 2.0 * np.eye(3)
    task = Task(
        rng.normal(size=(7, 6)),
        root,
        rng.normal(size=(7, 3)),
        rng.normal(size=(7, 3)),
        np.array([1.0, 2.0, 0.5]),
        rng.uniform(size=(7, 3)) < 0.7,
    )
    network = Network.random(6, 5, 6, rng)
    _, gradient = task.loss(network)
    direction, step = rng.normal(size=gradient.size), 1e-6
    ahead, behind = (
        task.loss(network.with_vector(network.vector() + s * step * direction))[0] for s in (1, -1)
    )
    assert (ahead - behind) / (2.0 * step) == pytest.approx(gradient @ direction, rel=1e-6)


def unmeasured(whole: Signals, where: np.ndarray) -> Signals:
    """The signals with an effort of zero where it was not measured, (N, n) bool."""
    return replace(whole, effort=np.where(where, 0.0, whole.effort), unmeasured=where)


def without_sensor(whole: Signals, joint: int) -> Signals:
    return unmeasured(whole, np.broadcast_to(np.arange(whole.width) == joint, whole.position.shape))


@pytest.mark.slow
@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("how", ["chain", "networks", "prior"])
def test_a_joint_without_a_sensor_spoils_nothing(arm2, how, joint):
    """Zero is no effort of its own: it would have the others' bodies bent to suit it."""
    robot, train, validation, test = arm2
    train, validation, test = (without_sensor(one, joint) for one in (train, validation, test))
    wrong = robot.with_inertials(1.1 * robot.inertials) if how == "prior" else None
    architecture = "networks" if how == "networks" else "chain"
    ticks = Clock(0.005 if how == "networks" else 0.02)
    model = identify(train, validation, wrong, budget=20.0, architecture=architecture, clock=ticks)
    found = nmse(model, test)
    assert np.isnan(found[joint]) and found[1 - joint] < (0.05 if how == "networks" else 2e-3)
    if how != "networks":
        assert not model.core.local.output_weights[joint].any()


def test_efforts_that_were_cut_off_are_not_learned(arm2):
    """A black box of a sensor that stops at three quarters of the range is as good as of one that measures all of it."""
    _, train, validation, test = arm2
    limit = 0.75 * np.abs(train.effort).max(axis=0)
    cut = [unmeasured(one, np.abs(one.effort) > limit) for one in (train, validation)]
    assert 0.02 < np.mean(~cut[0].seen) < 0.5
    assert (nmse(identify(*cut, budget=20.0, clock=Clock()), test) < 2e-3).all()


def test_no_rollout_is_driven_by_an_effort_that_was_not_measured(arm2):
    _, train, _, _ = arm2
    where = np.zeros(train.position.shape, bool)
    where[len(train) // 3 : -len(train) // 3, 1] = True
    rollouts, rng = Rollouts([unmeasured(train, where)], np.ones(2)), np.random.default_rng(0)
    assert all((rollouts.draw(50, rng).efforts != 0.0).all() for _ in range(20))
    assert Rollouts([without_sensor(train, 0)], np.ones(2)).draw(5, rng) is None


def test_windows_drawn_together_have_one_step(arm2):
    """Recordings of two rates: a window's motion is what its velocity says, whichever it is of."""
    _, train, validation, _ = arm2
    other = replace(
        train,
        time=2.0 * train.time,
        velocity=0.5 * train.velocity,
        acceleration=0.25 * train.acceleration,
        rate=0.5 * train.rate,
    )
    rollouts, rng = Rollouts([train, other, validation], np.ones(2)), np.random.default_rng(0)
    steps = set()
    for _ in range(20):
        windows = rollouts.draw(5, rng)
        moved = windows.states[2, :, :2] - windows.states[0, :, :2]
        np.testing.assert_allclose(moved / windows.step, windows.states[1, :, 2:], atol=0.05)
        steps.add(round(windows.step * train.rate))
    assert steps == {2, 4}


def test_networks_are_trained_where_no_window_fits(arm2):
    """By effort alone: of segments of 20 samples, as jitter may leave them."""
    _, train, validation, _ = arm2
    short = replace(
        train, segments=tuple(slice(k, min(k + 20, len(train))) for k in range(0, len(train), 20))
    )
    assert Rollouts([short], np.ones(2)).draw(5, np.random.default_rng(0)) is None
    model = identify(short, validation, budget=0.5, architecture="networks", clock=Clock(0.01))
    assert np.isfinite(model.predict(validation)).all()


def test_windows_are_pieces_of_the_motion(arm2):
    _, train, _, _ = arm2
    windows = Rollouts([train], np.ones(2)).draw(5, np.random.default_rng(0))
    start = windows.states[0, :, :2]
    rows = [int(np.argmin(np.abs(train.position - q).sum(axis=1))) for q in start]
    for k, row in enumerate(rows):
        span = slice(row, row + len(windows.states))
        np.testing.assert_allclose(windows.states[:, k, :2], train.position[span], rtol=1e-6)
        np.testing.assert_allclose(windows.efforts[:, k], train.effort[span], rtol=1e-6)
    assert windows.step == pytest.approx(2.0 / train.rate)
