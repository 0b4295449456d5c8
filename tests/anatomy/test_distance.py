"""The signed distance against formulas, trimesh and VTK."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.distance import SPACING_MM, lumen_distance, signed_distance
from naris.anatomy.triangles import index_triangles
from naris.core.anatomy import Anatomy, Between, Entrance
from naris.errors import InputError

from .shapes import anatomy_of, box, box_distance, sphere, torus

POINT = arrays(np.float64, (3,), elements=st.floats(-45, 45))


def points_around(anatomy, rng, count=2000, margin_mm=4.0):
    low, high = anatomy.bounds_mm
    return rng.uniform(low - margin_mm, high + margin_mm, (count, 3))


@settings(max_examples=60)
@given(POINT)
def test_exact_distance_to_a_box_is_the_formula(point):
    distance = signed_distance(box(), 2.0)
    expected = box_distance(point)
    # On the wall itself either sign is right.
    np.testing.assert_allclose(abs(distance.exact(point)), abs(expected), atol=1e-9)
    if abs(expected) > 1e-9:
        assert np.sign(distance.exact(point)) == np.sign(expected)


def test_the_nodes_are_exact():
    anatomy = torus()
    distance = signed_distance(anatomy, 1.0)
    nodes = np.stack(np.meshgrid(*distance.nodes_mm, indexing="ij"), axis=-1)
    np.testing.assert_allclose(distance.values_mm, distance.exact(nodes), atol=1e-5)


def test_between_the_nodes_the_grid_is_near_the_exact_distance():
    distance = signed_distance(sphere(), 1.0)
    points = points_around(sphere(), np.random.default_rng(1), margin_mm=0.9)
    off = np.abs(distance(points) - distance.exact(points))
    away_from_centre = np.linalg.norm(points, axis=1) > 2
    # spacing²/8 times the curvature 2/r, summed over both curved directions, and the facets of the sphere.
    assert off[away_from_centre].max() < 0.1
    assert off.max() < 0.87


def test_the_distance_to_a_sphere_is_its_formula():
    anatomy = sphere(20.0, 4)
    distance = signed_distance(anatomy, 2.0)
    points = points_around(anatomy, np.random.default_rng(2), margin_mm=0.9)
    # The facets of the icosphere lie at most 0.06 mm below the sphere.
    np.testing.assert_allclose(distance.exact(points), 20.0 - np.linalg.norm(points, axis=1), atol=0.06)


def test_the_gradient_points_away_from_the_wall_and_has_unit_length():
    anatomy = torus()
    distance = signed_distance(anatomy, 0.5)
    rng = np.random.default_rng(3)
    angle, around, depth = rng.uniform(0, 2 * np.pi, (2, 500)).tolist() + [rng.uniform(1.5, 4.5, 500).tolist()]
    angle, around, radius = np.array(angle), np.array(around), np.array(depth)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(500)], axis=1)
    outwards = np.cos(around)[:, None] * ring + np.sin(around)[:, None] * np.array([0.0, 0, 1])
    gradient = distance.gradient(20.0 * ring + radius[:, None] * outwards)
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=0.06)
    assert (-(gradient * outwards).sum(axis=1) > 0.95).all()


def test_beyond_the_grid_the_distance_goes_on_falling():
    distance = signed_distance(sphere(), 1.0)
    far = distance(np.array([[0.0, 0, 30], [0, 0, 40], [0, 0, 400]]))
    np.testing.assert_allclose(far, [-10, -20, -380], atol=0.2)


def test_a_point_that_is_no_number_has_no_distance():
    distance = signed_distance(box(), 2.0)
    assert np.isnan(distance(np.array([0.0, np.nan, 0.0])))
    assert distance(np.zeros((0, 3))).shape == (0,)
    assert distance(np.zeros((2, 5, 3))).shape == (2, 5)


@pytest.mark.parametrize("make", [box, sphere, torus], ids=["box", "sphere", "torus"])
def test_nearest_points_agree_with_vtk(make):
    vtk = pytest.importorskip("vtk")
    pytest.importorskip("pyvista")
    import pyvista

    anatomy = make()
    mesh = pyvista.PolyData.from_regular_faces(anatomy.vertices_mm, anatomy.faces)
    oracle = vtk.vtkImplicitPolyDataDistance()
    oracle.SetInput(mesh)
    points = points_around(anatomy, np.random.default_rng(4), 500)
    expected = np.array([-oracle.EvaluateFunction(p) for p in points])
    np.testing.assert_allclose(signed_distance(anatomy, 2.0).exact(points), expected, atol=1e-5)


def test_the_mean_nose_agrees_with_trimesh(mean_tissue):
    anatomy, distance = mean_tissue
    mesh = trimesh.Trimesh(anatomy.vertices_mm, anatomy.faces, process=False)
    points = points_around(anatomy, np.random.default_rng(5), 20000)
    np.testing.assert_array_equal(distance.inside(points), mesh.ray.contains_points(points))
    found = distance.closest(points[:300])
    # No face of the whole mesh comes nearer than the one found, and the point found lies in that face.
    _, expected, _ = trimesh.proximity.closest_point_naive(mesh, points[:30])
    np.testing.assert_allclose(found.distance_mm[:30], expected, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(points[:300] - found.points_mm, axis=1), found.distance_mm, atol=1e-12)
    corners = mesh.triangles[found.faces]
    on_face = trimesh.triangles.closest_point(corners, found.points_mm)
    np.testing.assert_allclose(on_face, found.points_mm, atol=1e-9)


def test_the_inside_of_the_mean_nose_has_the_volume_of_its_surface(mean_tissue):
    anatomy, distance = mean_tissue
    volume = (distance.values_mm > 0).sum() * distance.spacing_mm**3
    assert volume == pytest.approx(trimesh.Trimesh(anatomy.vertices_mm, anatomy.faces).volume, rel=0.01)


def test_straight_over_vertices_and_edges_nothing_is_counted_twice(mean_tissue):
    anatomy, distance = mean_tissue
    over = anatomy.vertices_mm * [1, 1, 0]
    middles = 0.5 * (anatomy.vertices_mm[anatomy.faces[:, 0]] + anatomy.vertices_mm[anatomy.faces[:, 1]]) * [1, 1, 0]
    for line in (over, middles):
        assert not distance.triangles.winding(line + [0, 0, -100.0]).any()
        assert not distance.triangles.winding(line + [0, 0, 100.0]).any()


@settings(max_examples=60)
@given(arrays(np.int64, (40, 3), elements=st.integers(-3, 3)))
def test_winding_on_a_lattice_of_cubes_is_occupancy(cells):
    """Cubes on a lattice: every ray from a cell centre plus a corner shift hits edges and vertices of others."""
    cells = np.unique(cells, axis=0)
    cube = trimesh.creation.box((1.0, 1.0, 1.0))
    soup = trimesh.util.concatenate([cube.copy().apply_translation(cell) for cell in cells])
    index = index_triangles(np.asarray(soup.vertices), np.asarray(soup.faces, dtype=np.int32))
    asked = np.stack(np.meshgrid(*[np.arange(-4, 5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    occupied = {tuple(cell) for cell in cells}
    expected = np.array([tuple(cell) in occupied for cell in asked])
    # Low corners belong to the half-open cell, and lie over edges and vertices of every cube below and above.
    for shift in (np.zeros(3), np.array([-0.5, -0.5, 0.0]), np.array([0.0, -0.5, 0.25])):
        np.testing.assert_array_equal(index.winding(asked + shift), expected)


def test_where_the_surface_overlaps_itself_it_winds_twice_and_is_inside():
    two = trimesh.util.concatenate([trimesh.creation.icosphere(3, 10.0).apply_translation([x, 0, 0]) for x in (0, 8)])
    distance = signed_distance(anatomy_of(two), 1.0)
    points = np.array([[-8.0, 0, 0], [4, 0, 0], [16, 0, 0], [20, 0, 0]])
    np.testing.assert_array_equal(distance.triangles.winding(points), [1, 2, 1, 0])
    np.testing.assert_array_equal(distance.inside(points), [True, True, True, False])


def plates(gap_mm=4.0) -> Anatomy:
    """Two blocks of tissue, 40 mm long and wide, with air between them at |x| < gap/2."""
    blocks = [trimesh.creation.box((10.0, 40.0, 40.0)) for _ in range(2)]
    for sign, block in zip((-1, 1), blocks, strict=True):
        block.apply_translation([sign * (5.0 + gap_mm / 2), 0, 0])
    return anatomy_of(trimesh.util.concatenate(blocks))


def test_between_walls_the_air_is_where_the_tissue_is_not():
    anatomy = plates().with_(airspace=Between(ball_mm=8.0))
    distance = signed_distance(anatomy)
    x = np.linspace(-1.9, 1.9, 20)
    gap = np.stack([x, np.zeros(20), np.zeros(20)], axis=1)
    np.testing.assert_allclose(distance.exact(gap), 2.0 - np.abs(x), atol=1e-9)
    assert distance.inside(gap).all()
    assert not distance.inside(gap + [6.0, 0, 0]).any()
    assert (distance.exact(gap + [6.0, 0, 0]) < 0).all()


def test_between_walls_the_air_ends_where_the_ball_rolls():
    """A ball of 8 mm on the corners of a gap of 4 mm reaches 8 − √(8² − 2²) = 0.25 mm into it."""
    distance = signed_distance(plates().with_(airspace=Between(ball_mm=8.0)))
    along = np.stack([np.zeros(61), np.linspace(15, 30, 61), np.zeros(61)], axis=1)
    inside = distance.inside(along)
    end = along[inside, 1].max()
    assert inside[: inside.sum()].all()
    # On nodes 1 mm apart, half a node off to the safe side.
    assert 20.0 - 2.0 < end < 20.0
    np.testing.assert_array_equal(distance.exact(along) > 0, inside)


def test_a_smaller_ball_leaves_less_air():
    points = points_around(plates(), np.random.default_rng(6), 4000)
    small, large = (signed_distance(plates(9.0).with_(airspace=Between(ball_mm=r))).inside(points) for r in (5.0, 9.0))
    assert not (small & ~large).any()
    assert small.sum() < large.sum()


def test_an_entrance_gives_room_in_its_box_only():
    box_low, box_high = (-4.0, 15.0, -5.0), (4.0, 24.0, 5.0)
    narrow = signed_distance(plates().with_(airspace=Between(ball_mm=8.0)))
    wide = signed_distance(plates().with_(airspace=Between(8.0, Entrance(box_low, box_high, ball_mm=20.0))))
    points = points_around(plates(), np.random.default_rng(7), 4000)
    in_box = ((points > box_low) & (points < box_high)).all(axis=1)
    np.testing.assert_array_equal(narrow.inside(points)[~in_box], wide.inside(points)[~in_box])
    ahead = np.array([0.0, 21.5, 0.0])
    assert wide.inside(ahead)
    assert not narrow.inside(ahead)


def test_the_original_camera_starts_in_the_air_of_the_mean_nose(mean_nose):
    _, distance = mean_nose
    assert distance(np.array([0.0, -35.0, 0.0])) > 0.5
    assert distance.inside(np.array([0.0, -35.0, 0.0]))


def test_the_air_of_the_mean_nose_is_outside_its_tissue(mean_nose, mean_tissue):
    anatomy, air = mean_nose
    _, tissue = mean_tissue
    points = points_around(anatomy, np.random.default_rng(8), 20000)
    assert not (air.inside(points) & tissue.inside(points)).any()
    np.testing.assert_array_equal(air.inside(points), air.exact(points) > 0)
    # Volumes of one side of a nose in the literature: 5 to 15 ml.
    assert 5.0 < (air.values_mm > 0).sum() * air.spacing_mm**3 / 1000 < 15.0


def test_the_same_anatomy_is_not_computed_twice_and_another_spacing_is():
    anatomy = box()
    again = Anatomy(anatomy.vertices_mm, anatomy.faces, anatomy.frame, "another name", "elsewhere")
    assert signed_distance(anatomy, 2.0) is signed_distance(again, 2.0)
    assert signed_distance(anatomy, 2.5) is not signed_distance(anatomy, 2.0)


@pytest.mark.parametrize("spacing", [0.0, -1.0, float("nan"), float("inf"), 1e-3])
def test_a_spacing_that_cannot_be_is_refused(spacing):
    with pytest.raises(InputError, match=r"spacing|nodes"):
        signed_distance(box(), spacing)


def test_faces_without_area_change_no_distance():
    """A level set through nodes of its grid leaves some: two or three of their corners are one point."""
    whole = box()
    first = whole.faces[0]
    flat = np.array([[first[0], first[0], first[1]], [first[1], first[2], first[2]], [first[0]] * 3], dtype=np.int32)
    with_flat = Anatomy(whole.vertices_mm, np.concatenate([flat, whole.faces]), "LPS", "a box", "made up")
    points = np.random.default_rng(0).uniform(-15, 15, (200, 3))
    points = np.concatenate([points, whole.vertices_mm, whole.vertices_mm[whole.faces].mean(axis=1)])
    found, expected = (
        index_triangles(one.vertices_mm, one.faces).closest(points).distance_mm for one in (with_flat, whole)
    )
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_far_tissue_may_be_left_out_and_nothing_else_changes() -> None:
    nose = built_in_nose(passages=False, resolution_mm=1.0)
    whole, near = signed_distance(nose, 1.5), signed_distance(nose, 1.5, tissue_to_mm=3.0)
    exact = near.values_mm != -3.0
    assert 0.3 < exact.mean() < 0.8
    assert (near.values_mm[exact] == whole.values_mm[exact]).all()
    assert (whole.values_mm[~exact] <= -3.0).all()


@pytest.mark.parametrize("deep_mm", [0.0, 2.0])
def test_what_asks_in_the_lumen_or_near_it_is_told_the_same(deep_mm: float) -> None:
    """Values and gradients to the last bit, of a ring that no other test asks for."""
    ring = torus(20.5 + 0.25 * deep_mm)
    near, whole = lumen_distance(ring, deep_mm), signed_distance(ring, SPACING_MM)
    assert (near.values_mm != whole.values_mm).mean() > 0.05
    points = points_around(ring, np.random.default_rng(0))
    asked = points[whole(points) > -deep_mm]
    assert len(asked) > 200
    np.testing.assert_array_equal(near(asked), whole(asked))
    np.testing.assert_array_equal(near.gradient(asked), whole.gradient(asked))
    assert ((near(points) > -deep_mm) == (whole(points) > -deep_mm)).all()
    assert lumen_distance(ring, deep_mm) is whole  # once it is there


@pytest.mark.parametrize("between", [False, True])
def test_around_some_points_a_finer_grid_says_what_the_surface_says(between) -> None:
    anatomy = plates().with_(airspace=Between(ball_mm=8.0)) if between else torus()
    points = np.array([[-1.0, 0.0, 0.0], [1.0, 14.0, 2.0]]) if between else np.array([[20.0, 0, 0], [14.0, 14.0, 2.0]])
    fine = signed_distance(anatomy, 2.0).around(points, 3.0, 0.5)
    low, high = (np.array([axis[end] for axis in fine.nodes_mm]) for end in (0, -1))
    assert (low <= points.min(axis=0) - 3.0).all() and (high >= points.max(axis=0) + 3.0).all()
    exact = fine.exact(np.stack(np.meshgrid(*fine.nodes_mm, indexing="ij"), axis=-1))
    np.testing.assert_allclose(fine.values_mm[exact > -1.0], exact[exact > -1.0], atol=1e-5)
    assert (fine.values_mm[exact < -1.0] <= -1.0 + 1e-5).all()


def test_after_the_vertices_went_elsewhere_the_nearest_points_are_those_of_the_new_mesh():
    one, rng = torus(), np.random.default_rng(4)
    moved = one.vertices_mm * [1.2, 0.8, 1.0] + rng.normal(0, 0.2, one.vertices_mm.shape)
    points = rng.uniform(-30, 30, (200, 3))
    found = index_triangles(one.vertices_mm, one.faces).closest_of(moved, one.faces, points)
    anew = index_triangles(moved, one.faces).closest(points)
    assert np.array_equal(found.distance_mm, anew.distance_mm)
    assert np.allclose(found.points_mm, anew.points_mm)
