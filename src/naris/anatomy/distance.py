"""The signed distance to the wall: positive inside the lumen, where it is the clearance of a camera."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32
from numba import njit

from naris.anatomy.triangles import Closest, TriangleIndex, index_triangles
from naris.core.anatomy import Anatomy
from naris.errors import InputError

SPACING_MM = 0.5
_MARGIN_NODES = 2
_MOST_NODES = 200_000_000
_KEPT = 4
_kept: OrderedDict[tuple[str, float], SignedDistance] = OrderedDict()
_kept_lock = threading.Lock()


@dataclass(frozen=True, eq=False)
class SignedDistance:
    """The distance to the nearest wall in mm, **positive inside the lumen**, negative outside.

    Calling it interpolates the grid (trilinear; the nodes are exact, so away from the medial axis of the lumen the
    error is of the order of spacing²/curvature radius, and at most 0.87 times the spacing anywhere).
    `exact` asks the surface itself.

    Attributes:
        values_mm: (nx, ny, nz) float32 at the nodes.
        origin_mm: (3,) where node (0, 0, 0) lies in `frame`.
        spacing_mm: between nodes.
        frame: the frame of the anatomy.
        triangles: the surface, ready for exact queries.
    """

    values_mm: Float32[np.ndarray, "nx ny nz"]
    origin_mm: Float[np.ndarray, "3"]
    spacing_mm: float
    frame: str
    triangles: TriangleIndex

    def __call__(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Signed distance of points (..., 3) in mm, interpolated; NaN for NaN.

        Beyond the grid, where everything is outside the lumen, the way to the grid is taken off.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        out = np.empty(len(flat))
        _interpolate(flat, self.values_mm, self.origin_mm, self.spacing_mm, out)
        return out.reshape(points.shape[:-1])

    def gradient(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """The gradient of the interpolated field: away from the nearest wall, about unit length (mm per mm).

        Central differences over one spacing.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        step = 0.5 * self.spacing_mm * np.eye(3)
        return (self(points[..., None, :] + step) - self(points[..., None, :] - step)) / self.spacing_mm

    def exact(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Signed distance of points (..., 3) in mm by the nearest point of the surface (double precision)."""
        distance = self.triangles.closest(points_mm).distance_mm
        return np.where(self.inside(points_mm), distance, -distance)

    def closest(self, points_mm: Float[np.ndarray, "*n 3"]) -> Closest:
        """The nearest point of the wall, its distance (unsigned) and its face."""
        return self.triangles.closest(points_mm)

    def inside(self, points_mm: Float[np.ndarray, "*n 3"]) -> Bool[np.ndarray, "*n"]:
        """Whether points (..., 3) in mm lie in the lumen: the surface winds around them at least once."""
        return self.triangles.winding(points_mm) >= 1

    @property
    def nodes_mm(self) -> tuple[Float[np.ndarray, "nx"], Float[np.ndarray, "ny"], Float[np.ndarray, "nz"]]:
        """The coordinates of the nodes along x, y and z."""
        x, y, z = (self.origin_mm[k] + self.spacing_mm * np.arange(self.values_mm.shape[k]) for k in range(3))
        return x, y, z


def signed_distance(anatomy: Anatomy, spacing_mm: float = SPACING_MM) -> SignedDistance:
    """The signed distance of an anatomy on a grid; the last few are kept, by the digest of the anatomy.

    Every node holds the exact distance (nearest point of the surface, sign by winding number).

    Raises:
        InputError: if the spacing is not positive, or asks for more than 200 million nodes.
    """
    key = (anatomy.digest, float(spacing_mm))
    with _kept_lock:
        if key not in _kept:
            _kept[key] = _compute(anatomy, float(spacing_mm))
            while len(_kept) > _KEPT:
                _kept.popitem(last=False)
        _kept.move_to_end(key)
        return _kept[key]


def _compute(anatomy: Anatomy, spacing_mm: float) -> SignedDistance:
    if not 0 < spacing_mm < np.inf:
        raise InputError("a grid spacing above 0 mm", f"{spacing_mm}", f"give a number such as {SPACING_MM}")
    low, high = anatomy.bounds_mm
    first = np.floor(low / spacing_mm) - _MARGIN_NODES
    nx, ny, nz = (int(n) + 1 for n in np.ceil(high / spacing_mm) + _MARGIN_NODES - first)
    shape = (nx, ny, nz)
    if nx * ny * nz > _MOST_NODES:
        raise InputError(
            f"a distance grid of at most {_MOST_NODES:,} nodes",
            f"{' × '.join(map(str, shape))} at {spacing_mm} mm",
            "take a wider spacing or check the unit of the surface",
        )
    triangles = index_triangles(anatomy.vertices_mm, anatomy.faces)
    origin = first * spacing_mm
    values = triangles.lattice(origin, spacing_mm, shape)
    values.setflags(write=False)
    return SignedDistance(values, origin, spacing_mm, anatomy.frame, triangles)


@njit(cache=True, nogil=True)
def _interpolate(points, values, origin, spacing, out):  # type: ignore[no-untyped-def]
    nx, ny, nz = values.shape
    for n in range(len(points)):
        u, v, w = (points[n] - origin) / spacing
        if not (np.isfinite(u) and np.isfinite(v) and np.isfinite(w)):
            out[n] = np.nan
            continue
        cu, cv, cw = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0), min(max(w, 0.0), nz - 1.0)
        beyond = np.sqrt((u - cu) ** 2 + (v - cv) ** 2 + (w - cw) ** 2) * spacing
        i, j, k = min(int(cu), nx - 2), min(int(cv), ny - 2), min(int(cw), nz - 2)
        a, b, c = cu - i, cv - j, cw - k
        low = (1 - c) * values[i, j, k] + c * values[i, j, k + 1]
        up = (1 - c) * values[i, j + 1, k] + c * values[i, j + 1, k + 1]
        near = (1 - b) * low + b * up
        low = (1 - c) * values[i + 1, j, k] + c * values[i + 1, j, k + 1]
        up = (1 - c) * values[i + 1, j + 1, k] + c * values[i + 1, j + 1, k + 1]
        out[n] = (1 - a) * near + a * ((1 - b) * low + b * up) - beyond
