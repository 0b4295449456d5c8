"""The cavity of one side without its turbinates: septum, lateral wall, floor, roof, nostril.

Coordinates of a side: u mm from the midline towards the lateral wall (x on the left, −x on the right), y and z as in
the frame. Heights are mm above the nasal floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from naris.anatomy.builtin.implicit import Field, Grid, bump, profile, smooth_min, smooth_min_of, step, table
from naris.anatomy.builtin.layout import Y_TIP_MM, Z_FLOOR_MM, Layout
from naris.anatomy.builtin.parameters import NoseParameters

Sheet = Float[np.ndarray, "ny nz"]


@dataclass(frozen=True, eq=False)
class Walls:
    """The two walls of a side over its sagittal plane, and its floor and roof over y.

    Attributes:
        medial_mm: (ny, nz) u of the septal mucosa.
        lateral_mm: (ny, nz) u of the lateral wall behind the turbinates.
        floor_mm, roof_mm: (ny,) z of floor and roof.
    """

    medial_mm: Sheet
    lateral_mm: Sheet
    floor_mm: Float[np.ndarray, "ny"]
    roof_mm: Float[np.ndarray, "ny"]


def septum_centre_mm(p: NoseParameters, at: Layout, y_mm: np.ndarray, z_mm: np.ndarray) -> Sheet:
    """x of the middle of the septum: one bow to the side of the deviation, a weaker counter-bow in front."""
    y, height = y_mm[:, None], (z_mm[None, :] - Z_FLOOR_MM) / at.height_scale
    bow = bump(y, at.y_middle_head + 4, 11) * bump(height, 17, 10)
    counter = bump(y, at.y_valve + 3, 6) * bump(height, 14, 9)
    return (p.septum_deviation_mm * (bow - 0.35 * counter)).astype(np.float32)


def septum_thickness_mm(p: NoseParameters, at: Layout, y_mm: np.ndarray, z_mm: np.ndarray) -> Sheet:
    """Columella, cartilage with its swell body, thin bony septum, broad foot on the maxillary crest."""
    y, height = y_mm[:, None], (z_mm[None, :] - Z_FLOOR_MM) / at.height_scale
    columella = step(y, at.y_valve - 2, at.y_sill - 2) * step(height, 7, -4)
    swell = bump(y, at.y_middle_head - 3, 7) * bump(height, 24, 6)
    foot = 1.8 * np.exp(-np.maximum(height, 0) / 1.8)
    thin = -0.25 * p.septum_thickness_mm * step(height, 28, 38) * step(y, at.y_middle_head, at.y_middle_head + 8)
    body = p.septum_thickness_mm + p.septal_swell_body_mm * swell + foot + thin
    return (body + (p.columella_width_mm - body) * columella).astype(np.float32)


def _spur_mm(p: NoseParameters, at: Layout, y_mm: np.ndarray, z_mm: np.ndarray) -> Sheet:
    """The crest above the vomer: rises from the floor backwards."""
    y = y_mm[:, None]
    height = (z_mm[None, :] - Z_FLOOR_MM) / at.height_scale
    along = step(y, at.y_inferior_head + 8, at.y_inferior_head + 20) * step(y, at.y_choana - 6, at.y_choana - 18)
    crest = 4 + 0.16 * (y - at.y_inferior_head)
    return (p.septal_spur_mm * along * bump(height, crest, 1.5)).astype(np.float32)


def _lateral_table(p: NoseParameters, at: Layout) -> tuple[list[float], list[float], np.ndarray]:
    """Stations along y, heights and u of the lateral wall, in the proportions of CT sections."""
    heights = [-11.0, -4.0, 0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 25.0, 31.0, 36.0, 43.0]
    low, mid = p.inferior_meatus_half_width_mm, p.middle_meatus_half_width_mm
    alar = p.columella_width_mm / 2 + p.nostril_width_mm
    top = p.septum_thickness_mm / 2 + 1.0
    slope = math.tan(math.radians(p.valve_angle_deg))
    valve = [top + max(0.0, 25 - h) * slope * (1.0 if h > 6 else 1.0 - 0.05 * (6 - h)) for h in heights]
    cleft = p.septum_thickness_mm / 2 + p.olfactory_cleft_width_mm
    choana = p.septum_thickness_mm / 2 + p.choana_width_mm
    span = at.y_sphenoid_face - at.y_middle_head
    aditus = [low * f for f in (0.45, 0.48, 0.49, 0.49, 0.48, 0.46, 0.43, 0.39, 0.34, 0.26)]
    head = [low * f for f in (0.60, 0.64, 0.66, 0.66, 0.65, 0.63, 0.58, 0.51, 0.44, 0.33)]
    belly = [low * f for f in (0.80, 0.84, 0.92, 0.99, 1.00, 0.96)] + [0.5 * (low + mid)]
    back = [low * f for f in (0.75, 0.78, 0.85, 0.92, 0.93, 0.90)] + [0.48 * (low + mid)]
    rows = [
        (Y_TIP_MM, [0.62 * alar + u for u in (0, 0, -0.2, -0.8, -1.5, -2, -2.4, -2.6, -2.8, -2.9, -3, -3)]),
        (at.y_nostril, [alar + u for u in (0, 0.7, 0.5, -0.9, -2.9, -4.4, -5.4, -6.0, -6.4, -6.6, -6.7, -6.7)]),
        (at.y_sill, [alar + u for u in (-0.6, 1.0, 0.9, -0.7, -3.0, -4.7, -5.6, -6.2, -6.6, -6.8, -7, -7)]),
        (at.y_valve, valve),
        (at.y_inferior_head - 1, [*aditus, cleft + 0.8, cleft]),
        (at.y_inferior_head + 5, [*head, cleft + 1.2, cleft]),
        (at.y_middle_head + 0.19 * span, [*belly, 0.93 * mid, 0.92 * mid, 0.64 * mid, cleft + 1.4, cleft + 0.5]),
        (at.y_middle_head + 0.47 * span, [*belly, mid, mid, 0.70 * mid, cleft + 1.6, cleft + 0.5]),
        (at.y_middle_head + 0.64 * span, [*belly, mid, mid, 0.76 * mid, cleft + 1.9, cleft + 0.5]),
        (at.y_middle_head + 0.84 * span, [*belly, mid, 0.98 * mid, 0.86 * mid, 0.64 * mid, cleft + 1.2]),
        (at.y_sphenoid_face, [*back, 0.96 * mid, 0.92 * mid, 0.82 * mid, 0.68 * mid, cleft + 2.0]),
        (at.y_choana, [choana + u for u in (-1.2, -1, -0.4, 0, 0, -0.2, -0.8, -1.6, -2.6, -4, -5, -6)]),
    ]
    return [y for y, _ in rows], heights, np.array([values for _, values in rows])


def lateral_wall_mm(p: NoseParameters, at: Layout, y_mm: np.ndarray, z_mm: np.ndarray) -> Sheet:
    """u of the lateral wall, with agger nasi, uncinate process and ethmoid bulla bulging into the middle meatus."""
    stations, heights, values = _lateral_table(p, at)
    z_rows = [at.z_at(h) for h in heights]
    wall = table(stations, z_rows, values, y_mm, z_mm)
    y, height = y_mm[:, None], (z_mm[None, :] - Z_FLOOR_MM) / at.height_scale
    head = at.y_middle_head
    agger = 1.6 * bump(y, head - 2, 3.5) * bump(height, 34, 4)
    ridge = 20 + 1.3 * (head + 10 - y)
    uncinate = 1.7 * bump(height, ridge, 1.5) * step(y, head - 1, head + 3) * step(y, head + 12, head + 8)
    bulla = 2.6 * bump(y, head + 14.5, 3.0) * bump(height, 27.5, 3.0)
    return (wall - agger - uncinate - bulla).astype(np.float32)


def floor_and_roof_mm(p: NoseParameters, at: Layout, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """z of the lower and the upper limit of the cavity along y."""
    z = Z_FLOOR_MM
    low = at.z_nostril - 6
    floor = profile(
        [
            (Y_TIP_MM, low),
            (at.y_sill - 2, low),
            (at.y_sill + 0.6, z - 5.5),
            (at.y_valve + 1, z - 1.2),
            (at.y_inferior_head + 2, z + 0.2),
            (at.y_inferior_head + 20, z),
            (at.y_choana, z + 0.6),
        ],
        y_mm,
    )
    arch = p.choana_height_mm
    span = at.y_sphenoid_face - at.y_middle_head
    roof = profile(
        [
            (Y_TIP_MM - 1, at.z_nostril + 2),
            (Y_TIP_MM + 1.5, z - 1.0),
            (at.y_nostril, z + 8),
            (at.y_sill, at.z_at(21)),
            (at.y_valve, at.z_at(27)),
            (at.y_inferior_head, at.z_at(35)),
            (at.y_middle_head, at.z_at(41)),
            (at.y_middle_head + 0.25 * span, at.z_roof),
            (at.y_sphenoid_face - 0.22 * span, at.z_roof - 0.5),
            (at.y_sphenoid_face - 2, at.z_roof - 3.5),
            (at.y_sphenoid_face + 1.5, max(at.z_roof - 11, z + arch + 3)),
            (at.y_choana - 1, z + arch + 0.8),
            (at.y_choana + 3, z + arch + 0.3),
        ],
        y_mm,
    )
    return floor, roof


def walls_of(p: NoseParameters, at: Layout, side: int, grid: Grid) -> Walls:
    """The walls of the left (+1) or right (−1) side; `grid.x_mm` is not used."""
    y, z = grid.y_mm, grid.z_mm
    septum = septum_centre_mm(p, at, y, z)
    convex = 1 if p.septum_deviation_mm >= 0 else -1
    medial = side * septum + septum_thickness_mm(p, at, y, z) / 2
    if side == convex:
        medial = medial + _spur_mm(p, at, y, z)
    floor, roof = floor_and_roof_mm(p, at, y)
    return Walls(medial.astype(np.float32), lateral_wall_mm(p, at, y, z), floor, roof)


def cavity(p: NoseParameters, at: Layout, walls: Walls, grid: Grid) -> Field:
    """One side without turbinates, from the capped nostril to 2 mm behind the choana, on a grid of (u, y, z)."""
    h = grid.spacing_mm
    medial = _upright(grid.x - walls.medial_mm[None], walls.medial_mm, h)
    lateral = _upright(walls.lateral_mm[None] - grid.x, walls.lateral_mm, h)
    floor = _level(grid.z - walls.floor_mm[None, :, None], walls.floor_mm, h)
    roof = _level(walls.roof_mm[None, :, None] - grid.z, walls.roof_mm, h)
    lumen = np.minimum(medial, lateral)
    lumen = smooth_min(lumen, floor, 4.5)
    lumen = smooth_min(lumen, _nostril(p, at, grid), 2.0)
    arch_mm = 2.0 + 4.0 * step(grid.y, at.y_sphenoid_face - 6, at.y_choana - 2)
    lumen = smooth_min(lumen, roof, arch_mm.astype(np.float32))
    plane = at.z_nostril + 0.14 * (at.y_sill - grid.y) - 0.05 * grid.x
    nostril = (grid.z - plane) + 0 * grid.y
    front = grid.y - Y_TIP_MM
    back = at.y_choana + 2.0 + 0.25 * (grid.z - Z_FLOOR_MM) - grid.y
    return smooth_min_of(1.0, lumen, nostril.astype(np.float32), front.astype(np.float32), back.astype(np.float32))


def _nostril(p: NoseParameters, at: Layout, grid: Grid) -> Field:
    """An oval tube whose axis leans towards the tip; far above the nostril it bounds nothing."""
    half_u, half_y = p.nostril_width_mm / 2 + 0.3, p.nostril_length_mm / 2
    off_u = grid.x - (p.columella_width_mm + p.nostril_width_mm) / 2 - 0.16 * (grid.y - at.y_nostril)
    off_y = grid.y - at.y_nostril
    oval = (1 - np.sqrt((off_u / half_u) ** 2 + (off_y / half_y) ** 2)) * min(half_u, half_y)
    release = 12 * step(grid.z, at.z_nostril + 1.5, Z_FLOOR_MM + 4.0)
    return (np.maximum(oval, -8) + release).astype(np.float32)


def _upright(gap: Field, sheet: Sheet, h: float) -> Field:
    """A gap along u made into a distance by the slope of the wall."""
    slope_y, slope_z = np.gradient(sheet, h)
    return gap / np.sqrt(1 + slope_y**2 + slope_z**2)[None].astype(np.float32)


def _level(gap: Field, height: np.ndarray, h: float) -> Field:
    """A gap along z made into a distance by the slope of floor or roof."""
    return (gap / np.sqrt(1 + np.gradient(height, h) ** 2)[None, :, None]).astype(np.float32)
