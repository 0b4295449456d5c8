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

from naris.anatomy.triangles import TriangleIndex
from naris.core.anatomy import Between

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
        from scipy.ndimage import map_coordinates

        index = (np.asarray(points_mm, dtype=np.float64) - self.origin_mm) / _COARSE_MM
        flat = map_coordinates(self.values_mm, index.reshape(-1, 3).T, order=1, mode="nearest")
        return flat.reshape(index.shape[:-1])


def envelope(triangles: TriangleIndex, low_mm: np.ndarray, high_mm: np.ndarray, air: Between) -> Envelope:
    """The envelope of a surface with bounds `low_mm`, `high_mm` (3,), in its own frame.

    In front of the entrance, where only some of the walls are modelled, a larger ball and some extra room apply.
    """
    reach = max(air.ball_mm, air.entrance.ball_mm if air.entrance else 0.0) + _MARGIN_MM
    first = np.floor((low_mm - reach) / _COARSE_MM)
    count = np.ceil((high_mm + reach) / _COARSE_MM).astype(int) - first.astype(int) + 1
    origin = first * _COARSE_MM
    free_mm = -triangles.lattice(origin, _COARSE_MM, (int(count[0]), int(count[1]), int(count[2])))
    depth = _closing(free_mm, air.ball_mm)
    if air.entrance is not None:
        door = air.entrance
        along = origin[door.axis] + _COARSE_MM * np.arange(count[door.axis])
        before = door.towards * (along - door.plane_mm)
        before = before.reshape([-1 if axis == door.axis else 1 for axis in range(3)])
        depth = np.maximum(depth, np.minimum(_closing(free_mm, door.ball_mm) + door.room_mm, before))
    return Envelope(depth.astype(np.float32), origin)


def _closing(free_mm: Float32[np.ndarray, "nx ny nz"], ball_mm: float) -> Float[np.ndarray, "nx ny nz"]:
    """Distance to the space that a ball of this radius can sweep without touching tissue; negative inside it."""
    from scipy.ndimage import distance_transform_edt

    centres = free_mm >= ball_mm
    return distance_transform_edt(~centres, sampling=_COARSE_MM) - ball_mm
