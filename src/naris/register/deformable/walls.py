# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
"""The walls of a shape, and which place of which face a ray meets or a point lies nearest to."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int
from numba import njit

from naris.anatomy.triangles import TriangleIndex, index_triangles
from naris.register.equations import Memory, Rays, keep, shoot
from naris.render.embree import ARGUMENTS, PacketScene, library
from naris.render.fast import aligned
from naris.render.lanes import LANES, store
from naris.render.packets import Embree, found
from naris.render.sources import OF_PACKETS, sources_of


@dataclass(frozen=True, eq=False)
class Places:
    """Places on walls, one a ray.

    Attributes:
        met: (N,) whether there is one; the rest has no meaning where there is none.
        range_mm: (N,) from the camera, negative where the wall is seen from its wrong side.
        faces: (N,) of the walls.
        corners: (N, 3) barycentric.
        normal: (N, 3) unit, towards the camera.
    """

    met: Bool[np.ndarray, "n"]
    range_mm: Float[np.ndarray, "n"]
    faces: Int[np.ndarray, "n"]
    corners: Float[np.ndarray, "n 3"]
    normal: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, eq=False)
class Walls:
    """The surface of one shape.

    Attributes:
        vertices_mm: (V, 3).
        faces: (F, 3), all or those near the camera.
        inside: the side of a face that is seen from the lumen, as the kernels tell it.
        of_mean: the walls of the same faces at the mean, in whose order they are searched; None for those themselves.
    """

    vertices_mm: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    inside: float
    of_mean: Walls | None = None

    @cached_property
    def scene(self) -> PacketScene:
        return PacketScene(np.ascontiguousarray(self.vertices_mm, np.float32), self.faces, brief=True)

    @cached_property
    def index(self) -> TriangleIndex:
        return index_triangles(self.vertices_mm, self.faces)

    def met(self, rays: Rays, pose: Float[np.ndarray, "4 4"], scale: float, memory: Memory) -> Places:
        """Where the rays of a camera at a pose meet the walls (mm)."""
        n, at = len(rays.x), library()
        embree = Embree(at.intersect, self.scene.address, ctypes.addressof(ARGUMENTS), at.width)
        faces, u, v = aligned(n, np.int32), aligned(n, np.float32), aligned(n, np.float32)
        _meet(embree, rays, np.array(pose), scale, memory, (faces, u, v), _sources())
        normal, u, v = memory.normal.T.astype(np.float64), u.astype(np.float64), v.astype(np.float64)
        met = (np.square(normal).sum(axis=1) > 0.5) & (rays.valid != 0)
        corners = np.stack([1 - u - v, u, v], axis=1)
        return Places(met, self.inside * memory.hit.astype(np.float64), faces.astype(np.int64), corners, normal)

    def points_mm(self, places: Places) -> Float[np.ndarray, "n 3"]:
        """Where places lie."""
        return np.einsum("njk,nj->nk", self.vertices_mm[self.faces[places.faces]], places.corners)

    def nearest(self, points_mm: Float[np.ndarray, "n 3"], ways: Float[np.ndarray, "n 3"]) -> Places:
        """Where points lie nearest to a wall that faces the camera; `ways` (unit) are those of their rays."""
        index = self.index if self.of_mean is None else self.of_mean.index
        closest = index.closest_of(self.vertices_mm, self.faces, points_mm)
        a, b, c = (self.vertices_mm[self.faces[closest.faces, k]] for k in range(3))
        across = np.cross(b - a, c - a)
        twice_area = np.linalg.norm(across, axis=1)
        normal = self.inside * across / np.maximum(twice_area, 1e-12)[:, None]
        at = closest.points_mm
        parts = [np.linalg.norm(np.cross(q - at, r - at), axis=1) for q, r in ((b, c), (c, a), (a, b))]
        corners = np.stack(parts, axis=1) / np.maximum(np.sum(parts, axis=0), 1e-12)[:, None]
        faces_camera = ((normal * ways).sum(axis=1) < 0) & (twice_area > 1e-12)
        return Places(faces_camera, closest.distance_mm, closest.faces.astype(np.int64), corners, normal)


@njit(cache=True, nogil=True, error_model="numpy", boundscheck=False)
def _meet(embree, rays, pose, scale, memory, out, _sources):  # noqa: ANN001, ANN202
    """As `naris.register.equations.cast`, with the face and the place in it."""
    faces, us, vs = out
    for block in range(len(rays.x) // LANES):
        at = block * LANES
        ray = shoot(embree, rays, pose, scale, memory.packet, block)
        _seen, distance, face, u, v, normal, side = found(memory.packet, rays.valid, at, ray)
        keep(memory, at, distance * side, normal)
        store(faces, at, face)
        store(us, at, u)
        store(vs, at, v)


@lru_cache(maxsize=1)
def _sources() -> np.ndarray:
    return sources_of("naris.register.deformable.walls", "naris.register.equations", *OF_PACKETS)
