# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""The likelihood of each point over the whole surface, not at its best match alone, compiled.

A point was seen of any place on the surface. With an error that is no smaller than the folds of the surface the best
match is a biased guess of that place (it is nearer than the truth, and more often on a ridge than in a groove); the
integral of the likelihood over the surface is not. It is summed over nodes in each triangle (Strang and Fix 1973, three
points, exact to the second order), in the triangles that are at most e^−`_REACH` as likely as the best match.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from naris.register.likely_point.match import STACK, Placed, at_least, of_direction, of_triangle

_REACH = 12.0
_UNKNOWNS = 6

_njit = njit(cache=True, nogil=True, error_model="numpy")
_part_njit = njit(nogil=True, error_model="numpy")


class Nodes(NamedTuple):
    """Where the likelihood is summed.

    Attributes:
        parts: (F,) into how many parts the sides of each triangle are cut.
        area: (F,) mm² that each node of it stands for.
        start: (K + 1,) where the nodes for so many parts begin in `weights`.
        weights: (M, 2) barycentric, of the second and third corner.
    """

    parts: np.ndarray
    area: np.ndarray
    start: np.ndarray
    weights: np.ndarray


class Seen(NamedTuple):
    """The cloud where a pose puts it, and in its own frame.

    Attributes:
        placed: in the frame of the surface.
        points: (N, 3) in mm, in its own.
        root: (N, 3, 3) what makes their errors white.
        axes: (3, N, 3) normals, and major and minor axes of their errors.
        pose: (4, 4) from the cloud to the surface.
    """

    placed: Placed
    points: np.ndarray
    root: np.ndarray
    axes: np.ndarray
    pose: np.ndarray


class Sums(NamedTuple):
    """Of each point.

    Attributes:
        costs: (N,) −log of the integral, in mm².
        gradients: (N, 6) of the cost by the twist.
        matrices: (N, 6, 6) the mean second derivative over the places.
        spreads: (N, 6, 6) the covariance of the first one; the second derivative of the cost is the mean less this
            (Louis 1982).
    """

    costs: np.ndarray
    gradients: np.ndarray
    matrices: np.ndarray
    spreads: np.ndarray


class _Memory(NamedTuple):
    """For one place: itself, its triangle made white, and the first and second derivatives: squares of rows (5, 6)."""

    place: np.ndarray
    white: np.ndarray
    slope: np.ndarray
    gradient: np.ndarray


@_part_njit
def _derive(seen, n, normal, memory):
    """The derivatives of what a place of the surface costs point n; gives the normal in the frame of the cloud."""
    pose, place, slope, gradient = seen.pose, memory.place, memory.slope, memory.gradient
    q, m, off = np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        q[k] = m[k] = 0.0
        for j in range(3):
            q[k] += pose[j, k] * (place[j] - pose[j, 3])
            m[k] += pose[j, k] * normal[j]
        off[k] = q[k] - seen.points[n, k]
    gradient[:] = 0.0
    for k in range(3):
        u = seen.root[n, k]
        white = u[0] * off[0] + u[1] * off[1] + u[2] * off[2]
        slope[k, 0], slope[k, 1], slope[k, 2] = -u[0], -u[1], -u[2]
        slope[k, 3] = u[1] * q[2] - u[2] * q[1]
        slope[k, 4] = u[2] * q[0] - u[0] * q[2]
        slope[k, 5] = u[0] * q[1] - u[1] * q[0]
        for j in range(_UNKNOWNS):
            gradient[j] += white * slope[k, j]
    return m


@_part_njit
def _derive_normal(seen, n, m, memory):
    """Adds those of what its normal m costs, of κ (1 − n·m) − β ((a·m)² − (b·m)²)."""
    straight, oval, slope, gradient = seen.placed.straight[n], seen.placed.oval[n], memory.slope, memory.gradient
    c, a, b = seen.axes[0, n], seen.axes[1, n], seen.axes[2, n]
    major = a[0] * m[0] + a[1] * m[1] + a[2] * m[2]
    minor = b[0] * m[0] + b[1] * m[1] + b[2] * m[2]
    by_major, by_minor = np.sqrt(straight - 2.0 * oval), np.sqrt(straight + 2.0 * oval)
    for j in range(3):
        i, k = (j + 1) % 3, (j + 2) % 3
        pull_i = straight * c[i] + 2.0 * oval * (major * a[i] - minor * b[i])
        pull_k = straight * c[k] + 2.0 * oval * (major * a[k] - minor * b[k])
        gradient[3 + j] -= pull_i * m[k] - pull_k * m[i]
        slope[3, 3 + j] = by_major * (a[i] * m[k] - a[k] * m[i])
        slope[4, 3 + j] = by_minor * (b[i] * m[k] - b[k] * m[i])


@_part_njit
def _add(sums, n, share, memory):
    slope, gradient = memory.slope, memory.gradient
    matrix, spread = sums.matrices[n], sums.spreads[n]
    for i in range(_UNKNOWNS):
        sums.gradients[n, i] += share * gradient[i]
        for j in range(i + 1):
            spread[i, j] += share * gradient[i] * gradient[j]
            for r in range(len(slope)):
                matrix[i, j] += share * slope[r, i] * slope[r, j]


@_part_njit
def _sum_triangle(tree, nodes, seen, which, best, sums, memory):
    """Adds what triangle f, made white in `memory`, gives to point n of (n, f); gives its part of the integral."""
    n, f = which
    placed, white, place, total = seen.placed, memory.white, memory.place, 0.0
    with_normal = placed.straight[n] > 0.0
    turned = of_direction(placed, n, tree.normals[f]) if with_normal else 0.0
    for k in range(nodes.start[nodes.parts[f]], nodes.start[nodes.parts[f] + 1]):
        v, w = nodes.weights[k, 0], nodes.weights[k, 1]
        u, cost = 1.0 - v - w, turned - best
        for j in range(3):
            off = u * white[0, 0, j] + v * white[0, 1, j] + w * white[0, 2, j]
            cost += 0.5 * off * off
            place[j] = u * tree.corners[f, 0, j] + v * tree.corners[f, 1, j] + w * tree.corners[f, 2, j]
        m = _derive(seen, n, tree.normals[f], memory)
        if with_normal:
            _derive_normal(seen, n, m, memory)
        share = nodes.area[f] * np.exp(-cost)
        total += share
        _add(sums, n, share, memory)
    return total


@_njit
def average(tree, nodes, seen, found, sums, first, last):
    """The sums of points first … last − 1, in all that is likely enough beside their best matches `found`."""
    stack, placed = np.empty(STACK, np.int64), seen.placed
    memory = _Memory(
        np.empty(3),
        np.empty((1, 3, 3)),
        np.zeros((5 if placed.straight[0] > 0.0 else 3, _UNKNOWNS)),
        np.empty(_UNKNOWNS),
    )
    first_leaf = len(tree.leaf_start) - 2
    for n in range(first, last):
        best, total = found.costs[n], 0.0
        matrix, spread, gradient = sums.matrices[n], sums.spreads[n], sums.gradients[n]
        matrix[:], spread[:], gradient[:] = 0.0, 0.0, 0.0
        stack[0], top = 0, 0
        while top >= 0:
            node = stack[top]
            top -= 1
            if at_least(tree, placed, n, node) > best + _REACH:
                continue
            if node < first_leaf:
                stack[top + 1], stack[top + 2] = 2 * node + 1, 2 * node + 2
                top += 2
                continue
            for f in range(tree.leaf_start[node - first_leaf], tree.leaf_start[node - first_leaf + 1]):
                if of_triangle(tree, placed, n, f, memory.white)[0] <= best + _REACH:
                    total += _sum_triangle(tree, nodes, seen, (n, f), best, sums, memory)
        sums.costs[n] = best - np.log(total)
        for i in range(_UNKNOWNS):
            gradient[i] /= total
        for i in range(_UNKNOWNS):
            for j in range(i + 1):
                matrix[i, j] /= total
                spread[i, j] = spread[i, j] / total - gradient[i] * gradient[j]
                matrix[j, i], spread[j, i] = matrix[i, j], spread[i, j]
