"""Line plots as inline SVG that follows the page's colours and needs no library."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

WIDTH, HEIGHT = 640, 340
LEFT, RIGHT, TOP, BOTTOM = 66, 16, 16, 48


@dataclass(frozen=True)
class Series:
    """A line, or dots that are not joined: name, points (x, y), and what pointer texts say beside them."""

    name: str
    points: Sequence[tuple[float, float]]
    notes: Sequence[str] = ()
    joined: bool = True


@dataclass(frozen=True)
class Axis:
    """A label, and whether the scale is logarithmic; `percent` shows shares as per cent."""

    label: str
    log: bool = False
    percent: bool = False


def svg(series: Sequence[Series], x: Axis, y: Axis, marks: Sequence[tuple[float, str]] = ()) -> str:
    """The plot as SVG text; `marks` are vertical lines (x, label), such as a knee.

    On logarithmic axes, points that are not positive are left out.
    """
    drawn = [
        [(*point, note) for point, note in zip(line.points, _notes(line), strict=True) if _fits(point, x, y)]
        for line in series
    ]
    points = [point for line in drawn for point in line]
    if not points:
        return '<p class="note">Nothing to draw.</p>'
    horizontal = _Scale([p[0] for p in points], x, LEFT, WIDTH - RIGHT)
    vertical = _Scale([p[1] for p in points], y, HEIGHT - BOTTOM, TOP)
    parts = [
        f'<svg class="plot" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{escape(y.label)} over {escape(x.label)}">'
    ]
    for value in vertical.ticks:
        at = vertical(value)
        parts.append(f'<path class="grid" d="M{LEFT} {at:.1f}H{WIDTH - RIGHT}"/>')
        parts.append(f'<text x="{LEFT - 8}" y="{at + 4:.1f}" text-anchor="end">{_number(value, y)}</text>')
    for value in horizontal.ticks:
        at = horizontal(value)
        parts.append(f'<path class="grid" d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}"/>')
        parts.append(
            f'<text x="{at:.1f}" y="{HEIGHT - BOTTOM + 18}" text-anchor="middle">{_number(value, x)}</text>'
        )
    parts.append(
        f'<text class="label" x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 8}" text-anchor="middle">'
        f"{escape(x.label)}</text>"
        f'<text class="label" transform="translate(14 {(TOP + HEIGHT - BOTTOM) / 2}) rotate(-90)" '
        f'text-anchor="middle">{escape(y.label)}</text>'
    )
    for value, label in marks:
        if x.log and value <= 0:
            continue
        at = horizontal(value)
        side, shift = ("end", -6) if at > WIDTH / 2 else ("start", 6)
        parts.append(f'<path class="mark" d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}"/>')
        parts.append(
            f'<text class="mark-label" x="{at + shift:.1f}" y="{TOP + 12}" text-anchor="{side}">'
            f"{escape(label)}</text>"
        )
    for number, (line, of) in enumerate(zip(drawn, series, strict=True)):
        tone = f"s{number % 6}"
        path = "L".join(f"{horizontal(px):.1f} {vertical(py):.1f}" for px, py, _ in line)
        if path and of.joined:
            parts.append(f'<path class="line {tone}" d="M{path}"/>')
        for px, py, note in line:
            text = escape(f"{of.name}: {_number(px, x)}, {_number(py, y)}{note}")
            parts.append(
                f'<circle class="{tone}" cx="{horizontal(px):.1f}" cy="{vertical(py):.1f}" r="4">'
                f"<title>{text}</title></circle>"
            )
    parts.append("</svg>")
    if len(series) > 1:
        names = (
            f'<li><span class="key s{number % 6}"></span>{escape(line.name)}</li>'
            for number, line in enumerate(series)
        )
        parts.append(f'<ul class="legend">{"".join(names)}</ul>')
    return "".join(parts)


class _Scale:
    """From values to places between two ends."""

    def __init__(self, values: Sequence[float], axis: Axis, start: float, end: float) -> None:
        self._axis, self._start, self._end = axis, start, end
        low, high = min(values), max(values)
        if axis.log:
            low, high = math.log10(low), math.log10(high)
            pad = max(0.05 * (high - low), 0.05)
            self._low, self._high = low - pad, high + pad
            self.ticks = _log_ticks(self._low, self._high)
        else:
            low = min(low, 0.0) if low > 0 and low < 0.5 * high else low
            step = _step((high - low) or abs(high) or 1.0)
            self._low = math.floor(low / step + 1e-9) * step
            self._high = math.ceil(high / step - 1e-9) * step
            if self._high <= self._low:
                self._high = self._low + step
            count = round((self._high - self._low) / step)
            self.ticks = [self._low + i * step for i in range(count + 1)]

    def __call__(self, value: float) -> float:
        at = math.log10(value) if self._axis.log else value
        return self._start + (at - self._low) / (self._high - self._low) * (self._end - self._start)


def _log_ticks(low: float, high: float) -> list[float]:
    """Powers of ten between exponents; with few of them also 2 and 5 times."""
    steps = (1, 2, 5) if high - low < 2.5 else (1,)
    every = 1 if high - low < 7 else 2
    powers = range(math.floor(low), math.ceil(high) + 1)
    return [
        step * 10.0**power
        for power in powers
        if power % every == 0
        for step in steps
        if low <= math.log10(step * 10.0**power) <= high
    ]


def _step(span: float) -> float:
    """About five steps over a span, each 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(span / 5))
    return next(step * power for step in (1, 2, 5, 10) if span / (step * power) <= 6)


def _fits(point: tuple[float, float], x: Axis, y: Axis) -> bool:
    return all(math.isfinite(value) for value in point) and not (
        (x.log and point[0] <= 0) or (y.log and point[1] <= 0)
    )


def _notes(line: Series) -> Sequence[str]:
    return [f" · {note}" for note in line.notes] if line.notes else [""] * len(line.points)


def _number(value: float, axis: Axis) -> str:
    if axis.percent:
        return f"{100 * value:.3g} %" if abs(value) < 10 else f"{100 * value:,.0f} %"
    if abs(value) < 1e-12:
        return "0"
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.0e}"
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
