"""An effect at a place of a robot: what a diagnosis tries, fits and names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdnn_ros.effects.base import Effect
from bdnn_ros.effects.motion import Motion
from bdnn_ros.effects.registry import get

WEAR = ("armature", "viscous_friction", "coulomb_friction")
"""What every joint has, whatever else happens there."""
COMMON = (*WEAR, "effort_offset")
"""What almost every drive has, and an identified model knows of each joint, in the order of `physical.parameters.JOINT_NAMES`."""
Shape = tuple[tuple[str, float], ...]
NOTHING = 1e-4
"""Spread, in units of what is believed, of a coefficient that is nothing."""


@dataclass(frozen=True)
class Term:
    """An effect at its place, with the shape its columns are made with.

    Attributes:
        again: which of those that act at one place one after another, from 0; only what acts for a time may do so again.
    """

    effect: Effect
    target: int
    link: str | None = None
    shape: Shape = ()
    again: int = 0

    @property
    def title(self) -> str:
        """What a sentence calls it."""
        return f"a drift of {self.effect.title}" if self.effect.name == "drift" else self.effect.title

    @property
    def place(self) -> tuple[str, str, int, str | None, int]:
        """What it is, where, and which of those there, without the shape."""
        return (*self.spot, self.again)

    @property
    def spot(self) -> tuple[str, str, int, str | None]:
        """What it is and where, whichever of those there."""
        return (self.effect.name, self.effect.variant, self.target, self.link)

    @property
    def kinds(self) -> np.ndarray:
        """Prior precisions of its coefficients by each of the effect's kinds, in units of what is believed, (m, k)."""
        return np.maximum(self.effect.kinds, NOTHING) ** -2.0

    @property
    def gone(self) -> np.ndarray:
        """How much of each coefficient may be gone of what a description or an earlier model has there, (k,) or (1,) where none.

        That may be more than a joint's effort has room for: a tag in a URDF is often a guess.
        """
        if self.effect.on_body or not self.effect.may_be_gone:
            return np.zeros(1)
        low = np.array(self.effect.coefficient_bounds)[:, 0]
        return np.where(np.isfinite(low), -low, 0.0)

    def shaped(self, shape: dict[str, float]) -> Term:
        """The same effect with another shape."""
        return replace(self, shape=tuple(sorted(shape.items())))

    def shapes(self, motion: Motion) -> list[dict[str, float]]:
        """Shapes to try first: those of the effect, or the only one there is."""
        kept = self.effect.kept
        return self.effect.shapes(motion, self.target, self.link) if kept is None else [dict(kept)]

    def settled(self, motion: Motion) -> Term | None:
        """What it settles into, with its first shape; None where it is always itself."""
        if self.effect.settles_into is None:
            return None
        plain = get(self.effect.settles_into)
        return Term(plain, self.target).shaped(plain.shapes(motion, self.target)[0])


def new_shapes(terms: Sequence[Term], before: Sequence[Term]) -> dict[int, Shape]:
    """Shapes of those of some terms that had others before."""
    pairs = enumerate(zip(terms, before, strict=True))
    return {one: term.shape for one, (term, old) in pairs if term.shape != old.shape}


def of_shapes(terms: Sequence[Term], shapes: Mapping[int, Shape]) -> dict[int, Term]:
    """Those of some terms that have other shapes, with these."""
    return {one: replace(terms[one], shape=shape) for one, shape in shapes.items()}
