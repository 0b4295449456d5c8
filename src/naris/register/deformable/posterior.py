"""How likely a pose, a scale and a shape are together, and the equations of a step from there.

The likelihood is that of rigid registration (`naris.register.equations`): ranges of depth images and of clouds of
unknown scale are compared as logarithms along their rays, points of known scale with the wall that they lie nearest
to, and a share of rays tells nothing. The walls move with the weights of the modes, whose prior is normal: the maximum
a posteriori of A. Sinha et al. 2018 (deformable most-likely-point registration) and of M. Lüthi et al. 2018, section 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from naris.register.deformable.modes import Modes
from naris.register.deformable.walls import Places, Walls
from naris.register.equations import POSE, RANGES, Memory, Model, Rays

_LEAST_COSINE = 0.05
_NO_WALL = 0.1
_ROOT = 1 / np.sqrt(2 * np.pi)


@dataclass(frozen=True, eq=False)
class State:
    """What is estimated.

    Attributes:
        pose: (4, 4) `anatomy_T_rig`.
        log_scale: logarithm of mm per unit of the observation.
        smooth: (S,) coefficients of the smooth error of the depth.
        weights: (K,) of the modes.
    """

    pose: Float[np.ndarray, "4 4"]
    log_scale: float
    smooth: Float[np.ndarray, "s"]
    weights: Float[np.ndarray, "k"]


@dataclass(frozen=True, eq=False)
class Problem:
    """What was seen, and the shapes it may be of.

    Attributes:
        modes: of the shape.
        rays, model, memory: as in `naris.register.equations`.
        faces: (F, 3) of the mesh that matter.
        at_mean: the walls at weights 0.
    """

    modes: Modes
    rays: Rays
    model: Model
    memory: Memory
    faces: Int[np.ndarray, "f 3"]
    at_mean: Walls

    @property
    def unknowns(self) -> int:
        return POSE + self.model.free + self.model.smooth + len(self.modes)

    @property
    def first_weight(self) -> int:
        return self.unknowns - len(self.modes)

    def walls(self, weights: Float[np.ndarray, "k"]) -> Walls:
        if not weights.any():
            return self.at_mean
        return Walls(self.modes.vertices_mm(weights), self.faces, self.model.inside, self.at_mean)


class Residuals(NamedTuple):
    """One a ray: the residual, its deviation, that along the ray, and which rays meet a wall.

    `across_mm` is the way of the point to the plane of its wall, `rows` (N, U) are the derivatives of the residual.
    """

    error: Float[np.ndarray, "n"]
    deviation: Float[np.ndarray, "n"]
    along: Float[np.ndarray, "n"]
    met: Bool[np.ndarray, "n"]
    across_mm: Float[np.ndarray, "n"]
    rows: Float[np.ndarray, "n u"]


class Linear(NamedTuple):
    """−2 log of the posterior density but for constants; the equations of a step; the share of rays inside tissue."""

    cost: float
    matrix: Float[np.ndarray, "u u"]
    right: Float[np.ndarray, "u"]


def linearised(problem: Problem, state: State, width: float = 1.0) -> Linear:
    """Cost and normal equations at a state, with the noise `width` times as wide as was said.

    Infinite where most rays begin in tissue or the scale is where it must not be.
    """
    model, real = problem.model, problem.rays.valid != 0
    n, walls = problem.unknowns, problem.walls(state.weights)
    places = _met(problem, state, walls)
    outside = (places.range_mm < 0) & places.met
    bounded = not model.free or model.log_low <= state.log_scale <= model.log_high
    if 2 * outside.sum() > real.sum() or not bounded:
        return Linear(np.inf, np.eye(n), np.zeros(n))
    found = residuals(problem, state, walls, places)
    even = model.outliers / model.reach
    missed = int(real.sum() - found.met.sum())
    e, rows = found.error[found.met], found.rows[found.met]
    sd, along = width * found.deviation[found.met], width * found.along[found.met]
    normal = (1 - model.outliers) * _ROOT / along * np.exp(-0.5 * (e / sd) ** 2)
    weight = normal / ((normal + even) * sd**2)
    cost = -2 * float(np.log(normal + even).sum()) - 2 * missed * float(np.log(_NO_WALL * even))
    matrix = (rows * weight[:, None]).T @ rows
    right = -rows.T @ (weight * e)
    return Linear(cost + _priors(problem, state, matrix, right), matrix, right)


def residuals(problem: Problem, state: State, walls: Walls, places: Places) -> Residuals:
    """Of every ray at a state; `walls` are those of its weights, and `places` what the rays meet of them."""
    model, rays, scale = problem.model, problem.rays, float(np.exp(state.log_scale))
    ways, origins = _ways(rays), scale * np.repeat(rays.origin, 16, axis=0)
    smooth = rays.field[:, : model.smooth] @ state.smooth
    r, t = rays.range.astype(np.float64), np.abs(places.range_mm)
    seen = origins + (scale * r)[:, None] * ways
    if model.kind != RANGES:
        places = _nearest(problem, state, walls, seen, places)
    inward = places.normal @ state.pose[:3, :3]
    cosine = np.minimum((inward * ways).sum(axis=1), -_LEAST_COSINE)
    wall = walls.points_mm(places)
    across = ((seen @ state.pose[:3, :3].T + state.pose[:3, 3] - wall) * places.normal).sum(axis=1)
    even, radial = rays.isotropic.astype(np.float64), rays.radial.astype(np.float64)
    if model.kind == RANGES:
        deviation = np.hypot(radial / r, even / (r * cosine))
        error = np.log(r * scale / np.maximum(t, 1e-6)) - smooth
        at, factor, along = origins + t[:, None] * ways, 1 / (np.maximum(t, 1e-6) * cosine), deviation * r
        by_scale, by_smooth = 1 + (inward * origins).sum(axis=1) * factor, -np.ones_like(r)
    else:
        deviation = scale * np.hypot(cosine * radial, even)
        error, at, factor = across - smooth * scale * r * cosine, seen, np.ones_like(r)
        along = deviation / (scale * np.abs(cosine))
        by_scale, by_smooth = (inward * seen).sum(axis=1), -cosine * r * scale
    rows = _rows(problem, (inward, at, factor, by_scale, by_smooth), places)
    return Residuals(error, deviation, along, places.met, across, rows)


def ended(problem: Problem, state: State) -> tuple[Walls, Places]:
    """The walls of a state, and what the rays meet of them."""
    walls = problem.walls(state.weights)
    return walls, _met(problem, state, walls)


def moves(problem: Problem, places: Places) -> Float[np.ndarray, "n 3 k"]:
    """How places on the walls move with each weight (mm)."""
    corners = problem.modes.by_vertex_mm[problem.faces[places.faces]]
    return np.einsum("njak,nj->nak", corners, places.corners.astype(np.float32), optimize=True).astype(np.float64)


def _rows(problem: Problem, parts: tuple[np.ndarray, ...], places: Places) -> Float[np.ndarray, "n u"]:
    """Derivatives by twist, scale, smooth error and weights."""
    inward, at, factor, by_scale, by_smooth = parts
    columns = [factor[:, None] * inward, factor[:, None] * np.cross(at, inward)]
    if problem.model.free:
        columns.append(by_scale[:, None])
    if problem.model.smooth:
        columns.append(by_smooth[:, None] * problem.rays.field[:, : problem.model.smooth])
    if len(problem.modes):
        corners = problem.modes.by_vertex_mm[problem.faces[places.faces]]
        each = (places.corners[:, :, None] * places.normal[:, None, :] * -factor[:, None, None]).astype(np.float32)
        n = len(each)
        columns.append((each.reshape(n, 1, 9) @ corners.reshape(n, 9, -1))[:, 0].astype(np.float64))
    return np.concatenate(columns, axis=1)


def _met(problem: Problem, state: State, walls: Walls) -> Places:
    return walls.met(problem.rays, state.pose, float(np.exp(state.log_scale)), problem.memory)


def _nearest(problem: Problem, state: State, walls: Walls, seen: Float[np.ndarray, "n 3"], met: Places) -> Places:
    """The walls that points lie nearest to, in the place of those that their rays meet.

    Behind the ray's wall, in other air, nothing can be seen, and a wall that faces away is not seen either: there
    the ray's own wall stays.
    """
    points = seen @ state.pose[:3, :3].T + state.pose[:3, 3]
    near = walls.nearest(points, _ways(problem.rays) @ state.pose[:3, :3].T)
    in_air = ((points - walls.points_mm(near)) * near.normal).sum(axis=1) > 0
    beyond = np.exp(state.log_scale) * problem.rays.range > np.abs(met.range_mm)
    takes = met.met & near.met & ~(beyond & in_air)
    return Places(
        met.met,
        met.range_mm,
        np.where(takes, near.faces, met.faces),
        np.where(takes[:, None], near.corners, met.corners),
        np.where(takes[:, None], near.normal, met.normal),
    )


def _ways(rays: Rays) -> Float[np.ndarray, "n 3"]:
    return np.stack([rays.x, rays.y, rays.z], axis=1).astype(np.float64)


def _priors(problem: Problem, state: State, matrix: Float[np.ndarray, "u u"], right: Float[np.ndarray, "u"]) -> float:
    """Adds what is known beforehand of scale, smooth error and shape; gives what it costs."""
    model, cost, at = problem.model, 0.0, POSE
    if model.free:
        off = model.log_scale - state.log_scale
        matrix[at, at] += model.precision
        right[at] += model.precision * off
        cost, at = cost + model.precision * off**2, at + 1
    precision = np.concatenate([problem.rays.prior[: model.smooth], np.ones(len(problem.modes))])
    values = np.concatenate([state.smooth, state.weights])
    diagonal = np.arange(at, at + len(values))
    matrix[diagonal, diagonal] += precision
    right[at:] -= precision * values
    return cost + float(precision @ values**2)
