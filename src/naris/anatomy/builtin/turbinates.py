"""The inferior, middle and superior turbinate: bands that hang from the lateral wall or the roof and curl outwards.

Each turbinate is given by stations along its length; at a station, control points (u, z, radius) lead from the root
through the body to the free border, which curls laterally and up. Between stations everything runs smoothly, and the
head and the tail taper to a round end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from naris.anatomy.builtin.implicit import Field, Grid, fine_curve, swept_tube
from naris.anatomy.builtin.layout import Layout
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.walls import Walls

_FAR_MM = 4.0
_POINTS = 18


@dataclass(frozen=True, eq=False)
class Turbinate:
    """A turbinate of one side.

    Attributes:
        y_head_mm, y_tail_mm: its ends.
        stations: fractions of the length.
        control: (stations, points, 3) of (u, z, radius) in mm.
        head_mm, tail_mm: over which length the ends taper.
    """

    name: str
    y_head_mm: float
    y_tail_mm: float
    stations: tuple[float, ...]
    control: Float[np.ndarray, "s n 3"]
    head_mm: float
    tail_mm: float


class WallReader:
    """Reads the walls of a side at single places."""

    def __init__(self, walls: Walls, grid: Grid) -> None:
        self._walls, self._grid = walls, grid

    def _at(self, sheet: np.ndarray, y_mm: float, z_mm: float) -> float:
        i = int(np.clip(np.searchsorted(self._grid.y_mm, y_mm), 0, len(self._grid.y_mm) - 1))
        j = int(np.clip(np.searchsorted(self._grid.z_mm, z_mm), 0, len(self._grid.z_mm) - 1))
        return float(sheet[i, j])

    def lateral(self, y_mm: float, z_mm: float) -> float:
        return self._at(self._walls.lateral_mm, y_mm, z_mm)

    def medial(self, y_mm: float, z_mm: float) -> float:
        """The septal face, half followed: turbinates grow into the wide side of a bent septum."""
        return self._at(self._walls.medial_mm, y_mm, z_mm)


def inferior_turbinate(p: NoseParameters, at: Layout, wall: WallReader) -> Turbinate:
    """A comma in section: root on the lateral wall, body towards the septum, border curled out and up."""
    z0 = at.z_at(0)
    r = p.inferior_thickness_mm / 2
    low, top = z0 + p.inferior_floor_gap_mm + r, z0 + p.inferior_floor_gap_mm + p.inferior_height_mm
    length = at.y_inferior_tail - at.y_inferior_head
    shrink = {0.0: 0.35, 0.12: 0.8, 0.35: 1.0, 0.7: 1.0, 0.9: 0.86, 1.0: 0.55}
    rows = []
    for t, size in shrink.items():
        y = at.y_inferior_head + t * length
        mid = 0.5 * (low + top) - 0.5
        gap = p.common_meatus_width_mm + 2.5 * max(0.0, 0.25 - t)
        u = wall.medial(y, mid) + gap + r
        root = wall.lateral(y, top)
        w_low = wall.lateral(y, low)
        u = max(u, root - 9.0)
        hook = min(u + 4.4, w_low - 3.2)
        points = np.array(
            [
                (root + 1.0, top - 0.6, 0.42 * r),
                (0.5 * (root + u) + 0.3, top - 0.9, 0.55 * r),
                (u + 0.7, top - 3.2, 0.85 * r),
                (u, mid - 0.6, 1.0 * r),
                (u + 0.9, low + 0.3, 1.0 * r),
                (0.45 * u + 0.55 * hook + 0.6, low - 0.3, 0.8 * r),
                (hook, low + 1.6, 0.55 * r),
            ]
        )
        anchor = np.array([wall.lateral(y, mid) - 0.5, mid - 0.5])
        points[:, :2] = anchor + (points[:, :2] - anchor) * (0.35 + 0.65 * size)
        points[:, 2] *= 0.45 + 0.55 * size
        rows.append(points)
    return Turbinate(
        "inferior", at.y_inferior_head, at.y_inferior_tail, tuple(shrink), np.array(rows), head_mm=6.0, tail_mm=7.0
    )


def middle_turbinate(p: NoseParameters, at: Layout, wall: WallReader) -> Turbinate:
    """Hangs from the skull base by a thin lamella that turns to the lateral wall behind; its border curls out."""
    r = p.middle_thickness_mm / 2
    length = at.y_middle_tail - at.y_middle_head
    # per station: height of root, of the body and of the border; lamella root: 0 at the wall, 1 at the cleft
    rows, stations = [], (0.0, 0.15, 0.4, 0.62, 0.8, 1.0)
    root_height = (33.5, 37.0, 40.0, 38.0, 30.0, 23.0)
    body_height = (28.5, 25.5, 24.5, 24.0, 22.8, 21.0)
    border_height = (25.0, 20.8, 20.0, 20.0, 19.8, 19.3)
    size = (0.7, 1.0, 1.0, 1.0, 0.9, 0.6)
    for t, h_root, h_body, h_low, s in zip(stations, root_height, body_height, border_height, size, strict=True):
        y = at.y_middle_head + t * length
        z_root, z_body, z_low = (at.z_at(h) for h in (h_root, h_body, h_low))
        u = wall.medial(y, z_body) + p.middle_olfactory_gap_mm + r * s
        cleft = wall.medial(y, z_root) + p.olfactory_cleft_width_mm + 0.7
        lateral = wall.lateral(y, z_root) + 0.8
        root = {0.0: lateral, 0.15: 0.5 * (lateral + cleft), 0.4: cleft, 0.62: 0.7 * cleft + 0.3 * lateral}.get(
            t, lateral
        )
        z_mid = 0.5 * (z_root + z_body)
        rows.append(
            np.array(
                [
                    (root, z_root, 0.7),
                    (0.55 * root + 0.45 * u, z_mid, 0.8 + 0.1 * r),
                    (u - 0.1, z_body + 1.6, 0.85 * r * s),
                    (u + 0.1, z_body - 0.6, r * s),
                    (u + 0.9, z_low + 1.4, 0.85 * r * s),
                    (u + 2.6 * s, z_low + 1.6, 0.55 * r * s),
                ]
            )
        )
    return Turbinate("middle", at.y_middle_head, at.y_middle_tail, stations, np.array(rows), head_mm=4.5, tail_mm=6.0)


def superior_turbinate(p: NoseParameters, at: Layout, wall: WallReader) -> Turbinate:
    """A small leaf above the posterior half of the middle turbinate."""
    r = p.superior_thickness_mm / 2
    length = at.y_superior_tail - at.y_superior_head
    rows, stations = [], (0.0, 0.3, 0.7, 1.0)
    for t, h_root, h_low in zip(stations, (40.0, 41.0, 40.0, 36.0), (34.5, 32.0, 30.5, 30.0), strict=True):
        y = at.y_superior_head + t * length
        z_root, z_low = at.z_at(h_root), at.z_at(h_low)
        u = wall.medial(y, z_low) + p.olfactory_cleft_width_mm + 0.5 + r
        root = wall.medial(y, z_root) + p.olfactory_cleft_width_mm + 0.8
        rows.append(
            np.array(
                [
                    (root, z_root, 0.8),
                    (0.5 * (root + u), 0.5 * (z_root + z_low), 0.75 * r),
                    (u + 0.1, z_low + 1.2, r),
                    (u + 1.0, z_low, 0.8 * r),
                ]
            )
        )
    return Turbinate(
        "superior", at.y_superior_head, at.y_superior_tail, stations, np.array(rows), head_mm=4.0, tail_mm=4.0
    )


def turbinate_field(
    turbinate: Turbinate, grid: Grid, wobble_mm: Float[np.ndarray, "ally 2"]
) -> tuple[Field, tuple[slice, ...]]:
    """Distance to a turbinate, outside positive, and the window of the grid that it is given in.

    Args:
        grid: of (u, y, z).
        wobble_mm: (all y, 2) shift of the whole section along u and z, for an uneven border.
    """
    t = turbinate
    low = t.control[..., :2].min(axis=(0, 1)) - t.control[..., 2].max() - _FAR_MM
    high = t.control[..., :2].max(axis=(0, 1)) + t.control[..., 2].max() + _FAR_MM
    window = grid.window((low[0], t.y_head_mm - _FAR_MM, low[1]), (high[0], t.y_tail_mm + _FAR_MM, high[1]))
    part = grid.part(window)
    y = np.clip(part.y_mm, t.y_head_mm, t.y_tail_mm)
    where = (y - t.y_head_mm) / (t.y_tail_mm - t.y_head_mm)
    control = PchipInterpolator(t.stations, t.control, axis=0)(where)
    control[..., :2] += wobble_mm[window[1]][:, None, :]
    curves = fine_curve(control, _POINTS)
    curves[..., 2] *= (_taper((y - t.y_head_mm) / t.head_mm) * _taper((t.y_tail_mm - y) / t.tail_mm))[:, None]
    distance = swept_tube(part, curves)
    beyond = np.abs(part.y_mm - y).astype(np.float32)[None, :, None]
    return np.where(beyond > 0, np.hypot(np.maximum(distance, 0), beyond), distance), window


def _taper(s: np.ndarray) -> np.ndarray:
    """A quarter circle: 0 at the end, 1 from one head length on."""
    return np.sqrt(np.maximum(1 - (1 - np.clip(s, 0, 1)) ** 2, 0))
