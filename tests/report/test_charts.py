"""Marks stand where the numbers say."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from naris.report import ReportData, TrainingCurve, charts
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
    from dataclasses import replace

    curve = TrainingCurve(3, np.array([2.0, np.nan, 0.01, np.inf]), 1.0, 1.0)
    chart = charts.loss_chart(replace(reproduce_data.networks[0], training=(curve,)))
    (line,) = drawn(chart).iter("polyline")
    assert len((line.get("points") or "").split()) == 2
    assert "nan" not in (line.get("points") or "")


@given(st.text(max_size=40))
def test_text_is_escaped_and_markup_is_not(text: str) -> None:
    made = element("p", text, Markup("<b>x</b>"), title=text)
    assert re.fullmatch(r'<p title="[^"<>]*">[^<>]*<b>x</b></p>', made, re.DOTALL)
    assert join(text, None, [Markup("<i/>")]).endswith("<i/>")


def test_attributes() -> None:
    assert element("line", x1=0.1, class_="a", stroke_width=2, hidden=True, alt=None) == (
        '<line x1="0.1" class="a" stroke-width="2" hidden/>'
    )
