"""A term: an effect at a place of a robot, as a diagnosis tries, fits and names it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import get

WEAR = ("armature", "viscous_friction", "coulomb_friction")
"""Kinds that every joint has to some extent."""
COMMON = (*WEAR, "effort_offset")
"""Kinds of almost every drive, which identified models know of each joint, in the order of `physical.parameters.JOINT_NAMES`."""
Shape = tuple[tuple[str, float], ...]
NOTHING = 1e-4
"""Prior spread, relative to the usual one, of a coefficient that is taken to be zero."""


@dataclass(frozen=True)
class Term:
    """An effect at its place, with the shape its columns are made with.

    Attributes:
        again: occurrence at its place, from 0; only what acts for a time can occur again.
    """

    effect: Effect
    target: int
    link: str | None = None
    shape: Shape = ()
    again: int = 0

    @property
    def title(self) -> str:
        """Name in a sentence."""
        return f"a drift of {self.effect.title}" if self.effect.name == "drift" else self.effect.title

    @property
    def place(self) -> tuple[str, str, int, str | None, int]:
        """Effect, place and occurrence, without the shape."""
        return (*self.spot, self.again)

    @property
    def spot(self) -> tuple[str, str, int, str | None]:
        """Effect and place, whichever occurrence."""
        return (self.effect.name, self.effect.variant, self.target, self.link)

    @property
    def kinds(self) -> np.ndarray:
        """Prior precisions of its coefficients for each of the effect's kinds, relative to the usual prior, (m, k)."""
        return np.maximum(self.effect.kinds, NOTHING) ** -2.0

    @property
    def removable(self) -> np.ndarray:
        """How far each coefficient can go below a description or earlier model, (k,); (1,) of zero if not at all.

        A lower limit of the prior spread, whatever the joint's effort: a tag in a URDF is often a guess.
        """
        if self.effect.on_body or not self.effect.may_be_gone:
            return np.zeros(1)
        low = np.array(self.effect.coefficient_bounds)[:, 0]
        return np.where(np.isfinite(low), -low, 0.0)

    def shaped(self, shape: dict[str, float]) -> Term:
        """The same term with another shape."""
        return replace(self, shape=tuple(sorted(shape.items())))

    def shapes(self, motion: Motion) -> list[dict[str, float]]:
        """Shapes to try first: those of the effect, or the one that an earlier model fixes."""
        kept = self.effect.kept
        return self.effect.shapes(motion, self.target, self.link) if kept is None else [dict(kept)]

    def settled(self, motion: Motion) -> Term | None:
        """The simpler law that it settles into, with its first shape; None if there is none."""
        if self.effect.settles_into is None:
            return None
        plain = get(self.effect.settles_into)
        return Term(plain, self.target).shaped(plain.shapes(motion, self.target)[0])


def kinds_of(terms: Sequence[Term], base: int) -> tuple[np.ndarray, list[int]]:
    """Relative prior precisions by kind of some terms' coefficients, (m, base + K), and how many kinds each term has.

    Args:
        base: number of coefficients before theirs, which have one kind only, as have terms of fewer kinds than others.
    """
    own = [term.kinds for term in terms]
    counts = [len(kinds) for kinds in own]
    most = max(counts, default=1)
    each = (np.broadcast_to(kinds, (most, kinds.shape[1])) for kinds in own)
    return np.concatenate([np.ones((most, base)), *each], axis=1), counts


def new_shapes(terms: Sequence[Term], before: Sequence[Term]) -> dict[int, Shape]:
    """Index and shape of terms whose shape differs from before."""
    pairs = enumerate(zip(terms, before, strict=True))
    return {one: term.shape for one, (term, old) in pairs if term.shape != old.shape}


def of_shapes(terms: Sequence[Term], shapes: Mapping[int, Shape]) -> dict[int, Term]:
    """Those terms that have new shapes, with these."""
    return {one: replace(terms[one], shape=shape) for one, shape in shapes.items()}
