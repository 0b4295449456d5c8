# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""The equations of a cloud whose points are off in every direction, compiled.

What a camera at a pose sees is cast on a lattice of rays. A point is the place of some ray on the wall plus noise, so
its likelihood is the sum over the rays around it (the E-step of Granger and Pennec 2002, ECCV, taken over what is
visible instead of a whole surface). Nothing behind a wall counts, and edges and slits need no rule of their own. A ray
stands for a patch of the wall: across it the noise alone tells how far a point may be, along it the patch is added.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from naris.register.equations import POSE, cast, per_ray, priors

_LEAST_COSINE = 0.1
_PATCH = 0.4  # standard deviation of a patch, beside the way from ray to ray
_FAR_MM = 1e6
_POWER = 64.0  # (1 − x/64)^64 in place of exp(−x): no call, so the loop runs on all lanes
_NORM = 0.06349363593424098  # (2π)^(−3/2)

_part_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False)


class Seen(NamedTuple):
    """What the rays of the lattices meet, in the rig; lengths in mm.

    Attributes:
        t: (K,) how far; very far where nothing is.
        wall: (3, K) its normal.
        cosine: (K,) of its normal with the ray, negative.
        patch: (K,) variance of the patch along the wall (mm²).
        weights, pulls: (K,) responsibilities of the rays over the variance, and times the way along the row.
        shares: (most,) of the rays around one point.
    """

    t: np.ndarray
    wall: np.ndarray
    cosine: np.ndarray
    patch: np.ndarray
    weights: np.ndarray
    pulls: np.ndarray
    shares: np.ndarray


class Cloud(NamedTuple):
    """Points, and where on the lattice of their view each of them lies; lengths in the unit of the observation.

    Attributes:
        points: (3, N) from the origin of their view.
        range, sd: (N,) how far they are, and the standard deviation of the error in each direction.
        window: (N, 4) first and last row and first and last column (each last one not in it) around a point.
        first, stride: (N,) the first ray of its view, and from one row to the next.
        solid: (K,) what solid angle each ray of the lattices stands for.
        origin: (K, 3) where each ray begins, in the rig.
        most: the most rays in a window.
    """

    points: np.ndarray
    range: np.ndarray
    sd: np.ndarray
    window: np.ndarray
    first: np.ndarray
    stride: np.ndarray
    solid: np.ndarray
    origin: np.ndarray
    most: int


@_part_njit
def linearise_cloud(sight, pose, log_scale, smooth, width, equations):
    """As `naris.register.steps.linearise`, for points."""
    model, cloud = sight.model, sight.cloud
    scale, n = np.float32(np.exp(log_scale)), len(cloud.range)
    seen, outside = _look(sight, pose, scale)
    cost, even = 0.0, model.outliers / model.reach
    for i in range(n):
        cost += _point(sight.rays, cloud, i, (scale, np.float32(width), 1.0 - model.outliers, even), seen)
    _add_up(sight.rays, cloud, scale, seen, POSE + model.free, equations)
    cost += priors(sight.rays, model, log_scale, smooth, equations)
    return per_ray(model, cost, n, 2 * outside > len(seen.t), log_scale)


@_part_njit
def _look(sight, pose, scale):
    """What the lattices see from a pose, and how many of their rays meet a wall from outside."""
    rays, memory, cloud = sight.rays, sight.memory, sight.cloud
    cast(sight.embree, rays, pose, scale, memory)
    n = len(rays.x)
    t, cosine, patch = np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32)
    wall = np.empty((3, n), np.float32)
    outside = 0
    for k in range(n):
        nx, ny, nz = memory.normal[0, k], memory.normal[1, k], memory.normal[2, k]
        wall[0, k] = pose[0, 0] * nx + pose[1, 0] * ny + pose[2, 0] * nz
        wall[1, k] = pose[0, 1] * nx + pose[1, 1] * ny + pose[2, 1] * nz
        wall[2, k] = pose[0, 2] * nx + pose[1, 2] * ny + pose[2, 2] * nz
        there = nx * nx + ny * ny + nz * nz > 0.5
        t[k] = abs(memory.hit[k]) if there else _FAR_MM
        met = wall[0, k] * rays.x[k] + wall[1, k] * rays.y[k] + wall[2, k] * rays.z[k]
        cosine[k] = min(met, -_LEAST_COSINE)
        patch[k] = _PATCH * _PATCH * cloud.solid[k] * (t[k] / cosine[k]) ** 2 if there else 0.0
        if memory.hit[k] * sight.model.inside < 0:
            outside += 1
    weights, pulls = np.zeros(n, np.float32), np.zeros(n, np.float32)
    return Seen(t, wall, cosine, patch, weights, pulls, np.empty(cloud.most, np.float32)), outside


@_part_njit
def _point(rays, cloud, i, noise, seen):
    """−2 log likelihood of a point; adds to each ray around it its responsibility and how it pulls at its wall.

    A density along the ray, as that of a range, so that costs can be compared: it is the one in space times the area
    that a solid angle has at the point.
    """
    scale, width, real, even = noise
    px, py, pz = scale * cloud.points[0, i], scale * cloud.points[1, i], scale * cloud.points[2, i]
    r = scale * cloud.range[i]
    variance = (scale * cloud.sd[i] * width) ** 2
    precision, falls = np.float32(1.0) / variance, np.float32(0.5 / _POWER)
    first, stride, shares = cloud.first[i], cloud.stride[i], seen.shares
    top, bottom, left, right = cloud.window[i, 0], cloud.window[i, 1], cloud.window[i, 2], cloud.window[i, 3]
    across = right - left
    total = np.float32(0.0)
    for row in range(top, bottom):
        base, into = first + row * stride + left, (row - top) * across
        part = np.float32(0.0)
        for c in range(across):
            k = base + c
            dx, dy, dz = px - seen.t[k] * rays.x[k], py - seen.t[k] * rays.y[k], pz - seen.t[k] * rays.z[k]
            off = dx * seen.wall[0, k] + dy * seen.wall[1, k] + dz * seen.wall[2, k]
            beside = dx * dx + dy * dy + dz * dz - off * off
            spread = np.float32(1.0) / (variance + seen.patch[k])
            u = max(np.float32(1.0) - falls * (off * off * precision + beside * spread), np.float32(0.0))
            u2 = u * u
            u4 = u2 * u2
            u8 = u4 * u4
            u16 = u8 * u8
            u32 = u16 * u16
            shares[into + c] = u32 * u16 * u8 * u4 * u2 * u * spread
            part += u32 * u32 * spread
        total += part * cloud.solid[base]
    normal = real * _NORM * r * r * scale * np.sqrt(precision)
    density = normal * total
    each = np.float32(normal / (density + even))
    for row in range(top, bottom):
        base, into = first + row * stride + left, (row - top) * across
        weight = each * cloud.solid[base]
        for c in range(across):
            k = base + c
            w = weight * shares[into + c]
            dx, dy, dz = px - seen.t[k] * rays.x[k], py - seen.t[k] * rays.y[k], pz - seen.t[k] * rays.z[k]
            off = dx * seen.wall[0, k] + dy * seen.wall[1, k] + dz * seen.wall[2, k]
            along = (dx * rays.x[k] + dy * rays.y[k] + dz * rays.z[k]) / seen.cosine[k]
            seen.weights[k] += w * precision
            seen.pulls[k] += w * (off * precision + (along - off) / (variance + seen.patch[k]))
    return -2.0 * np.log(density + even)


@_part_njit
def _add_up(rays, cloud, scale, seen, unknowns, equations):
    """The normal equations from the responsibilities of the rays.

    When the pose moves, the place of a ray slides along it as the plane of its wall says.
    """
    matrix, right, origin = equations.matrix, equations.right, cloud.origin
    matrix[:unknowns, :unknowns] = 0
    right[:unknowns] = 0
    row = np.empty(POSE + 1)
    for k in range(len(seen.t)):
        if seen.weights[k] < 1e-9 or seen.t[k] >= _FAR_MM:
            continue
        mx, my, mz, t = seen.wall[0, k], seen.wall[1, k], seen.wall[2, k], seen.t[k]
        qx = scale * origin[k, 0] + t * rays.x[k]
        qy = scale * origin[k, 1] + t * rays.y[k]
        qz = scale * origin[k, 2] + t * rays.z[k]
        row[0], row[1], row[2] = mx, my, mz
        row[3], row[4], row[5] = qy * mz - qz * my, qz * mx - qx * mz, qx * my - qy * mx
        row[6] = mx * qx + my * qy + mz * qz
        for i in range(unknowns):
            right[i] -= seen.pulls[k] * row[i]
            q = seen.weights[k] * row[i]
            for j in range(i + 1):
                matrix[i, j] += q * row[j]
