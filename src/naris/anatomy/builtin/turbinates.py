"""The inferior, middle and superior turbinate: bands that hang from the lateral wall or the roof and curl outwards.

Each turbinate is given by stations along its length; at a station, control points (u, z, radius) lead from the root
through the body to the free border, which curls laterally and up. Between stations everything runs smoothly, and the
head and the tail taper to a round end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from naris.anatomy.builtin.implicit import Field, Grid, Number, fine_curve, swept_tube
from naris.anatomy.builtin.layout import Layout
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.walls import Walls

_FAR_MM = 4.0
_POINTS = 18
_STATIONS = 15
_MEATUS_MM = 2.2


@dataclass(frozen=True, eq=False)
class Turbinate:
    """A turbinate of one side.

    Attributes:
        y_mm: (s,) stations from head to tail.
        control: (s, n, 3) of (u, z, radius) in mm, from the root to the free border.
        head_mm, tail_mm: over which length the ends taper.
    """

    name: str
    y_mm: Float[np.ndarray, "s"]
    control: Float[np.ndarray, "s n 3"]
    head_mm: float
    tail_mm: float


class WallReader:
    """Reads the walls of a side at single places, in mm."""

    def __init__(self, walls: Walls, grid: Grid) -> None:
        self._walls, self._grid = walls, grid

    def lateral(self, y_mm: float, z_mm: float) -> float:
        """u of the lateral wall."""
        return float(self._walls.lateral_mm[self._row(y_mm), self._column(z_mm)])

    def medial(self, y_mm: float, z_mm: float) -> float:
        """u of the septal mucosa."""
        return float(self._walls.medial_mm[self._row(y_mm), self._column(z_mm)])

    def roof(self, y_mm: float) -> float:
        """z of the roof."""
        return float(self._walls.roof_mm[self._row(y_mm)])

    def _row(self, y_mm: float) -> int:
        return int(np.clip(np.searchsorted(self._grid.y_mm, y_mm), 0, len(self._grid.y_mm) - 1))

    def _column(self, z_mm: float) -> int:
        return int(np.clip(np.searchsorted(self._grid.z_mm, z_mm), 0, len(self._grid.z_mm) - 1))


def _stations(table: Sequence[tuple[Number, ...]]) -> Float[np.ndarray, "s k"]:
    """A table of values over the fraction of the length (first column), refined so that a root keeps to its wall."""
    rows = np.asarray(table, dtype=np.float64)
    fractions = np.unique(np.r_[np.linspace(0, 1, _STATIONS), rows[:, 0]])
    return np.column_stack([fractions, PchipInterpolator(rows[:, 0], rows[:, 1:], axis=0)(fractions)])


def inferior_turbinate(p: NoseParameters, at: Layout, wall: WallReader) -> Turbinate:
    """A comma in section: root on the lateral wall, body towards the septum, border curled out and up.

    Its head is a solid bulb on the lateral wall; the inferior meatus opens behind it. Where the cavity is too narrow
    for the common and the inferior meatus beside it, it is thinner than asked, by half at most.
    """
    full = r = p.inferior_thickness_mm / 2
    low = at.z_at(0) + p.inferior_floor_gap_mm + r
    top = at.z_at(0) + p.inferior_floor_gap_mm + p.inferior_height_mm
    mid = 0.5 * (low + top) - 0.5
    # fraction of the length; size of the section; how far the meatus behind it is open
    table = ((0.0, 0.35, 0.0), (0.12, 0.78, 0.05), (0.3, 1.0, 1.0), (0.7, 1.0, 1.0), (0.9, 0.88, 1.0), (1.0, 0.55, 1.0))
    ys, rows = [], []
    for t, size, open_ in _stations(table):
        y = at.y_inferior_head + t * (at.y_inferior_tail - at.y_inferior_head)
        room = wall.lateral(y, mid) - wall.medial(y, mid) - p.common_meatus_width_mm - _MEATUS_MM
        r = full - open_ * (full - min(full, max(0.5 * room, 0.5 * full)))
        u_free = wall.medial(y, mid) + p.common_meatus_width_mm + r
        u_head = max(wall.lateral(y, mid) - 0.9 * r, wall.medial(y, mid) + p.common_meatus_width_mm + 1.3 * r)
        u = u_free * open_ + u_head * (1 - open_)
        root, w_low = wall.lateral(y, top), wall.lateral(y, low)
        hook = min(u + 1.35 * r, w_low - 1.5 * r) * open_ + (w_low + 1.0) * (1 - open_)
        points = np.array(
            [
                (root + 1.0, top - 0.6, 0.42 * r),
                (0.5 * (root + u) + 0.3, top - 0.9, 0.55 * r),
                (u + 0.7, top - 3.2, 0.85 * r),
                (u, mid - 0.6, r),
                (u + 0.9, low + 0.3, r),
                (0.45 * u + 0.55 * hook + 0.6, low - 0.3, 0.8 * r),
                (hook, low + 1.6, 0.5 * r),
            ]
        )
        anchor = np.array([wall.lateral(y, mid) - 0.5, mid - 0.5])
        points[:, :2] = anchor + (points[:, :2] - anchor) * (0.35 + 0.65 * size)
        points[:, 2] += r * (1 - open_) * np.array([0.5, 0.6, 0.5, 0.35, 0.35, 0.5, 0.6])
        points[:, 2] *= 0.45 + 0.55 * size
        ys.append(y)
        rows.append(points)
    return Turbinate("inferior", np.array(ys), np.array(rows), head_mm=6.0, tail_mm=7.0)


def middle_turbinate(p: NoseParameters, at: Layout, wall: WallReader) -> Turbinate:
    """Hangs from the skull base by a thin lamella that turns to the lateral wall behind; its border curls out."""
    r = p.middle_thickness_mm / 2
    # fraction of the length; heights of root, body and border; size; curl. The root runs on the wall: from the axilla
    # up to the skull base, along it, and down behind as the basal lamella.
    table = (
        (0.00, 32.5, 29.0, 26.0, 0.7, 0.3),
        (0.15, 35.5, 26.5, 22.9, 1.0, 1.2),
        (0.35, 38.0, 25.8, 22.1, 1.0, 2.5),
        (0.50, 37.5, 25.5, 22.0, 1.0, 2.6),
        (0.60, 35.8, 25.2, 21.9, 1.0, 2.6),
        (0.70, 31.5, 24.8, 21.7, 0.96, 2.5),
        (0.80, 27.5, 24.0, 21.5, 0.9, 2.3),
        (1.00, 23.0, 22.0, 20.9, 0.6, 1.2),
    )
    ys, rows = [], []
    for t, h_root, h_body, h_low, size, curl in _stations(table):
        y = at.y_middle_head + t * (at.y_middle_tail - at.y_middle_head)
        z_root, z_body, z_low = (at.z_at(h) for h in (h_root, h_body, h_low))
        u = wall.medial(y, z_body) + p.middle_olfactory_gap_mm + r * size
        root = wall.lateral(y, z_root) + 1.0
        ys.append(y)
        rows.append(
            [
                (root, z_root, 1.3),
                (0.5 * (root + u), 0.45 * z_root + 0.55 * z_body + 0.4, 1.05 + 0.1 * r),
                (u - 0.1, z_body + 1.6, 0.85 * r * size),
                (u + 0.1, z_body - 0.6, r * size),
                (u + 0.35 * curl, z_low + 1.4, 0.85 * r * size),
                (u + curl, z_low + 1.6, 0.55 * r * size),
            ]
        )
    return Turbinate("middle", np.array(ys), np.array(rows), head_mm=4.5, tail_mm=6.0)


def superior_turbinate(p: NoseParameters, at: Layout, wall: WallReader) -> Turbinate:
    """A small leaf that hangs from the skull base above the posterior half of the middle turbinate."""
    r = p.superior_thickness_mm / 2
    ys, rows = [], []
    # fraction of the length; height of the free border
    for t, h_low in _stations(((0.0, 35.0), (0.3, 32.3), (0.7, 31.2), (1.0, 31.0))):
        y = at.y_superior_head + t * (at.y_superior_tail - at.y_superior_head)
        z_root, z_low = wall.roof(y) + 1.0, at.z_at(h_low)
        u = wall.medial(y, z_low) + p.olfactory_cleft_width_mm + 0.5 + r
        root = wall.medial(y, z_root - 3) + p.olfactory_cleft_width_mm + 1.2
        ys.append(y)
        rows.append(
            [
                (root, z_root, 0.9),
                (0.6 * root + 0.4 * u, 0.6 * z_root + 0.4 * z_low, 0.7 * r + 0.1),
                (u - 0.3, 0.25 * z_root + 0.75 * z_low, 0.9 * r),
                (u + 0.1, z_low + 1.0, r),
                (u + 1.3, z_low + 0.3, 0.8 * r),
            ]
        )
    return Turbinate("superior", np.array(ys), np.array(rows), head_mm=4.0, tail_mm=4.0)


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
    window = grid.window((low[0], t.y_mm[0] - _FAR_MM, low[1]), (high[0], t.y_mm[-1] + _FAR_MM, high[1]))
    part = grid.part(window)
    y = np.clip(part.y_mm, t.y_mm[0], t.y_mm[-1])
    control = PchipInterpolator(t.y_mm, t.control, axis=0)(y)
    control[..., :2] += wobble_mm[window[1]][:, None, :]
    curves = fine_curve(control, _POINTS)
    curves[..., 2] *= (_taper((y - t.y_mm[0]) / t.head_mm) * _taper((t.y_mm[-1] - y) / t.tail_mm))[:, None]
    distance = swept_tube(part, curves)
    beyond = np.abs(part.y_mm - y).astype(np.float32)[None, :, None]
    return np.where(beyond > 0, np.hypot(np.maximum(distance, 0), beyond), distance), window


def _taper(s: np.ndarray) -> np.ndarray:
    """A quarter circle: 0 at the end, 1 from one head length on."""
    return np.sqrt(np.maximum(1 - (1 - np.clip(s, 0, 1)) ** 2, 0))
