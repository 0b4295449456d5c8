# mypy: allow-untyped-decorators
"""An engine that shares nothing with ours: every face against every ray, in double precision.

Möller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Int, Int32
from numba import njit


def nearest_faces(
    vertices_mm: Float[np.ndarray, "v 3"],
    faces: Int32[np.ndarray, "f 3"],
    origins_mm: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """The nearest face that each ray meets (−1 for none) and the distance to it in lengths of the direction."""
    corners = np.ascontiguousarray(vertices_mm, np.float64)[faces]
    found = np.empty(len(origins_mm), np.int64)
    distance = np.empty(len(origins_mm))
    _nearest(corners, np.asarray(origins_mm, np.float64), np.asarray(directions, np.float64), found, distance)
    return found, distance


@njit(cache=True, nogil=True, error_model="numpy")
def _nearest(corners: Any, origins: Any, directions: Any, found: Any, distance: Any) -> None:
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    for ray in range(len(origins)):
        ox, oy, oz = origins[ray]
        dx, dy, dz = directions[ray]
        best, face = np.inf, -1
        for k in range(len(corners)):
            ax, ay, az = first[k, 0], first[k, 1], first[k, 2]
            bx, by, bz = second[k, 0], second[k, 1], second[k, 2]
            px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
            determinant = ax * px + ay * py + az * pz
            sx, sy, sz = ox - corners[k, 0, 0], oy - corners[k, 0, 1], oz - corners[k, 0, 2]
            inverse = 1.0 / determinant
            u = (sx * px + sy * py + sz * pz) * inverse
            qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
            v = (dx * qx + dy * qy + dz * qz) * inverse
            t = (bx * qx + by * qy + bz * qz) * inverse
            if u >= 0.0 and v >= 0.0 and u + v <= 1.0 and 1e-9 < t < best:
                best, face = t, k
        found[ray], distance[ray] = face, best
