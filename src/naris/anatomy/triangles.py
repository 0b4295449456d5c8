"""Exact questions to a triangle mesh: what is the nearest point of it, and how often does it wind around a point.

`TriangleIndex` answers both for many points at once, without the interpreter lock:

- The nearest point by a tree of boxes and the point-triangle distance of Ericson, Real-Time Collision
  Detection (2005), section 5.1.5.
- The winding number by counting signed crossings of the ray towards +z. Which triangles the ray crosses is
  decided edge by edge with a half-open rule, from the same two floating-point numbers on both sides of an edge:
  so a ray through an edge or a vertex of a closed mesh is never counted twice or missed.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32, Int64
from scipy import ndimage

from naris.anatomy.kernels import closest_of_lattice, closest_of_many, sign_lattice, winding_of_many
from naris.core.cores import cores

_LEAF = 2
_SLABS = 32  # of a lattice, worked on side by side: thin enough that the threads end together
_MOST_CELLS = 4096


@dataclass(frozen=True, eq=False)
class Closest:
    """The nearest points of a surface.

    Attributes:
        points_mm: (..., 3) on the surface.
        distance_mm: (...) at least 0.
        faces: (...) the triangle that each lies in.
    """

    points_mm: Float[np.ndarray, "*n 3"]
    distance_mm: Float[np.ndarray, "*n"]
    faces: Int[np.ndarray, "*n"]


class Columns(NamedTuple):
    """Triangles by the cell of the x-y plane that they lie over (compressed rows; a named tuple for numba).

    Attributes:
        start: (nx·ny + 1,) where the members of each cell begin.
        members: rows of `TriangleIndex.corners_mm`.
        low_mm: (2,) the low corner of the grid.
        cell_mm: the edge of a cell.
        nx, ny: cells along x and y.
    """

    start: Int64[np.ndarray, "c"]
    members: Int64[np.ndarray, "e"]
    low_mm: Float[np.ndarray, "2"]
    cell_mm: float
    nx: int
    ny: int


@dataclass(frozen=True, eq=False)
class TriangleIndex:
    """A mesh prepared for queries; make it with `index_triangles`.

    Attributes:
        corners_mm: (F, 3, 3) the corners of each triangle, in the order of the leaves of the tree.
        face_ids: (F,) the face that each of them was.
        leaf_start: (L + 1,) where each leaf of the tree begins in them.
        boxes_mm: (2L − 1, 6) low and high corner of each box of a complete binary tree, root first.
        columns: which triangles lie over each cell of a grid in the x-y plane.
    """

    corners_mm: Float[np.ndarray, "f 3 3"]
    face_ids: Int64[np.ndarray, "f"]
    leaf_start: Int64[np.ndarray, "l"]
    boxes_mm: Float[np.ndarray, "m 6"]
    columns: Columns

    def closest(self, points_mm: Float[np.ndarray, "*n 3"]) -> Closest:
        """The nearest point of the surface to each point (double precision)."""
        return self._closest(points_mm, self.corners_mm, self.boxes_mm)

    def closest_of(
        self, vertices_mm: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], points_mm: Float[np.ndarray, "*n 3"]
    ) -> Closest:
        """As `closest`, after the vertices of the mesh went elsewhere: exact, and slower the further they went."""
        corners = np.ascontiguousarray(vertices_mm[faces[self.face_ids]])
        boxes = np.hstack([corners.min(axis=1), corners.max(axis=1)])
        return self._closest(points_mm, corners, _boxes_of_tree(boxes, self.leaf_start))

    def _closest(
        self, points_mm: Float[np.ndarray, "*n 3"], corners: Float[np.ndarray, "f 3 3"], boxes: Float[np.ndarray, "m 6"]
    ) -> Closest:
        points = np.asarray(points_mm, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        found, distance, rows = np.empty_like(flat), np.empty(len(flat)), np.empty(len(flat), dtype=np.int64)
        closest_of_many(flat, corners, self.leaf_start, boxes, found, distance, rows)
        shape = points.shape[:-1]
        return Closest(found.reshape(points.shape), distance.reshape(shape), self.face_ids[rows].reshape(shape))

    def winding(self, points_mm: Float[np.ndarray, "*n 3"]) -> Int[np.ndarray, "*n"]:
        """How often the surface winds around each point: 1 inside a simple closed surface, 0 outside.

        Where a surface cuts through itself the overlap counts 2, and a pocket turned inside out −1.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        numbers = np.zeros(len(flat), dtype=np.int64)
        winding_of_many(flat, self.corners_mm, self.columns, numbers)
        return numbers.reshape(points.shape[:-1])

    def lattice(
        self,
        origin_mm: Float[np.ndarray, "3"],
        spacing_mm: float,
        shape: tuple[int, int, int],
        tissue_to_mm: float = np.inf,
    ) -> Float32[np.ndarray, "nx ny nz"]:
        """The exact distance in mm at each node of a lattice, positive where the surface winds around it.

        With `tissue_to_mm`, nodes that it does not wind around may say −`tissue_to_mm` if they are further away.
        """
        origin, values = np.asarray(origin_mm, dtype=np.float64), np.full(shape, np.nan, dtype=np.float32)
        if np.isfinite(tissue_to_mm):
            values[self._far_outside(origin, spacing_mm, shape, tissue_to_mm)] = tissue_to_mm

        def work(layers: tuple[int, int]) -> None:
            closest_of_lattice(origin, spacing_mm, self.corners_mm, self.leaf_start, self.boxes_mm, values, layers)

        edges = np.linspace(0, shape[0], min(_SLABS, shape[0]) + 1).astype(int).tolist()
        with ThreadPoolExecutor(cores(), thread_name_prefix="distance") as pool:
            list(pool.map(work, pairwise(edges)))
        sign_lattice(origin, spacing_mm, self.corners_mm, self.columns, values)
        return values

    def _far_outside(
        self, origin: Float[np.ndarray, "3"], spacing_mm: float, shape: tuple[int, int, int], least_mm: float
    ) -> Bool[np.ndarray, "nx ny nz"]:
        """Nodes that the surface does not wind around and that lie at least so far from it; nearly all of them."""
        near = np.ones(shape, dtype=np.float32)
        sign_lattice(origin, spacing_mm, self.corners_mm, self.columns, near)
        inside = near > 0
        # Every triangle lies within its own size of its first corner, and that within half a diagonal of its node.
        size_mm = float(np.linalg.norm(np.ptp(self.corners_mm, axis=1), axis=1).max())
        nodes = np.rint((self.corners_mm[:, 0] - origin) / spacing_mm).astype(np.int64)
        wall = np.zeros(shape, dtype=bool)
        wall[tuple(np.clip(nodes, 0, np.array(shape) - 1).T)] = True
        reach = int(np.ceil((least_mm + size_mm) / spacing_mm + 0.5))
        return ~inside & ~ndimage.maximum_filter(wall, 2 * reach + 1)


def index_triangles(vertices_mm: Float[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"]) -> TriangleIndex:
    """Prepares a mesh (mm, any frame) for queries."""
    corners = np.ascontiguousarray(np.asarray(vertices_mm, dtype=np.float64)[faces])
    face_ids, leaf_start = _sort_into_leaves(corners.mean(axis=1))
    corners = np.ascontiguousarray(corners[face_ids])
    boxes = np.hstack([corners.min(axis=1), corners.max(axis=1)])
    return TriangleIndex(corners, face_ids, leaf_start, _boxes_of_tree(boxes, leaf_start), _sort_into_columns(boxes))


def _sort_into_leaves(middles: Float[np.ndarray, "f 3"]) -> tuple[Int64[np.ndarray, "f"], Int64[np.ndarray, "l"]]:
    """Halves the triangles along their longest extent, level by level: their order, and where each leaf begins."""
    count = len(middles)
    levels = max(int(np.ceil(np.log2(count / _LEAF))), 0)
    order = np.arange(count)
    for level in range(levels):
        start = np.arange(2**level) * count // 2**level
        sorted_mm = middles[order]
        high, low = (ufunc.reduceat(sorted_mm, start) for ufunc in (np.maximum, np.minimum))
        # Parts differ by one triangle at most: as rows of a table, each is sorted by itself; what is beyond its end
        # belongs to the next part, counts as infinite and stays behind.
        length = np.diff(start, append=count)
        rows = start[:, None] + np.arange(length.max())
        inside = np.arange(length.max()) < length[:, None]
        values = np.where(
            inside, sorted_mm[np.minimum(rows, count - 1), np.argmax(high - low, axis=1)[:, None]], np.inf
        )
        turn = np.argsort(values, axis=1, kind="stable")
        order = order[(start[:, None] + turn)[inside]]
    return order, np.append(np.arange(2**levels) * count // 2**levels, count)


def _boxes_of_tree(boxes: Float[np.ndarray, "f 6"], leaf_start: Int64[np.ndarray, "l"]) -> Float[np.ndarray, "m 6"]:
    """The boxes of a complete binary tree, root first: those of node i's children are 2i + 1 and 2i + 2."""
    low = np.minimum.reduceat(boxes[:, :3], leaf_start[:-1])
    high = np.maximum.reduceat(boxes[:, 3:], leaf_start[:-1])
    levels = [np.hstack([low, high])]
    while len(low) > 1:
        low, high = np.minimum(low[::2], low[1::2]), np.maximum(high[::2], high[1::2])
        levels.append(np.hstack([low, high]))
    return np.ascontiguousarray(np.vstack(levels[::-1]))


def _sort_into_columns(boxes: Float[np.ndarray, "f 6"]) -> Columns:
    """About one cell a triangle, so that a column holds a few dozen of them."""
    low = np.ascontiguousarray(boxes[:, :2].min(axis=0))
    size = np.maximum(boxes[:, 3:5].max(axis=0) - low, 1e-6)
    cell_mm = max(float(np.sqrt(size[0] * size[1] / len(boxes))), float(size.max()) / _MOST_CELLS)
    nx, ny = (int(extent / cell_mm) + 1 for extent in size)
    first = np.minimum(((boxes[:, :2] - low) / cell_mm).astype(np.int64), [nx - 1, ny - 1])
    last = np.minimum(((boxes[:, 3:5] - low) / cell_mm).astype(np.int64), [nx - 1, ny - 1])
    wide, deep = (last - first + 1).T
    members = np.repeat(np.arange(len(boxes)), wide * deep)
    turn = np.arange(len(members)) - np.repeat(np.cumsum(wide * deep) - wide * deep, wide * deep)
    i, j = first[members, 0] + turn // deep[members], first[members, 1] + turn % deep[members]
    cells = i * ny + j
    start = np.append(0, np.cumsum(np.bincount(cells, minlength=nx * ny)))
    return Columns(start, members[np.argsort(cells, kind="stable")], low, cell_mm, nx, ny)
