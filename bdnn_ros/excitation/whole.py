"""A motion in one piece, which loses no time in transitions.

The best of some random Fourier series, then varied joint by joint while that helps. Swevers et al., Optimal robot excitation
and identification, IEEE T-RA 13(5), 1997, optimise the coefficients in a similar way.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bdnn_ros.excitation.bounds import Bounds
from bdnn_ros.excitation.motions import Piece, retouched, swinging
from bdnn_ros.excitation.separation import Design

LONGEST = 25.0
"""Longer motions are joined of pieces, which show more of what friction does [s]."""
DRAWN, RETOUCHED = 800.0, 3600.0
"""Seconds of motion that are drawn, and tried near the best one."""
FEWEST = 20
WIDER, NARROWER, STEPS = 1.5, 0.93, (0.15, 1.5)
"""What a step that helped does to the size of the next one, one that did not, and how small and large it gets."""


def whole(
    bounds: Bounds,
    design: Design,
    duration: float,
    rng: np.random.Generator,
    say: Callable[[str], None],
) -> Piece | None:
    """The most informative motion in one piece; None if none keeps the limits."""
    drawn, near = (max(round(seconds / duration), FEWEST) for seconds in (DRAWN, RETOUCHED))

    def value(piece: Piece | None, count: int) -> float:
        if count % 20 == 0:
            say(f"a motion in one piece {count}/{drawn + near}")
        return -np.inf if piece is None else float(design.value(design.gram(piece)))

    first = [swinging(bounds, duration, rng) for _ in range(drawn)]
    values = [value(piece, k) for k, piece in enumerate(first)]
    best, highest, step = first[int(np.argmax(values))], max(values), 1.0
    if best is None:
        return None
    for k in range(drawn, drawn + near):
        piece = retouched(bounds, best, step, rng)
        found = value(piece, k)
        step = float(np.clip(step * (WIDER if found > highest else NARROWER), *STEPS))
        if piece is not None and found > highest:
            best, highest = piece, found
    return best
