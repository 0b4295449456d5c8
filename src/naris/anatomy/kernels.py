"""The compiled loops behind `triangles` and `distance`, without the interpreter lock.

Nearest point of a triangle: Ericson, Real-Time Collision Detection (2005), section 5.1.5. Arrays, in mm: `corners`
(F, 3, 3) in the order of the leaves of a complete binary tree, `leaf_start` (L + 1,), `boxes` (2L − 1, 6) and points
(N, 3).
"""
# ruff: noqa: ANN001, ANN201, ANN202, D103, PLR0913
# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator"

from __future__ import annotations

import numpy as np
from numba import njit

_STACK = 64


@njit(cache=True, nogil=True)
def box_distance2(box, node, x, y, z):
    dx = max(box[node, 0] - x, x - box[node, 3], 0.0)
    dy = max(box[node, 1] - y, y - box[node, 4], 0.0)
    dz = max(box[node, 2] - z, z - box[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def nearest_in_triangle(t, f, x, y, z):
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
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
        v, w = d1 / (d1 - d3), 0.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
        v, w = 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0 and (d4 - d3) + (d5 - d6) > 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    elif va + vb + vc > 0.0:
        scale = 1.0 / (va + vb + vc)
        v, w = vb * scale, vc * scale
    else:  # a triangle without area, as a level set through a node of its grid has them
        v, w = 0.0, 0.0
    return v, w


@njit(cache=True, nogil=True)
def _triangle_distance2(t, f, x, y, z):
    v, w = nearest_in_triangle(t, f, x, y, z)
    dx = t[f, 0, 0] + v * (t[f, 1, 0] - t[f, 0, 0]) + w * (t[f, 2, 0] - t[f, 0, 0]) - x
    dy = t[f, 0, 1] + v * (t[f, 1, 1] - t[f, 0, 1]) + w * (t[f, 2, 1] - t[f, 0, 1]) - y
    dz = t[f, 0, 2] + v * (t[f, 1, 2] - t[f, 0, 2]) + w * (t[f, 2, 2] - t[f, 0, 2]) - z
    return dx * dx + dy * dy + dz * dz


@njit(cache=True, nogil=True)
def _closest_of_one(x, y, z, seed, corners, leaf_start, boxes, stack, stack_d2):
    """The nearest triangle and its squared distance; a good `seed` triangle spares most of the search."""
    best, best_d2 = seed, _triangle_distance2(corners, seed, x, y, z)
    top, first_leaf = 0, len(leaf_start) - 2
    stack[0], stack_d2[0] = 0, box_distance2(boxes, 0, x, y, z)
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
        near_d2, far_d2 = box_distance2(boxes, left, x, y, z), box_distance2(boxes, right, x, y, z)
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
def closest_of_many(points, corners, leaf_start, boxes, found, distance, rows):
    stack, stack_d2 = np.empty(_STACK, dtype=np.int64), np.empty(_STACK)
    f = 0
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        f, d2 = _closest_of_one(x, y, z, f, corners, leaf_start, boxes, stack, stack_d2)
        v, w = nearest_in_triangle(corners, f, x, y, z)
        for k in range(3):
            found[n, k] = (1.0 - v - w) * corners[f, 0, k] + v * corners[f, 1, k] + w * corners[f, 2, k]
        distance[n], rows[n] = np.sqrt(d2), f


@njit(cache=True, nogil=True)
def closest_of_lattice(origin, spacing, corners, leaf_start, boxes, values, layers):
    """Of the layers `layers[0]` … `layers[1]` − 1 along x; nodes that are not NaN before stay as they are."""
    stack, stack_d2 = np.empty(_STACK, dtype=np.int64), np.empty(_STACK)
    f = 0
    for i in range(layers[0], layers[1]):
        for j in range(values.shape[1]):
            for step in range(values.shape[2]):
                # To and fro, so that the last nearest triangle is always that of a neighbour.
                k = step if j % 2 == 0 else values.shape[2] - 1 - step
                if not np.isnan(values[i, j, k]):
                    continue
                x, y, z = origin[0] + i * spacing, origin[1] + j * spacing, origin[2] + k * spacing
                f, d2 = _closest_of_one(x, y, z, f, corners, leaf_start, boxes, stack, stack_d2)
                values[i, j, k] = np.sqrt(d2)


@njit(cache=True, nogil=True)
def _cell_members(columns, x, y):
    """The slice of `columns.members` over (x, y), in the arithmetic that sorted the triangles in."""
    u, v = (x - columns.low_mm[0]) / columns.cell_mm, (y - columns.low_mm[1]) / columns.cell_mm
    first, last = 0, 0
    if u >= 0.0 and v >= 0.0 and u < columns.nx + 1 and v < columns.ny + 1:
        cell = min(int(u), columns.nx - 1) * columns.ny + min(int(v), columns.ny - 1)
        first, last = columns.start[cell], columns.start[cell + 1]
    return first, last


@njit(cache=True, nogil=True)
def _turns(t, f, x, y):
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
def _height(t, f, x, y):
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
def winding_of_many(points, corners, columns, numbers):
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        first, last = _cell_members(columns, x, y)
        for i in range(first, last):
            f = columns.members[i]
            turns = _turns(corners, f, x, y)
            if turns != 0 and _height(corners, f, x, y) > z:
                numbers[n] += turns


@njit(cache=True, nogil=True)
def sign_lattice(origin, spacing, corners, columns, values):
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


@njit(cache=True, nogil=True)
def value_at(x, y, z, values, origin, spacing):
    """Trilinear; beyond the lattice the value at its edge less the way there; NaN for NaN."""
    nx, ny, nz = values.shape
    # Number by number: an array for each point would cost more than the rest.
    u = (x - origin[0]) / spacing
    v = (y - origin[1]) / spacing
    w = (z - origin[2]) / spacing
    if not (np.isfinite(u) and np.isfinite(v) and np.isfinite(w)):
        return np.nan
    cu, cv, cw = min(max(u, 0.0), nx - 1.0), min(max(v, 0.0), ny - 1.0), min(max(w, 0.0), nz - 1.0)
    beyond = np.sqrt((u - cu) ** 2 + (v - cv) ** 2 + (w - cw) ** 2) * spacing
    i, j, k = min(int(cu), nx - 2), min(int(cv), ny - 2), min(int(cw), nz - 2)
    a, b, c = cu - i, cv - j, cw - k
    low = (1 - c) * values[i, j, k] + c * values[i, j, k + 1]
    up = (1 - c) * values[i, j + 1, k] + c * values[i, j + 1, k + 1]
    near = (1 - b) * low + b * up
    low = (1 - c) * values[i + 1, j, k] + c * values[i + 1, j, k + 1]
    up = (1 - c) * values[i + 1, j + 1, k] + c * values[i + 1, j + 1, k + 1]
    return (1 - a) * near + a * ((1 - b) * low + b * up) - beyond


@njit(cache=True, nogil=True)
def interpolate(points, values, origin, spacing, out):
    for n in range(len(points)):
        out[n] = value_at(points[n, 0], points[n, 1], points[n, 2], values, origin, spacing)
