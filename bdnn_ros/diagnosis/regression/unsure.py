"""What is not known of what acts at the joints of a model that an earlier diagnosis made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.registry import get

if TYPE_CHECKING:
    from bdnn_ros.diagnosis.regression.equations import Equations

DOUBTED = 2.0
"""What was found may be off by so many times as much as it seems."""


@dataclass(frozen=True)
class Unsure:
    """Errors of the coefficients of effects at joints.

    Attributes:
        terms: the effects with their places and shapes; found, or left out.
        covariance: of all coefficients, one term's after another's, (K, K).
    """

    terms: tuple[Term, ...]
    covariance: np.ndarray

    @property
    def slots(self) -> list[slice]:
        """Where each term's coefficients are."""
        return slots_of(self.terms)

    @property
    def last(self) -> slice:
        """Where its errors are among those of all that is not known."""
        return slice(-len(self.covariance), None)

    @cached_property
    def errors(self) -> np.ndarray:
        """From K independent errors, of which one unit is what is believed of each, to those of the coefficients, (K, K)."""
        variances, directions = np.linalg.eigh(0.5 * (self.covariance + self.covariance.T))
        return np.asarray(DOUBTED * directions * np.sqrt(np.maximum(variances, 0.0)))

    def columns(self, equations: Equations) -> np.ndarray:
        """What one unit of each error does, rows (R, n, K) [N·m]."""
        each = [equations.columns(term) for term in self.terms]
        return np.asarray(np.concatenate(each, axis=2) @ self.errors)

    def moved(self, errors: np.ndarray) -> list[np.ndarray]:
        """By how much each term's coefficients are others by the last of all errors (U,)."""
        found = self.errors @ errors[self.last]
        return [found[slot] for slot in self.slots]

    def to_state(self, joints: Sequence[str]) -> list[dict[str, Any]]:
        """The terms, JSON-able; beside them the covariance makes it again."""
        return [
            {
                "effect": term.effect.name,
                "variant": term.effect.variant,
                "joint": joints[term.target],
                "shape": dict(term.shape),
            }
            for term in self.terms
        ]

    @classmethod
    def from_state(
        cls, entries: Sequence[Mapping[str, Any]], covariance: np.ndarray, joints: Sequence[str]
    ) -> Unsure:
        """That of `to_state`.

        Raises:
            UsageError: an effect is not known.
            ValueError: something does not fit.
        """
        terms = []
        for one in entries:
            effect = get(str(one["effect"]), str(one["variant"]))
            shape = {str(name): float(value) for name, value in one["shape"].items()}
            terms.append(Term(effect, joints.index(str(one["joint"]))).shaped(shape))
        size = slots_of(terms)[-1].stop if terms else 0
        if covariance.shape != (size, size) or not np.isfinite(covariance).all():
            raise ValueError("unsure")
        return cls(tuple(terms), covariance)


def slots_of(terms: Sequence[Term]) -> list[slice]:
    """Where each term's coefficients are among those of all, one term's after another's."""
    ends = np.cumsum([0, *(len(term.effect.coefficient_bounds) for term in terms)]).tolist()
    return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
