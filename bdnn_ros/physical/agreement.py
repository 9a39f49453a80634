"""Compares the parameters identified from several recordings of one robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from bdnn_ros.errors import UsageError
from bdnn_ros.physical.combinations import Combination, combinations
from bdnn_ros.physical.model import PhysicalModel
from bdnn_ros.robot import PER_LINK

CHANCE = 0.01
"""Probability that chance alone makes any of all parameters seem to differ."""


@dataclass(frozen=True)
class Agreement:
    """One parameter, or combination of parameters, as identified from each recording.

    Attributes:
        words, unit: what it is.
        values, stds: by each recording, (m,) each.
        mean: weighted by what each recording knows.
        spread: standard deviation of the values.
        differs: whether they differ more than their errors allow.
        by_motion: it is friction or offset of a joint that does more than these say: then they are what fits each
            motion best, and differ from motion to motion without any change of the robot.
    """

    words: str
    unit: str
    values: np.ndarray
    stds: np.ndarray
    mean: float
    spread: float
    differs: bool
    by_motion: bool = False

    def sentence(self) -> str:
        """The values in one sentence."""
        values = ", ".join(f"{v:.4g} ± {s:.2g}" for v, s in zip(self.values, self.stds, strict=True))
        verdict = "the recordings disagree" if self.differs else "the recordings agree"
        why = (
            ", as other motions may where friction is not Coulomb and viscous alone" if self.by_motion else ""
        )
        return f"{self.words} [{self.unit}]: {values}; {verdict}{why if self.differs else ''}."


def agreement(models: Sequence[PhysicalModel]) -> list[Agreement]:
    """Compare models of one robot, each identified from another recording, in every identifiable combination of parameters.

    Base tilt and joint zeros are compared between the models that found them different from the description.

    Values differ if their weighted squared distances from the mean exceed what chance explains (χ² test, level divided by the
    number of parameters after Bonferroni).

    Raises:
        UsageError: there are fewer than two, or of different robots.
    """
    if len(models) < 2 or any(model.joints != models[0].joints for model in models):
        raise UsageError("Agreement takes two or more models of one robot.", "Give several recordings of it.")
    found = combinations(models[0].robot)
    parameters = [model.parameters.vector() for model in models]
    level = CHANCE / len(found)
    result = []
    for one in found:
        values = np.array([one.value(vector) for vector in parameters])
        stds = np.array([one.std(model.covariance) for model in models])
        result.append(_compared(one.words, one.unit, values, stds, level, _by_motion(one, models)))
    turned = [model for model in models if model.leans]
    for k, name in enumerate(("roll", "pitch") if len(turned) > 1 else ()):
        values = np.degrees([model.tilt[k] for model in turned])
        stds = np.degrees([model.tilt_std[k] for model in turned])
        result.append(_compared(f"{name} of the base", "deg", values, stds, level))
    return [*result, *_zeros(models, level)]


def _zeros(models: Sequence[PhysicalModel], level: float) -> Iterator[Agreement]:
    """The joint zeros that models identified, for joints where at least two found one."""
    for joint, name in enumerate(models[0].joints):
        told = [(value, std) for model in models for k, value, std in model.zeros if k == joint]
        if len(told) > 1:
            values, stds = np.array(told).T
            yield _compared(f"zero of {name}", models[0].position_unit(joint), values, stds, level)


def _compared(
    words: str, unit: str, values: np.ndarray, stds: np.ndarray, level: float, by_motion: bool = False
) -> Agreement:
    """The values of one quantity from each recording, (m,) each, and whether they differ at this level."""
    stds = np.maximum(stds, 1e-12)
    weights = 1.0 / stds**2
    mean = float(weights @ values / weights.sum())
    distance = float(weights @ (values - mean) ** 2)
    differs = bool(chdtrc(len(values) - 1, distance) < level)
    return Agreement(words, unit, values, stds, mean, float(values.std(ddof=1)), differs, by_motion)


def _by_motion(one: Combination, models: Sequence[PhysicalModel]) -> bool:
    """Whether it is the friction or offset of a joint for which a model learned further terms."""
    width = len(models[0].joints)
    first = int(np.flatnonzero(one.weights)[0])
    if first < width * (PER_LINK + 1):
        return False
    return any(m.learned is not None and bool(m.learned.groups[first % width]) for m in models)
