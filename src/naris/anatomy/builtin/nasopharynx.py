"""The nasopharynx behind the choanae: roof, posterior wall, pharyngeal recesses, torus and Eustachian openings."""

from __future__ import annotations

import numpy as np

from naris.anatomy.builtin.implicit import Field, Grid, bump, profile, smooth_max, smooth_min, smooth_min_of, tube
from naris.anatomy.builtin.layout import Z_FLOOR_MM, Layout
from naris.anatomy.builtin.parameters import NoseParameters

PALATE_DROP_MM = 14.0
"""How far below the nasal floor the nasopharynx is closed off, behind the soft palate."""


def nasopharynx(p: NoseParameters, at: Layout, grid: Grid) -> Field:
    """The whole nasopharynx, on a grid of (x, y, z)."""
    y, z, width = grid.y_mm, grid.z_mm, np.abs(grid.x)
    depth = p.nasopharynx_depth_mm
    back = at.y_choana + depth
    roof = profile(
        [
            (at.y_choana - 1, Z_FLOOR_MM + p.choana_height_mm - 0.5),
            (at.y_choana + 0.35 * depth, Z_FLOOR_MM + p.choana_height_mm + 0.5),
            (at.y_choana + 0.7 * depth, Z_FLOOR_MM + p.choana_height_mm - 3.5),
            (back, Z_FLOOR_MM + 0.45 * p.choana_height_mm),
        ],
        y,
    )
    floor = profile(
        [
            (at.y_choana - 2, Z_FLOOR_MM + 0.4),
            (at.y_choana + 0.25 * depth, Z_FLOOR_MM - 0.6),
            (at.y_choana + 0.5 * depth, Z_FLOOR_MM - 4.0),
            (at.y_choana + 0.7 * depth, Z_FLOOR_MM - 10.5),
            (at.y_choana + 0.8 * depth, Z_FLOOR_MM - PALATE_DROP_MM - 3),
        ],
        y,
    )
    steep = np.sqrt(1 + np.gradient(floor, grid.spacing_mm) ** 2).astype(np.float32)
    choana = p.septum_thickness_mm / 2 + p.choana_width_mm
    half = (
        profile(
            [
                (at.y_choana - 1, choana - 0.2),
                (at.y_choana + 0.4 * depth, choana + 0.8),
                (at.y_choana + 0.75 * depth, p.nasopharynx_width_mm / 2),
                (back + 2, p.nasopharynx_width_mm / 2),
            ],
            y,
        )[None, :, None]
        - (3.0 * bump((z - Z_FLOOR_MM) / p.choana_height_mm, 1.0, 0.25))[None, None, :]
    )
    lateral = half - width
    # adenoid pad: the posterior wall bulges in the midline, high up
    pad = 1.6 * bump(grid.x, 0, 5.0) * bump(z, Z_FLOOR_MM + 0.62 * p.choana_height_mm, 6.0)[None, None, :]
    lean = 0.10 * (z - Z_FLOOR_MM)[None, None, :]
    posterior = back - lean - pad - grid.y
    front = grid.y - (at.y_choana - 0.5 + 0.15 * (grid.z - Z_FLOOR_MM))
    lumen = smooth_min_of(
        6.0,
        lateral.astype(np.float32),
        posterior.astype(np.float32),
        (roof[None, :, None] - grid.z).astype(np.float32),
    )
    lumen = smooth_min(lumen, ((grid.z - floor[None, :, None]) / steep[None, :, None]).astype(np.float32), 5.0)
    lumen = smooth_min(lumen, (grid.z - (Z_FLOOR_MM - PALATE_DROP_MM) + 0 * width).astype(np.float32), 4.0)
    return smooth_min(lumen, front.astype(np.float32), 1.5)


def with_tubes(p: NoseParameters, at: Layout, grid: Grid, lumen: Field) -> Field:
    """Adds on both sides the Eustachian opening and the torus that arches over it."""
    depth = p.nasopharynx_depth_mm
    half = p.nasopharynx_width_mm / 2
    y, z = at.y_choana + 0.5 * depth, Z_FLOOR_MM + 0.36 * p.choana_height_mm
    r = p.torus_radius_mm
    for side in (-1, 1):
        mouth = np.array(
            [
                (side * (half - 3.0), y - 1.0, z - 0.5, 1.9),
                (side * (half + 1.5), y + 0.2, z + 1.0, 1.3),
                (side * (half + 4.5), y + 1.4, z + 2.6, 0.5),
            ]
        )
        arch = np.array(
            [
                (side * (half - 1.4), y - 0.28 * depth, z + 1.4, 0.45 * r),
                (side * (half - 1.8), y - 0.10 * depth, z + 4.2, 0.7 * r),
                (side * (half - 1.9), y + 0.10 * depth, z + 4.6, 0.95 * r),
                (side * (half - 1.8), y + 0.24 * depth, z + 1.6, 1.0 * r),
                (side * (half - 1.4), y + 0.26 * depth, z - 3.0, 0.8 * r),
                (side * (half - 0.8), y + 0.24 * depth, z - 9.0, 0.5 * r),
                (side * (half - 0.3), y + 0.22 * depth, z - 15.0, 0.3 * r),
            ]
        )
        window = grid.window(
            (min(side * (half - 10), side * (half + 8)), y - 14, z - 20),
            (max(side * (half - 10), side * (half + 8)), y + 14, z + 14),
        )
        part = grid.part(window)
        piece = smooth_min(lumen[window], tube(part, arch), 2.0)
        lumen[window] = smooth_max(piece, -tube(part, mouth), 1.2)
    return lumen
