"""What a surface must be before anything is made of it."""

import logging

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from naris.anatomy.checks import check_surface, pieces_of, unit_by_extent, wound_one_way
from naris.anatomy.read import read_surface
from naris.core.anatomy import Between
from naris.errors import SurfaceError

from .shapes import box, sphere, torus, tube


def written(path, vertices, faces):
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


@pytest.mark.parametrize(("make", "genus"), [(box, 0), (sphere, 0), (tube, 0), (torus, 1)])
def test_the_report_agrees_with_trimesh(make, genus):
    anatomy = make()
    mesh = trimesh.Trimesh(anatomy.vertices_mm, anatomy.faces, process=False)
    report = check_surface(anatomy.vertices_mm, anatomy.faces)
    assert (report.closed, report.open_edges, report.pieces, report.genus) == (mesh.is_watertight, 0, 1, genus)
    assert report.genus == (2 - mesh.euler_number) // 2
    assert report.volume_ml == pytest.approx(mesh.volume / 1000)
    assert not report.inside_out
    assert report.unit == "mm"


def test_the_report_of_the_mean_nose(mean_nose):
    anatomy, _ = mean_nose
    report = check_surface(anatomy.vertices_mm, anatomy.faces)
    assert (report.vertices, report.faces, report.genus, report.pieces) == (14056, 28136, 7, 1)
    assert report.volume_ml == pytest.approx(23.3, abs=0.05)


@given(st.integers(1, 11))
def test_a_hole_of_any_number_of_faces_is_seen(missing):
    report = check_surface(box().vertices_mm, box().faces[missing:])
    assert not report.closed
    assert report.open_edges > 0
    assert report.genus is None


def test_faces_that_touch_along_an_edge_close_a_surface_that_is_no_manifold():
    """Two boxes that share an edge: four faces there, and yet an inside."""
    one, other = trimesh.creation.box((20, 20, 20)), trimesh.creation.box((20, 20, 20))
    other.apply_translation([20, 20, 0])
    both = trimesh.util.concatenate([one, other])
    both.merge_vertices()
    report = check_surface(np.asarray(both.vertices), np.asarray(both.faces))
    assert report.closed
    assert report.genus is None
    assert report.volume_ml == pytest.approx(16.0)


@given(st.lists(st.booleans(), min_size=80, max_size=80))
def test_uneven_winding_is_made_even(flips):
    anatomy = sphere(20.0, 1)
    uneven = np.where(np.array(flips)[:, None], anatomy.faces[:, ::-1], anatomy.faces)
    even = wound_one_way(uneven)
    assert check_surface(anatomy.vertices_mm, even).closed
    np.testing.assert_array_equal(np.sort(even, axis=1), np.sort(anatomy.faces, axis=1))
    assert abs(check_surface(anatomy.vertices_mm, even).volume_ml) == pytest.approx(
        check_surface(anatomy.vertices_mm, anatomy.faces).volume_ml
    )


def test_an_uneven_surface_is_mended_with_a_notice(tmp_path, caplog):
    faces = torus().faces.copy()
    faces[::3] = faces[::3, ::-1]
    with caplog.at_level(logging.WARNING):
        read = read_surface(written(tmp_path / "a.ply", torus().vertices_mm, faces))
    assert "unevenly" in caplog.text
    assert trimesh.Trimesh(read.vertices_mm, read.faces, process=False).is_volume


def test_corners_that_are_not_joined_are_joined_with_a_notice(tmp_path, caplog):
    soup = torus().vertices_mm[torus().faces].reshape(-1, 3)
    with caplog.at_level(logging.WARNING):
        read = read_surface(written(tmp_path / "a.obj", soup, np.arange(len(soup)).reshape(-1, 3)))
    assert "joined" in caplog.text
    assert len(read.vertices_mm) == len(torus().vertices_mm)


def test_an_open_surface_is_refused(tmp_path):
    path = written(tmp_path / "open.ply", sphere().vertices_mm, sphere().faces[1:])
    with pytest.raises(SurfaceError, match=r"closed surface in open.ply, got 3 open edges"):
        read_surface(path)


@pytest.mark.parametrize(
    ("unit", "size", "words"), [("m", 1000.0, "metres"), ("in", 25.4, "inches"), ("um", 0.001, "micrometres")]
)
def test_other_units_are_recognised_and_can_be_told(tmp_path, unit, size, words):
    path = written(tmp_path / "a.obj", torus().vertices_mm / size, torus().faces)
    with pytest.raises(SurfaceError, match=f"{words}.*unit.*{unit}"):
        read_surface(path)
    np.testing.assert_allclose(read_surface(path, unit=unit).bounds_mm, torus().bounds_mm, rtol=1e-4)


def test_a_wrong_unit_that_was_told_is_refused(tmp_path):
    path = written(tmp_path / "a.ply", torus().vertices_mm, torus().faces)
    with pytest.raises(SurfaceError, match="check the unit"):
        read_surface(path, unit="m")
    with pytest.raises(SurfaceError, match="mm, cm, m, in, um"):
        read_surface(path, unit="parsec")


@given(st.floats(15, 600))
def test_what_is_as_long_as_a_nose_or_a_head_is_in_mm(longest):
    assert unit_by_extent(longest) == "mm"
    assert "m" in unit_by_extent(longest / 1000).split(" or ")


@given(st.floats(1e-12, 1e12))
def test_every_extent_has_an_answer(longest):
    assert unit_by_extent(longest)


def test_crumbs_are_dropped_with_a_notice(tmp_path, caplog):
    crumbs = [trimesh.creation.icosphere(1, 0.5).apply_translation([30, i, 0]) for i in range(0, 20, 4)]
    big = trimesh.Trimesh(sphere().vertices_mm, sphere().faces, process=False)
    both = trimesh.util.concatenate([*crumbs, big])
    with caplog.at_level(logging.WARNING):
        read = read_surface(written(tmp_path / "a.ply", both.vertices, both.faces))
    assert "5 small pieces" in caplog.text
    np.testing.assert_allclose(read.vertices_mm, sphere().vertices_mm, atol=1e-5)
    np.testing.assert_array_equal(read.faces, sphere().faces)


def two_spheres():
    return trimesh.util.concatenate(
        [trimesh.creation.icosphere(2, r).apply_translation([x, 0, 0]) for r, x in ((10, 0), (8, 30))]
    )


def test_two_large_pieces_are_refused_unless_they_are_walls(tmp_path):
    path = written(tmp_path / "a.ply", two_spheres().vertices, two_spheres().faces)
    with pytest.raises(SurfaceError, match=r"one connected surface.*2 pieces"):
        read_surface(path)
    walls = read_surface(path, airspace=Between())
    assert check_surface(walls.vertices_mm, walls.faces).pieces == 2


def test_pieces_are_those_of_trimesh():
    both = two_spheres()
    piece = pieces_of(len(both.vertices), np.asarray(both.faces))
    assert len(np.unique(piece)) == both.body_count == 2


def test_a_flat_surface_has_no_inside(tmp_path):
    flat = np.array([[0, 0, 0], [40, 0, 0], [0, 40, 0]], dtype=float)
    path = written(tmp_path / "flat.ply", flat, [[0, 1, 2], [2, 1, 0]])
    with pytest.raises(SurfaceError, match="inside"):
        read_surface(path)


def test_crossings_are_looked_for_when_asked() -> None:
    ball = trimesh.creation.icosphere(2, radius=20.0)
    both = trimesh.util.concatenate([ball, ball.copy().apply_translation([15.0, 3.0, 1.0])])
    vertices, faces = np.asarray(both.vertices), np.asarray(both.faces)
    assert check_surface(vertices, faces).crossings is None
    found = check_surface(vertices, faces, find_crossings=True)
    assert found.crossing_faces is not None and found.crossings is not None
    assert 10 < found.crossing_faces < len(faces) / 2
    assert found.crossings >= found.crossing_faces / 2
    one = check_surface(np.asarray(ball.vertices), np.asarray(ball.faces), find_crossings=True)
    assert (one.crossings, one.crossing_faces) == (0, 0)
