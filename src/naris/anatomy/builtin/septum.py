"""Keeps the septum whole: where uneven walls would meet through it, it stays a sheet of tissue.

A septum of 2 mm, thinner on top, can be less than its walls are uneven, and a normal septum has no hole.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from naris.anatomy.builtin.implicit import Field, Grid, step
from naris.anatomy.builtin.layout import Z_FLOOR_MM, Layout
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.walls import Sheet, septum_centre_mm

_LEAST_HALF_MM = 0.85
"""Half of what is left where the septum is mended; softening takes about 0.1 mm of it."""
_THIN_MM, _PIERCED_MM = 0.25, 0.05
"""Depth of the middle of the septum in the tissue: above the first it is left as it is, below the second mended."""
_AROUND_MM = 1.3
_BORDER_MM = 1.5


def whole_septum(p: NoseParameters, at: Layout, grid: Grid, lumen: Field) -> Field:
    """The lumen with at least about 1.5 mm of septum where it would have had a hole or nearly so, else unchanged.

    In front of the posterior border alone: there the nasopharynx begins (see `nasopharynx`).
    """
    middle = septum_centre_mm(p, at, grid.y_mm, grid.z_mm)
    in_front = grid.y - _border_mm(at, grid)
    weight = step(_along(middle, grid, lumen), -_THIN_MM, -_PIERCED_MM) * (in_front[0] < 0)
    if not weight.any():
        return lumen
    nodes = 2 * round(_AROUND_MM / grid.spacing_mm) + 1
    half_mm = _LEAST_HALF_MM * ndimage.maximum_filter(weight, nodes)
    slope_y, slope_z = np.gradient(middle, grid.spacing_mm)
    beside = np.abs(grid.x - middle[None]) / np.sqrt(1 + slope_y**2 + slope_z**2)[None]
    tissue = (half_mm > 0)[None] & (beside < half_mm[None]) & (in_front < 0)
    outside = np.maximum(beside - half_mm[None], in_front)
    return np.where(tissue, np.minimum(lumen, outside), lumen).astype(np.float32)


def _border_mm(at: Layout, grid: Grid) -> Field:
    """y of a line a little in front of the posterior border of the septum."""
    return at.y_choana - 0.5 + 0.15 * (grid.z - Z_FLOOR_MM) - _BORDER_MM


def _along(middle_mm: Sheet, grid: Grid, lumen: Field) -> Sheet:
    """The lumen on the middle of the septum, between the two nodes beside it."""
    where = np.clip((middle_mm - grid.x_mm[0]) / grid.spacing_mm, 0, len(grid.x_mm) - 1.001)
    low = where.astype(int)[None]
    one, other = (np.take_along_axis(lumen, low + k, axis=0)[0] for k in (0, 1))
    return one + (where - low[0]) * (other - one)
