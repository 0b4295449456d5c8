"""Cuts and views of an anatomy: they show what is there, where it is."""

from __future__ import annotations

import numpy as np

from naris.airway.block import Block
from naris.core.anatomy import Passage
from naris.report.anatomy_page import anatomy_page
from naris.report.anatomy_sheet import SHARES, cuts, view_places, views_down
from naris.report.pictures import region_colours
from tests.winding_tube import RADIUS_MM, SLABS, winding_tube

CONTOUR = np.array([255, 90, 40])


def test_a_cut_has_the_wall_where_it_is_and_the_regions_inside() -> None:
    """The coronal cut of a tube along y is about a circle."""
    _, coronal, sagittal = cuts(winding_tube(), SLABS)
    is_wall = np.abs(coronal.image.astype(int) - CONTOUR).sum(axis=2) < 60
    rows, columns = np.nonzero(is_wall)
    assert abs(np.ptp(columns) * 0.2 - 2 * RADIUS_MM) < 1.0
    assert abs(np.ptp(rows) * 0.2 - 2 * RADIUS_MM) < 1.5
    # From front to back the four regions follow each other, the first on the left.
    colours = region_colours(SLABS.names).astype(int)
    tinted = 0.25 * 40 + 0.75 * colours
    seen = []
    for k in range(4):
        of_region = np.abs(sagittal.image.astype(int) - tinted[k]).sum(axis=2) < 20
        assert of_region.sum() > 1000
        seen.append(np.nonzero(of_region)[1].mean())
    assert seen == sorted(seen)


def test_behind_a_cut_lies_the_scan_it_was_found_in() -> None:
    """A bright corner of the scan, up, at the back and on the left, is up and on the right in all cuts that show it."""
    low, high = winding_tube().bounds_mm
    shape = tuple(int(n) for n in np.ceil((high - low) / 1.0) + 30)
    hu = np.full(shape, -200, np.float32)
    middle = [n // 2 for n in shape]
    hu[middle[0] :, middle[1] :, middle[2] :] = 600
    axial, coronal, sagittal = cuts(winding_tube(), SLABS, Block(hu, low - 15, 1.0))
    for cut, rows in ((coronal, slice(0, 20)), (sagittal, slice(0, 20)), (axial, slice(-20, None))):
        strip = cut.image[rows].astype(float).mean(axis=(0, 2))
        assert strip[-20:].mean() > strip[:20].mean() + 30, cut.name
    assert coronal.image[:20, -20:].mean() > coronal.image[-20:, -20:].mean() + 30


def test_a_passage_of_a_few_points_has_its_views_too() -> None:
    tube = winding_tube()
    short = Passage("short", tube.passages[0].points_mm[70:75], np.full(5, 5.0))
    (down,) = views_down(tube.with_(passages=(short,)))
    assert len(down.images) == len(SHARES)


def test_four_views_down_a_passage_show_something() -> None:
    (down,) = views_down(winding_tube())
    assert down.passage == "main"
    assert len(down.captions) == len(down.images) == len(SHARES)
    far = [float(caption.split()[0]) for caption in down.captions]
    assert far == sorted(far)
    for image in down.images:
        assert image.std() > 10
        red, _, blue = image.reshape(-1, 3).mean(axis=0)
        assert red > 1.2 * blue


def test_views_lie_closer_where_it_is_narrow() -> None:
    """Four in a way of 60 mm whose middle third is narrow: two of them are there, none next to another."""
    along_mm = np.arange(61.0)
    clearance_mm = np.where((along_mm > 20) & (along_mm < 40), 1.0, 4.0)
    places = view_places(Passage("way", along_mm[:, None] * [0, 1, 0], clearance_mm))
    assert places == sorted(places)
    assert sum(20 < place < 40 for place in places) >= 2
    assert np.diff(places).min() > 4


def test_a_branch_is_looked_down_where_it_runs_alone() -> None:
    along_mm = np.arange(61.0)
    trunk = Passage("trunk", along_mm[:, None] * [0, 1, 0], np.full(61, 3.0))
    aside_mm = np.maximum(along_mm - 30, 0)
    branch = Passage("branch", np.stack([aside_mm, along_mm, 0 * along_mm], axis=1), np.full(61, 3.0))
    assert min(view_places(branch, [trunk])) > 31
    assert np.diff(view_places(branch, [trunk])).min() > 4
    assert view_places(trunk, [trunk]) == view_places(trunk)  # what has no way of its own is shown whole


def test_the_page_holds_all_of_it() -> None:
    page = anatomy_page(winding_tube(), "slabs", {"from": "a test"})
    for said in ("axial, z =", "coronal, y =", "sagittal, x =", "Down each passage", "air dark, tissue grey"):
        assert said in page
    assert page.count("data:image/webp") >= 3 + len(SHARES)
