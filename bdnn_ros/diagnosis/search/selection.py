"""A set of effects that a search found."""

from __future__ import annotations

from dataclasses import dataclass

from bdnn_ros.diagnosis.regression.evidence import Pool
from bdnn_ros.diagnosis.regression.fit import Fit
from bdnn_ros.diagnosis.regression.term import Term


@dataclass(frozen=True)
class Selection:
    """The set of effects found, with what is needed to judge it.

    Attributes:
        pool: candidates at the final noise model; `chosen` are indices into it.
        fit: posterior of the chosen terms.
    """

    pool: Pool
    chosen: tuple[int, ...]
    fit: Fit

    @property
    def terms(self) -> list[Term]:
        """The chosen terms."""
        return [self.pool.terms[c] for c in self.chosen]

    @property
    def places(self) -> frozenset[tuple[str, str, int, str | None, int]]:
        """Effects and places of the chosen terms, without their shapes."""
        return frozenset(term.place for term in self.terms)
