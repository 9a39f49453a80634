"""Units of what joints do, about an axis or along it where a joint slides; and how values are printed."""

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
"""What takes the place of each unit where a joint slides."""


def along(unit: str, slides: bool) -> str:
    """A unit of a joint that turns, as it is where the joint `slides`."""
    return ALONG.get(unit, unit) if slides else unit


def printed(unit: str) -> str:
    """A unit as a text has it: `N*m*s^2/rad^2` as N·m·s²/rad²; nothing for `-`."""
    return {"-": "", "deg": "°"}.get(unit, unit.replace("*", "·").replace("^2", "²"))


def shown_as(value: float, digits: int = 3) -> str:
    """A value in a sentence: "?" for what a motion does not show."""
    return "?" if math.isnan(value) else f"{value:.{digits}g}"
