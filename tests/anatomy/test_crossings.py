"""Where meshes pass through themselves: against slow references and shapes that are known, and how it is undone."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from naris.anatomy.builtin.variation import virtual_patient
from naris.anatomy.crossings import crossings, uncrossed


def told(vertices: object, faces: object) -> list[list[int]]:
    return crossings(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int32)).tolist()


def slowly(vertices: np.ndarray, faces: np.ndarray) -> list[list[int]]:
    """Of faces in no special position: every edge against every face, by solving for where they meet."""

    def meet(edge: tuple[int, int], face: np.ndarray) -> bool:
        if set(edge) & set(face.tolist()):
            return False
        (p, q), (a, b, c) = vertices[list(edge)], vertices[face]
        along, u, v = np.linalg.solve(np.stack([q - p, a - b, a - c], axis=1), a - p)
        return bool(0 <= along <= 1 and u >= 0 and v >= 0 and u + v <= 1)

    def edges(face: np.ndarray) -> list[tuple[int, int]]:
        return list(combinations(face.tolist(), 2))

    return [
        [i, j]
        for i, j in combinations(range(len(faces)), 2)
        if any(meet(edge, faces[j]) for edge in edges(faces[i]))
        or any(meet(edge, faces[i]) for edge in edges(faces[j]))
    ]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31), vertices=st.integers(5, 40), faces=st.integers(2, 40), flat=st.sampled_from([1, 0.01])
)
def test_the_same_pairs_as_by_every_edge_against_every_face(seed: int, vertices: int, faces: int, flat: float) -> None:
    """Few vertices, so that many faces share one or two of them; some of the clouds are nearly flat."""
    rng = np.random.default_rng(seed)
    cloud = rng.standard_normal((vertices, 3)) * [1, 1, flat] * rng.choice([1e-3, 1, 1e3]) + rng.choice([0, 100.0])
    chosen = np.unique(np.sort(np.stack([rng.permutation(vertices)[:3] for _ in range(faces)]), axis=1), axis=0)
    assert told(cloud, chosen) == slowly(cloud, chosen)


def test_small_faces_among_large_ones_and_many_strips() -> None:
    rng = np.random.default_rng(3)
    corner = rng.uniform(0, 100, (300, 1, 3)) * [1, 0.8, 0.1]
    cloud = (corner + rng.standard_normal((300, 3, 3)) * rng.choice([1, 4, 60], (300, 1, 1))).reshape(-1, 3)
    faces = np.arange(900).reshape(-1, 3)
    found = told(cloud, faces)
    assert len(found) > 50
    assert found == slowly(cloud, faces)


FACE = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]


@pytest.mark.parametrize(
    ("more", "other", "cross"),
    [
        ([[1, 1, -1], [1, 1, 1], [9, 9, 1]], [3, 4, 5], True),  # an edge through the middle
        ([[1, 1, 0], [1, 1, 1], [9, 9, 1]], [3, 4, 5], False),  # a vertex that touches it
        ([[1, 1, 0], [2, 1, 0], [1, 1, 3]], [3, 4, 5], False),  # an edge that lies on it
        ([[1, 1, 0], [9, 1, 0], [1, 9, 0]], [3, 4, 5], True),  # flat on it
        ([[0, 4, 0], [4, 0, 0], [4, 4, 0]], [3, 4, 5], False),  # flat beside it, at the same place as its edge
        ([[2, 2, 0], [4, 4, 0], [4, 2, 0]], [3, 4, 5], False),  # flat, corner on edge
        ([[1, 1, 0.1], [9, 1, 0.1], [1, 9, 0.1]], [3, 4, 5], False),  # above it
        ([[4, 4, 0]], [2, 1, 3], False),  # over a shared edge, flat
        ([[4, 4, 3]], [2, 1, 3], False),
        ([[1, 1, 0]], [2, 1, 3], True),  # folded flat onto it over a shared edge
        ([[1, 1, 1e-6]], [2, 1, 3], False),
        ([[1, 1, -1], [2, 1, 1]], [0, 3, 4], True),  # one shared vertex, the edge across passes through
        ([[1, 1, 1], [2, 1, 1]], [0, 3, 4], False),
        ([[-1, -1, -1], [-2, -1, 1]], [0, 3, 4], False),
        ([[1, 1, 0], [-1, 2, 0]], [0, 3, 4], True),  # one shared vertex, flat on it
        ([[-1, 1, 0], [-1, 2, 0]], [0, 3, 4], False),
        ([[2, 2, 1], [2, 2, -1]], [0, 3, 4], True),  # by the rim
        ([[1, 0, -1], [-1, 0, 1]], [0, 3, 4], False),  # without area, through the shared vertex alone
        ([], [0, 1, 2], True),  # twice the same
    ],
)
def test_two_faces(more: list[list[float]], other: list[int], cross: bool) -> None:
    for turn in range(3):
        vertices = np.roll(np.array([*FACE, *more], dtype=np.float64), turn, axis=1)
        for faces in ([[0, 1, 2], other], [other, [0, 1, 2]], [[0, 1, 2], other[::-1]], [[1, 2, 0], np.roll(other, 1)]):
            assert bool(told(vertices, faces)) == cross


def test_closed_shapes_do_not_cross_themselves() -> None:
    for mesh in (trimesh.creation.icosphere(3), trimesh.creation.box(), trimesh.creation.torus(10, 2)):
        assert told(mesh.vertices, mesh.faces) == []
    grid = np.stack(np.meshgrid(*[np.arange(20.0)] * 2, [0.0]), axis=-1).reshape(-1, 3)  # all flat
    corner = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()
    quads = np.stack([corner, corner + 1, corner + 21, corner + 20], axis=1)
    assert told(grid, np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])) == []


def test_a_sphere_pushed_through_its_far_side_crosses_along_a_circle() -> None:
    ball = trimesh.creation.icosphere(4)
    vertices = np.array(ball.vertices)
    vertices[:, 2] = np.where(vertices[:, 2] > 0.5, 1.0 - 5 * (vertices[:, 2] - 0.5), vertices[:, 2])
    found = crossings(vertices, np.asarray(ball.faces))
    assert len(found) > 20
    where = vertices[ball.faces[found.ravel()]].mean(axis=1)
    pushed, far = (ball.triangles_center[found[:, k], 2] for k in range(2))
    assert (np.maximum(pushed, far) > 0.5).all() and (np.minimum(pushed, far) < -0.5).all()
    assert np.ptp(where[:, 2]) < 0.4


def test_two_spheres_cross_in_the_pairs_that_vtk_cuts() -> None:
    pyvista = pytest.importorskip("pyvista")
    one, other = trimesh.creation.icosphere(3), trimesh.creation.icosphere(3)
    other.apply_translation([0.713, 0.311, 0.177])
    line, _, _ = pyvista.wrap(one).intersection(pyvista.wrap(other))
    theirs = np.stack([line.cell_data[f"Input{k}CellID"] for k in range(2)], axis=1) + [0, len(one.faces)]
    both = trimesh.util.concatenate([one, other])
    assert told(both.vertices, both.faces) == np.unique(theirs, axis=0).tolist()


def test_what_crosses_is_taken_back_and_nothing_else() -> None:
    ball = trimesh.creation.icosphere(4)
    begin, faces = np.array(ball.vertices), np.asarray(ball.faces, dtype=np.int32)
    end = 1.1 * begin
    end[np.argsort(begin[:, 2])[-5:], 2] -= 3.0
    assert len(crossings(end, faces))
    there = uncrossed(begin, end, faces)
    assert len(crossings(there, faces)) == 0
    assert 0.9 < (there == end).all(axis=1).mean() < 1
    assert uncrossed(begin, 1.1 * begin, faces).tobytes() == (1.1 * begin).tobytes()


def test_what_crosses_at_the_beginning_is_left_as_it_was_there() -> None:
    ball = trimesh.creation.icosphere(2)
    both = trimesh.util.concatenate([ball, ball.copy().apply_translation([0.7, 0.3, 0.1])])
    begin, faces = np.asarray(both.vertices), np.asarray(both.faces, dtype=np.int32)
    there = uncrossed(begin, begin * 1.3, faces)
    wrong = crossings(there, faces)
    assert len(wrong)
    assert np.array_equal(there[faces[wrong.ravel()]], begin[faces[wrong.ravel()]])


@pytest.mark.long
def test_some_noses_within_the_normal_ranges_do_not_cross_themselves() -> None:
    for number in range(4):
        nose = virtual_patient(0, number)
        assert len(crossings(nose.vertices_mm, nose.faces)) == 0


def test_pairs_asked_for_are_those_of_all_with_one_of_the_faces() -> None:
    rng = np.random.default_rng(3)
    vertices, faces = rng.uniform(-1, 1, (40, 3)), rng.integers(0, 40, (120, 3))
    faces = faces[(np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)]
    asked = rng.random(len(faces)) < 0.2
    everything = crossings(vertices, faces)
    expected = everything[asked[everything].any(axis=1)]
    assert 0 < len(expected) < len(everything)
    assert np.array_equal(crossings(vertices, faces, asked), expected)
