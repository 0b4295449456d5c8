"""The charts of the report, each from the data alone, each with words for those who cannot see it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from naris.anatomy.shape_curves import ShapeCurves
from naris.report.data import NEIGHBOUR_DEG, NEIGHBOUR_MM, NetworkResult, Published, ReportData, Split
from naris.report.markup import Markup, element, join
from naris.report.plot import SHARE, Axes, Scale, drawing, label, legend, per_cent
from naris.report.scores import Calibration, PoseErrors, TestResult

_WIDTH, _GAP, _GROUP_GAP, _GROUP_LEAST = 960, 14, 44, 150
_MARGIN = (64, 26, 96, 54)
_STEEP = 10
_MANY_POINTS = 40
FEW = 5
"""A share of fewer pictures says little."""


def series(data: ReportData, split: str) -> str:
    """The style class of a split: leaky ones have the first colour, clean ones the others in order."""
    clean = [s.key for s in data.splits if not s.leaky]
    return f"s{clean.index(split) + 1}" if split in clean else "s0"


def accuracy_bars(data: ReportData) -> Markup:
    """Accuracy of every network on every split: mean, interval, every run, chance, and the published figure."""
    groups = [(network, network.tests) for network in data.networks if network.tests]
    count = sum(len(tests) for _, tests in groups)
    room_px = _WIDTH - _MARGIN[0] - _MARGIN[2]
    bar = float(np.clip((room_px - _GROUP_GAP * len(groups)) / max(count, 1) - _GAP, 26, 64))
    inner = [len(tests) * (bar + _GAP) - _GAP for _, tests in groups]
    width = math.ceil(sum(max(w, _GROUP_LEAST) for w in inner) + _GROUP_GAP * len(groups))
    none = Scale(0, width, ())
    axes = Axes(width + _MARGIN[0] + _MARGIN[2], 380, none, SHARE, margin=_MARGIN)
    under = axes.height - _MARGIN[3]
    marks: list[Markup] = []
    if data.published:
        marks += _published_band(axes, data.published, none.high)
    at = _GROUP_GAP / 2
    for (network, tests), w in zip(groups, inner, strict=True):
        room = max(w, _GROUP_LEAST)
        for i, test in enumerate(tests):
            marks += _bar(axes, at + (room - w) / 2 + i * (bar + _GAP), bar, test, series(data, test.split))
        middle = axes.x_px(at + room / 2)
        marks.append(label(middle, under + 21, network.label, class_="group"))
        runs = len(tests[0].runs)
        marks.append(label(middle, under + 39, f"{runs} run{'s' * (runs > 1)}"))
        at += room + _GROUP_GAP
    alt = "Accuracy: " + "; ".join(
        f"{n.label}, {data.split(t.split).label} {per_cent(t.mean)}" for n, ts in groups for t in ts
    )
    used = [split for split in data.splits if any(n.test(split.key) for n in data.networks)]
    entries = [(series(data, split.key), split.label) for split in used]
    extra = [("whisker", "95\u00a0% interval"), ("chance", "always the commonest region")]
    if any(len(test.runs) > 1 for _, tests in groups for test in tests):
        extra.insert(1, ("run", "one run"))
    return join(axes.draw(alt, marks), legend(entries + extra))


def _published_band(axes: Axes, published: Published, right: float) -> list[Markup]:
    low, high = published.accuracy - published.std, published.accuracy + published.std
    x, y = axes.x_px(right) + 6, axes.y_px(published.accuracy)
    return [
        axes.box(0, right, low, high, "band"),
        axes.line(0, published.accuracy, right, published.accuracy, "rule"),
        label(x, y - 3, "published", "start"),
        label(x, y + 12, f"{100 * published.accuracy:.1f} ± {100 * published.std:.1f} %", "start"),
    ]


def _bar(axes: Axes, x: float, width: float, test: TestResult, class_: str) -> list[Markup]:
    """A bar, its chance line, the runs as dots on its left part and the interval on its right."""
    marks = [axes.box(x, x + width, 0, test.mean, f"bar {class_}")]
    marks.append(axes.line(x, test.chance, x + width, test.chance, "chance"))
    top, edge = test.mean, x + 0.84 * width
    if test.interval:
        low, high = test.interval
        marks.append(axes.line(edge, low, edge, high, "whisker"))
        marks += [axes.line(edge - 4, end, edge + 4, end, "whisker") for end in (low, high)]
        top = max(top, high)
    if len(test.runs) > 1:
        places = x + width * np.linspace(0.14, 0.64, len(test.runs))
        marks += [axes.dots(places, test.accuracies, class_, radius=r) for class_, r in (("run", 3.4), ("run-core", 2))]
        top = max(top, float(test.accuracies.max()))
    middle = axes.x_px(x + width / 2)
    return [*marks, label(middle, axes.y_px(top) - 8, f"{100 * test.mean:.1f}", class_="value")]


def loss_chart(network: NetworkResult) -> Markup:
    """The training loss of every run of a network; logarithmic where it falls over more than a factor of ten."""
    losses = np.concatenate([run.loss for run in network.training])
    finite = losses[np.isfinite(losses) & (losses > 0)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.1, 1.0)
    steep = high / low > _STEEP
    y = Scale.logarithmic(low / 1.2, high * 1.2, "loss") if steep else Scale.linear(0, high, "loss")
    longest = max(len(run.loss) for run in network.training)
    each, unit = _each_point(network.step)
    x = Scale.linear(0, each * max(longest, 2), unit, count=min(5, max(longest, 2)))
    axes = Axes(310, 230, x, y)
    marks = []
    for i, run in enumerate(network.training):
        good = np.isfinite(run.loss)
        at, loss = each * (1.0 + np.nonzero(good)[0]), run.loss[good]
        marks.append(axes.curve(at, loss, f"q{i % 5}"))
        if len(loss) <= _MANY_POINTS:  # a line through one point is not to be seen
            marks.append(axes.dots(at, loss, f"q{i % 5}", radius=2.5))
    ends = ", ".join(f"{run.loss[-1]:.3g}" for run in network.training if len(run.loss))
    alt = f"Training loss of {network.label} against {network.step}; it ends at {ends}"
    entries = [(f"q{i % 5}", f"seed {run.seed}") for i, run in enumerate(network.training)]
    return join(axes.draw(alt, marks), legend(entries))


def _each_point(step: str) -> tuple[int, str]:
    """What one point stands for, as a number and its unit: `20 steps` are 20 of them, an `epoch` is one."""
    count, _, unit = step.partition(" ")
    return (int(count), unit) if count.isdecimal() and unit else (1, step)


def confusion_chart(
    counts: Int[np.ndarray, "k k"], neighbours: Bool[np.ndarray, "k k"], names: Sequence[str], small: bool = False
) -> Markup:
    """A confusion matrix: true region by row, answer by column, shade by share of the row.

    Right answers, errors between neighbours and errors between non-neighbours have colours of their own. The large one
    writes per cent of the row, the small one counts.
    """
    k = len(counts)
    cell = 24 if small else (58 if k <= 4 else 34)
    left, top = (2, 2) if small else (26, 26)
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    marks = []
    for i, j in np.ndindex(k, k):
        kind = "right" if i == j else ("near" if neighbours[i, j] else "far")
        x, y = left + j * cell, top + i * cell
        marks.append(element("rect", x=x, y=y, width=cell - 1, height=cell - 1, class_="cell"))
        if counts[i, j]:
            shade = 0.12 + 0.88 * float(share[i, j])
            box = element("rect", x=x, y=y, width=cell - 1, height=cell - 1, class_=kind, fill_opacity=round(shade, 3))
            text = f"{counts[i, j]}" if small else f"{100 * share[i, j]:.0f}"
            tone = "strong" if shade > 0.55 else None
            marks += [box, label(x + cell / 2 - 0.5, y + cell / 2 + 4, text, class_=tone)]
    if not small:
        marks += [label(left + i * cell + cell / 2, top - 9, str(i + 1)) for i in range(k)]
        marks += [label(left - 12, top + i * cell + cell / 2 + 4, str(i + 1)) for i in range(k)]
    size = left + k * cell + 1
    worst = [f"{names[i]} as {names[j]} {per_cent(share[i, j])}" for i, j in _worst(share)]
    alt = f"Confusion matrix, {per_cent(np.trace(counts) / counts.sum())} right"
    alt += f"; most confused: {', '.join(worst)}" if worst and not small else ""
    return drawing(size, top + k * cell + 1, alt, join(marks), "chart matrix" + (" small" if small else ""))


def _worst(share: Float[np.ndarray, "k k"], most: int = 2) -> list[tuple[int, int]]:
    off = np.where(np.eye(len(share), dtype=bool), 0, share)
    order = np.argsort(off, axis=None)[::-1][:most]
    pairs = [divmod(int(flat), len(share)) for flat in order]
    return [(i, j) for i, j in pairs if off[i, j] > 0]


def calibration_chart(entries: Sequence[tuple[str, str, Calibration]]) -> Markup:
    """How often the answer is right against how sure the network is; entries are (style class, label, calibration)."""
    x = Scale(0, 1, SHARE.ticks, "how sure the network is", form=per_cent)
    y = Scale(0, 1, SHARE.ticks, "how often it is right", form=per_cent)
    axes = Axes(310, 300, x, y, margin=(58, 14, 24, 44))
    marks = [axes.line(0, 0, 1, 1, "rule")]
    for class_, _, calibration in entries:
        used = calibration.count > 0
        confidence, accuracy = calibration.confidence[used], calibration.accuracy[used]
        many = calibration.count[used] >= FEW
        marks.append(axes.curve(confidence[many], accuracy[many], class_))
        weight = np.sqrt(calibration.count[used] / calibration.count.sum())
        for c, a, w in zip(confidence, accuracy, weight, strict=True):
            marks.append(axes.dots(np.array([c]), np.array([a]), class_, radius=2 + 7 * float(w)))
    alt = "Calibration: " + "; ".join(f"{name}, expected calibration error {c.ece:.2f}" for _, name, c in entries)
    return join(axes.draw(alt, marks), legend([(c, f"{name}: ECE {cal.ece:.3f}") for c, name, cal in entries]))


def pose_charts(entries: Sequence[tuple[str, str, PoseErrors]]) -> Markup:
    """The share of test pictures whose camera is found within so many mm, and within so many degrees."""
    drawn = []
    for unit, most, field in (("mm", 20.0, "position_mm"), ("degrees", 60.0, "rotation_deg")):
        x = Scale.linear(0, most, f"error of the {'position (mm)' if unit == 'mm' else 'orientation (degrees)'}", 4)
        axes = Axes(360, 250, x, Scale(0, 1, SHARE.ticks, "share of pictures", form=per_cent), margin=(58, 14, 18, 44))
        marks, words = [], []
        for class_, name, errors in entries:
            values = np.sort(getattr(errors, field))
            shown = np.linspace(0, most, 121)
            marks.append(axes.curve(shown, np.searchsorted(values, shown, side="right") / len(values), class_))
            words.append(f"{name}, median {np.median(values):.1f} {unit}")
        drawn.append(axes.draw(f"Cumulative pose error in {unit}: " + "; ".join(words), marks))
    return join(element("div", drawn, class_="row"), legend([(class_, name) for class_, name, _ in entries]))


def shape_curve_charts(curves: ShapeCurves) -> Markup:
    """Compactness, generalisation and specificity of a shape model against the number of its modes."""
    most = len(curves.compactness) - 1
    modes = Scale.linear(0, max(most, 1), "modes", count=min(5, max(most, 1)))
    farthest = float(max(curves.generalisation_mm.max(), curves.specificity_mm.max(), 1e-3))
    drawn = []
    for name, scale, values, form in (
        ("compactness", Scale(0, 1, SHARE.ticks, "compactness", form=per_cent), curves.compactness, per_cent),
        ("generalisation", Scale.linear(0, farthest, "generalisation (mm)"), curves.generalisation_mm, _mm),
        ("specificity", Scale.linear(0, farthest, "specificity (mm)"), curves.specificity_mm, _mm),
    ):
        axes = Axes(310, 250, modes, scale, margin=(58, 14, 18, 44))
        at = np.arange(len(values), dtype=np.float64)
        marks = [axes.curve(at, values, "q0")]
        if len(at) <= _MANY_POINTS:
            marks.append(axes.dots(at, values, "q0", radius=2.5))
        said = f"{form(values[0])} without modes, {form(values[-1])} with {len(values) - 1}"
        drawn.append(axes.draw(f"{name.capitalize()} against the number of modes: {said}", marks))
    return element("div", drawn, class_="row")


def _mm(value: float) -> str:
    return f"{value:.2f} mm"


def neighbour_chart(data: ReportData, splits: Sequence[Split]) -> Markup:
    """How far every test view lies from its nearest training view, in mm and in degrees."""
    mm = [split.nearest_mm for split in splits if split.nearest_mm is not None]
    deg = [split.nearest_deg for split in splits if split.nearest_deg is not None]
    x = Scale.linear(0, max(4.0, float(np.concatenate(mm).max())), "distance to the nearest training view (mm)")
    y = Scale.linear(0, max(30.0, float(np.concatenate(deg).max())), "angle between the two (degrees)")
    axes = Axes(560, 340, x, y, margin=(58, 14, 14, 44))
    marks = [axes.box(0, NEIGHBOUR_MM, 0, NEIGHBOUR_DEG, "band")]
    words, entries = [], []
    for i, (split, across, turn) in enumerate(zip(splits, mm, deg, strict=True)):
        words.append(f"{split.label}, median {np.median(across):.2g} mm and {np.median(turn):.2g} degrees")
        same = [k for k in range(i) if np.array_equal(mm[k], across) and np.array_equal(deg[k], turn)]
        if same:
            first = splits[same[0]]
            entries.append((series(data, first.key), f"{split.label} (the poses of {first.label})"))
            continue
        marks.append(axes.dots(across, turn, f"{series(data, split.key)} faint", radius=3.2))
        entries.append((series(data, split.key), split.label))
    alt = "Distance of test views to their nearest training view: " + "; ".join(words)
    within = f"within {NEIGHBOUR_MM:g} mm and {NEIGHBOUR_DEG:g}°: a neighbour"
    return join(axes.draw(alt, marks), legend([*entries, ("band", within)]))


def confusion_legend() -> Markup:
    """What the three colours of the confusion matrices mean."""
    return legend([("right", "right"), ("near", "a neighbouring region"), ("far", "a region that does not touch")])
