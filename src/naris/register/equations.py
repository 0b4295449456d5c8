# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""The equations of a registration, compiled: rays against the anatomy, residuals, derivatives, likelihood.

A pose is `anatomy_T_rig` (4, 4); a step is a twist (translation in mm, rotation vector in rad) in the rig, applied from
the right. After it come, where they are free, the logarithm of the scale and the coefficients of the smooth error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from naris.render.lanes import LANES, load, store
from naris.render.packets import Packet, begin_frame, found, intersect

POSE = 6
MOST_UNKNOWNS = 64
RANGES, ON_RAY, CLOUD = 0, 1, 2
_LEAST_COSINE = 0.05
_OUTSIDE = 100.0
_NO_WALL = 0.1
_ROOT = 0.3989422804014327  # 1/√(2π)

_part_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False)
_inline_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, forceinline=True)
_raw_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, _nrt=False)


class Rays(NamedTuple):
    """What was seen, in blocks of sixteen rays with one origin a block; lengths in the unit of the observation.

    Attributes:
        x, y, z: (N,) unit direction in the rig.
        valid: (N,) −1 where there is a ray, else 0; aligned to 64 bytes.
        origin: (N / 16, 3) in the rig.
        range: (N,) along the ray.
        radial, isotropic: (N,) standard deviations of the error along the ray and in every direction.
        field: (N, K) functions whose sum makes the smooth relative error of the ranges.
        prior: (K,) precision of their coefficients.
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    valid: np.ndarray
    origin: np.ndarray
    range: np.ndarray
    radial: np.ndarray
    isotropic: np.ndarray
    field: np.ndarray
    prior: np.ndarray


class Model(NamedTuple):
    """How likely it is to be seen.

    Attributes:
        kind: `RANGES` to compare logarithms of ranges, `ON_RAY` to compare points with the plane of the wall that
            their ray meets, `CLOUD` with all that is seen around them (`naris.register.cloud_equations`).
        outliers: the share of rays that tell nothing.
        reach: outliers lie anywhere up to here, in the unit of the observation.
        free: 1 where the scale is unknown, else 0.
        log_scale, precision: what is known of its logarithm.
        log_low, log_high: where it may lie.
        inside: the side of a wall that is seen from the lumen, as `found` tells it.
        smooth: how many functions of the smooth error are in use.
    """

    kind: int
    outliers: float
    reach: float
    free: int
    log_scale: float
    precision: float
    log_low: float
    log_high: float
    inside: float
    smooth: int


class Memory(NamedTuple):
    """What one thread needs: rays in flight, and what N of them met.

    Attributes:
        ray: (3, N) direction in the anatomy.
        hit: (N,) distance to the wall, times the side that is seen.
        normal: (3, N) of the wall, towards the camera; 0 where no wall is.
    """

    packet: Packet
    ray: np.ndarray
    hit: np.ndarray
    normal: np.ndarray


class Equations(NamedTuple):
    """Normal equations: the lower triangle of (U, U), and the right-hand side (U,)."""

    matrix: np.ndarray
    right: np.ndarray


@_inline_njit
def shoot(embree, rays, pose, scale, packet, block):
    """Sends one block of rays from a pose; gives their directions in the anatomy, what they meet is in the packet."""
    at = block * LANES
    ox, oy, oz = scale * rays.origin[block, 0], scale * rays.origin[block, 1], scale * rays.origin[block, 2]
    px = np.float32(pose[0, 0] * ox + pose[0, 1] * oy + pose[0, 2] * oz + pose[0, 3])
    py = np.float32(pose[1, 0] * ox + pose[1, 1] * oy + pose[1, 2] * oz + pose[1, 3])
    pz = np.float32(pose[2, 0] * ox + pose[2, 1] * oy + pose[2, 2] * oz + pose[2, 3])
    begin_frame(packet, (px, py, pz))
    x, y, z = load(rays.x, at), load(rays.y, at), load(rays.z, at)
    r0 = np.float32(pose[0, 0]) * x + np.float32(pose[0, 1]) * y + np.float32(pose[0, 2]) * z
    r1 = np.float32(pose[1, 0]) * x + np.float32(pose[1, 1]) * y + np.float32(pose[1, 2]) * z
    r2 = np.float32(pose[2, 0]) * x + np.float32(pose[2, 1]) * y + np.float32(pose[2, 2]) * z
    intersect(embree, packet, rays.valid, at, (r0, r1, r2))
    return r0, r1, r2


@_inline_njit
def keep(memory, at, distance, normal):
    """Leaves what a block of rays met in `memory`: distances times the side that is seen, and normals."""
    n = len(memory.hit)
    store(memory.hit, at, distance)
    store(memory.normal, at, normal[0])
    store(memory.normal, n + at, normal[1])
    store(memory.normal, 2 * n + at, normal[2])


@_raw_njit
def cast(embree, rays, pose, scale, memory):
    """What the rays meet from a pose, left in `memory`."""
    n = len(rays.x)
    for block in range(n // LANES):
        at = block * LANES
        ray = shoot(embree, rays, pose, scale, memory.packet, block)
        _seen, distance, _face, _u, _v, normal, side = found(memory.packet, rays.valid, at, ray)
        keep(memory, at, distance * side, normal)
        store(memory.ray, at, ray[0])
        store(memory.ray, n + at, ray[1])
        store(memory.ray, 2 * n + at, ray[2])


@_inline_njit
def _by_plane(rays, at, scale, wall, smooth_error):
    """The way of a point to the plane of the wall that its ray meets.

    Gives the residual (mm), its deviation, the deviation along the ray in the unit of the observation, the point in the
    rig that turns with it, the factor of the pose's derivative, and the derivatives by log scale and smooth error.
    """
    mx, my, mz, cosine, t, ox, oy, oz = wall
    r = rays.range[at] * scale
    radial, even = rays.radial[at] * scale, rays.isotropic[at] * scale
    inward = max(cosine * cosine, _LEAST_COSINE * _LEAST_COSINE)
    deviation = np.sqrt(inward * radial * radial + even * even)
    px, py, pz = ox + r * rays.x[at], oy + r * rays.y[at], oz + r * rays.z[at]
    error = (r * (1.0 - smooth_error) - t) * cosine
    along, by_scale = deviation / np.sqrt(inward) / scale, mx * px + my * py + mz * pz
    return error, deviation, along, px, py, pz, 1.0, by_scale, -cosine * r


@_inline_njit
def _by_range(rays, at, scale, wall, smooth_error):
    """The logarithm of the ratio of a range to that of the wall; what it gives is as that of `_by_plane`.

    A scale that is free is not drawn towards small clouds by it, as it is by residuals in mm.
    """
    mx, my, mz, cosine, t, ox, oy, oz = wall
    cosine = min(cosine, -_LEAST_COSINE)
    r = rays.range[at]
    radial, even = rays.radial[at] / r, rays.isotropic[at] / (r * cosine)
    deviation = np.sqrt(radial * radial + even * even)
    px, py, pz = ox + t * rays.x[at], oy + t * rays.y[at], oz + t * rays.z[at]
    factor = 1.0 / (t * cosine)
    by_scale = 1.0 + (mx * ox + my * oy + mz * oz) * factor
    return np.log(r * scale / t) - smooth_error, deviation, deviation * r, px, py, pz, factor, by_scale, -1.0


@_inline_njit
def _equation(sight, pose, scale, smooth, at, row):
    """The residual of a ray that meets a wall, its deviation, that along the ray, and, in `row`, the derivatives."""
    rays, model, memory = sight.rays, sight.model, sight.memory
    nx, ny, nz = memory.normal[0, at], memory.normal[1, at], memory.normal[2, at]
    mx = pose[0, 0] * nx + pose[1, 0] * ny + pose[2, 0] * nz
    my = pose[0, 1] * nx + pose[1, 1] * ny + pose[2, 1] * nz
    mz = pose[0, 2] * nx + pose[1, 2] * ny + pose[2, 2] * nz
    cosine = mx * rays.x[at] + my * rays.y[at] + mz * rays.z[at]
    origin = at // LANES
    ox, oy, oz = scale * rays.origin[origin, 0], scale * rays.origin[origin, 1], scale * rays.origin[origin, 2]
    smooth_error = 0.0
    for k in range(model.smooth):
        smooth_error += smooth[k] * rays.field[at, k]
    wall = (mx, my, mz, cosine, abs(memory.hit[at]), ox, oy, oz)
    if model.kind == RANGES:
        e, sd, along, px, py, pz, factor, by_scale, by_smooth = _by_range(rays, at, scale, wall, smooth_error)
    else:
        e, sd, along, px, py, pz, factor, by_scale, by_smooth = _by_plane(rays, at, scale, wall, smooth_error)
    row[0], row[1], row[2] = factor * mx, factor * my, factor * mz
    row[3], row[4] = factor * (py * mz - pz * my), factor * (pz * mx - px * mz)
    row[5] = factor * (px * my - py * mx)
    if model.free:
        row[POSE] = by_scale
    for k in range(model.smooth):
        row[POSE + model.free + k] = by_smooth * rays.field[at, k]
    return e, sd, along


@_part_njit
def linearise_rays(sight, pose, log_scale, smooth, width, equations):
    """As `naris.register.steps.linearise`, for rays each of which is compared with the wall that it meets.

    A range is normal about what the wall says, or an outlier (even up to `model.reach`); each ray is weighted by the
    probability that it is none. `width` widens the normal distribution, which widens the basin.
    """
    rays, model, memory = sight.rays, sight.model, sight.memory
    matrix, right = equations.matrix, equations.right
    scale = np.exp(log_scale)
    cast(sight.embree, rays, pose, scale, memory)
    unknowns = POSE + model.free + model.smooth
    matrix[:unknowns, :unknowns] = 0
    right[:unknowns] = 0
    row = np.empty(MOST_UNKNOWNS)
    cost, count, outside = 0.0, 0, 0
    even = model.outliers / model.reach
    for at in range(len(rays.x)):
        if rays.valid[at] == 0:
            continue
        count += 1
        if memory.hit[at] * model.inside < 0:
            outside += 1
        nx, ny, nz = memory.normal[0, at], memory.normal[1, at], memory.normal[2, at]
        if nx * nx + ny * ny + nz * nz < 0.5:
            cost -= 2.0 * np.log(_NO_WALL * even)
            continue
        e, sd, along = _equation(sight, pose, scale, smooth, at, row)
        sd, along = sd * width, along * width
        normal = (1.0 - model.outliers) * _ROOT / along * np.exp(-0.5 * (e / sd) ** 2)
        cost -= 2.0 * np.log(normal + even)
        weight = normal / ((normal + even) * sd * sd)
        for i in range(unknowns):
            q = weight * row[i]
            right[i] -= q * e
            for j in range(i + 1):
                matrix[i, j] += q * row[j]
    cost += priors(rays, model, log_scale, smooth, equations)
    return per_ray(model, cost, count, 2 * outside > count, log_scale)


@_part_njit
def per_ray(model, cost, count, is_outside, log_scale):
    """A cost for each of the rays, dear where most begin in tissue or the scale is where it must not be."""
    if is_outside or (model.free and not model.log_low <= log_scale <= model.log_high):
        cost += _OUTSIDE * count
    return cost / max(count, 1)


@_part_njit
def priors(rays, model, log_scale, smooth, equations):
    """Adds what is known beforehand of the scale and the smooth error."""
    matrix, right = equations.matrix, equations.right
    cost, first = 0.0, POSE + model.free
    if model.free:
        off = model.log_scale - log_scale
        matrix[POSE, POSE] += model.precision
        right[POSE] += model.precision * off
        cost += model.precision * off * off
    for k in range(model.smooth):
        matrix[first + k, first + k] += rays.prior[k]
        right[first + k] -= rays.prior[k] * smooth[k]
        cost += rays.prior[k] * smooth[k] * smooth[k]
    return cost
