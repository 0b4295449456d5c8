"""Centrelines: inside, in order, through where they were sent; oracles where the answer is known."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from naris.anatomy.centreline import resample
from naris.anatomy.distance import signed_distance
from naris.anatomy.lumen import lumen_graph
from naris.anatomy.mean_nose import ROUTES
from naris.anatomy.passages import Route, find_passages
from naris.errors import PoseError

from .shapes import anatomy_of, torus, tube


def lies_inside(passage, distance):
    """Every point, and every point between two of them, is off the wall."""
    points = passage.points_mm
    between = np.concatenate([(1 - t) * points[:-1] + t * points[1:] for t in np.linspace(0, 1, 8)])
    assert (distance.exact(between) > 0).all()
    np.testing.assert_allclose(passage.clearance_mm, distance.exact(points), atol=1e-9)


def turns_deg(passage):
    step = np.diff(passage.points_mm, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip((step[1:] * step[:-1]).sum(axis=1), -1, 1)))


@pytest.fixture(scope="module")
def nose_passages(mean_nose):
    anatomy, distance = mean_nose
    return find_passages(anatomy, distance, ROUTES)


def test_the_passages_of_the_mean_nose_stay_in_its_air(mean_nose, nose_passages):
    assert [p.name for p in nose_passages] == [r.name for r in ROUTES]
    for passage in nose_passages:
        lies_inside(passage, mean_nose[1])
        assert passage.clearance_mm.min() > 0.5
        assert np.median(passage.clearance_mm) > 1.0


def test_the_passages_of_the_mean_nose_lead_from_front_to_back(nose_passages):
    for passage in nose_passages:
        y = passage.points_mm[:, 1]
        assert y[0] < -35.0
        assert (np.maximum.accumulate(y) - y).max() < 2.0
        if passage.name not in ("inferior meatus", "olfactory cleft"):
            assert y[-1] > 29.0


def test_the_passages_of_the_mean_nose_are_even_and_smooth(nose_passages):
    for passage in nose_passages:
        step = np.linalg.norm(np.diff(passage.points_mm, axis=0), axis=1)
        np.testing.assert_allclose(step, 0.5, atol=0.05)
        assert turns_deg(passage).max() < 25.0


def test_the_passages_of_the_mean_nose_part(nose_passages):
    """Half way back, the passages of the three meatuses are different places, in their order from floor to roof."""
    height = {}
    for passage in nose_passages:
        at = passage.points_mm[np.argmin(np.abs(passage.points_mm[:, 1] - 5.0))]
        height[passage.name] = at[2]
    assert height["floor"] < height["inferior meatus"] < height["middle meatus"]


def test_all_four_slabs_of_the_paper_have_passages(mean_nose, nose_passages):
    regions = mean_nose[0].region_set("paper")
    seen = np.unique(np.concatenate([regions.label(p.points_mm) for p in nose_passages]))
    np.testing.assert_array_equal(seen, [0, 1, 2, 3])


def test_in_a_tube_the_passage_is_its_axis():
    anatomy = tube(60.0, 4.0)
    distance = signed_distance(anatomy)
    (main,) = find_passages(anatomy, distance)
    assert main.name == "main"
    assert main.points_mm[0, 1] < -28
    assert main.points_mm[-1, 1] > 28
    middle = np.abs(main.points_mm[:, 1]) < 20
    assert np.linalg.norm(main.points_mm[middle][:, [0, 2]], axis=1).max() < 0.5
    lies_inside(main, distance)


def test_around_a_torus_both_ways_are_found():
    """The way to the far end takes one half; the other half is a branch of its own, and goes on to the far end."""
    anatomy = torus(20.0, 5.0)
    passages = find_passages(anatomy, signed_distance(anatomy, 1.0))
    assert len(passages) >= 2
    sides = {np.sign(p.points_mm[len(p.points_mm) // 2, 0]) for p in passages}
    assert sides == {-1.0, 1.0}
    for passage in passages:
        off_axis = np.abs(np.linalg.norm(passage.points_mm[:, :2], axis=1) - 20.0)
        assert off_axis[15:-15].max() < 2.0


def test_landmarks_tell_the_sides_apart():
    """Two straight nostrils that meet: a passage from each to the back, named after its side."""
    parts = [trimesh.creation.box((6, 60, 6)).apply_translation([x, 0, 0]) for x in (-8, 8)]
    parts.append(trimesh.creation.box((22, 10, 6)).apply_translation([0, 34.5, 0]))
    joined = trimesh.boolean.union(parts, engine="manifold")
    landmarks = {
        "right nostril centre": np.array([-8.0, -29.0, 0.0]),
        "left nostril centre": np.array([8.0, -29.0, 0.0]),
        "nasopharynx centre": np.array([0.0, 36.0, 0.0]),
    }
    passages = {p.name: p for p in find_passages(anatomy_of(joined).with_(landmarks_mm=landmarks))}
    assert {"left.main", "right.main"} <= set(passages)
    assert passages["left.main"].points_mm[:-20, 0].min() > -1.0
    np.testing.assert_allclose(passages["left.main"].points_mm * [-1, 1, 1], passages["right.main"].points_mm, atol=1.0)


def test_a_branch_begins_in_the_nostril_of_its_own_side():
    """Also where that is narrow, and the other nostril has more room all the way round behind the septum."""
    parts = [
        trimesh.creation.box((10, 60, 10)).apply_translation([-8, 0, 0]),
        trimesh.creation.box((2.4, 30, 2.4)).apply_translation([8, -15, 0]),
        trimesh.creation.box((10, 31, 10)).apply_translation([8, 14.5, 0]),
        trimesh.creation.box((6, 8, 20)).apply_translation([8, 4, 14]),
        trimesh.creation.box((26, 10, 10)).apply_translation([0, 34.5, 0]),
    ]
    landmarks = {
        "right nostril": np.array([-8.0, -29.0, 0.0]),
        "left nostril": np.array([8.0, -29.0, 0.0]),
        "nasopharynx": np.array([0.0, 36.0, 0.0]),
    }
    anatomy = anatomy_of(trimesh.boolean.union(parts, engine="manifold")).with_(landmarks_mm=landmarks)
    into_the_cell = [p for p in find_passages(anatomy) if p.points_mm[:, 2].max() > 12]
    assert into_the_cell
    assert all(p.name.startswith("left.") for p in into_the_cell)
    assert all(p.points_mm[0, 0] > 5 for p in into_the_cell)


def test_a_route_goes_by_its_points():
    anatomy = torus(20.0, 5.0)
    routes = [
        Route("left", np.array([0.0, -20, 0]), np.array([0.0, 20, 0]), (np.array([20.0, 0, 0]),)),
        Route("right", np.array([0.0, -20, 0]), np.array([0.0, 20, 0]), (np.array([-20.0, 0, 0]),)),
    ]
    left, right = find_passages(anatomy, routes=routes)
    assert left.points_mm[:, 0].min() > -3
    assert right.points_mm[:, 0].max() < 3
    assert left.length_mm == pytest.approx(np.pi * 20, rel=0.1)


def test_a_wall_thinner_than_the_grid_is_not_crossed():
    """A box parted by a wall of 0.1 mm with a gap at one end: the way is around, though nodes are nearer."""
    whole, wall = trimesh.creation.box((20, 40, 10)), trimesh.creation.box((0.1, 34, 12))
    wall.apply_translation([0.25, -4, 0])
    anatomy = anatomy_of(trimesh.boolean.difference([whole, wall], engine="manifold"))
    distance = signed_distance(anatomy)
    route = Route("around", np.array([-5.0, -15, 0]), np.array([5.0, -15, 0]))
    (passage,) = find_passages(anatomy, distance, [route])
    lies_inside(passage, distance)
    assert passage.points_mm[:, 1].max() > 13.0
    assert passage.length_mm > 50.0


def test_a_point_far_from_the_lumen_is_refused():
    with pytest.raises(PoseError, match="within 5 mm"):
        find_passages(tube(20.0), routes=[Route("out", np.array([0.0, 0, 0]), np.array([0.0, 0, 90]))])


def test_a_lumen_thinner_than_the_grid_is_refused():
    thin = anatomy_of(trimesh.creation.box((0.2, 40, 40)).apply_translation([0.25, 0, 0]))
    with pytest.raises(PoseError, match="finer spacing"):
        find_passages(thin, signed_distance(thin, 0.5))


def test_the_graph_holds_only_free_ways(mean_tissue):
    _, distance = mean_tissue
    graph = lumen_graph(distance)
    sample = np.random.default_rng(0).integers(0, len(graph.ends), 3000)
    a, b = (graph.points_mm[graph.ends[sample, k]] for k in (0, 1))
    for t in (0.25, 0.5, 0.75):
        assert (distance.exact((1 - t) * a + t * b) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(a - b, axis=1), graph.length_mm[sample])


@settings(max_examples=50)
@given(st.lists(st.tuples(*[st.floats(-50, 50)] * 3), min_size=2, max_size=20), st.floats(0.1, 5))
def test_resampling_keeps_ends_and_never_lengthens(points, step):
    points = np.array(points)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    if length < 1e-3:
        return
    out = resample(points, step)
    np.testing.assert_allclose(out[[0, -1]], points[[0, -1]], atol=1e-9)
    gaps = np.linalg.norm(np.diff(out, axis=0), axis=1)
    assert gaps.sum() <= length * (1 + 1e-9)
    assert gaps.max() <= max(1.51 * step, length * (1 + 1e-9) if length < 1.5 * step else 0)


def test_a_way_too_narrow_for_the_grid_is_found_on_a_finer_one():
    """A roomy tube with a thin one beside it: nodes 2 mm apart miss the thin one, and its neighbour stays as it was."""
    thin = trimesh.creation.cylinder(radius=0.8, height=40.0, sections=48)
    thin.apply_translation([1.0 + 0.8, 0.0, 20.0])
    wide = trimesh.creation.cylinder(radius=6.0, height=40.0, sections=64)
    wide.apply_translation([0.0, 0.0, -20.0])
    anatomy = anatomy_of(trimesh.boolean.union([wide, thin], engine="manifold"))
    coarse = signed_distance(anatomy, 2.0)
    ends = [np.array([0.0, 0.0, z]) for z in (-38.0, -4.0)]
    routes = [Route("wide", *ends), Route("thin", ends[1], np.array([1.8, 0.0, 38.0]))]
    with pytest.raises(PoseError, match=r"within 5 mm"):
        find_passages(anatomy, coarse, routes)
    found = find_passages(anatomy, coarse, routes, finer_mm=0.4)
    assert [passage.name for passage in found] == ["wide", "thin"]
    (alone,) = find_passages(anatomy, coarse, routes[:1])
    np.testing.assert_array_equal(found[0].points_mm, alone.points_mm)
    assert found[1].points_mm[-1, 2] > 35.0
    lies_inside(found[1], coarse)
