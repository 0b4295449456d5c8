"""An anatomy whose vertices went elsewhere: what is known in it goes along."""

from __future__ import annotations

import numpy as np
import pytest

from naris.anatomy.carry import Mover, carried_along
from naris.core.anatomy import NOWHERE, GridRegions
from naris.errors import PoseError
from tests.anatomy.test_correspondence import bent, marked_tube
from tests.winding_tube import SLABS


def gridded() -> GridRegions:
    """The slabs as a grid over the tube."""
    low = np.array([-15.0, -55.0, -20.0])
    nodes = low + np.stack(np.meshgrid(np.arange(31.0), np.arange(111.0), np.arange(41.0), indexing="ij"), axis=-1)
    return GridRegions("grid", SLABS.names, "LPS", SLABS.label(nodes).astype(np.int8), low, 1.0)


def test_a_mover_goes_with_the_vertices() -> None:
    begin = np.random.default_rng(0).uniform(-10, 10, (4000, 3))
    points = begin[::9]
    np.testing.assert_allclose(Mover.between(begin, begin + [1, 2, 3])(points + 0.3), points + [1.3, 2.3, 3.3])
    assert np.linalg.norm(Mover.between(begin, bent(begin))(points) - bent(points), axis=1).max() < 0.5


def test_everything_is_where_the_map_takes_it() -> None:
    tube = marked_tube().with_(regions={"grid": gridded(), "slabs": SLABS})
    made = carried_along(tube, bent(tube.vertices_mm), "bent", "a test")
    for name, point in tube.landmarks_mm.items():
        assert np.linalg.norm(made.landmarks_mm[name] - bent(point)) < 0.5
    (passage,) = made.passages
    line = tube.passages[0].points_mm
    assert np.linalg.norm(passage.points_mm[[0, -1]] - bent(line[[0, -1]]), axis=1).max() < 0.5
    assert passage.clearance_mm.min() > 3
    label = made.region_set("grid").label(bent(line))
    away = np.abs(line[:, 1:2] - np.array(SLABS.borders_mm)).min(axis=1) > 1.5
    assert (label == SLABS.label(line))[away].all()
    slabs = made.region_set("slabs")
    assert slabs.names == SLABS.names
    assert (slabs.label(bent(line)) == SLABS.label(line))[away].all()
    assert (made.region_set("grid").label(np.array([[500.0, 0, 0]])) == NOWHERE).all()


def test_labels_on_a_coarse_field_are_those_of_the_mover_itself() -> None:
    """The oracle is the mover asked at every node; what differs lies at borders."""
    tube = marked_tube().with_(regions={"grid": gridded()})
    moved = bent(tube.vertices_mm)
    regions = carried_along(tube, moved, "bent", "a test").region_set("grid")
    assert isinstance(regions, GridRegions)
    nodes = regions.origin_mm + np.stack(np.meshgrid(*map(np.arange, regions.labels.shape), indexing="ij"), axis=-1)
    asked = gridded().label(Mover.between(moved, tube.vertices_mm)(nodes))
    near = np.linalg.norm(nodes[..., None, :] - bent(tube.passages[0].points_mm[::4]), axis=-1).min(axis=-1) < 5
    assert (regions.labels == asked)[near].mean() > 0.98


def test_walls_that_pass_through_each_other_are_refused() -> None:
    tube = marked_tube()
    with pytest.raises(PoseError, match="inside the lumen"):
        carried_along(tube, tube.vertices_mm * [-1, 1, 1], "inside out", "a test")
