"""Anatomies, regions and passages: what they promise, and what they refuse."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from naris.core.anatomy import NOWHERE, Anatomy, Between, GridRegions, Passage, RegionSet, SlabRegions
from naris.core.camera import Intrinsics
from naris.core.frame import Frame, Sample
from naris.core.pose import Pose
from naris.core.results import Prediction
from naris.errors import ImageError, RegionError, SurfaceError

PAPER = SlabRegions("paper", ("one", "two", "three", "four"), "mean", 1, (-30.0, -15.0, 0.0))


def cube(**changes: object) -> Anatomy:
    mesh = trimesh.creation.box((2.0, 4.0, 6.0))
    given_or_default = {
        "vertices_mm": np.array(mesh.vertices, dtype=float),
        "faces": np.array(mesh.faces, dtype=np.int32),
        "frame": "LPS",
        "name": "box",
        "source": "test",
        **changes,
    }
    return Anatomy(**given_or_default)


def test_nobody_changes_the_surface_of_an_anatomy_here_or_in_another_process() -> None:
    for anatomy in (cube(), pickle.loads(pickle.dumps(cube())), copy.deepcopy(cube())):
        assert anatomy.digest == cube().digest
        for array in (anatomy.vertices_mm, anatomy.faces):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0


def grid() -> GridRegions:
    labels = np.full((4, 3, 2), NOWHERE, dtype=np.int8)
    labels[0], labels[1], labels[3] = 0, 1, 2
    return GridRegions("anatomical", ("a", "b", "c"), "LPS", labels, np.array([-10.0, 5.0, 0.0]), 2.0)


# Regions ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("y_mm", "label"), [(-40, 0), (-30, 0), (-29.99, 1), (-15, 1), (-14, 2), (0, 2), (0.01, 3)])
def test_the_slabs_of_the_paper_hold_their_upper_border(y_mm: float, label: int) -> None:
    assert PAPER.label(np.array([3.0, y_mm, 7.0])) == label


@given(hnp.arrays(np.float64, (20, 3), elements=st.floats(-100, 100)))
def test_slabs_count_the_borders_below(points_mm: np.ndarray) -> None:
    counted = (points_mm[:, 1, None] > np.array(PAPER.borders_mm)).sum(axis=1)
    np.testing.assert_array_equal(PAPER.label(points_mm), counted)


@pytest.mark.parametrize("borders_mm", [(0.0,), (5.0, 0.0, 10.0), (1.0, 1.0, 2.0)])
def test_borders_that_do_not_rise_are_refused(borders_mm: tuple) -> None:
    with pytest.raises(RegionError, match="rising borders"):
        SlabRegions("paper", ("one", "two", "three", "four"), "mean", 1, borders_mm)


@given(hnp.arrays(np.float64, (30, 3), elements=st.floats(-20, 20)))
def test_a_grid_labels_by_the_nearest_voxel(points_mm: np.ndarray) -> None:
    """Oracle: the nearest of all voxel centres, found by trying each."""
    regions = grid()
    index = np.stack(np.meshgrid(*(np.arange(n) for n in regions.labels.shape), indexing="ij"), -1).reshape(-1, 3)
    centres_mm = regions.origin_mm + index * regions.spacing_mm
    offset = np.abs(points_mm[:, None] - centres_mm[None])
    nearest = offset.sum(axis=-1).argmin(axis=1)
    inside = offset[np.arange(len(points_mm)), nearest].max(axis=-1)
    decided = np.abs(inside - regions.spacing_mm / 2) > 1e-9  # on a border either side is right
    expected = np.where(inside < regions.spacing_mm / 2, regions.labels.reshape(-1)[nearest], NOWHERE)
    ties = np.sort(offset.max(axis=-1), axis=1)[:, :2]
    decided &= np.abs(ties[:, 0] - ties[:, 1]) > 1e-9
    np.testing.assert_array_equal(regions.label(points_mm)[decided], expected[decided])


@pytest.mark.parametrize("regions", [PAPER, grid()], ids=["slabs", "grid"])
def test_neighbours_are_symmetric_and_each_its_own(regions: RegionSet) -> None:
    assert isinstance(regions, RegionSet)
    neighbours = regions.neighbours
    assert neighbours.shape == (len(regions.names),) * 2
    np.testing.assert_array_equal(neighbours, neighbours.T)
    assert neighbours.diagonal().all()


def test_regions_that_do_not_touch_are_no_neighbours() -> None:
    np.testing.assert_array_equal(grid().neighbours, [[True, True, False], [True, True, False], [False, False, True]])
    np.testing.assert_array_equal(PAPER.neighbours[0], [True, True, False, False])


# Anatomies ----------------------------------------------------------------------------------------------------------


def test_vertex_normals_agree_with_trimesh() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    sphere = cube(vertices_mm=np.array(mesh.vertices), faces=np.array(mesh.faces, dtype=np.int32))
    np.testing.assert_allclose(sphere.vertex_normals, mesh.vertices / 10.0, atol=6e-3)
    np.testing.assert_allclose(sphere.vertex_normals, mesh.vertex_normals, atol=5e-3)


def test_the_corner_of_a_box_points_along_its_diagonal() -> None:
    """Weighted by angle, the three sides count alike however they are cut into triangles."""
    box = cube()
    np.testing.assert_allclose(box.vertex_normals, np.sign(box.vertices_mm) / np.sqrt(3), atol=1e-12)


def test_the_air_before_the_walls_is_on_the_side_where_it_is() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    sphere = cube(vertices_mm=np.array(mesh.vertices), faces=np.array(mesh.faces, dtype=np.int32))
    np.testing.assert_allclose(np.linalg.norm(sphere.before_walls_mm(0.5), axis=1), 9.5, atol=1e-3)
    around = cube(vertices_mm=sphere.vertices_mm, faces=sphere.faces, airspace=Between(2))
    np.testing.assert_allclose(np.linalg.norm(around.before_walls_mm(0.5), axis=1), 10.5, atol=1e-3)


def test_the_digest_tells_shapes_apart_and_nothing_else() -> None:
    box = cube()
    assert box.digest == cube(name="another name", source="elsewhere", faces=box.faces.astype(np.int32)).digest
    assert box.digest != cube(frame="mean").digest
    assert box.digest != cube(vertices_mm=box.vertices_mm + 1e-9).digest
    assert box.digest != cube(faces=box.faces[:, [1, 2, 0]].copy()).digest


def test_an_anatomy_cannot_be_changed_in_place() -> None:
    vertices_mm = np.array(cube().vertices_mm)
    box = cube(vertices_mm=vertices_mm)
    vertices_mm[0] = 99.0
    assert box.vertices_mm.max() < 99
    with pytest.raises(ValueError, match="read-only"):
        box.vertices_mm[0, 0] = 1.0


def test_bounds_and_copies_with_changes() -> None:
    box = cube()
    np.testing.assert_allclose(box.bounds_mm, [[-1, -2, -3], [1, 2, 3]])
    assert box.with_(name="renamed").name == "renamed"
    assert box.name == "box"


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"vertices_mm": np.full((8, 3), np.nan)}, "NaN"),
        ({"faces": np.array([[0, 1, 8]], dtype=np.int32)}, "face indices 0…7, got 0…8"),
        ({"faces": np.array([[0, 1, -1]], dtype=np.int32)}, "face indices"),
        ({"faces": np.zeros((0, 3), dtype=np.int32)}, "triangle mesh"),
    ],
)
def test_what_is_no_mesh_is_refused(changes: dict, word: str) -> None:
    with pytest.raises(SurfaceError, match=word):
        cube(**changes)


def test_region_sets_and_passages_by_name() -> None:
    line = Passage("left", np.array([[0.0, 0, 0], [0, 3, 4]]), np.ones(2))
    box = cube(regions={"paper": PAPER, "anatomical": grid()}, passages=(line,))
    assert box.region_set() is PAPER
    assert box.region_set("anatomical").name == "anatomical"
    assert box.passage("left").length_mm == 5
    with pytest.raises(RegionError, match="'whole'"):
        box.region_set("whole")
    with pytest.raises(RegionError, match="'right'"):
        box.passage("right")
    with pytest.raises(RegionError, match="one with none"):
        cube().region_set()


# Frames, samples, predictions ---------------------------------------------------------------------------------------


def test_a_picture_must_have_the_size_of_its_intrinsics() -> None:
    intrinsics = Intrinsics.from_vertical_fov(4, 3, 45)
    frame = Frame(np.zeros((3, 4, 3), np.uint8), intrinsics)
    assert Sample(frame, Pose.identity("LPS", "camera"), 2).depth_mm is None
    with pytest.raises(ImageError, match="resize"):
        Frame(np.zeros((4, 3, 3), np.uint8), intrinsics)


def test_a_prediction_names_its_best_region() -> None:
    probabilities = np.array([0.1, 0.7, 0.15, 0.05])
    prediction = Prediction("paper", PAPER.names, np.log(probabilities))
    assert (prediction.region, prediction.region_name) == (1, "two")
    np.testing.assert_allclose(prediction.probabilities, probabilities)
    with pytest.raises(RegionError, match="one a region"):
        Prediction("paper", PAPER.names, np.log(probabilities[:3]))
