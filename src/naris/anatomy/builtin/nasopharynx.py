"""The nasopharynx behind the choanae: roof, posterior wall, pharyngeal recesses, torus and Eustachian openings."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

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
    lateral = _half_width_mm(p, at, grid) - width
    # The adenoid pad: the posterior wall bulges in the midline, high up, in shallow folds.
    folds = 1.0 - 0.22 * np.cos(2 * np.pi * grid.x / 5.5)
    pad = 1.8 * folds * bump(grid.x, 0, 5.5) * bump(z, Z_FLOOR_MM + 0.62 * p.choana_height_mm, 6.5)[None, None, :]
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


def _half_width_mm(p: NoseParameters, at: Layout, grid: Grid) -> Float[np.ndarray, "1 ny nz"]:
    """From the midline to the lateral wall: the choanae in front, the pharyngeal recesses behind, narrower on top."""
    choana, recess = p.septum_thickness_mm / 2 + p.choana_width_mm, p.nasopharynx_width_mm / 2
    depth = p.nasopharynx_depth_mm
    along = profile(
        [
            (at.y_choana - 1, choana - 0.2),
            (at.y_choana + 0.4 * depth, choana + 0.8),
            (at.y_choana + 0.75 * depth, recess),
            (at.y_choana + depth + 2, recess),
        ],
        grid.y_mm,
    )
    vault = 3.0 * bump((grid.z_mm - Z_FLOOR_MM) / p.choana_height_mm, 1.0, 0.25)
    return along[None, :, None] - vault[None, None, :]


def with_tubes(p: NoseParameters, at: Layout, grid: Grid, lumen: Field) -> Field:
    """Adds on both sides the torus, the Eustachian opening in front of it and the pharyngeal recess behind it."""
    depth = p.nasopharynx_depth_mm
    half = p.nasopharynx_width_mm / 2
    y, z = at.y_choana + 0.40 * depth, Z_FLOOR_MM + 0.36 * p.choana_height_mm
    r = p.torus_radius_mm
    for side in (-1, 1):
        ends = sorted((side * (half - 11), side * (half + 8)))
        window = grid.window((ends[0], y - 16, z - 22), (ends[1], y + 16, z + 18))
        part = grid.part(window)
        arch = [
            (half - 1.0, y - 0.26 * depth, z + 1.0, 0.40 * r),
            (half - 1.6, y - 0.12 * depth, z + 4.4, 0.65 * r),
            (half - 2.2, y + 0.08 * depth, z + 5.2, 0.95 * r),
            (half - 2.4, y + 0.22 * depth, z + 2.4, 1.05 * r),
            (half - 2.0, y + 0.25 * depth, z - 2.6, 0.85 * r),
            (half - 1.2, y + 0.23 * depth, z - 8.0, 0.55 * r),
            (half - 0.3, y + 0.20 * depth, z - 15.0, 0.30 * r),
        ]
        mouth = [
            (half - 2.8, y + 0.5, z + 1.2, 1.6),
            (half - 2.4, y - 0.8, z - 1.6, 2.0),
            (half + 0.8, y + 0.6, z + 0.2, 1.6),
            (half + 3.0, y + 1.6, z + 1.8, 1.0),
            (half + 5.0, y + 2.4, z + 3.0, 0.4),
        ]
        recess = [
            (half - 2.2, y + 0.45 * depth, z + 6.0, 1.8),
            (half - 0.4, y + 0.46 * depth, z + 2.0, 2.2),
            (half - 0.4, y + 0.46 * depth, z - 5.0, 1.8),
        ]
        air, torus, pit = lumen[window], *(tube(part, _mirrored(line, side)) for line in (arch, recess))
        air = smooth_max(air, -pit, 2.5)
        air = smooth_min(air, torus, 2.0)
        lumen[window] = smooth_max(air, -tube(part, _mirrored(mouth, side)), 1.2)
    return lumen


def _mirrored(line: list[tuple[float, float, float, float]], side: int) -> Float[np.ndarray, "n 4"]:
    """A polyline of (u, y, z, radius) with u turned into x of a side."""
    points = np.array(line)
    points[:, 0] *= side
    return points
