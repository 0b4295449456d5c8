"""The anatomical regions of the built-in nose, cut by planes that follow from its parameters."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int
from scipy import ndimage

from naris.anatomy.builtin.implicit import Field, Grid
from naris.anatomy.builtin.layout import Z_FLOOR_MM, Layout
from naris.anatomy.builtin.parameters import NoseParameters
from naris.anatomy.builtin.walls import septum_centre_mm
from naris.core.anatomy import NOWHERE, GridRegions

OF_A_SIDE = (
    "vestibule",
    "nasal valve and anterior septum",
    "inferior meatus",
    "middle meatus",
    "superior meatus and olfactory cleft",
    "posterior cavity and choana",
)
ANATOMICAL = "anatomical"
ANATOMICAL_NAMES = (*(f"left {n}" for n in OF_A_SIDE), *(f"right {n}" for n in OF_A_SIDE), "nasopharynx")
SPACING_MM = 1.0
INFERIOR_TO_MIDDLE = 18.4
"""Height in a cavity of nominal height at which the level of the inferior meatus ends."""
MIDDLE_TO_SUPERIOR = 29.0
_POSTERIOR_MM = 10.0
_REACH_MM = 1.8


def label_points(p: NoseParameters, at: Layout, grid: Grid) -> Int[np.ndarray, "nx ny nz"]:
    """The region of every point of a grid, whether in the lumen or not.

    `inferior`, `middle` and `superior` are levels of the whole side, the common meatus beside the septum included.
    """
    y, height = grid.y, (grid.z - Z_FLOOR_MM) / at.height_scale
    left = grid.x > septum_centre_mm(p, at, grid.y_mm, grid.z_mm)[None]
    part = np.full(grid.shape, 3)
    part[np.broadcast_to(height < INFERIOR_TO_MIDDLE, grid.shape)] = 2
    part[np.broadcast_to((height < INFERIOR_TO_MIDDLE) & (y < at.y_inferior_head + 3), grid.shape)] = 1
    part[np.broadcast_to((height >= INFERIOR_TO_MIDDLE) & (y < at.y_middle_head - 1), grid.shape)] = 1
    part[np.broadcast_to((height >= MIDDLE_TO_SUPERIOR) & (y >= at.y_middle_head - 1), grid.shape)] = 4
    behind = (height < MIDDLE_TO_SUPERIOR) & (y >= at.y_choana - _POSTERIOR_MM)
    part[np.broadcast_to(behind, grid.shape)] = 5
    part[np.broadcast_to(y < at.y_valve - 2.5, grid.shape)] = 0
    labels = np.where(left, part, part + len(OF_A_SIDE))
    labels[np.broadcast_to(y > at.y_choana + 0.15 * (grid.z - Z_FLOOR_MM), grid.shape)] = 2 * len(OF_A_SIDE)
    return labels


def anatomical_regions(p: NoseParameters, at: Layout, lumen: Field, grid: Grid, frame: str) -> GridRegions:
    """Labels in the lumen and a little beyond its wall, on a grid of 1 mm."""
    coarse = _coarse(grid)
    near = _near_lumen(lumen, grid, coarse)
    labels = np.where(near, label_points(p, at, coarse), NOWHERE).astype(np.int8)
    return GridRegions(ANATOMICAL, ANATOMICAL_NAMES, frame, labels, coarse.origin_mm, SPACING_MM)


def _coarse(grid: Grid) -> Grid:
    axes = [
        np.arange(np.floor(axis[0] / SPACING_MM), np.ceil(axis[-1] / SPACING_MM) + 1, dtype=np.float32) * SPACING_MM
        for axis in (grid.x_mm, grid.y_mm, grid.z_mm)
    ]
    return Grid(axes[0], axes[1], axes[2], SPACING_MM)


def _near_lumen(lumen: Field, grid: Grid, coarse: Grid) -> Bool[np.ndarray, "cx cy cz"]:
    """Which points of the coarse grid lie in the lumen or within `_REACH_MM` of it."""
    distance = ndimage.distance_transform_edt(lumen <= 0, sampling=grid.spacing_mm)
    at = np.meshgrid(
        *((c - f[0]) / grid.spacing_mm for c, f in zip(_axes(coarse), _axes(grid), strict=True)), indexing="ij"
    )
    return ndimage.map_coordinates(distance, at, order=1, mode="nearest") <= _REACH_MM


def _axes(grid: Grid) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return grid.x_mm, grid.y_mm, grid.z_mm
