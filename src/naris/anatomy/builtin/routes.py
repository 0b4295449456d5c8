"""The passages of the built-in nose: from a nostril through a meatus, as far as a camera goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from naris.anatomy.builtin.implicit import Field, Grid
from naris.core.anatomy import Passage
from naris.errors import InputError

_STEP_MM = 0.5
_SNAP_MM = 2.5


@dataclass(frozen=True)
class NamedRoute:
    """A passage by the landmarks that it begins at, goes through and ends at."""

    name: str
    through: tuple[str, ...]


def routes() -> tuple[NamedRoute, ...]:
    found = []
    for side in ("left", "right"):
        start = (f"{side} nostril centre", f"{side} valve centre")
        end = (f"{side} choana centre", "nasopharynx centre")
        found += [
            NamedRoute(f"{side}.septal", (*start, f"{side} common meatus centre", *end)),
            NamedRoute(f"{side}.inferior", (*start, f"{side} inferior meatus centre")),
            NamedRoute(f"{side}.middle", (*start, f"{side} middle meatus centre", *end)),
            NamedRoute(f"{side}.superior", (*start, f"{side} superior meatus centre")),
        ]
    return tuple(found)


def find_routes(lumen: Field, grid: Grid, landmarks_mm: dict[str, Float[np.ndarray, "3"]]) -> tuple[Passage, ...]:
    """Minimal paths through the clearance along the named landmarks."""
    clearance = ndimage.distance_transform_edt(lumen > 0, sampling=grid.spacing_mm).astype(np.float32)
    cost = np.where(clearance > 0, 1.0 / (0.15 + clearance) ** 2, np.inf)
    return tuple(_passage(r, cost, clearance, grid, landmarks_mm) for r in routes())


def _passage(
    route: NamedRoute, cost: Field, clearance: Field, grid: Grid, landmarks_mm: dict[str, Float[np.ndarray, "3"]]
) -> Passage:
    from skimage.graph import route_through_array

    stops = [_snap(landmarks_mm[name], clearance, grid, name) for name in route.through]
    path = [stops[0]]
    for a, b in zip(stops[:-1], stops[1:], strict=True):
        path += route_through_array(cost, a, b, fully_connected=True, geometric=True)[0][1:]
    points = np.asarray(path) * grid.spacing_mm + grid.origin_mm
    points = ndimage.gaussian_filter1d(points, 2.0, axis=0, mode="nearest")
    along = np.r_[0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
    at = np.arange(0, along[-1], _STEP_MM)
    points = np.stack([np.interp(at, along, points[:, i]) for i in range(3)], axis=1)
    index = ((points - grid.origin_mm) / grid.spacing_mm).T
    return Passage(route.name, points, ndimage.map_coordinates(clearance, index, order=1).astype(np.float64))


def _snap(point_mm: Float[np.ndarray, "3"], clearance: Field, grid: Grid, name: str) -> tuple[int, int, int]:
    """The voxel with the most clearance near a landmark."""
    window = grid.window(tuple(point_mm - _SNAP_MM), tuple(point_mm + _SNAP_MM))
    near = clearance[window]
    best = np.unravel_index(near.argmax(), near.shape)
    if near[best] <= 0:
        raise InputError(f"air at the {name}", "a nose that is closed there", "widen the passages")
    return tuple(int(s.start + i) for s, i in zip(window, best, strict=True))  # type: ignore[return-value]
