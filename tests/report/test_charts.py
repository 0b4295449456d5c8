"""Marks stand where the numbers say."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from naris.anatomy.shape_curves import ShapeCurves
from naris.report import Calibration, ReportData, TrainingCurve, charts
from naris.report.markup import Markup, element, join
from naris.report.plot import SHARE, Axes, Scale

spans = st.tuples(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4)).map(lambda pair: (pair[0], pair[0] + pair[1]))


def drawn(markup: str, which: int = 0) -> ElementTree.Element:
    root = ElementTree.fromstring("<div>" + re.sub(r' xmlns="[^"]*"', "", markup) + "</div>")
    return list(root.iter("svg"))[which]


@given(spans)
def test_linear_scales_hold_what_they_were_made_for(span: tuple[float, float]) -> None:
    low, high = span
    scale = Scale.linear(low, high, "")
    tolerance = 1e-6 * (high - low) + 1e-9
    assert scale.low <= low + tolerance
    assert scale.high >= high - tolerance
    assert 2 <= len(scale.ticks) <= 9
    steps = np.diff(scale.ticks)
    assert steps == pytest.approx(steps[0], rel=1e-3)
    at = scale.at(np.array([scale.low, scale.high]))
    assert at == pytest.approx([0, 1])


@given(st.floats(1e-4, 10), st.floats(1.5, 1e4))
def test_logarithmic_scales_are_even_in_ratios(low: float, factor: float) -> None:
    scale = Scale.logarithmic(low, low * factor, "")
    assert all(low <= tick <= low * factor for tick in scale.ticks)
    assert scale.at(np.array([low * np.sqrt(factor)]))[0] == pytest.approx(0.5)
    assert len(scale.ticks) <= 9
    assert len(scale.ticks) >= 3 or factor < 10


def test_beyond_the_ends_is_drawn_at_the_ends() -> None:
    axes = Axes(100, 100, SHARE, SHARE, margin=(10, 10, 10, 10))
    assert axes.places(np.array([-1.0, 2.0]), np.array([-1.0, 2.0])).tolist() == [[10, 90], [90, 10]]


def test_bars_are_as_high_as_accuracies(reproduce_data: ReportData) -> None:
    chart = drawn(charts.accuracy_bars(reproduce_data))
    bars = [bar for bar in chart.iter("rect") if "bar" in bar.get("class", "").split()]
    tests = [test for network in reproduce_data.networks for test in network.tests]
    heights = np.array([float(bar.get("height", "nan")) for bar in bars])
    means = np.array([test.mean for test in tests])
    assert len(bars) == len(tests)
    assert heights / heights[0] == pytest.approx(means / means[0], abs=2e-3)
    values = [text.text for text in chart.iter("text") if text.get("class") == "value"]
    assert values == [f"{100 * mean:.1f}" for mean in means]


def test_leaky_and_clean_have_colours_of_their_own(reproduce_data: ReportData) -> None:
    chart = drawn(charts.accuracy_bars(reproduce_data))
    kinds = [bar.get("class", "").split()[1] for bar in chart.iter("rect") if "bar" in bar.get("class", "").split()]
    assert kinds == ["s0", "s1", "s2", "s0", "s1", "s2", "s2"]


def test_cells_are_as_dark_as_their_share(reproduce_data: ReportData) -> None:
    regions = reproduce_data.anatomy.regions
    counts = np.array([[8, 2, 0, 0], [0, 10, 0, 0], [5, 0, 5, 0], [0, 0, 0, 10]])
    chart = drawn(charts.confusion_chart(counts, regions.neighbours, regions.names))
    cells = [cell for cell in chart.iter("rect") if cell.get("fill-opacity")]
    kinds = [(cell.get("class"), float(cell.get("fill-opacity", "nan"))) for cell in cells]
    assert [kind for kind, _ in kinds] == ["right", "near", "right", "far", "right", "right"]
    assert kinds[1][1] < kinds[3][1] < kinds[0][1] < kinds[2][1] == 1.0
    written = [text.text for text in chart.iter("text")][: len(cells)]
    assert written == ["80", "20", "100", "50", "50", "100"]
    assert "slab 3 as slab 1 (anterior) 50 %" in chart.get("aria-label", "")


def test_cumulative_curves_end_at_the_share_within(reproduce_data: ReportData) -> None:
    pose = reproduce_data.networks[1].tests[0].pose
    assert pose is not None
    chart = drawn(charts.pose_charts([("s0", "one", pose)]))
    (curve,) = (line for line in chart.iter("polyline"))
    last = float((curve.get("points") or "").split()[-1].split(",")[1])
    axes = Axes(360, 250, Scale.linear(0, 20.0, "", 4), SHARE, margin=(58, 14, 18, 44))
    assert last == pytest.approx(axes.y_px(float((pose.position_mm <= 20).mean())), abs=0.02)


def test_losses_that_break_are_drawn_as_far_as_they_are_numbers(reproduce_data: ReportData) -> None:
    curve = TrainingCurve(3, np.array([2.0, np.nan, 0.01, np.inf]), 1.0, 1.0)
    chart = charts.loss_chart(replace(reproduce_data.networks[0], training=(curve,)))
    (line,) = drawn(chart).iter("polyline")
    assert len((line.get("points") or "").split()) == 2
    assert "nan" not in (line.get("points") or "")


def test_a_training_of_one_value_is_a_mark_not_an_empty_chart(reproduce_data: ReportData) -> None:
    curve = TrainingCurve(3, np.array([0.76]), 1.0, 1.0)
    short = replace(reproduce_data.networks[0], training=(curve,), step="100 steps")
    chart = drawn(charts.loss_chart(short))
    (dot,) = (path for path in chart.iter("path") if "dots" in path.get("class", ""))
    assert len(re.findall("M", dot.get("d", ""))) == 1
    assert {"100", "steps"} <= {text.text for text in chart.iter("text")}


def test_long_curves_have_no_marks(reproduce_data: ReportData) -> None:
    long = TrainingCurve(3, np.linspace(1, 0.5, 300), 1.0, 1.0)
    chart = drawn(charts.loss_chart(replace(reproduce_data.networks[0], training=(long,))))
    assert len(list(chart.iter("polyline"))) == 1
    assert not list(chart.iter("path"))


def test_splits_of_the_same_poses_share_their_dots(reproduce_data: ReportData) -> None:
    published, unseen, other = reproduce_data.splits
    alike = replace(other, nearest_mm=unseen.nearest_mm, nearest_deg=unseen.nearest_deg)
    for last, sets in ((other, 3), (alike, 2)):
        chart = charts.neighbour_chart(reproduce_data, [published, unseen, last])
        assert len(list(drawn(chart).iter("path"))) == sets
        assert ("the poses of unseen trajectories" in chart) == (last is alike)


def test_shares_of_few_pictures_are_dots_alone() -> None:
    calibration = Calibration(np.array([0.3, 0.6, 0.9]), np.array([1.0, 0.5, 0.9]), np.array([1, 10, 40]))
    chart = drawn(charts.calibration_chart([("s0", "one", calibration)]))
    (line,) = chart.iter("polyline")
    assert len((line.get("points") or "").split()) == 2
    assert len(list(chart.iter("path"))) == 3


@given(st.text(max_size=40))
def test_text_is_escaped_and_markup_is_not(text: str) -> None:
    made = element("p", text, Markup("<b>x</b>"), title=text)
    assert re.fullmatch(r'<p title="[^"<>]*">[^<>]*<b>x</b></p>', made, re.DOTALL)
    assert join(text, None, [Markup("<i/>")]).endswith("<i/>")


def test_attributes() -> None:
    assert element("line", x1=0.1, class_="a", stroke_width=2, hidden=True, alt=None) == (
        '<line x1="0.1" class="a" stroke-width="2" hidden/>'
    )


def test_curves_of_a_shape_model_begin_without_modes_and_fall_on_common_axes() -> None:
    curves = ShapeCurves(np.array([0.0, 0.7, 1.0]), np.array([2.0, 0.5]), np.array([1.0, 1.5, 1.6]))
    markup = charts.shape_curve_charts(curves)
    lines = [next(iter(drawn(markup, k).iter("polyline"))).get("points", "") for k in range(3)]
    heights = [[float(point.split(",")[1]) for point in line.split()] for line in lines]
    assert [len(line) for line in heights] == [3, 2, 3]
    assert heights[0] == sorted(heights[0], reverse=True)
    assert heights[1] == sorted(heights[1])
    # Both distances are drawn to one scale: 2 mm stands higher than 1.6 mm.
    assert heights[1][0] < heights[2][2] < heights[2][0] < heights[1][1]
    assert "0.50 mm with 1" in markup
