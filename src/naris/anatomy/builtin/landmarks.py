"""Named points of the built-in nose, and the ends of its passages."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from naris.anatomy.builtin.layout import Y_TIP_MM, Z_FLOOR_MM, Layout
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.walls import lateral_wall_mm, septum_centre_mm, septum_thickness_mm

Point = Float[np.ndarray, "3"]
SIDES = {"left": 1, "right": -1}


def landmarks_mm(p: NoseParameters, at: Layout) -> dict[str, Point]:
    """Points in mm in the frame of the nose: on its surface, or in the lumen for names that end in `centre`."""
    z = Z_FLOOR_MM
    points = {
        "anterior tip": np.array([0.0, Y_TIP_MM, z - 4]),
        "posterior wall": np.array([0.0, at.y_posterior_wall, z + 0.4 * p.choana_height_mm]),
        "nasopharynx centre": np.array([0.0, at.y_choana + 0.5 * p.nasopharynx_depth_mm, z + 0.4 * p.choana_height_mm]),
    }
    for name, side in SIDES.items():
        points |= {f"{name} {what}": point for what, point in _of_side(p, at, side).items()}
    return {name: np.asarray(point, dtype=np.float64) for name, point in points.items()}


def _of_side(p: NoseParameters, at: Layout, side: int) -> dict[str, Point]:
    z = Z_FLOOR_MM

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
    inferior_y = at.y_inferior_head + 0.55 * (at.y_inferior_tail - at.y_inferior_head)
    eustachian_y = at.y_choana + 0.5 * p.nasopharynx_depth_mm
    return {
        "nostril centre": np.array(
            [side * (p.columella_width_mm + p.nostril_width_mm) / 2, at.y_nostril, at.z_nostril + 1.5]
        ),
        "valve centre": medial(at.y_valve, 8.0, 2.2),
        "common meatus centre": medial(inferior_y, 9.0, p.common_meatus_width_mm / 2),
        "nasal floor": medial(at.y_inferior_head + 20, 0.0, 5.0),
        "inferior meatus centre": lateral(inferior_y, 9.0, 1.8),
        "middle meatus centre": lateral(middle_y, 21.5, 1.6),
        "superior meatus centre": medial(at.y_superior_tail - 1, 31.0, 1.3),
        "olfactory cleft centre": medial(at.y_superior_head, 37.0, p.olfactory_cleft_width_mm / 2),
        "choana centre": medial(at.y_choana - 1, 0.45 * p.choana_height_mm, p.choana_width_mm / 2),
        "eustachian opening": np.array(
            [side * (p.nasopharynx_width_mm / 2 - 2), eustachian_y, z + 0.34 * p.choana_height_mm]
        ),
    }
