"""Axes and marks as SVG whose colours come from the style sheet, so that one drawing serves light, dark and print."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from naris.report.markup import Markup, element, join

_MANY_TICKS = 9


def plain_number(value: float) -> str:
    """Up to four digits, without trailing zeros."""
    return f"{value:.4g}"


def per_cent(value: float) -> str:
    """A share as whole per cent."""
    return f"{100 * value:.0f} %"


@dataclass(frozen=True)
class Scale:
    """One axis.

    Attributes:
        low, high: the values at its ends; values beyond are drawn at the end.
        ticks: where lines and numbers stand.
        label: with its unit.
        log: logarithmic; then low must be positive.
        form: how a tick is written.
    """

    low: float
    high: float
    ticks: tuple[float, ...]
    label: str = ""
    log: bool = False
    form: Callable[[float], str] = plain_number

    @staticmethod
    def linear(low: float, high: float, label: str, count: int = 5) -> Scale:
        """With about `count` round ticks; the ends move outwards to ticks."""
        span = max(high - low, 1e-9)
        raw = span / count
        power = 10.0 ** math.floor(math.log10(raw))
        step = next(m * power for m in (1, 2, 2.5, 5, 10) if m * power >= raw * 0.999)
        first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
        ticks = tuple(round(i * step, 12) for i in range(first, last + 1))
        return Scale(ticks[0], ticks[-1], ticks, label)

    @staticmethod
    def logarithmic(low: float, high: float, label: str) -> Scale:
        """Ticks at 1, 2 and 5 times powers of ten where they are few, else at powers of ten."""
        exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        ticks = tuple(m * 10.0**e for e in exponents for m in (1, 2, 5) if low <= m * 10.0**e <= high)
        if len(ticks) > _MANY_TICKS:
            ticks = tuple(10.0**e for e in exponents if low <= 10.0**e <= high)
        return Scale(low, high, ticks, label, log=True)

    def at(self, values: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Where values stand between the ends, 0…1."""
        values = np.clip(values, self.low, self.high)
        if self.log:
            return np.log(values / self.low) / math.log(self.high / self.low)
        return (values - self.low) / (self.high - self.low)


SHARE = Scale(0.0, 1.0, (0.0, 0.2, 0.4, 0.6, 0.8, 1.0), form=per_cent)


@dataclass(frozen=True)
class Axes:
    """A plotting area with two scales; lengths in the pixels of the drawing.

    Attributes:
        width, height: of the whole drawing.
        margin: left, top, right, bottom, for the numbers and labels.
    """

    width: int
    height: int
    x: Scale
    y: Scale
    margin: tuple[int, int, int, int] = (52, 14, 14, 44)

    def x_px(self, value: float) -> float:
        return float(self.places(np.array([value], float), np.array([self.y.low], float))[0, 0])

    def y_px(self, value: float) -> float:
        return float(self.places(np.array([self.x.low], float), np.array([value], float))[0, 1])

    def places(self, xs: Float[np.ndarray, "n"], ys: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 2"]:
        """Pixels of points given by their values on the axes."""
        left, top, right, bottom = self.margin
        across = left + self.x.at(xs) * (self.width - left - right)
        down = self.height - bottom - self.y.at(ys) * (self.height - top - bottom)
        return np.round(np.stack([across, down], axis=1), 2)

    def curve(self, xs: Float[np.ndarray, "n"], ys: Float[np.ndarray, "n"], class_: str) -> Markup:
        """A line through points."""
        points = " ".join(f"{x:g},{y:g}" for x, y in self.places(xs, ys))
        return element("polyline", points=points, class_=f"curve {class_}")

    def dots(self, xs: Float[np.ndarray, "n"], ys: Float[np.ndarray, "n"], class_: str, radius: float = 3) -> Markup:
        """All dots as one path of round caps: a tenth of the size of single circles."""
        path = "".join(f"M{x:g} {y:g}h0" for x, y in self.places(xs, ys))
        return element("path", d=path, class_=f"dots {class_}", stroke_width=2 * radius)

    def box(self, x0: float, x1: float, y0: float, y1: float, class_: str) -> Markup:
        """A filled rectangle between two values on either axis."""
        left, right = self.x_px(x0), self.x_px(x1)
        low, high = self.y_px(y0), self.y_px(y1)
        return element("rect", x=left, y=high, width=right - left, height=max(low - high, 0.5), class_=class_)

    def line(self, x0: float, y0: float, x1: float, y1: float, class_: str) -> Markup:
        return element(
            "line",
            x1=self.x_px(x0),
            y1=self.y_px(y0),
            x2=self.x_px(x1),
            y2=self.y_px(y1),
            class_=class_,
        )

    def text(self, x: float, y: float, text: str, anchor: str = "middle", rise: float = 0.0) -> Markup:
        """Text at a value on either axis, `rise` pixels above it."""
        return label(self.x_px(x), self.y_px(y) - rise, text, anchor)

    def draw(self, alt: str, marks: Iterable[Markup]) -> Markup:
        """The drawing: grid, numbers, labels, marks; `alt` says in words what it shows."""
        left, top, right, bottom = self.margin
        under = self.height - bottom
        grid = [
            element("line", x1=left, x2=self.width - right, y1=y, y2=y, class_="grid")
            for y in map(self.y_px, self.y.ticks)
        ]
        numbers = [label(left - 8, self.y_px(t) + 4, self.y.form(t), "end") for t in self.y.ticks]
        numbers += [label(self.x_px(t), under + 17, self.x.form(t)) for t in self.x.ticks]
        base = element("line", x1=left, x2=self.width - right, y1=under, y2=under, class_="axis")
        middle = (top + under) / 2
        names = [
            label((left + self.width - right) / 2, self.height - 6, self.x.label, class_="axis-label"),
            element(
                "text",
                self.y.label,
                transform=f"translate(13 {middle:g}) rotate(-90)",
                text_anchor="middle",
                class_="axis-label",
            ),
        ]
        return drawing(self.width, self.height, alt, join(grid, base, list(marks), numbers, names))


def drawing(width: int, height: int, alt: str, content: Markup, class_: str = "chart") -> Markup:
    """An SVG image of a natural size in pixels that shrinks with its column; `alt` is read aloud."""
    return element(
        "svg",
        content,
        xmlns="http://www.w3.org/2000/svg",
        viewBox=f"0 0 {width} {height}",
        role="img",
        aria_label=alt,
        class_=class_,
        style=f"max-width:{width}px",
    )


def label(x: float, y: float, text: str, anchor: str = "middle", class_: str | None = None) -> Markup:
    """Text in a drawing."""
    return element("text", text, x=float(x), y=float(y), text_anchor=anchor, class_=class_)


def legend(entries: Iterable[tuple[str, str]]) -> Markup:
    """Swatches beside a chart: (class of the series, what it is)."""
    return element(
        "p",
        [element("span", element("i", class_=f"swatch {class_}"), text) for class_, text in entries],
        class_="legend",
    )
