"""A motion in one piece: short ones lose too much time in ways from piece to piece.

The best of some random Fourier series, then changed joint by joint while that helps. Swevers et al., Optimal robot excitation
and identification, IEEE T-RA 13(5), 1997, optimise their coefficients alike.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bdnn_ros.excitation.motions import Bounds, Piece, retouched, swinging
from bdnn_ros.excitation.separation import Design
from bdnn_ros.robot import Robot

LONGEST = 25.0
"""Longer motions are joined of pieces, which show more of what friction does [s]."""
DRAWN, RETOUCHED = 800.0, 2400.0
"""Seconds of motion that are drawn, and tried near the best one."""
FEWEST = 20


def whole(
    robot: Robot,
    bounds: Bounds,
    design: Design,
    duration: float,
    rng: np.random.Generator,
    say: Callable[[str], None],
) -> Piece | None:
    """The most informative motion of one piece; None where none keeps the limits."""
    best: Piece | None = None
    highest = -np.inf
    drawn, near = (max(round(seconds / duration), FEWEST) for seconds in (DRAWN, RETOUCHED))
    for k in range(drawn + near):
        if k % 20 == 0:
            say(f"a motion in one piece {k}/{drawn + near}")
        if k < drawn or best is None:
            piece = swinging(robot, bounds, duration, rng)
        else:
            piece = retouched(robot, bounds, best, rng)
        value = -np.inf if piece is None else float(design.value(design.gram(piece)))
        if value > highest:
            best, highest = piece, value
    return best
