# ruff: noqa: ANN001, ANN201
# mypy: ignore-errors
"""The most likely match of each point on a surface, compiled.

Not the nearest point but the one with the least −log likelihood, of the place under the covariance of the point and of
the direction under that of its normal (Billings and Taylor 2014; Billings, Boctor and Taylor 2015, section 2.3: a
tree whose boxes bound both from below). With white = metric · y + offset the Mahalanobis distance of y is the length
of white, so that the search in a triangle is that of the nearest point to the origin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from naris.anatomy.kernels import box_distance2, nearest_in_triangle

STACK = 64

_njit = njit(cache=True, nogil=True, error_model="numpy")
_part_njit = njit(nogil=True, error_model="numpy")


class Tree(NamedTuple):
    """Triangles in a complete binary tree.

    Attributes:
        corners, leaf_start, boxes: as in `TriangleIndex`, in mm.
        normals: (F, 3) unit, 0 of a triangle without area.
        cones: (2L − 1, 5) mean normal in a box, and cosine and sine of the angle that all lie within.
        sources: an array whose type changes with the sources of this code: numba looks at one file only.
    """

    corners: np.ndarray
    leaf_start: np.ndarray
    boxes: np.ndarray
    normals: np.ndarray
    cones: np.ndarray
    sources: np.ndarray


class Placed(NamedTuple):
    """Points where a pose puts them, in the frame of the surface.

    Attributes:
        points: (N, 3) in mm.
        metric, offset: (N, 3, 3) and (N, 3), white = metric · y + offset.
        least: (N,) the smallest eigenvalue of the precision, 1/mm².
        normal, major, minor: (N, 3) as in `Axes`.
        straight, oval: (N,) κ and β of the normals; 0 where they do not count.
    """

    points: np.ndarray
    metric: np.ndarray
    offset: np.ndarray
    least: np.ndarray
    normal: np.ndarray
    major: np.ndarray
    minor: np.ndarray
    straight: np.ndarray
    oval: np.ndarray


class Found(NamedTuple):
    """The match of each point.

    Attributes:
        rows: (N,) of the tree's triangles; where the search begins, then what it found.
        weights: (N, 2) barycentric, of the second and third corner.
        costs: (N,) −log likelihood but for constants, at least 0.
    """

    rows: np.ndarray
    weights: np.ndarray
    costs: np.ndarray


@_part_njit
def of_direction(placed, n, normal):
    """What a unit normal of the surface costs point n; at least 0."""
    x, y, z = normal[0], normal[1], normal[2]
    along = x * placed.normal[n, 0] + y * placed.normal[n, 1] + z * placed.normal[n, 2]
    major = x * placed.major[n, 0] + y * placed.major[n, 1] + z * placed.major[n, 2]
    minor = x * placed.minor[n, 0] + y * placed.minor[n, 1] + z * placed.minor[n, 2]
    return placed.straight[n] * (1.0 - along) - placed.oval[n] * (major * major - minor * minor)


@_part_njit
def of_triangle(tree, placed, n, f, white):
    """The least cost of point n in triangle f, and where; `white` is working memory (1, 3, 3)."""
    for c in range(3):
        x, y, z = tree.corners[f, c, 0], tree.corners[f, c, 1], tree.corners[f, c, 2]
        for k in range(3):
            m = placed.metric[n, k]
            white[0, c, k] = m[0] * x + m[1] * y + m[2] * z + placed.offset[n, k]
    v, w = nearest_in_triangle(white, 0, 0.0, 0.0, 0.0)
    cost = 0.0
    for k in range(3):
        off = (1.0 - v - w) * white[0, 0, k] + v * white[0, 1, k] + w * white[0, 2, k]
        cost += 0.5 * off * off
    if placed.straight[n] > 0.0:
        cost += of_direction(placed, n, tree.normals[f])
    return cost, v, w


@_part_njit
def at_least(tree, placed, n, node):
    """What every triangle in a box costs point n at least."""
    box, total = tree.boxes, 0.0
    for k in range(3):
        middle, reach = placed.offset[n, k], 0.0
        for j in range(3):
            m = placed.metric[n, k, j]
            middle += 0.5 * m * (box[node, j] + box[node, 3 + j])
            reach += 0.5 * abs(m) * (box[node, 3 + j] - box[node, j])
        off = max(abs(middle) - reach, 0.0)
        total += off * off
    x, y, z = placed.points[n, 0], placed.points[n, 1], placed.points[n, 2]
    cost = 0.5 * max(total, placed.least[n] * box_distance2(box, node, x, y, z))
    if placed.straight[n] > 0.0:
        cone, normal = tree.cones[node], placed.normal[n]
        cosine = cone[0] * normal[0] + cone[1] * normal[1] + cone[2] * normal[2]
        if cosine < cone[3]:
            nearest = cosine * cone[3] + np.sqrt(max(1.0 - cosine * cosine, 0.0)) * cone[4]
            cost += placed.straight[n] * (1.0 - nearest) - placed.oval[n] * (1.0 - nearest * nearest)
    return cost


@_njit
def match(tree, placed, found, first, last):
    """The matches of points first … last − 1."""
    stack, bounds, white = np.empty(STACK, np.int64), np.empty(STACK), np.empty((1, 3, 3))
    first_leaf = len(tree.leaf_start) - 2
    for n in range(first, last):
        best = found.rows[n]
        least, best_v, best_w = of_triangle(tree, placed, n, best, white)
        top = 0
        stack[0], bounds[0] = 0, at_least(tree, placed, n, 0)
        while top >= 0:
            node, bound = stack[top], bounds[top]
            top -= 1
            if bound >= least:
                continue
            if node >= first_leaf:
                for f in range(tree.leaf_start[node - first_leaf], tree.leaf_start[node - first_leaf + 1]):
                    cost, v, w = of_triangle(tree, placed, n, f, white)
                    if cost < least:
                        best, least, best_v, best_w = f, cost, v, w
                continue
            near, far = 2 * node + 1, 2 * node + 2
            near_bound, far_bound = at_least(tree, placed, n, near), at_least(tree, placed, n, far)
            if far_bound < near_bound:
                near, far, near_bound, far_bound = far, near, far_bound, near_bound
            if far_bound < least:
                top += 1
                stack[top], bounds[top] = far, far_bound
            if near_bound < least:
                top += 1
                stack[top], bounds[top] = near, near_bound
        found.rows[n], found.weights[n, 0], found.weights[n, 1], found.costs[n] = best, best_v, best_w, least
