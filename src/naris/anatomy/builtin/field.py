"""The whole lumen as one field, and what else follows from the same parameters."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from naris.anatomy.builtin.implicit import Field, Grid, irregularity, smooth_max, smooth_min
from naris.anatomy.builtin.layout import Y_TIP_MM, Layout
from naris.anatomy.builtin.nasopharynx import PALATE_DROP_MM, nasopharynx, with_tubes
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.septum import whole_septum
from naris.anatomy.builtin.turbinates import (
    Turbinate,
    WallReader,
    inferior_turbinate,
    middle_turbinate,
    superior_turbinate,
    turbinate_field,
)
from naris.anatomy.builtin.walls import Walls, cavity, walls_of

LEFT, RIGHT = 1, -1
_MARGIN_MM = 2.4
_MEDIAL_REACH_MM = 8.0
_LEAST_SEPTAL_GAP_MM = 1.1
_WAVELENGTHS_MM = (12.0, 6.0, 3.2)
_AMPLITUDES = (0.75, 0.45, 0.15)


def grid_for(p: NoseParameters, at: Layout, resolution_mm: float) -> Grid:
    """A grid around the whole lumen whose voxels lie on multiples of the resolution (so x = 0 is one of them)."""
    reach = max(p.inferior_meatus_half_width_mm + 3, p.nasopharynx_width_mm / 2 + 5, 18.0) + _MARGIN_MM
    low_z = min(at.z_nostril - 3, -18 - PALATE_DROP_MM) - _MARGIN_MM
    ends = (
        (-reach, reach),
        (Y_TIP_MM - _MARGIN_MM, at.y_posterior_wall + 1 + _MARGIN_MM),
        (low_z, at.z_roof + _MARGIN_MM),
    )
    axes = [
        (np.arange(np.floor(a / resolution_mm), np.ceil(b / resolution_mm) + 1) * resolution_mm).astype(np.float32)
        for a, b in ends
    ]
    return Grid(axes[0], axes[1], axes[2], resolution_mm)


def turbinates_of(p: NoseParameters, at: Layout, walls: Walls, grid: Grid) -> tuple[Turbinate, ...]:
    """Inferior, middle and superior turbinate of the side that the walls belong to."""
    wall = WallReader(walls, grid)
    return inferior_turbinate(p, at, wall), middle_turbinate(p, at, wall), superior_turbinate(p, at, wall)


def side_field(p: NoseParameters, at: Layout, side: int, grid: Grid, rng: np.random.Generator) -> Field:
    """One side with its turbinates, on a grid of (u, y, z)."""
    walls = walls_of(p, at, side, grid)
    lumen = cavity(p, at, walls, grid)
    for turbinate in turbinates_of(p, at, walls, grid):
        wobble = _wobble(grid.y_mm, p.irregularity_mm, rng)
        body, window = turbinate_field(turbinate, grid, wobble)
        # No turbinate touches the septum: the common meatus stays open from floor to roof.
        beside_septum = (
            walls.medial_mm[None, window[1], window[2]] + np.float32(_LEAST_SEPTAL_GAP_MM) - grid.x[window[0]]
        )
        body = smooth_max(body, beside_septum, 1.0)
        lumen[window] = smooth_min(lumen[window], body, 1.1)
    return lumen


def lumen_field(p: NoseParameters, at: Layout, grid: Grid) -> Field:
    """Positive inside the lumen, about the distance to the wall near it."""
    rng = np.random.default_rng(p.irregularity_seed)
    lumen = nasopharynx(p, at, grid)
    x = grid.x_mm
    for side in (LEFT, RIGHT):
        keep = np.flatnonzero(side * x >= -_MEDIAL_REACH_MM)
        order = keep if side == LEFT else keep[::-1]
        half = Grid((side * x[order]).astype(np.float32), grid.y_mm, grid.z_mm, grid.spacing_mm)
        field = side_field(p, at, side, half, rng)
        lumen[order] = smooth_max(lumen[order], field, 1.5)
    lumen = with_tubes(p, at, grid, lumen)
    for wavelength, amplitude in zip(_WAVELENGTHS_MM, _AMPLITUDES, strict=True):
        lumen += np.float32(p.irregularity_mm * amplitude) * irregularity(grid, wavelength, rng)
    return whole_septum(p, at, grid, lumen)


def _wobble(y_mm: Float[np.ndarray, "ny"], amplitude_mm: float, rng: np.random.Generator) -> Float[np.ndarray, "ny 2"]:
    """A smooth random shift along the length of a turbinate: a few sines of 9–40 mm."""
    total = np.zeros((len(y_mm), 2))
    for wavelength in (40.0, 22.0, 13.0, 9.0):
        phase = rng.uniform(0, 2 * np.pi, 2)
        total += (wavelength / 40) ** 0.7 * np.sin(2 * np.pi * y_mm[:, None] / wavelength + phase)
    return 0.7 * amplitude_mm * total
