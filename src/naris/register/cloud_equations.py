# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""The equations of a cloud whose points are off in every direction, compiled.

What a camera at a pose sees is cast on a lattice of rays. A point is the place of some ray on the wall plus noise, so
its likelihood is the sum over the rays around it (the E-step of Granger and Pennec 2002, ECCV, taken over what is
visible instead of a whole surface). Nothing behind a wall counts, and edges and slits need no rule of their own. A ray
stands for a patch of the wall, the longer the more the wall is slanted: across the wall the noise alone tells how far
away a point may be, along it the patch is added.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from naris.register.equations import BLOCKS, POSE, add_up, cast, per_ray, priors, slopes, to_rows, walls
from naris.render.lane_functions import exponential
from naris.render.lanes import LANES, any_lane, choose, everywhere, least, load, most, sqrt, store

_LEAST_COSINE = 0.1
_PATCH = 0.35  # standard deviation of a patch, beside the way from ray to ray
_FAR_MM = 1e6
_NOTHING = np.float32(40.0)  # an exponent from which on a share is 0
_LEAST_SINE = np.float32(1e-4)  # squared
_LEAST_WEIGHT = np.float32(1e-9)
_NORM = 0.06349363593424098  # (2π)^(−3/2)

_part_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False)
_inline_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, forceinline=True)


class Seen(NamedTuple):
    """What the rays of the lattices meet, in the rig; lengths in mm.

    Attributes:
        t: (K,) how far; very far where nothing is.
        wall: (3, K) its normal.
        cosine: (K,) of its normal with the ray, negative where the wall is seen from inside.
        patch: (K,) variance of the patch across its ray (mm²).
        weights, pulls: (K,) responsibilities of the rays over the variance, and times the way along the row.
        shares: (most,) of the rays around one point, and sixteen more.
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
        window: (N, 4) first and last row and first and last column (each last one not in it) around a point; a multiple
            of sixteen columns.
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
    _equations_of(sight, scale, seen, equations)
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
    for at in range(0, n, LANES):
        there, ((mx, my, mz), met, far) = walls(sight, pose, at)
        store(wall, at, mx)
        store(wall, n + at, my)
        store(wall, 2 * n + at, mz)
        store(t, at, choose(there, far, np.float32(_FAR_MM)))
        store(cosine, at, met)
        store(patch, at, choose(there, np.float32(_PATCH * _PATCH) * load(cloud.solid, at) * far * far, 0.0))
    for k in range(n):
        outside += memory.hit[k] * sight.model.inside < 0
    weights, pulls = np.zeros(n, np.float32), np.zeros(n, np.float32)
    return Seen(t, wall, cosine, patch, weights, pulls, np.empty(cloud.most + LANES, np.float32)), outside


@_inline_njit
def _off(rays, seen, point, variance, k):
    """From the places of sixteen rays on their walls to a point.

    Gives the way across the wall, then along it that away from the camera and that across the ray, squared, the
    precisions of these two, and how fast the first grows when the wall moves. How long the patch is, and how fast its
    middle slides, is told as if no wall were seen at less than about 6°, nor from outside.
    """
    n = len(seen.t)
    t, x, y, z = load(seen.t, k), load(rays.x, k), load(rays.y, k), load(rays.z, k)
    dx, dy, dz = point[0] - t * x, point[1] - t * y, point[2] - t * z
    across = dx * load(seen.wall, k) + dy * load(seen.wall, n + k) + dz * load(seen.wall, 2 * n + k)
    cosine, patch = load(seen.cosine, k), load(seen.patch, k)
    sine = sqrt(most(1.0 - cosine * cosine, _LEAST_SINE))
    away = (dx * x + dy * y + dz * z - across * cosine) / sine
    level = most(dx * dx + dy * dy + dz * dz - across * across - away * away, np.float32(0.0))
    slanted = least(cosine, np.float32(-_LEAST_COSINE))
    of_away, of_level = 1.0 / (patch / (slanted * slanted) + variance), 1.0 / (patch + variance)
    return across, away, level, of_away, of_level, sine / slanted


@_part_njit
def _point(rays, cloud, i, noise, seen):
    """−2 log likelihood of a point; adds to each ray around it its responsibility and how it pulls at its wall.

    A density along the ray, as that of a range, so that costs can be compared: it is the one in space times the area
    that a solid angle has at the point.
    """
    scale, width, real, even = noise
    point = scale * cloud.points[0, i], scale * cloud.points[1, i], scale * cloud.points[2, i]
    r = scale * cloud.range[i]
    variance = (scale * cloud.sd[i] * width) ** 2
    precision = np.float32(1.0) / variance
    first, stride, shares = cloud.first[i], cloud.stride[i], seen.shares
    top, bottom, left, right = cloud.window[i, 0], cloud.window[i, 1], cloud.window[i, 2], cloud.window[i, 3]
    lanes, into = everywhere(np.float32(0.0)), 0
    for row in range(top, bottom):
        base = first + row * stride
        part = everywhere(np.float32(0.0))
        for k in range(base + left, base + right, LANES):
            across, away, level, of_away, of_level, _ = _off(rays, seen, point, variance, k)
            exponent = (across * across * precision + away * away * of_away + level * of_level) * 0.5
            share = choose(exponent < _NOTHING, exponential(-exponent) * sqrt(of_away * of_level), 0.0)
            store(shares, into, share)
            part += share
            into += LANES
        lanes += part * cloud.solid[base]
    total = np.float32(0.0)
    store(shares, into, lanes)
    for k in range(LANES):
        total += shares[into + k]
    normal = real * _NORM * r * r * scale * np.sqrt(precision)
    density = normal * total
    each, into = np.float32(normal / (density + even)), 0
    for row in range(top, bottom):
        base = first + row * stride
        weight = each * cloud.solid[base]
        for k in range(base + left, base + right, LANES):
            across, away, _, of_away, _, slope = _off(rays, seen, point, variance, k)
            share = load(shares, into) * weight
            store(seen.weights, k, load(seen.weights, k) + share * precision)
            pull = across * precision + away * slope * of_away
            store(seen.pulls, k, load(seen.pulls, k) + share * pull)
            into += LANES
    return -2.0 * np.log(density + even)


@_part_njit
def _equations_of(sight, scale, seen, equations):
    """The normal equations from the responsibilities of the rays.

    When the pose moves, the place of a ray slides along it as the plane of its wall says.
    """
    rays, model, work, origin = sight.rays, sight.model, sight.memory.work, sight.cloud.origin
    unknowns = POSE + model.free
    equations.matrix[: unknowns + 4] = 0
    n, count = len(seen.t), 0
    for at in range(0, n, LANES):
        weight, t = load(seen.weights, at), load(seen.t, at)
        there = (weight > _LEAST_WEIGHT) & (t < _FAR_MM)
        if not any_lane(there):
            continue
        wall = load(seen.wall, at), load(seen.wall, n + at), load(seen.wall, 2 * n + at)
        qx = t * load(rays.x, at) + scale * origin[at, 0]
        qy = t * load(rays.y, at) + scale * origin[at, 1]
        qz = t * load(rays.z, at) + scale * origin[at, 2]
        slopes(work, wall, (qx, qy, qz), everywhere(np.float32(1.0)))
        store(work.lane, 6 * LANES, wall[0] * qx + wall[1] * qy + wall[2] * qz)
        store(work.weight, 0, choose(there, weight, 0.0))
        store(work.error, 0, choose(there, load(seen.pulls, at) / weight, 0.0))
        to_rows(rays, model, work, at, count)
        count += LANES
        if count == BLOCKS * LANES:
            add_up(work, count, unknowns + 1, equations.matrix)
            count = 0
    add_up(work, count, unknowns + 1, equations.matrix)
    for i in range(unknowns):
        equations.right[i] = -equations.matrix[unknowns, i]
