"""Trains a BDNN within a time budget; training can be interrupted and resumed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bdnn_ros.bdnn import modelfile
from bdnn_ros.bdnn.dynamics import BDNN
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import ModelFileError, UsageError, listed
from bdnn_ros.signals import Signals

Progress = Callable[[float, str], None]
"""Told the share of the budget that is spent, and what is being done."""
ARCHITECTURES = ("chain", "networks")
SAVE_SECONDS = 2.0
"""Least time between two writings of the state."""


class Training(Protocol):
    """A training in progress."""

    @property
    def finished(self) -> bool:
        """Whether the training is complete."""

    @property
    def told(self) -> str:
        """The present stage, for a progress line."""

    def advance(self, used: Callable[[], float]) -> None:
        """Do one step; `used` returns the share of the budget that is spent."""

    def model(self) -> BDNN:
        """The best model so far."""

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able information to resume the training."""

    def restore(self, arrays: dict[str, np.ndarray], info: dict[str, Any]) -> None:
        """Resume from a state of the same data."""


def identify(
    signals_train: Signals | Sequence[Signals],
    signals_validation: Signals | Sequence[Signals],
    prior: Dynamics | None = None,
    budget: float = 60.0,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    architecture: str = "chain",
    state: str | Path | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> BDNN:
    """A BDNN that explains the effort along motions.

    Args:
        signals_train: motions to learn from, of one recording or several.
        signals_validation: held-out motions that choose and stop; a chain, which needs neither, learns from
            them too.
        prior: what is known; a `Robot`'s bodies and joints are identified, any other dynamics stay as they
            are, and networks learn the rest. None learns all.
        budget: [s]; the training ends by itself, at the latest 10 % later.
        seed: of all that is random.
        progress: told now and then.
        architecture: without a prior: "chain" (a serial chain whose axes are learned, and networks for the
            rest) or "networks" (H and R networks alone, as in the paper).
        state: a file to go on from if it is there. It is written every `SAVE_SECONDS` between two pieces of work, and at
            the end, an exception's and Ctrl-C's, too: a process that is killed loses what came since, and its piece.
        clock: tells the time [s].

    Raises:
        UsageError: the budget or the architecture makes no sense, or the joints of the signals differ.
        RecordingError: there is too little to learn from.
        DataError: the budget is too short for any model, or no start of the search came to one.
        ModelFileError: the state is not of such a training.
    """
    train = [signals_train] if isinstance(signals_train, Signals) else list(signals_train)
    validation = [signals_validation] if isinstance(signals_validation, Signals) else list(signals_validation)
    _check(train, validation, prior, budget, architecture)
    rng = np.random.default_rng(seed)
    start = clock()
    training = _training(train, validation, prior, rng, architecture, budget)
    label = "prior" if prior is not None else architecture
    path = None if state is None else Path(state)
    spending = _Spending(budget, clock, start, _restore(training, path, label))
    _spend(spending, training, progress, path, label)
    model = training.model()
    if progress is not None:
        progress(1.0, "done")
    return model


@dataclass(frozen=True)
class _Spending:
    """The use of a time budget [s].

    Attributes:
        start: when the training began, or went on.
        before: what was spent until then [s].
    """

    budget: float
    clock: Callable[[], float]
    start: float
    before: float

    def used(self) -> float:
        """The share that is spent."""
        return (self.before + self.clock() - self.start) / self.budget


def _spend(
    spending: _Spending, training: Training, progress: Progress | None, path: Path | None, label: str
) -> None:
    """Train until the budget is spent or the training is complete; the state is kept in a file if one is given."""
    saved = spending.start
    try:
        while not training.finished and spending.used() < 1.0:
            training.advance(spending.used)
            if progress is not None:
                progress(min(spending.used(), 0.99), training.told)
            if path is not None and spending.clock() - saved > SAVE_SECONDS:
                _save(training, path, label, spending.used() * spending.budget)
                saved = spending.clock()
    finally:
        if path is not None:
            _save(training, path, label, spending.used() * spending.budget)


def _training(
    train: list[Signals],
    validation: list[Signals],
    prior: Dynamics | None,
    rng: np.random.Generator,
    architecture: str,
    budget: float,
) -> Training:
    if prior is not None:
        from bdnn_ros.bdnn.prior_training import PriorTraining

        return PriorTraining(train, validation, prior, rng, budget)
    if architecture == "chain":
        from bdnn_ros.bdnn.chain_training import ChainTraining

        return ChainTraining(train, validation, rng, budget)
    from bdnn_ros.bdnn.network_training import NetworkTraining

    return NetworkTraining(train, validation, rng)


def _check(
    train: list[Signals], validation: list[Signals], prior: Dynamics | None, budget: float, architecture: str
) -> None:
    if not budget > 0.0:
        raise UsageError(f"A budget of {budget:g} s is no time.", "Give seconds above zero.")
    if architecture not in ARCHITECTURES:
        raise UsageError(f"No architecture {architecture!r}.", f"There are {listed(ARCHITECTURES)}.")
    if not train or not validation:
        raise UsageError("Training needs signals to learn from and signals held out.", "Give both.")
    joints = train[0].joints if prior is None else prior.joints
    for signals in [*train, *validation]:
        if signals.joints != joints:
            raise UsageError(
                f"Signals of {listed(signals.joints)} do not fit a model of {listed(joints)}.",
                "Pick the joints with --joints.",
            )


def _save(training: Training, path: Path, label: str, spent: float) -> None:
    arrays, info = training.to_state()
    modelfile.write(path, "training", arrays, {"of": label, "spent": spent, "state": info})


def _restore(training: Training, path: Path | None, label: str) -> float:
    """Resume from the file if there is one; returns the seconds spent before."""
    if path is None or not path.exists():
        return 0.0
    kind, arrays, info = modelfile.load(path, finite=False)  # what cannot be costs infinitely much
    if kind != "training" or info.get("of") != label:
        raise ModelFileError(f"{path} is not the state of this training.", "Give another file, or remove it.")
    try:
        training.restore(arrays, info["state"])
        return float(info["spent"])
    except (KeyError, TypeError, ValueError, IndexError):
        raise ModelFileError(f"The training state {path} is damaged.", "Remove it to begin anew.") from None
