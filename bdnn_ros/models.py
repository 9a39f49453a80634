"""Loading and saving models of every kind."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from bdnn_ros.bdnn import modelfile
from bdnn_ros.dynamics import Dynamics
from bdnn_ros.errors import BdnnError, ModelFileError, listed
from bdnn_ros.recording import Recording
from bdnn_ros.signals import Signals


class Model(Dynamics, Protocol):
    """A model of a robot that predicts along a motion and can be saved."""

    kind: ClassVar[str]

    def predict(self, signals: Signals) -> np.ndarray:
        """Effort along a motion, (N, n) [N·m], low-passed as much as `signals.effort` is."""

    def to_state(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Arrays and JSON-able rest that make the model again."""


KINDS = {
    "physical": "bdnn_ros.physical.model:PhysicalModel",
    "bdnn": "bdnn_ros.bdnn.dynamics:BDNN",
    "bdnn_on_prior": "bdnn_ros.bdnn.dynamics:BDNNOnPrior",
    "extended": "bdnn_ros.extension.extended:ExtendedModel",
}
"""Where the class of each kind of model is, imported when one is met."""
ON_A_PRIOR = ("bdnn", "bdnn_on_prior")
"""Kinds that may hold a model of any kind."""


def load_model(path: str | Path) -> Model:
    """The model of a file, or of the directory that holds `model.bdnn`.

    Raises:
        ModelFileError: the file is missing, damaged, of another version, or of a kind that is not known.
    """
    target = modelfile.model_path(path)
    kind, arrays, info = modelfile.load(target)
    try:
        return build_model(kind, arrays, info, source=str(target))
    except BdnnError as error:
        if str(target) in error.problem:
            raise
        remedy = error.remedy if isinstance(error, ModelFileError) else "Identify the model again."
        raise ModelFileError(f"{target}: {error.problem}", remedy) from None


def build_model(
    kind: str, arrays: dict[str, np.ndarray], info: dict[str, Any], source: str = "The state"
) -> Model:
    """The model of a kind from its state.

    Raises:
        ModelFileError: the kind is not known, or the state is incomplete.
    """
    if kind not in KINDS:
        raise ModelFileError(f"{source} holds a model of kind {kind!r}.", f"Known kinds are {listed(KINDS)}.")
    module, name = KINDS[kind].split(":")
    read = getattr(import_module(module), name).from_state
    model: Model = read(arrays, info, build_model) if kind in ON_A_PRIOR else read(arrays, info)
    return model


@runtime_checkable
class KnowsTimes(Protocol):
    """A model with effects that act only at certain times of its recordings."""

    def along(self, recording: Recording) -> tuple[Any, str]:
        """The model for another recording's clock, and a sentence on what is left out."""

    def afterwards(self) -> Model:
        """The model once these times are over."""


def load_to_serve(path: Path) -> Model:
    """As `load_model`, for a live stream: effects bound to times of the recordings are over.

    Raises:
        ModelFileError: see `load_model`.
    """
    model = load_model(path)
    return model.afterwards() if isinstance(model, KnowsTimes) else model


def save_model(path: str | Path, model: Model) -> Path:
    """Write a model to a file, or to `model.bdnn` in a directory; returns the file's path."""
    arrays, info = model.to_state()
    return modelfile.save(path, model.kind, arrays, info)
