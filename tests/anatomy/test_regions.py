"""Region sets: labels, neighbours, JSON both ways."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from naris.anatomy.regions import (
    PAPER_SLABS,
    even_slabs,
    read_regions,
    region_of_viewpoints,
    regions_from_json,
    regions_to_json,
    whole,
    write_regions,
)
from naris.core.anatomy import NOWHERE, GridRegions, SlabRegions
from naris.core.pose import Pose
from naris.errors import RegionError

from .shapes import tube

NAMES = st.lists(st.text(min_size=1, max_size=10), min_size=1, max_size=6).map(tuple)


@given(st.floats(-60, 60))
def test_the_paper_divides_by_the_y_of_the_camera(y):
    expected = 0 if y <= -30 else 1 if y <= -15 else 2 if y <= 0 else 3
    assert PAPER_SLABS.label(np.array([[3.0, y, -7.0]]))[0] == expected


def test_slabs_touch_their_neighbours_only():
    np.testing.assert_array_equal(PAPER_SLABS.neighbours, np.abs(np.subtract.outer(range(4), range(4))) <= 1)


def test_the_whole_is_one_region():
    assert (whole("LPS").label(np.random.default_rng(0).normal(size=(9, 3))) == 0).all()


def test_even_slabs_are_even():
    slabs = even_slabs(tube(60.0), 4)
    np.testing.assert_allclose(slabs.borders_mm, [-15, 0, 15], atol=1e-9)
    with pytest.raises(RegionError, match="axis 0, 1 or 2"):
        even_slabs(tube(), 4, 3)


@given(arrays(np.int8, array_shapes(min_dims=3, max_dims=3, max_side=6), elements=st.integers(-1, 2)))
def test_voxels_that_touch_make_regions_neighbours(labels):
    grid = GridRegions("g", ("a", "b", "c"), "LPS", labels, np.array([1.0, 2.0, 3.0]), 0.7)
    expected = np.eye(3, dtype=bool)
    for index in np.ndindex(labels.shape):
        for axis in range(3):
            other = tuple(i + (axis == k) for k, i in enumerate(index))
            if other[axis] < labels.shape[axis] and min(labels[index], labels[other]) >= 0:
                expected[labels[index], labels[other]] = expected[labels[other], labels[index]] = True
    np.testing.assert_array_equal(grid.neighbours, expected)
    centres = grid.origin_mm + 0.7 * np.argwhere(labels > -9)
    np.testing.assert_array_equal(grid.label(centres), labels.ravel())
    assert grid.label(centres[-1:] + [0, 0, 0.8])[0] == NOWHERE


@given(NAMES, st.sampled_from([0, 1, 2]), st.lists(st.floats(-99, 99), min_size=5, max_size=5, unique=True))
def test_slabs_survive_json(names, axis, borders):
    slabs = SlabRegions("mine", names, "LPS", axis, tuple(sorted(borders))[: len(names) - 1])
    assert regions_from_json(json.loads(json.dumps(regions_to_json(slabs)))) == slabs


@given(arrays(np.int8, array_shapes(min_dims=3, max_dims=3, max_side=9), elements=st.integers(-1, 4)))
def test_grids_survive_json(labels):
    grid = GridRegions("g", tuple("abcde"), "LPS", labels, np.array([0.1, -2.3, 1 / 3]), 0.6)
    back = regions_from_json(json.loads(json.dumps(regions_to_json(grid))))
    np.testing.assert_array_equal(back.labels, labels)
    np.testing.assert_array_equal(back.origin_mm, grid.origin_mm)
    assert (back.name, back.names, back.frame, back.spacing_mm) == ("g", tuple("abcde"), "LPS", 0.6)


def test_a_region_file_made_by_hand(tmp_path):
    path = tmp_path / "regions.json"
    path.write_text(
        '{"schema": "naris.regions/1", "kind": "slabs", "name": "mine", "names": ["front", "back"], "frame": "LPS",'
        ' "axis": 1, "borders_mm": [0]}'
    )
    assert read_regions(path) == SlabRegions("mine", ("front", "back"), "LPS", 1, (0.0,))
    write_regions(PAPER_SLABS, path)
    assert read_regions(path) == PAPER_SLABS


GRID = regions_to_json(GridRegions("g", ("a",), "LPS", np.zeros((3, 3, 3), np.int8), np.zeros(3), 1.0))
SLABS = regions_to_json(PAPER_SLABS)
BROKEN = [
    {**SLABS, "axis": 5},
    {**SLABS, "borders_mm": [0, 0, 0]},
    {**SLABS, "borders_mm": ["north", 0, 1]},
    {**SLABS, "kind": "spheres"},
    {key: value for key, value in SLABS.items() if key != "names"},
    {**GRID, "shape": [3, 3, 4]},
    {**GRID, "shape": [10**6, 10**6, 10**6]},
    {**GRID, "shape": [-3, -3, 3]},
    {**GRID, "labels": "no base64!"},
    {**GRID, "labels": "AAAA"},
    {**GRID, "labels": 7},
    {**GRID, "names": []},
    {**GRID, "spacing_mm": 0},
    {**GRID, "origin_mm": [0, 0]},
]


@pytest.mark.parametrize("value", BROKEN)
def test_what_does_not_fit_is_refused(value):
    with pytest.raises(RegionError):
        regions_from_json(value)


@pytest.mark.parametrize("content", [b"", b"text", b"[]", b'{"schema": "other"}', b"\xff\xfe"])
def test_what_is_no_region_file_is_refused(tmp_path, content):
    (tmp_path / "regions.json").write_bytes(content)
    with pytest.raises(RegionError, match=r"regions\.json"):
        read_regions(tmp_path / "regions.json")
    with pytest.raises(RegionError, match="No such file"):
        read_regions(tmp_path / "absent.json")


def test_the_region_of_a_viewpoint_is_that_of_its_position():
    poses = Pose.look(np.array([[0.0, -40, 0], [0, 5, 0]]), np.array([[0.0, 1, 0]] * 2), np.array([0.0, 0, 1]), "mean")
    np.testing.assert_array_equal(region_of_viewpoints(PAPER_SLABS, poses), [0, 3])
    with pytest.raises(RegionError, match="'mean'"):
        region_of_viewpoints(PAPER_SLABS, Pose.identity("LPS", "camera"))
