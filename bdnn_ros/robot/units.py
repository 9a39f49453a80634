"""Units of revolute and prismatic joints, and how values are printed."""

from __future__ import annotations

import math

ALONG = {
    "rad": "m",
    "rad/s": "m/s",
    "kg*m^2": "kg",
    "N*m": "N",
    "N*m/rad": "N/m",
    "rad/(N*m)": "m/N",
    "N*m*s/rad": "N*s/m",
    "N*m*s^2/rad^2": "N*s^2/m^2",
}
"""Units of a prismatic joint, by those of a revolute one."""


def along(unit: str, slides: bool) -> str:
    """The unit that a quantity of a revolute joint has on a joint that `slides`, if it does."""
    return ALONG.get(unit, unit) if slides else unit


def printed(unit: str) -> str:
    """A unit as printed: `N*m*s^2/rad^2` as N·m·s²/rad²; empty for `-`."""
    return {"-": "", "deg": "°"}.get(unit, unit.replace("*", "·").replace("^2", "²"))


def shown_as(value: float, digits: int = 3) -> str:
    """A value in a sentence: "?" for NaN, which a motion does not determine."""
    return "?" if math.isnan(value) else f"{value:.{digits}g}"
