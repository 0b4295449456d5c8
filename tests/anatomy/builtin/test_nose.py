"""The built-in nose as a whole: a closed surface, sides as they should be, and honest refusals."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from naris.anatomy.builtin import NORMAL_RANGES, NoseParameters, built_in_nose
from naris.core.anatomy import Anatomy
from naris.errors import InputError


@pytest.fixture(scope="module")
def nose() -> Anatomy:
    return built_in_nose()


@pytest.fixture(scope="module")
def mesh(nose: Anatomy) -> trimesh.Trimesh:
    return trimesh.Trimesh(nose.vertices_mm, nose.faces, process=False)


def test_surface_is_closed_manifold_and_in_one_piece(mesh: trimesh.Trimesh) -> None:
    edges = np.sort(mesh.edges, axis=1)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    assert (uses == 2).all()
    assert mesh.is_winding_consistent
    assert len(mesh.split(only_watertight=False)) == 1
    assert mesh.euler_number % 2 == 0


def test_normals_point_out_of_the_lumen(mesh: trimesh.Trimesh) -> None:
    assert mesh.volume > 0  # divergence theorem: positive only when normals point out of the enclosed lumen


def test_left_is_positive_x(nose: Anatomy) -> None:
    names = nose.regions["anatomical"].names
    for side, sign in (("left", 1), ("right", -1)):
        for name, point in nose.landmarks_mm.items():
            if name.startswith(f"{side}."):
                assert sign * point[0] > 0, name
                label = int(nose.regions["anatomical"].label(point))
                assert label >= 0 and names[label].split()[0] in (side, "nasopharynx"), name


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -3.0, 1e6])
@pytest.mark.parametrize("name", ["cavity_length_mm", "choana_width_mm"])
def test_absurd_parameters_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        NoseParameters(**{name: value})


def test_defaults_lie_in_their_normal_ranges() -> None:
    for name, normal in NORMAL_RANGES.items():
        assert normal.minimum <= normal.low <= getattr(NoseParameters(), name) <= normal.high <= normal.maximum, name
