"""The septum of a normal nose is whole, however uneven its walls are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from naris.anatomy.builtin import NoseParameters
from naris.anatomy.builtin.field import grid_for, lumen_field
from naris.anatomy.builtin.layout import Z_FLOOR_MM, layout_of
from naris.anatomy.builtin.nose import Shape, shape_of
from naris.anatomy.builtin.septum import whole_septum
from naris.anatomy.builtin.variation import drawn_parameters
from naris.anatomy.builtin.walls import septum_centre_mm


def on_the_middle_sheet(shape: Shape, parameters: NoseParameters) -> np.ndarray:
    """The lumen on the middle of the septum, 2 mm and more in front of its posterior border."""
    at, grid = shape.at, shape.grid
    middle = septum_centre_mm(parameters, at, grid.y_mm, grid.z_mm)
    j, k = np.indices(middle.shape)
    values = ndimage.map_coordinates(shape.lumen, [(middle - grid.x_mm[0]) / grid.spacing_mm, j, k], order=1)
    border = at.y_choana - 0.5 + 0.15 * (grid.z_mm - Z_FLOOR_MM)
    return values[grid.y_mm[:, None] < border[None] - 2.0]


@pytest.mark.slow
@pytest.mark.parametrize("number", [3, 5, 6, 7, 9, 16, 20, 23, 24, 27, 28, 29])
def test_the_middle_of_the_septum_is_tissue(number: int) -> None:
    parameters = drawn_parameters(np.random.default_rng([0, number]))
    assert on_the_middle_sheet(shape_of(parameters), parameters).max() < 0


def test_a_thin_and_uneven_septum_is_mended() -> None:
    uneven = NoseParameters(septum_thickness_mm=2.0, irregularity_mm=0.6)
    assert on_the_middle_sheet(shape_of(uneven, 0.8), uneven).max() < 0


def test_a_hole_is_closed_by_a_millimetre_and_a_half_and_nothing_else_changes() -> None:
    plain = NoseParameters(irregularity_mm=0.0, septum_deviation_mm=0.0)
    at = layout_of(plain)
    grid = grid_for(plain, at, 0.5)
    whole = lumen_field(plain, at, grid)
    assert whole_septum(plain, at, grid, whole) is whole
    hole = whole.copy()
    near = (np.abs(grid.x) < 4) & (np.hypot(grid.y + 10, grid.z + 4) < 3)
    hole[near] = 1.0
    mended = whole_septum(plain, at, grid, hole)
    across = mended[:, np.argmin(abs(grid.y_mm + 10)), np.argmin(abs(grid.z_mm + 4))] < 0
    assert 1.4 <= np.ptp(grid.x_mm[across & (np.abs(grid.x_mm) < 3)]) + grid.spacing_mm <= 2.3
    far = np.hypot(grid.y + 10, grid.z + 4) > 3 + 3
    assert (mended == hole)[np.broadcast_to(far, hole.shape)].all()
