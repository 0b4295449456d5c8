"""The choana is the middle of its section, in every nose at the same place."""

from __future__ import annotations

import numpy as np
import pytest

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.builtin.field import grid_for
from naris.anatomy.builtin.landmarks import SIDES, choana_mm
from naris.anatomy.builtin.layout import Z_FLOOR_MM, layout_of
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.variation import drawn_parameters
from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Anatomy


def test_the_choana_is_the_middle_of_the_air_of_its_side(nose: Anatomy) -> None:
    p = NoseParameters()
    y_mm = layout_of(p).y_choana + 1
    x, z = np.meshgrid(np.arange(-25, 25, 0.2), np.arange(Z_FLOOR_MM, Z_FLOOR_MM + p.choana_height_mm, 0.2))
    points = np.stack([x, np.full_like(x, y_mm), z], axis=-1)
    inside = signed_distance(nose, 1.0).inside(points)
    for name, side in SIDES.items():
        middle = points[inside & (side * x > 0)].mean(axis=0)
        assert np.linalg.norm(nose.landmarks_mm[f"{name}.choana"] - middle) < 0.5


@pytest.mark.slow
@pytest.mark.parametrize("number", range(6))
def test_choanae_of_drawn_noses_lie_alike(number: int) -> None:
    p = drawn_parameters(np.random.default_rng([0, number]))
    at, nose = layout_of(p), built_in_nose(p, passages=False)
    left, right = (nose.landmarks_mm[f"{side}.choana"] for side in SIDES)
    assert np.abs(left * [-1, 1, 1] - right).max() < 1.5
    for name, point in (("left", left), ("right", right)):
        assert point[1] == at.y_choana + 1
        assert 0.4 < (point[2] - Z_FLOOR_MM) / p.choana_height_mm < 0.55
        regions = nose.regions["anatomical"]
        assert regions.names[int(regions.label(point))] == f"{name} posterior cavity and choana"


def test_a_middle_in_tissue_moves_to_the_nearest_air_of_its_side() -> None:
    p = NoseParameters()
    at = layout_of(p)
    grid = grid_for(p, at, 1.0)
    x, z = grid.x, grid.z
    ring = (np.abs(np.hypot(x - 7, z + 8) - 4) < 1.2) & (np.abs(grid.y - at.y_choana) < 3)
    point = choana_mm(p, at, 1, np.broadcast_to(ring, grid.shape), grid)
    assert np.hypot(point[0] - 7, point[2] + 8) == pytest.approx(4, abs=1.3)
