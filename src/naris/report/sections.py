"""The sections of the page, each from the data, each None where the data have nothing for it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool

from naris.report import charts, words
from naris.report.anatomy_figure import anatomy_caption, anatomy_figure
from naris.report.data import LocatedFrame, ReportData, Split
from naris.report.markup import Child, Markup, element, figure, join, table
from naris.report.pictures import css_colour, picture, region_colours
from naris.report.scores import TestResult

_MAX_VIEWS = 6
_MAX_LOCATED = 24
_FEW_REGIONS = 6
_MACHINE = {"memory_gib": "memory, GiB"}


def anatomy(data: ReportData) -> Markup:
    """The anatomy with its regions, and where the cameras went."""
    view = data.anatomy
    low, high = view.anatomy.bounds_mm
    size = " × ".join(f"{extent:.0f}" for extent in high - low)
    facts = (
        f"{view.anatomy.name}: {len(view.anatomy.faces):,} triangles, {size} mm, frame "
        f"{view.anatomy.frame}, SHA-256 {view.anatomy.digest[:12]}…. Source: {view.anatomy.source}."
    )
    return join(figure(anatomy_figure(view), anatomy_caption(view), "wide"), element("p", facts, class_="small"))


def views(data: ReportData) -> Markup | None:
    """Example pictures of every region."""
    if not data.views:
        return None
    names = data.anatomy.regions.names
    colours = region_colours(names)
    sets = []
    for views in data.views:
        rows = []
        for name, colour, images in zip(names, colours, views.images, strict=True):
            shown = [picture(image, f"View in {name}", 220) for image in images[:_MAX_VIEWS]]
            heading = element("h4", element("i", class_="swatch", style=f"background:{css_colour(colour)}"), name)
            rows.append(element("div", heading, element("div", shown or "no view", class_="strip"), class_="views"))
        sets.append(join(element("h3", views.title), figure(rows, views.caption, "wide")))
    return join(sets)


def splits(data: ReportData) -> Markup:
    """How the test pictures were chosen, and how near they lie to those of the training."""
    rows = []
    for split in data.splits:
        near = "–"
        if split.nearest_mm is not None and split.nearest_deg is not None:
            near = f"{np.median(split.nearest_mm):.1f} mm, {np.median(split.nearest_deg):.1f}°"
        kind = element("span", "leaky" if split.leaky else "clean", class_="tag " + ("bad" if split.leaky else "good"))
        rows.append([join(split.label, " ", kind), split.explanation, f"{split.count:,}", near])
    parts = [table(["Split", "Test views", "Pictures", "Nearest training view (median)"], rows, "prose")]
    if any(split.leaky for split in data.splits):
        told = "Leaky: the test views lie among the training views, and remembering these helps. Clean: they do not."
        parts.append(element("p", told, class_="small"))
    known = [split for split in data.splits if split.nearest_mm is not None and split.nearest_deg is not None]
    if known:
        caption = (
            "Every dot is a test view; splits with the same poses share their dots. Inside the shaded corner it has a "
            "training view within 2 mm and 15°: a network that only remembers can answer there."
        )
        parts.append(figure(charts.neighbour_chart(data, known), caption))
    pairs = [_pair(split) for split in data.splits if split.pair]
    if pairs:
        caption = "For each split a typical test view and the training view that stands nearest to it."
        parts.append(figure(element("div", pairs, class_="row"), caption))
    return join(parts)


def _pair(split: Split) -> Markup | None:
    pair = split.pair
    if pair is None:
        return None
    apart = f"{pair.distance_mm:.1f} mm and {pair.angle_deg:.1f}° apart"
    both = [
        element("div", picture(image, f"{what}, {split.label}", 300), element("span", what), class_="labelled")
        for image, what in ((pair.test, "test view"), (pair.training, "nearest training view"))
    ]
    return element("div", element("h4", split.label), element("div", both, class_="pair"), element("p", apart))


def results(data: ReportData) -> Markup:
    """The accuracies as a chart and as a table beside the published figure."""
    head = ["Network", "Split", "Accuracy", "95 % interval", "Chance", "Errors between non-neighbours", "ECE", "Runs"]
    rows: list[list[Child]] = []
    if data.published:
        known = data.published
        figures: list[Child] = [words.spread(known.accuracy, known.std), "–", "–", "almost none", "–"]
        rows.append(["published", "as published", *figures, str(known.runs)])
    neighbours = data.anatomy.regions.neighbours
    for network in data.networks:
        for test in network.tests:
            interval = "–" if not test.interval else f"{100 * test.interval[0]:.1f}–{100 * test.interval[1]:.1f}\u00a0%"
            calibration = test.calibration
            rows.append(
                [
                    network.label,
                    data.split(test.split).label,
                    element("b", words.spread(test.mean, test.std)),
                    interval,
                    words.share(test.chance),
                    _far_errors(test, neighbours),
                    "–" if calibration is None else f"{calibration.ece:.3f}",
                    str(len(test.runs)),
                ]
            )
    note = (
        "Accuracy: share of test pictures whose region is named rightly, mean ± standard deviation between runs. "
        "Interval: of the mean, by bootstrap over runs and camera positions, all views of a position together. Chance: "
        "always naming the commonest region of the "
        "test set. Errors between non-neighbours: share of the wrong answers that name a region which does not touch "
        "the true one. ECE: expected calibration error, 0 is perfect."
    )
    both = ", leaky and clean side by side" if any(split.leaky for split in data.splits) else ""
    band = " The band is the published figure." if data.published else ""
    caption = f"Share of test pictures whose region is named rightly{both}.{band}"
    return join(
        figure(charts.accuracy_bars(data), caption, "wide"), table(head, rows), element("p", note, class_="small")
    )


def _far_errors(test: TestResult, neighbours: Bool[np.ndarray, "k k"]) -> str:
    far = test.nonneighbour_error(neighbours)
    return "none wrong" if far is None else f"{words.share(far)} of {test.wrong:,}"


def confusions(data: ReportData) -> Markup:
    """The confusion matrices of all runs together and of every run."""
    names, neighbours = data.anatomy.regions.names, data.anatomy.regions.neighbours
    parts: list[Child] = [
        element("p", "Regions in order: ", _numbered(names), "."),
        charts.confusion_legend(),
    ]
    for network in data.networks:
        columns = []
        for test in network.tests:
            every = [
                element(
                    "div",
                    charts.confusion_chart(run.confusion, neighbours, names, small=True),
                    f"seed {run.seed}: {words.share(run.accuracy)}",
                )
                for run in test.runs
            ]
            mean = charts.confusion_chart(test.confusion, neighbours, names)
            title = f"{data.split(test.split).label}: {words.share(test.mean)}"
            small = element("div", every, class_="runs") if len(test.runs) > 1 else None
            columns.append(element("div", element("h4", title), mean, small, class_="confusion"))
        parts += [
            element("h3", network.label),
            element("div", columns, class_="thirds" if len(names) <= _FEW_REGIONS else "halves"),
        ]
    caption = (
        "Row: true region; column: answer. Large: per cent of the row over all runs; small, if there are several: "
        "pictures, run by run. Strength of colour: share of the row."
    )
    return figure(parts, caption, "wide")


def _numbered(names: tuple[str, ...]) -> str:
    return words.listed([f"{i + 1} {name}" for i, name in enumerate(names)])


def calibrations(data: ReportData) -> Markup | None:
    """Reliability diagrams, one a network."""
    drawn = []
    for network in data.networks:
        entries = [
            (charts.series(data, test.split), data.split(test.split).label, calibration)
            for test in network.tests
            if (calibration := test.calibration) is not None
        ]
        if entries:
            drawn.append(element("div", element("h4", network.label), charts.calibration_chart(entries)))
    if not drawn:
        return None
    caption = (
        "On the dashed diagonal, answers given with 80 % are right in 80 % of cases. Below it the network is too sure "
        f"of itself. Larger dots hold more pictures; those of fewer than {charts.FEW} say little and are not joined."
    )
    return figure(element("div", drawn, class_="row"), caption, "wide")


def poses(data: ReportData) -> Markup | None:
    """Errors of predicted camera poses."""
    parts, rows = [], []
    for network in data.networks:
        entries = [
            (charts.series(data, test.split), data.split(test.split).label, pose)
            for test in network.tests
            if (pose := test.pose) is not None
        ]
        if not entries:
            continue
        parts.append(join(element("h3", network.label), charts.pose_charts(entries)))
        for _, name, pose in entries:
            cells = [f"{pose.median_mm:.1f} mm", f"{np.percentile(pose.position_mm, 90):.1f} mm"]
            cells += [f"{pose.median_deg:.1f}°", f"{np.percentile(pose.rotation_deg, 90):.1f}°"]
            rows.append([network.label, name, *cells, words.share(pose.share_within(4, 15))])
    if not parts:
        return None
    head = [
        "Network",
        "Split",
        "Position, median",
        "90 % below",
        "Orientation, median",
        "90 % below",
        "≤ 4\u00a0mm and ≤\u00a015°",
    ]
    caption = "How large a share of all test pictures is found within a given error; nothing was left out."
    return join(figure(parts, caption, "wide"), table(head, rows))


def located(data: ReportData) -> Markup | None:
    """Pictures with the answer of the network."""
    if not data.located:
        return None
    shown = [_card(data, frame) for frame in data.located[:_MAX_LOCATED]]
    return figure(
        element("div", shown, class_="cards"),
        "What the network answers for single pictures: the bars are its probabilities; the true region is marked ✓.",
        "wide",
    )


def _card(data: ReportData, frame: LocatedFrame) -> Markup:
    prediction = frame.prediction
    colours = region_colours(prediction.region_names)
    bars = []
    for i, (name, probability) in enumerate(zip(prediction.region_names, prediction.probabilities, strict=True)):
        fill = element("i", style=f"width:{100 * float(probability):.1f}%;background:{css_colour(colours[i])}")
        mark = element("b", " ✓", title="the true region") if i == frame.truth else None
        bars.append(
            join(
                element("span", name, mark),
                element("span", fill, class_="meter"),
                element("span", f"{100 * float(probability):.0f} %", class_="number"),
            )
        )
    if not frame.localised:
        answer, kind = "not localised", "unsure"
    elif frame.truth is None:
        answer, kind = prediction.region_name, "plain"
    else:
        answer, kind = prediction.region_name, "good" if prediction.region == frame.truth else "bad"
    errors = []
    if frame.position_error_mm is not None:
        errors.append(f"{frame.position_error_mm:.1f} mm")
    if frame.rotation_error_deg is not None:
        errors.append(f"{frame.rotation_error_deg:.0f}°")
    off = element("p", f"Pose off by {' and '.join(errors)}", class_="small") if errors else None
    return element(
        "div",
        picture(frame.image, f"Picture {frame.name}", 300),
        element("h4", answer, class_=f"answer {kind}"),
        element("p", frame.name, class_="small"),
        element("div", bars, class_="bars"),
        off,
        class_="card",
    )


def training(data: ReportData) -> Markup | None:
    """Loss curves, and what each training cost."""
    drawn, rows = [], []
    for network in data.networks:
        if not network.training:
            continue
        short = words.short_training(network)
        said = element("p", short, class_="small") if short else None
        drawn.append(element("div", element("h4", network.label), charts.loss_chart(network), said))
        wall = np.array([run.wall_s for run in network.training])
        cpu = np.array([run.cpu_s for run in network.training])
        seeds = words.listed([str(run.seed) for run in network.training])
        pictures = "–" if network.pictures is None else f"{network.pictures:,}"
        cost = [words.seconds(float(wall.mean())), words.seconds(float(cpu.mean())), words.seconds(float(wall.sum()))]
        rows.append([network.label, f"{network.parameters:,}", pictures, seeds, *cost])
    if not drawn:
        return None
    head = ["Network", "Weights", "Pictures shown", "Seeds", "A run, wall", "A run, CPU", "All runs, wall"]
    regions = len(data.anatomy.regions.names)
    caption = (
        "Training loss of every run: the cross-entropy of the region, a mean for each point. A network that is always "
        f"right and sure has 0, one that thinks all {words.counted(regions)} regions equally likely has "
        f"{math.log(regions):.2f}."
    )
    return join(figure(element("div", drawn, class_="row"), caption, "wide"), table(head, rows))


def making(data: ReportData) -> Markup:
    """Settings, seeds, timings, machine and versions: enough to make the page again."""
    parts: list[Child] = [element("pre", element("code", data.command))]
    if data.stages:
        rows = [[s.name, s.made, *map(_spent, ([s.wall_s], [s.cpu_s]))] for s in data.stages]
        columns = [s.wall_s for s in data.stages], [s.cpu_s for s in data.stages]
        rows.append(["in all", "", *map(_spent, columns)])
        parts.append(table(["Stage", "Made", "Wall", "CPU, all threads"], rows, "prose"))
        parts.append(element("p", "Drawing this page comes after that, and is not counted.", class_="small"))
    facts: dict[str, Any] = {"seed": data.seed, "made": data.made, "commit": data.commit or "not known"}
    parts.append(
        _mapping(
            "Run", facts | {_MACHINE.get(key, key.replace("_", " ")): value for key, value in data.machine.items()}
        )
    )
    if data.versions:
        parts.append(_mapping("Versions", data.versions))
    parts += [_mapping(section, flat(values)) for section, values in data.settings.items()]
    return join(parts)


def _spent(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return words.seconds(sum(known)) if len(known) == len(values) else "not known"


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings with dotted names."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            found |= flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = value
    return found


def _mapping(title: str, values: Mapping[str, Any]) -> Markup:
    terms = [element("div", element("dt", key), element("dd", str(value))) for key, value in values.items()]
    return join(element("h3", title), element("dl", terms))


def headline(data: ReportData) -> Markup:
    """The main figures as tiles: published; leaky, clean and hardest of the first network; the hardest of others."""
    tiles = []
    if data.published:
        figure_ = words.spread(data.published.accuracy, data.published.std)
        tiles.append(_tile(figure_, "published", f"{data.published.runs} runs", "plain"))
    for network in data.networks:
        for test in words.main_tests(data, network):
            split = data.split(test.split)
            number, kind = words.spread(test.mean, test.std), "leaky" if split.leaky else "clean"
            tiles.append(_tile(number, network.label, split.label, kind))
    return element("div", tiles, class_="tiles")


def _tile(number: str, what: str, where: str, kind: str) -> Markup:
    return element("div", element("b", number), element("span", what), element("span", where), class_=f"tile {kind}")
