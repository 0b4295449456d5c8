"""The signed distance to the wall: positive inside the lumen, where it is the clearance of a camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32

from naris.anatomy.airspace import Envelope, envelope
from naris.anatomy.kernels import interpolate
from naris.anatomy.triangles import Closest, TriangleIndex, index_triangles
from naris.core.anatomy import Anatomy, Between
from naris.core.kept import Kept
from naris.errors import InputError

SPACING_MM = 0.5
_AROUND_MM = 3 * SPACING_MM  # from a point to the nodes that it and its gradient are told by, at most
_MARGIN_NODES = 2
_MOST_NODES = 200_000_000
_kept: Kept[SignedDistance] = Kept(4)


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
        envelope: where the air lies between walls that the surface encloses, how far it goes; None where the surface
            encloses the air.
    """

    values_mm: Float32[np.ndarray, "nx ny nz"]
    origin_mm: Float[np.ndarray, "3"]
    spacing_mm: float
    frame: str
    triangles: TriangleIndex
    envelope: Envelope | None = None

    def __call__(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Signed distance of points (..., 3) in mm, interpolated; NaN for NaN.

        Beyond the grid, where everything is outside the lumen, the way to the grid is taken off.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        out = np.empty(len(flat))
        interpolate(flat, self.values_mm, self.origin_mm, self.spacing_mm, out)
        return out.reshape(points.shape[:-1])

    def gradient(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """The gradient of the interpolated field: away from the nearest wall, about unit length (mm per mm).

        Central differences over one spacing.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        step = 0.5 * self.spacing_mm * np.eye(3)
        return (self(points[..., None, :] + step) - self(points[..., None, :] - step)) / self.spacing_mm

    def exact(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Signed distance of points (..., 3) in mm by the nearest point of the surface (double precision).

        Between walls the end of the air counts as a wall; it is known to a fraction of a mm only.
        """
        distance = self.triangles.closest(points_mm).distance_mm
        wound = self.triangles.winding(points_mm) >= 1
        if self.envelope is None:
            return np.where(wound, distance, -distance)
        return np.asarray(np.minimum(np.where(wound, -distance, distance), self.envelope(points_mm)))

    def closest(self, points_mm: Float[np.ndarray, "*n 3"]) -> Closest:
        """The nearest point of the wall, its distance (unsigned) and its face."""
        return self.triangles.closest(points_mm)

    def inside(self, points_mm: Float[np.ndarray, "*n 3"]) -> Bool[np.ndarray, "*n"]:
        """Whether points (..., 3) in mm lie in the lumen.

        Either the surface winds around them at least once; or, between walls, it does not and the air reaches there.
        """
        wound = np.asarray(self.triangles.winding(points_mm) >= 1)
        return np.asarray(wound if self.envelope is None else ~wound & (self.envelope(points_mm) > 0))

    def around(self, points_mm: Float[np.ndarray, "n 3"], margin_mm: float, spacing_mm: float) -> SignedDistance:
        """The same on a lattice of its own in the box around some points; nodes deep in tissue may say less."""
        first = np.floor((points_mm.min(axis=0) - margin_mm) / spacing_mm)
        nx, ny, nz = (int(n) + 1 for n in np.ceil((points_mm.max(axis=0) + margin_mm) / spacing_mm) - first)
        origin = first * spacing_mm
        values = _values(self.triangles, origin, spacing_mm, (nx, ny, nz), self.envelope, 2 * spacing_mm)
        return replace(self, values_mm=values, origin_mm=origin, spacing_mm=spacing_mm)

    @property
    def nodes_mm(self) -> tuple[Float[np.ndarray, "nx"], Float[np.ndarray, "ny"], Float[np.ndarray, "nz"]]:
        """The coordinates of the nodes along x, y and z."""
        x, y, z = (self.origin_mm[k] + self.spacing_mm * np.arange(self.values_mm.shape[k]) for k in range(3))
        return x, y, z


def signed_distance(
    anatomy: Anatomy, spacing_mm: float = SPACING_MM, *, tissue_to_mm: float = np.inf
) -> SignedDistance:
    """The signed distance of an anatomy on a grid; the last few are kept, by the digest of the anatomy.

    Every node holds the exact distance (nearest point of the surface, sign by winding number).

    Args:
        anatomy: what to measure.
        spacing_mm: between nodes.
        tissue_to_mm: nodes deeper in tissue than this may say so much only, which halves the time; enough inside the
            lumen. Of no effect where the air lies between walls that the surface encloses.

    Raises:
        InputError: if the spacing is not positive, or asks for more than 200 million nodes.
    """
    key = (anatomy.digest, float(spacing_mm), float(tissue_to_mm))
    return _kept.get(key, lambda: _compute(anatomy, float(spacing_mm), float(tissue_to_mm)))


def known_distance(anatomy: Anatomy, spacing_mm: float, values_mm: Float32[np.ndarray, "nx ny nz"]) -> SignedDistance:
    """What `signed_distance` gave once, from the values of its nodes.

    Raises:
        InputError: if they are not of the grid of this anatomy.
    """
    origin, shape = _grid(anatomy, spacing_mm)
    if values_mm.shape != shape:
        raise InputError(f"distances on a grid of {shape}", f"{values_mm.shape}", "compute them anew")
    triangles, end = _surface(anatomy)
    values_mm.setflags(write=False)
    return SignedDistance(values_mm, origin, spacing_mm, anatomy.frame, triangles, end)


def grid_shape(anatomy: Anatomy, spacing_mm: float) -> tuple[int, int, int]:
    """How many nodes `signed_distance` has along each axis."""
    return _grid(anatomy, spacing_mm)[1]


def lumen_distance(anatomy: Anatomy, deep_mm: float = 0.0) -> SignedDistance:
    """The signed distance for what asks in the lumen and so deep in tissue alone: the whole one where that is kept."""
    whole = (anatomy.digest, SPACING_MM, np.inf) in _kept or isinstance(anatomy.airspace, Between)
    return signed_distance(anatomy, tissue_to_mm=np.inf if whole else deep_mm + _AROUND_MM)


def _compute(anatomy: Anatomy, spacing_mm: float, tissue_to_mm: float) -> SignedDistance:
    if not 0 < spacing_mm < np.inf:
        raise InputError("a grid spacing above 0 mm", f"{spacing_mm}", f"give a number such as {SPACING_MM}")
    origin, shape = _grid(anatomy, spacing_mm)
    if math.prod(shape) > _MOST_NODES:
        raise InputError(
            f"a distance grid of at most {_MOST_NODES:,} nodes",
            f"{' × '.join(map(str, shape))} at {spacing_mm} mm",
            "take a wider spacing or check the unit of the surface",
        )
    triangles, end = _surface(anatomy)
    values = _values(triangles, origin, spacing_mm, shape, end, tissue_to_mm)
    return SignedDistance(values, origin, spacing_mm, anatomy.frame, triangles, end)


def _grid(anatomy: Anatomy, spacing_mm: float) -> tuple[Float[np.ndarray, "3"], tuple[int, int, int]]:
    """Where the first node lies, and how many there are along each axis."""
    low, high = anatomy.bounds_mm
    first = np.floor(low / spacing_mm) - _MARGIN_NODES
    nx, ny, nz = (int(n) + 1 for n in np.ceil(high / spacing_mm) + _MARGIN_NODES - first)
    return first * spacing_mm, (nx, ny, nz)


def _surface(anatomy: Anatomy) -> tuple[TriangleIndex, Envelope | None]:
    triangles = index_triangles(anatomy.vertices_mm, anatomy.faces)
    low, high = anatomy.bounds_mm
    air = anatomy.airspace
    return triangles, envelope(triangles, low, high, air) if isinstance(air, Between) else None


def _values(
    triangles: TriangleIndex,
    origin_mm: Float[np.ndarray, "3"],
    spacing_mm: float,
    shape: tuple[int, int, int],
    end: Envelope | None,
    tissue_to_mm: float,
) -> Float32[np.ndarray, "nx ny nz"]:
    values = triangles.lattice(origin_mm, spacing_mm, shape, np.inf if end is not None else tissue_to_mm)
    if end is not None:
        axes = (origin_mm[k] + spacing_mm * np.arange(shape[k]) for k in range(3))
        values = np.minimum(-values, end(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))).astype(np.float32)
    values.setflags(write=False)
    return values
