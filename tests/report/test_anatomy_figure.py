"""The figure of the anatomy, and a caption that speaks of what is in it and of nothing else."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from naris.core.anatomy import Passage, SlabRegions
from naris.report import AnatomyView, Line, ReportData
from naris.report.anatomy_figure import anatomy_caption, anatomy_figure
from naris.report.anatomy_page import anatomy_page

STEPS_MM = np.array([0.0, 1, 2, 3, 15, 16])


@pytest.fixture(scope="module")
def view(reproduce_data: ReportData) -> AnatomyView:
    return replace(reproduce_data.anatomy, lines=())


def way(role: str, y_mm: np.ndarray) -> Line:
    return Line("a way", role, np.stack([0 * y_mm, y_mm, 0 * y_mm], axis=1))  # type: ignore[arg-type]


def with_passage(view: AnatomyView) -> AnatomyView:
    y_mm = np.linspace(-30, 10, 20)
    one = Passage("only", np.stack([0 * y_mm, y_mm, 0 * y_mm], axis=1), np.linspace(0.954, 7, 20))
    return replace(view, anatomy=view.anatomy.with_(passages=(one,)))


def test_cameras_far_apart_are_not_joined(view: AnatomyView) -> None:
    """A straight line between them would lead through walls."""
    made = anatomy_figure(replace(view, lines=(way("test", STEPS_MM - 20),)))
    lines = re.findall(r'<polyline points="([^"]*)" class="way test"', made)
    spots = re.findall(r'<path d="([^"]*)" class="spot test"', made)
    assert len(lines) == 2 * 3  # from three sides
    assert [spot.count("M") for spot in spots] == [len(STEPS_MM)] * 3


def test_a_camera_alone_is_to_be_seen(view: AnatomyView) -> None:
    made = anatomy_figure(replace(view, lines=(way("training", np.zeros(1)),)))
    assert made.count('class="spot training"') == 3
    assert "polyline" not in made


def test_caption_speaks_of_what_is_there(view: AnatomyView) -> None:
    cameras, passages = replace(view, lines=(way("test", STEPS_MM),)), with_passage(view)
    nothing = anatomy_caption(view)
    assert "dot is a place" in anatomy_caption(cameras)
    assert "dashed" in anatomy_caption(passages)
    for absent in ("dot is a place", "dashed", "ticks", "lines are where"):
        assert absent not in nothing
    assert "dashed" not in anatomy_caption(cameras)


@pytest.mark.parametrize(("axis", "labelled"), [(0, "x = 1"), (1, "y = 1"), (2, None)])
def test_borders_are_told_where_they_are_drawn(view: AnatomyView, axis: int, labelled: str | None) -> None:
    slabs = SlabRegions("paper", ("a", "b"), "mean", axis, (1.0,))
    cut = replace(view, anatomy=view.anatomy.with_(regions={"paper": slabs}))
    made, caption = anatomy_figure(cut), anatomy_caption(cut)
    assert ("dotted" in caption) == ('class="border"' in made) == (labelled is not None)
    if labelled:
        assert made.count(f">{labelled}<") == 1
        assert f"stands their {labelled[0]} in mm" in caption


def test_sides_are_told_where_they_are_known(view: AnatomyView) -> None:
    assert "patient’s left is on the right" in anatomy_caption(replace(view, anatomy=view.anatomy.with_(frame="LPS")))
    assert "patient’s left" not in anatomy_caption(view)


def test_page_of_an_anatomy_has_the_caption_and_no_empty_headings(view: AnatomyView) -> None:
    shown = with_passage(view)
    made = anatomy_page(shown.anatomy, "paper", {"from": "a test"})
    assert f"<figcaption>{anatomy_caption(shown)}</figcaption>" in made
    assert '<th scope="col"></th>' not in made
    assert "0.95–7.00 mm" in made
