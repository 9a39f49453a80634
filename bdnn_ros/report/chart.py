"""Small charts for the HTML report: an SVG that stretches to any width, with its axis labels as HTML text beside it.

Text laid out by the page stays readable on a narrow screen and follows its light or dark scheme, unlike text in a scaled
picture. A cloud drawn as one path of dots takes a tenth of the bytes of one element per point.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

SIZE = 2000
"""Width and height of the drawing in its own units, fine enough for any screen."""
MOST_POINTS = 600
"""Points of one cloud: more only darken it."""
SMALL = 0.05
"""A y axis that does not reach this far is labelled in thousandths: short labels fit a narrow chart."""
ROBUST = 0.002
"""Share of points at each end that may lie outside of a cloud's axes."""

Range = tuple[float, float]


@dataclass(frozen=True)
class Tick:
    """A labelled place on an axis, in per cent of its length."""

    place: float
    text: str


@dataclass(frozen=True)
class Layer:
    """A path in the drawing's units with the name of its style (`kind`), for example `line measured`."""

    kind: str
    path: str


@dataclass(frozen=True)
class Panel:
    """One chart, ready for the template.

    Attributes:
        x_label, y_label: what is on the axes, with units.
        x_ticks, y_ticks: labelled grid lines.
        layers: drawn in this order.
        alt: what it shows, for those who cannot see it.
        title: heading above it; may be empty.
    """

    x_label: str
    y_label: str
    x_ticks: tuple[Tick, ...]
    y_ticks: tuple[Tick, ...]
    layers: tuple[Layer, ...]
    alt: str
    title: str = ""


@dataclass
class Axes:
    """The ranges of a chart, and the layers drawn so far."""

    x: Range
    y: Range
    layers: list[Layer] = field(default_factory=list)

    def line(self, kind: str, x: np.ndarray, y: np.ndarray, runs: Iterable[slice] = (slice(None),)) -> None:
        """Connected samples x, y (N,), broken between runs."""
        h, v = self._units(x, y)
        pieces = []
        for run in runs:
            points = [f"{a} {b}" for a, b in zip(h[run].tolist(), v[run].tolist(), strict=True)]
            if len(points) > 1:
                pieces.append("M" + "L".join(points))
        self.layers.append(Layer(f"line {kind}", "".join(pieces)))

    def cloud(self, kind: str, x: np.ndarray, y: np.ndarray, most: int = MOST_POINTS) -> None:
        """Dots at x, y (N,), at most `most` of them; dots outside the axes are left out."""
        inside = (x >= self.x[0]) & (x <= self.x[1]) & (y >= self.y[0]) & (y <= self.y[1])
        picked = np.flatnonzero(inside)
        if len(picked) > most:
            # Not every k-th: a periodic motion would show the same few phases again and again.
            picked = np.sort(np.random.default_rng(0).choice(picked, most, replace=False))
        h, v = self._units(x[picked], y[picked])
        dots = "".join(f"M{a} {b}h0" for a, b in zip(h.tolist(), v.tolist(), strict=True))
        self.layers.append(Layer(f"cloud {kind}", dots))

    def band(self, kind: str, spans: Iterable[Range]) -> None:
        """Vertical stripes over spans of the x axis."""
        pieces = []
        for start, end in spans:
            a, b = (round(self._share(side, self.x) * SIZE) for side in (start, end))
            a, b = max(a, 0), min(b, SIZE)
            if b > a:
                pieces.append(f"M{a} 0h{b - a}v{SIZE}h{a - b}z")
        self.layers.append(Layer(f"band {kind}", "".join(pieces)))

    def panel(self, x_label: str, y: tuple[str, str], alt: str, title: str = "", x_most: int = 3) -> Panel:
        """The finished chart; `y` is the label of the vertical axis and its unit."""
        name, unit = y
        small = max(abs(side) for side in self.y) < SMALL
        low, high = (side * (1e3 if small else 1.0) for side in self.y)
        return Panel(
            x_label,
            f"{name} [{'m' if small else ''}{unit}]",
            ticks(self.x, x_most),
            ticks((low, high), 5),
            tuple(layer for layer in self.layers if layer.path),
            alt,
            title,
        )

    def _units(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values as whole units of the drawing, y downwards."""
        h = np.rint(_scaled(x, self.x) * SIZE).astype(int)
        v = np.rint((1.0 - _scaled(y, self.y)) * SIZE).astype(int)
        return h, v

    @staticmethod
    def _share(value: float, of: Range) -> float:
        return (value - of[0]) / (of[1] - of[0])


def ticks(of: Range, most: int) -> tuple[Tick, ...]:
    """As many round numbers inside a range as fit, `most` of them or fewer."""
    low, high = of
    power = 10.0 ** math.floor(math.log10((high - low) / (most + 1)))
    for digits in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0, 25.0, 50.0):
        step = digits * power
        first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
        if last - first < most:
            break
    decimals = max(0, -math.floor(math.log10(step) + 1e-9) + (digits in (2.5, 25.0)))
    return tuple(
        Tick(round(100.0 * (k * step - low) / (high - low), 2), _label(k * step, decimals))
        for k in range(first, last + 1)
    )


def span(values: Sequence[np.ndarray], robust: float = 0.0, margin: float = 0.06) -> Range:
    """Range that holds all values but a share `robust` at each end, with a margin; never empty."""
    flat = np.concatenate([np.ravel(v) for v in values])
    flat = flat[np.isfinite(flat)]
    if not len(flat):
        return (-1.0, 1.0)
    low, high = (float(v) for v in np.quantile(flat, [robust, 1.0 - robust]))
    room = max(margin * (high - low), 1e-6 * max(abs(low), abs(high)), 1e-9)
    return (low - room, high + room)


def _scaled(values: np.ndarray, of: Range) -> np.ndarray:
    # A value far outside must not become a number of many digits.
    return np.clip((np.asarray(values, float) - of[0]) / (of[1] - of[0]), -1.0, 2.0)


def _label(value: float, decimals: int) -> str:
    if decimals > 4 or abs(value) >= 1e5:
        text = f"{value:.3g}"
    else:
        text = f"{value:.{decimals}f}"
    return "0" if float(text) == 0.0 else text.replace("-", "−")
