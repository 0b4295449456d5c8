"""Regions carried to another anatomy, on shapes where the right ones are known, and between noses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.builtin.variation import drawn_parameters
from naris.anatomy.distance import signed_distance
from naris.anatomy.transfer import LIKELY, Transfer, transfer_regions, virtual_references
from naris.core.anatomy import NOWHERE
from naris.errors import InputError, RegionError
from tests.anatomy.test_correspondence import bent, marked_tube, moved, turned_and_stretched
from tests.winding_tube import SLABS

OTHERS = replace(SLABS, borders_mm=(-39.0, -30.0, -10.0))
"""The same names with borders elsewhere: most of the tube is in another region."""


@pytest.fixture(scope="module")
def carried() -> Transfer:
    tube = marked_tube()
    bare = tube.with_(regions={})
    return transfer_regions(bare, [moved(tube, by).with_(regions={"slabs": SLABS}) for by in (turned, bent)])


def turned(points: np.ndarray) -> np.ndarray:
    """Nearly all of it across the slabs, whose borders are planes of y."""
    return turned_and_stretched(points) * [1, 0, 1] + points * [0, 1, 0]


def test_regions_end_where_they_should(carried: Transfer) -> None:
    line = marked_tube().passages[0].points_mm
    away = np.abs(line[:, 1:2] - np.array(SLABS.borders_mm)).min(axis=1) > 1.0
    assert (carried.regions.label(line) == SLABS.label(line))[away].mean() > 0.98
    assert carried.regions.names == SLABS.names
    assert carried.usable


def test_it_is_less_sure_near_a_border_and_knows_nothing_outside(carried: Transfer) -> None:
    line = marked_tube().passages[0].points_mm
    off = np.abs(line[:, 1:2] - np.array(SLABS.borders_mm)).min(axis=1)
    assert carried.sure_at(line[off < 0.6]).mean() < 0.75
    assert carried.sure_at(line[off > 5]).mean() > 0.95
    outside = np.array([[0.0, 0.0, 40.0], [400.0, 0, 0]])
    assert carried.sure_at(outside).tolist() == [0, 0]
    assert (carried.regions.label(outside) == NOWHERE).all()
    assert sum(fit.weight for fit in carried.fits) == pytest.approx(1)


def test_a_reference_that_does_not_fit_is_hardly_heard() -> None:
    """A tube with ripples, which no smooth map lays on an even one, and whose regions begin elsewhere."""
    tube = marked_tube()
    wrong = moved(tube, rippled).with_(regions={"slabs": replace(SLABS, borders_mm=(-5.0, 15.0, 35.0))})
    right = moved(tube, bent).with_(regions={"slabs": SLABS})
    both = transfer_regions(tube, [wrong, right])
    assert both.fits[1].weight > 0.9
    line = tube.passages[0].points_mm
    away = np.abs(line[:, 1:2] - np.array(SLABS.borders_mm)).min(axis=1) > 1.5
    assert (both.regions.label(line) == SLABS.label(line))[away].mean() > 0.98


def rippled(points: np.ndarray) -> np.ndarray:
    """Wider and narrower by two fifths every 6 mm."""
    y = points[..., 1:2]
    middle = np.concatenate([2 * np.cos(y / 20), y, 6 * np.sin(y / 18)], axis=-1)
    return middle + (points - middle) * (1 + 0.4 * np.sin(y))


def test_one_reference_alone_claims_less_than_two_alike() -> None:
    """It cannot show that borders lie elsewhere in every nose; where its regions are put stays the same."""
    tube = marked_tube()
    one = moved(tube, turned).with_(regions={"slabs": SLABS})
    alone, two = transfer_regions(tube, [one]), transfer_regions(tube, [one, one])
    assert 0.5 < alone.likely < two.likely - 0.02
    assert (alone.regions.labels == two.regions.labels)[alone.lumen].mean() > 0.97


def test_references_that_contradict_each_other_are_no_use() -> None:
    tube = marked_tube()
    one, other = (tube.with_(regions={"slabs": slabs}) for slabs in (SLABS, OTHERS))
    found = transfer_regions(tube, [one, other])
    assert found.likely < LIKELY
    assert not found.usable


def test_references_of_several_kinds_are_refused() -> None:
    tube = marked_tube()
    other = tube.with_(regions={"slabs": replace(SLABS, names=("a", "b", "c", "d"))})
    with pytest.raises(RegionError, match="the same regions"):
        transfer_regions(tube, [tube, other])
    with pytest.raises(InputError, match="a reference"):
        transfer_regions(tube, [])


@pytest.mark.long
def test_between_noses_most_of_the_lumen_gets_its_region() -> None:
    """Two references only; `naris bench anatomy` tells how it is with twelve."""
    target = built_in_nose(drawn_parameters(np.random.default_rng(5)), passages=False)
    found = transfer_regions(target, list(virtual_references(2)))
    distance = signed_distance(target, 1.0)
    places = distance.origin_mm + np.argwhere(distance.values_mm > 1.0)
    true = target.region_set("anatomical").label(places)
    right = (found.regions.label(places) == true)[true != NOWHERE]
    assert right.mean() > 0.8
    assert found.likely < right.mean() + 0.1
