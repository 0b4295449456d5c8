"""Exact questions to a triangle mesh: what is the nearest point of it, and how often does it wind around a point.

`TriangleIndex` answers both for many points at once on one thread without the interpreter lock:

- The nearest point by a tree of boxes and the point-triangle distance of Ericson, Real-Time Collision
  Detection (2005), section 5.1.5.
- The winding number by counting signed crossings of the ray towards +z. Which triangles the ray crosses is
  decided edge by edge with a half-open rule, from the same two floating-point numbers on both sides of an edge:
  so a ray through an edge or a vertex of a closed mesh is never counted twice or missed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, Int32, Int64
from numba import njit

_LEAF = 2
_STACK = 64
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
        points = np.asarray(points_mm, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        found, distance, rows = np.empty_like(flat), np.empty(len(flat)), np.empty(len(flat), dtype=np.int64)
        _closest_of_many(flat, self.corners_mm, self.leaf_start, self.boxes_mm, found, distance, rows)
        shape = points.shape[:-1]
        return Closest(found.reshape(points.shape), distance.reshape(shape), self.face_ids[rows].reshape(shape))

    def winding(self, points_mm: Float[np.ndarray, "*n 3"]) -> Int[np.ndarray, "*n"]:
        """How often the surface winds around each point: 1 inside a simple closed surface, 0 outside.

        Where a surface cuts through itself the overlap counts 2, and a pocket turned inside out −1.
        """
        points = np.asarray(points_mm, dtype=np.float64)
        flat = np.ascontiguousarray(points.reshape(-1, 3))
        numbers = np.zeros(len(flat), dtype=np.int64)
        _winding_of_many(flat, self.corners_mm, self.columns, numbers)
        return numbers.reshape(points.shape[:-1])

    def lattice(
        self, origin_mm: Float[np.ndarray, "3"], spacing_mm: float, shape: tuple[int, int, int]
    ) -> Float32[np.ndarray, "nx ny nz"]:
        """The exact distance in mm at each node of a lattice, positive where the surface winds around it."""
        origin, values = np.asarray(origin_mm, dtype=np.float64), np.empty(shape, dtype=np.float32)
        _closest_of_lattice(origin, spacing_mm, self.corners_mm, self.leaf_start, self.boxes_mm, values)
        _sign_lattice(origin, spacing_mm, self.corners_mm, self.columns, values)
        return values


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
        high, low = (ufunc.reduceat(middles[order], start) for ufunc in (np.maximum, np.minimum))
        part = np.repeat(np.arange(2**level), np.diff(start, append=count))
        order = order[np.lexsort((middles[order, np.argmax(high - low, axis=1)[part]], part))]
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


@njit(cache=True, nogil=True)
def _box_distance2(box, node, x, y, z):  # type: ignore[no-untyped-def]
    dx = max(box[node, 0] - x, x - box[node, 3], 0.0)
    dy = max(box[node, 1] - y, y - box[node, 4], 0.0)
    dz = max(box[node, 2] - z, z - box[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def _nearest_in_triangle(t, f, x, y, z):  # type: ignore[no-untyped-def]
    """Barycentric weights (v, w) of the second and third corner at the nearest point (Ericson 2005, 5.1.5)."""
    ax, ay, az = t[f, 0, 0], t[f, 0, 1], t[f, 0, 2]
    abx, aby, abz = t[f, 1, 0] - ax, t[f, 1, 1] - ay, t[f, 1, 2] - az
    acx, acy, acz = t[f, 2, 0] - ax, t[f, 2, 1] - ay, t[f, 2, 2] - az
    apx, apy, apz = x - ax, y - ay, z - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    abac = abx * acx + aby * acy + abz * acz
    d3, d4 = d1 - (abx * abx + aby * aby + abz * abz), d2 - abac
    d5, d6 = d1 - abac, d2 - (acx * acx + acy * acy + acz * acz)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        v, w = 1.0, 0.0
    elif d6 >= 0.0 and d5 <= d6:
        v, w = 0.0, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        v, w = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        scale = 1.0 / (va + vb + vc)
        v, w = vb * scale, vc * scale
    return v, w


@njit(cache=True, nogil=True)
def _triangle_distance2(t, f, x, y, z):  # type: ignore[no-untyped-def]
    v, w = _nearest_in_triangle(t, f, x, y, z)
    dx = t[f, 0, 0] + v * (t[f, 1, 0] - t[f, 0, 0]) + w * (t[f, 2, 0] - t[f, 0, 0]) - x
    dy = t[f, 0, 1] + v * (t[f, 1, 1] - t[f, 0, 1]) + w * (t[f, 2, 1] - t[f, 0, 1]) - y
    dz = t[f, 0, 2] + v * (t[f, 1, 2] - t[f, 0, 2]) + w * (t[f, 2, 2] - t[f, 0, 2]) - z
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def _closest_of_one(x, y, z, seed, corners, leaf_start, boxes, stack, stack_d2):  # type: ignore[no-untyped-def]
    """The nearest triangle and its squared distance; a good `seed` triangle spares most of the search."""
    best, best_d2 = seed, _triangle_distance2(corners, seed, x, y, z)
    top, first_leaf = 0, len(leaf_start) - 2
    stack[0], stack_d2[0] = 0, _box_distance2(boxes, 0, x, y, z)
    while top >= 0:
        node, d2 = stack[top], stack_d2[top]
        top -= 1
        if d2 >= best_d2:
            continue
        if node >= first_leaf:
            for f in range(leaf_start[node - first_leaf], leaf_start[node - first_leaf + 1]):
                d2 = _triangle_distance2(corners, f, x, y, z)
                if d2 < best_d2:
                    best, best_d2 = f, d2
            continue
        left, right = 2 * node + 1, 2 * node + 2
        near_d2, far_d2 = _box_distance2(boxes, left, x, y, z), _box_distance2(boxes, right, x, y, z)
        if far_d2 < near_d2:
            left, right, near_d2, far_d2 = right, left, far_d2, near_d2
        if far_d2 < best_d2:
            top += 1
            stack[top], stack_d2[top] = right, far_d2
        if near_d2 < best_d2:
            top += 1
            stack[top], stack_d2[top] = left, near_d2
    return best, best_d2


@njit(cache=True, nogil=True)
def _closest_of_many(points, corners, leaf_start, boxes, found, distance, rows):  # type: ignore[no-untyped-def]
    stack, stack_d2 = np.empty(_STACK, dtype=np.int64), np.empty(_STACK)
    f = 0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        f, d2 = _closest_of_one(x, y, z, f, corners, leaf_start, boxes, stack, stack_d2)
        v, w = _nearest_in_triangle(corners, f, x, y, z)
        for k in range(3):
            found[n, k] = (1.0 - v - w) * corners[f, 0, k] + v * corners[f, 1, k] + w * corners[f, 2, k]
        distance[n], rows[n] = np.sqrt(d2), f


@njit(cache=True, nogil=True)
def _closest_of_lattice(origin, spacing, corners, leaf_start, boxes, values):  # type: ignore[no-untyped-def]
    stack, stack_d2 = np.empty(_STACK, dtype=np.int64), np.empty(_STACK)
    f = 0
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            for step in range(values.shape[2]):
                # To and fro, so that the last nearest triangle is always that of a neighbour.
                k = step if j % 2 == 0 else values.shape[2] - 1 - step
                x, y, z = origin[0] + i * spacing, origin[1] + j * spacing, origin[2] + k * spacing
                f, d2 = _closest_of_one(x, y, z, f, corners, leaf_start, boxes, stack, stack_d2)
                values[i, j, k] = np.sqrt(d2)


@njit(cache=True, nogil=True)
def _cell_members(columns, x, y):  # type: ignore[no-untyped-def]
    """The slice of `columns.members` over (x, y), in the arithmetic that sorted the triangles in."""
    u, v = (x - columns.low_mm[0]) / columns.cell_mm, (y - columns.low_mm[1]) / columns.cell_mm
    first, last = 0, 0
    if u >= 0.0 and v >= 0.0 and u < columns.nx + 1 and v < columns.ny + 1:
        cell = min(int(u), columns.nx - 1) * columns.ny + min(int(v), columns.ny - 1)
        first, last = columns.start[cell], columns.start[cell + 1]
    return first, last


@njit(cache=True, nogil=True)
def _turns(t, f, x, y):  # type: ignore[no-untyped-def]
    """+1 where the line through (x, y) along +z leaves through the front of triangle f, −1 through its back, or 0.

    Winding number in the plane by half-open edge crossings; each edge is judged from its lower end, so that the
    two triangles on it always say the same.
    """
    number = 0
    for e in range(3):
        ax, ay, bx, by = t[f, e, 0], t[f, e, 1], t[f, (e + 1) % 3, 0], t[f, (e + 1) % 3, 1]
        if ay <= y and by > y:
            if (bx - ax) * (y - ay) - (x - ax) * (by - ay) > 0.0:
                number += 1
        elif by <= y and ay > y and (ax - bx) * (y - by) - (x - bx) * (ay - by) > 0.0:
            number -= 1
    return number


@njit(cache=True, nogil=True)
def _height(t, f, x, y):  # type: ignore[no-untyped-def]
    """The z of triangle f over (x, y)."""
    low, high = min(t[f, 0, 2], t[f, 1, 2], t[f, 2, 2]), max(t[f, 0, 2], t[f, 1, 2], t[f, 2, 2])
    ux, uy, uz = t[f, 1, 0] - t[f, 0, 0], t[f, 1, 1] - t[f, 0, 1], t[f, 1, 2] - t[f, 0, 2]
    vx, vy, vz = t[f, 2, 0] - t[f, 0, 0], t[f, 2, 1] - t[f, 0, 1], t[f, 2, 2] - t[f, 0, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    height = 0.5 * (low + high)
    if nz != 0.0:
        height = min(max(t[f, 0, 2] - (nx * (x - t[f, 0, 0]) + ny * (y - t[f, 0, 1])) / nz, low), high)
    return height


@njit(cache=True, nogil=True)
def _winding_of_many(points, corners, columns, numbers):  # type: ignore[no-untyped-def]
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        first, last = _cell_members(columns, x, y)
        for i in range(first, last):
            f = columns.members[i]
            turns = _turns(corners, f, x, y)
            if turns != 0 and _height(corners, f, x, y) > z:
                numbers[n] += turns


@njit(cache=True, nogil=True)
def _sign_lattice(origin, spacing, corners, columns, values):  # type: ignore[no-untyped-def]
    """Turns the values of nodes that the surface does not wind around negative, a whole column at a time."""
    depth = values.shape[2]
    below = np.empty(depth + 1, dtype=np.int64)
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            x, y = origin[0] + i * spacing, origin[1] + j * spacing
            first, last = _cell_members(columns, x, y)
            below[:] = 0
            for member in range(first, last):
                f = columns.members[member]
                turns = _turns(corners, f, x, y)
                if turns != 0:
                    # The nodes 0 … k − 1 lie below this crossing.
                    k = int(np.ceil((_height(corners, f, x, y) - origin[2]) / spacing))
                    below[min(max(k, 0), depth)] += turns
            number = 0
            for k in range(depth - 1, -1, -1):
                number += below[k + 1]
                if number < 1:
                    values[i, j, k] = -values[i, j, k]
