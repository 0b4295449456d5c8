"""Named points of the built-in nose."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from naris.anatomy.builtin.implicit import Field, Grid
from naris.anatomy.builtin.layout import Y_TIP_MM, Z_FLOOR_MM, Layout
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.walls import lateral_wall_mm, septum_centre_mm, septum_thickness_mm
from naris.errors import InputError

Point = Float[np.ndarray, "3"]
SIDES = {"left": 1, "right": -1}
ON_THE_WALL = ("anterior tip", "posterior wall", "nasal floor")
_BEHIND_CHOANA_MM = 1.0
_SEARCH_MM = (2.0, 3.5, 5.0)


def landmarks_mm(p: NoseParameters, at: Layout, clearance_mm: Field, grid: Grid) -> dict[str, Point]:
    """Points in mm in the frame of the nose, those of a side called `left.` or `right.`.

    Those in `ON_THE_WALL` lie near the mucosa as the parameters say, a choana as `choana_mm` says,
    all others where the air around there is roomiest.

    Raises:
        InputError: if there is no air at one of them.
    """
    z = Z_FLOOR_MM
    points = {
        "anterior tip": np.array([0.0, Y_TIP_MM, z - 4]),
        "posterior wall": np.array([0.0, at.y_posterior_wall, z + 0.4 * p.choana_height_mm]),
        "nasopharynx": np.array([0.0, at.y_choana + 0.5 * p.nasopharynx_depth_mm, z + 0.4 * p.choana_height_mm]),
    }
    for name, side in SIDES.items():
        points |= {f"{name}.{what}": point for what, point in _of_side(p, at, side).items()}
    found = {
        name: point if name.endswith(ON_THE_WALL) else _roomiest(point, clearance_mm, grid, name)
        for name, point in points.items()
    }
    return found | {f"{name}.choana": choana_mm(p, at, side, clearance_mm > 0, grid) for name, side in SIDES.items()}


def choana_mm(p: NoseParameters, at: Layout, side: int, air: Bool[np.ndarray, "nx ny nz"], grid: Grid) -> Point:
    """The middle of one choana: of the air of its side in the coronal section 1 mm behind `y_choana`.

    From the nasal floor up to the arch of the choana; the centroid of the area, or the node of air nearest to it where
    that is tissue (by a turbinate's tail, say). There the posterior border of the septum begins, which leans backwards.

    Raises:
        InputError: if there is no air.
    """
    y_mm = at.y_choana + _BEHIND_CHOANA_MM
    row = int(np.abs(grid.y_mm - y_mm).argmin())
    of_side = side * (grid.x_mm[:, None] - septum_centre_mm(p, at, np.array([y_mm]), grid.z_mm)) > 0
    within = (grid.z_mm >= Z_FLOOR_MM) & (grid.z_mm <= Z_FLOOR_MM + p.choana_height_mm)
    nodes = np.argwhere(air[:, row] & of_side & within)
    if not len(nodes):
        raise InputError("air at the choana", "a nose that is closed there", "widen the choanae")
    middle = nodes.mean(axis=0)
    nearest = nodes[np.linalg.norm(nodes - middle, axis=1).argmin()]
    i, k = middle if (np.abs(nearest - middle) <= 0.5).all() else nearest
    return np.array([grid.x_mm[0] + i * grid.spacing_mm, y_mm, grid.z_mm[0] + k * grid.spacing_mm], dtype=np.float64)


def _of_side(p: NoseParameters, at: Layout, side: int) -> dict[str, Point]:
    def medial(y: float, height: float, out_mm: float) -> Point:
        """A point that lies `out_mm` lateral to the septal mucosa."""
        level = at.z_at(height)
        where = np.array([y]), np.array([level])
        u = side * septum_centre_mm(p, at, *where)[0, 0] + septum_thickness_mm(p, at, *where)[0, 0] / 2
        return np.array([side * (float(u) + out_mm), y, level])

    def lateral(y: float, height: float, in_mm: float) -> Point:
        """A point that lies `in_mm` medial to the lateral wall."""
        level = at.z_at(height)
        u = float(lateral_wall_mm(p, at, np.array([y]), np.array([level]))[0, 0])
        return np.array([side * (u - in_mm), y, level])

    middle_y = at.y_middle_head + 0.35 * (at.y_middle_tail - at.y_middle_head)
    inferior_y = at.y_inferior_head + 0.5 * (at.y_inferior_tail - at.y_inferior_head)
    tube_y, tube_z = at.y_choana + 0.4 * p.nasopharynx_depth_mm - 0.8, Z_FLOOR_MM + 0.36 * p.choana_height_mm - 1.6
    low = 0.5 * p.inferior_floor_gap_mm + 0.5
    return {
        "nostril": np.array([side * (p.columella_width_mm + p.nostril_width_mm) / 2, at.y_nostril, at.z_nostril + 2]),
        "valve": medial(at.y_valve, 7.0, 2.5),
        "nasal floor": medial(at.y_inferior_head + 20, 0.0, 5.0),
        "common meatus": medial(inferior_y, 7.0, 0.5 * p.common_meatus_width_mm),
        "inferior meatus entrance": medial(inferior_y - 4, low, p.common_meatus_width_mm + p.inferior_thickness_mm / 2),
        "inferior meatus": lateral(inferior_y, 10.0, 1.8),
        "middle meatus": lateral(middle_y, 20.0, 2.6),
        "olfactory approach": medial(middle_y, 26.0, 0.5 * p.middle_olfactory_gap_mm),
        "superior meatus": medial(at.y_superior_tail - 1, 31.0, 1.6),
        "olfactory cleft": medial(at.y_superior_head, 37.0, 0.5 * p.olfactory_cleft_width_mm),
        "choana approach": medial(at.y_choana - 1, 0.45 * p.choana_height_mm, 0.5 * p.choana_width_mm),
        "eustachian opening": np.array([side * (p.nasopharynx_width_mm / 2 - 2.4), tube_y, tube_z]),
    }


def _roomiest(point_mm: Point, clearance_mm: Field, grid: Grid, name: str) -> Point:
    """The node with the most clearance near a point: within the first of `_SEARCH_MM` along each axis with any air."""
    for reach_mm in _SEARCH_MM:
        window = grid.window(tuple((point_mm - reach_mm).tolist()), tuple((point_mm + reach_mm).tolist()))
        near = clearance_mm[window]
        if near.size and near.max() > 0:
            best = np.unravel_index(int(near.argmax()), near.shape)
            axes = (grid.x_mm, grid.y_mm, grid.z_mm)
            return np.array([axis[s][i] for axis, s, i in zip(axes, window, best, strict=True)], dtype=np.float64)
    raise InputError(f"air at the {name}", "a nose that is closed there", "widen the passages")
