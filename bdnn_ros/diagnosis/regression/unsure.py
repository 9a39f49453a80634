"""Uncertainty of joint effects in a model that an earlier diagnosis made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from bdnn_ros.diagnosis.regression.columns import Columns
from bdnn_ros.diagnosis.regression.term import Term
from bdnn_ros.effects.registry import get

ERROR_FACTOR = 2.0
"""Factor on the estimated standard deviations of what was found."""


@dataclass(frozen=True)
class Unsure:
    """Errors of the coefficients of joint effects.

    Attributes:
        terms: the effects with their places and shapes, those found and common ones left out.
        covariance: of all coefficients, one term after another, (K, K).
    """

    terms: tuple[Term, ...]
    covariance: np.ndarray

    @property
    def slots(self) -> list[slice]:
        """Slice of each term's coefficients."""
        return slots_of(self.terms)

    @property
    def last(self) -> slice:
        """Slice of these errors among all independent errors of the regression."""
        return slice(-len(self.covariance), None)

    @cached_property
    def errors(self) -> np.ndarray:
        """Map from K independent errors, in prior standard deviations, to those of the coefficients, (K, K)."""
        variances, directions = np.linalg.eigh(0.5 * (self.covariance + self.covariance.T))
        return np.asarray(ERROR_FACTOR * directions * np.sqrt(np.maximum(variances, 0.0)))

    def columns(self, columns: Columns) -> np.ndarray:
        """Effort per unit of each error, rows (R, n, K) [N·m]."""
        each = [columns.of(term) for term in self.terms]
        return np.asarray(np.concatenate(each, axis=2) @ self.errors)

    def moved(self, errors: np.ndarray) -> list[np.ndarray]:
        """Change of each term's coefficients by the last of all errors (U,)."""
        found = self.errors @ errors[self.last]
        return [found[slot] for slot in self.slots]

    def to_state(self, joints: Sequence[str]) -> list[dict[str, Any]]:
        """The terms as JSON-able data; together with the covariance it restores the object."""
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
        """Restore what `to_state` made.

        Raises:
            UsageError: an effect is not known.
            ValueError: the covariance does not fit the terms.
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
    """Slice of each term's coefficients, one term after another."""
    ends = np.cumsum([0, *(len(term.effect.coefficient_bounds) for term in terms)]).tolist()
    return [slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
