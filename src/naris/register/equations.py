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

from naris.render.lane_functions import exponential, logarithm
from naris.render.lanes import LANES, choose, everywhere, least, load, magnitude, most, sqrt, store
from naris.render.packets import Packet, begin_frame, found, intersect

POSE = 6
MOST_UNKNOWNS = 64
ROW, BLOCKS = 80, 4
"""Numbers from one row of equations to the next, and how many blocks of rays are added up at a time."""
RANGES, ON_RAY, CLOUD = 0, 1, 2
_LEAST_COSINE = 0.05
_OUTSIDE = 100.0
_NO_WALL = 0.1
_LEAST_DENSITY = 1e-37  # a float has a logarithm from there on
_ROOT = 0.3989422804014327  # 1/√(2π)

_part_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False)
_inline_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, forceinline=True)
_raw_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, _nrt=False)
_kept_njit = njit(cache=True, nogil=True, fastmath=True, error_model="numpy", boundscheck=False)


class Rays(NamedTuple):
    """What was seen, in blocks of sixteen rays with one origin a block; lengths in the unit of the observation.

    Attributes:
        x, y, z: (N,) unit direction in the rig.
        valid: (N,) −1 where there is a ray, else 0; aligned to 64 bytes.
        origin: (N / 16, 3) in the rig.
        range: (N,) along the ray.
        radial, isotropic: (N,) standard deviations of the error along the ray and in every direction.
        field: (N, K) functions whose sum makes the smooth relative error of the ranges, with 0 up to a multiple of 16.
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


class Work(NamedTuple):
    """Where a few blocks of rays become rows of equations; float32.

    Attributes:
        lane: (128,) what is on its way from lanes to rows.
        error, by_smooth, weight: (16,) of one block.
        smooth: (64,) coefficients of the smooth error.
        rows, weighted: (ROW · 16 · BLOCKS,) derivatives and residuals, and the same times their weights.
    """

    lane: np.ndarray
    error: np.ndarray
    by_smooth: np.ndarray
    weight: np.ndarray
    smooth: np.ndarray
    rows: np.ndarray
    weighted: np.ndarray


class Memory(NamedTuple):
    """What one thread needs: rays in flight, and what N of them met.

    Attributes:
        ray: (3, N) direction in the anatomy.
        hit: (N,) distance to the wall, times the side that is seen.
        normal: (3, N) of the wall, towards the camera; 0 where no wall is.
        work: where equations are put together.
    """

    packet: Packet
    ray: np.ndarray
    hit: np.ndarray
    normal: np.ndarray
    work: Work


class Equations(NamedTuple):
    """Normal equations: the lower triangle of (U, U), and the right-hand side (U,).

    The matrix (64, 64) has room for more, what lies beyond has no meaning.
    """

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


@_kept_njit
def cast_alone(sources, embree, rays, pose, scale, memory):
    """`cast` for whoever calls it from outside; `sources` as those of `naris.register.steps.Sight`."""
    cast(embree, rays, pose, scale, memory)


@_inline_njit
def _by_plane(ray, scale, wall, smooth_error):
    """The way of points to the planes of the walls that their rays meet.

    Gives the residual (mm), its deviation, the deviation along the ray in the unit of the observation, the point in the
    rig that turns with it, the factor of the pose's derivative, and the derivatives by log scale and smooth error.
    """
    (x, y, z), (ox, oy, oz), distance, radial, even = ray
    (mx, my, mz), cosine, t = wall
    r = distance * scale
    radial, even = radial * scale, even * scale
    inward = most(cosine * cosine, np.float32(_LEAST_COSINE * _LEAST_COSINE))
    deviation = sqrt(inward * radial * radial + even * even)
    px, py, pz = r * x + ox, r * y + oy, r * z + oz
    error = (r * (1.0 - smooth_error) - t) * cosine
    along, by_scale = deviation / (sqrt(inward) * scale), mx * px + my * py + mz * pz
    return error, deviation, along, (px, py, pz), everywhere(np.float32(1.0)), by_scale, -cosine * r


@_inline_njit
def _by_range(ray, scale, wall, smooth_error):
    """The logarithms of the ratios of ranges to those of the walls; what it gives is as that of `_by_plane`.

    A scale that is free is not drawn towards small clouds by it, as it is by residuals in mm.
    """
    (x, y, z), (ox, oy, oz), r, radial, even = ray
    (mx, my, mz), cosine, t = wall
    cosine = least(cosine, np.float32(-_LEAST_COSINE))
    radial, even = radial / r, even / (r * cosine)
    deviation = sqrt(radial * radial + even * even)
    px, py, pz = t * x + ox, t * y + oy, t * z + oz
    factor = 1.0 / (t * cosine)
    by_scale = (mx * ox + my * oy + mz * oz) * factor + 1.0
    error = logarithm(r * scale / t) - smooth_error
    return error, deviation, deviation * r, (px, py, pz), factor, by_scale, everywhere(np.float32(-1.0))


@_inline_njit
def walls(sight, pose, at):
    """What a block of rays meets: normals in the rig, their cosines with the rays, and how far away it is."""
    rays, memory = sight.rays, sight.memory
    n = len(memory.hit)
    nx, ny, nz = load(memory.normal, at), load(memory.normal, n + at), load(memory.normal, 2 * n + at)
    mx = np.float32(pose[0, 0]) * nx + np.float32(pose[1, 0]) * ny + np.float32(pose[2, 0]) * nz
    my = np.float32(pose[0, 1]) * nx + np.float32(pose[1, 1]) * ny + np.float32(pose[2, 1]) * nz
    mz = np.float32(pose[0, 2]) * nx + np.float32(pose[1, 2]) * ny + np.float32(pose[2, 2]) * nz
    cosine = mx * load(rays.x, at) + my * load(rays.y, at) + mz * load(rays.z, at)
    return nx * nx + ny * ny + nz * nz > 0.5, ((mx, my, mz), cosine, magnitude(load(memory.hit, at)))


@_inline_njit
def _block(sight, pose, scale, width, block, base):
    """The residuals of a block of rays and their derivatives, left in `memory.work` as its rays base … base + 15.

    A range is normal about what the wall says, or an outlier (even up to `model.reach`); each ray is weighted by the
    probability that it is none. Gives the logarithm of the likelihood of each ray.
    """
    rays, model, work = sight.rays, sight.model, sight.memory.work
    at = block * LANES
    met, wall = walls(sight, pose, at)
    real = load(rays.valid, at) < 0
    met = met & real
    smooth_error = everywhere(np.float32(0.0))
    if model.smooth:
        _smooth_errors(rays, model, work, at)
        smooth_error = load(work.lane, 0)
    ox, oy, oz = scale * rays.origin[block, 0], scale * rays.origin[block, 1], scale * rays.origin[block, 2]
    way = load(rays.x, at), load(rays.y, at), load(rays.z, at)
    origin = np.float32(ox), np.float32(oy), np.float32(oz)
    ray = way, origin, load(rays.range, at), load(rays.radial, at), load(rays.isotropic, at)
    if model.kind == RANGES:
        e, sd, along, point, factor, by_scale, by_smooth = _by_range(ray, np.float32(scale), wall, smooth_error)
    else:
        e, sd, along, point, factor, by_scale, by_smooth = _by_plane(ray, np.float32(scale), wall, smooth_error)
    sd, along, even = sd * np.float32(width), along * np.float32(width), np.float32(model.outliers / model.reach)
    off = e / sd
    normal = np.float32((1.0 - model.outliers) * _ROOT) / along * exponential(off * off * -0.5)
    density = most(normal + even, np.float32(_LEAST_DENSITY))
    slopes(work, wall[0], point, factor)
    store(work.lane, 6 * LANES, by_scale)
    store(work.error, 0, e)
    store(work.by_smooth, 0, by_smooth)
    store(work.weight, 0, choose(met, normal / (density * sd * sd), 0.0))
    to_rows(rays, model, work, at, base)
    return choose(real, logarithm(choose(met, density, np.float32(_NO_WALL) * even)), 0.0)


@_part_njit
def _smooth_errors(rays, model, work, at):
    """Those of a block of rays, left in the first lanes."""
    for k in range(LANES):
        error = np.float32(0.0)
        for m in range(model.smooth):
            error += work.smooth[m] * rays.field[at + k, m]
        work.lane[k] = error


@_inline_njit
def slopes(work, wall, point, factor):
    """How residuals change with the pose, left in the first six lanes: walls (normals) and points in the rig."""
    (mx, my, mz), (px, py, pz) = wall, point
    store(work.lane, 0, factor * mx)
    store(work.lane, LANES, factor * my)
    store(work.lane, 2 * LANES, factor * mz)
    store(work.lane, 3 * LANES, factor * (py * mz - pz * my))
    store(work.lane, 4 * LANES, factor * (pz * mx - px * mz))
    store(work.lane, 5 * LANES, factor * (px * my - py * mx))


@_part_njit
def to_rows(rays, model, work, at, base):
    """From lanes to rows, with the derivatives by the smooth error, the residual at their end, and times the weight."""
    first, unknowns = POSE + model.free, POSE + model.free + model.smooth
    for k in range(LANES):
        row = (base + k) * ROW
        for m in range(0, model.smooth, LANES):
            store(work.rows, row + first + m, work.by_smooth[k] * load(rays.field, (at + k) * rays.field.shape[1] + m))
        for m in range(first):
            work.rows[row + m] = work.lane[m * LANES + k]
        work.rows[row + unknowns] = work.error[k]
        for m in range(0, unknowns + 1, LANES):
            store(work.weighted, row + m, work.weight[k] * load(work.rows, row + m))


@_part_njit
def add_up(work, count, size, matrix):
    """Adds the products of `count` rows and weighted rows to the lower triangle, four of its rows at a time."""
    for i in range(0, size, 4):
        for j in range(0, i + 4, LANES):
            a, b, c, d = (everywhere(np.float32(0.0)), everywhere(np.float32(0.0)), everywhere(np.float32(0.0)),
                          everywhere(np.float32(0.0)))  # fmt: skip
            for k in range(count):
                row, at = load(work.rows, k * ROW + j), k * ROW + i
                a += work.weighted[at] * row
                b += work.weighted[at + 1] * row
                c += work.weighted[at + 2] * row
                d += work.weighted[at + 3] * row
            store(work.lane, 0, a)
            store(work.lane, LANES, b)
            store(work.lane, 2 * LANES, c)
            store(work.lane, 3 * LANES, d)
            for k in range(4):
                for m in range(LANES):
                    matrix[i + k, j + m] += work.lane[k * LANES + m]


@_part_njit
def linearise_rays(sight, pose, log_scale, smooth, width, equations):
    """As `naris.register.steps.linearise`, for rays each of which is compared with the wall that it meets.

    `width` widens the normal distribution, which widens the basin.
    """
    rays, model, memory = sight.rays, sight.model, sight.memory
    matrix, right, work = equations.matrix, equations.right, memory.work
    scale = np.exp(log_scale)
    cast(sight.embree, rays, pose, scale, memory)
    unknowns = POSE + model.free + model.smooth
    for k in range(model.smooth):
        work.smooth[k] = smooth[k]
    matrix[: unknowns + 4] = 0
    cost, count, outside = 0.0, 0, 0
    blocks = len(rays.x) // LANES
    for first in range(0, blocks, BLOCKS):
        last = min(first + BLOCKS, blocks)
        for block in range(first, last):
            logs = _block(sight, pose, scale, width, block, (block - first) * LANES)
            store(work.lane, 0, logs)
            for k in range(LANES):
                at = block * LANES + k
                cost -= 2.0 * work.lane[k]
                count -= rays.valid[at]
                outside += rays.valid[at] != 0 and memory.hit[at] * model.inside < 0
        add_up(work, (last - first) * LANES, unknowns + 1, matrix)
    for i in range(unknowns):
        right[i] = -matrix[unknowns, i]
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
