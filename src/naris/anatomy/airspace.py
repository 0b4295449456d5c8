"""Where the air is when a surface encloses the tissue and not the air: between the walls, up to a rolling ball.

Surfaces come in two kinds. A segmented airway encloses the air. A surface built from segmented structures (septum,
turbinates, lateral wall), as the mean nose published with Sinha et al. 2018, encloses tissue: there the camera flies
outside the closed surface, in the gaps between the walls, and nothing but the walls themselves says where the air
ends. We end it where a ball that rolls over the surface from outside can still reach: a morphological closing
(Serra 1982) of the tissue, with the tissue taken away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32
from scipy.ndimage import distance_transform_edt, map_coordinates

from naris.anatomy.triangles import TriangleIndex
from naris.core.anatomy import Between, Entrance

_COARSE_MM = 1.0
_MARGIN_MM = 4.0


@dataclass(frozen=True, eq=False)
class Envelope:
    """How deep a point lies within reach of the walls: positive where the rolling ball cannot get.

    Attributes:
        values_mm: (nx, ny, nz) float32 at nodes one mm apart; distances to the reach of the ball.
        origin_mm: (3,) node (0, 0, 0).
    """

    values_mm: Float32[np.ndarray, "nx ny nz"]
    origin_mm: Float[np.ndarray, "3"]

    def __call__(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Depth in mm of points (..., 3), trilinear; beyond the grid as at its edge (negative)."""
        index = (np.asarray(points_mm, dtype=np.float64) - self.origin_mm) / _COARSE_MM
        flat = map_coordinates(self.values_mm, index.reshape(-1, 3).T, order=1, mode="nearest")
        return flat.reshape(index.shape[:-1])


def envelope(triangles: TriangleIndex, low_mm: np.ndarray, high_mm: np.ndarray, air: Between) -> Envelope:
    """The envelope of a surface with bounds `low_mm`, `high_mm` (3,), in its own frame.

    At the entrance, where only some of the walls are modelled, a larger ball and some extra room apply.
    """
    first = np.floor(low_mm / _COARSE_MM)
    nx, ny, nz = (int(n) + 1 for n in np.ceil(high_mm / _COARSE_MM) - first)
    tissue = triangles.lattice(first * _COARSE_MM, _COARSE_MM, (nx, ny, nz)) > 0
    reach = max(air.ball_mm, air.entrance.ball_mm if air.entrance else 0.0) + _MARGIN_MM
    pad = int(np.ceil(reach / _COARSE_MM))
    free_mm = distance_transform_edt(~np.pad(tissue, pad), sampling=_COARSE_MM)
    origin = (first - pad) * _COARSE_MM
    depth = _closing(free_mm, air.ball_mm)
    if air.entrance is not None:
        before = _inside_box(origin, depth.shape, air.entrance)
        depth = np.maximum(depth, np.minimum(_closing(free_mm, air.entrance.ball_mm) + air.entrance.room_mm, before))
    # Half a node off, lest the rounding of the grid leave a skin of air around the outside.
    return Envelope((depth - _COARSE_MM / 2).astype(np.float32), origin)


def _closing(free_mm: Float[np.ndarray, "nx ny nz"], ball_mm: float) -> Float[np.ndarray, "nx ny nz"]:
    """Distance to the space that a ball of this radius can sweep without touching tissue; negative inside it."""
    return distance_transform_edt(free_mm < ball_mm, sampling=_COARSE_MM) - ball_mm


def _inside_box(
    origin_mm: Float[np.ndarray, "3"], shape: tuple[int, ...], box: Entrance
) -> Float[np.ndarray, "nx ny nz"]:
    """How far inside the box each node lies (mm; negative outside)."""
    depth = np.full(shape, np.inf)
    for axis in range(3):
        along = origin_mm[axis] + _COARSE_MM * np.arange(shape[axis])
        inside = np.minimum(along - box.low_mm[axis], box.high_mm[axis] - along)
        depth = np.minimum(depth, inside.reshape([-1 if k == axis else 1 for k in range(3)]))
    return depth
