"""How unlikely a cloud is at a pose, with its first and second derivatives.

Everything is told in the frame of the cloud, in which its noise does not turn with the pose. A step is a twist
(translation in mm, rotation vector in rad) applied from the right. The match of a point moves along its triangle, or
along the edge that it lies on, as the pose moves: only what is left of a derivative across it counts (variable
projection, Golub and Pereyra 1973). With matches that stay where they are the second derivative would be that of ICP,
which promises less than there is to gain, and creeps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from naris.register.likely_point.match import Found, Placed, Tree, match
from naris.register.likely_point.noise import Axes
from naris.register.threads import spread

PIECE = 64  # points that a thread matches at a time


class Misalignment(NamedTuple):
    """What the pose is still off by, counted as noise: variances in mm² and in rad²."""

    mm2: float
    rad2: float


ALIGNED = Misalignment(0.0, 0.0)


class Cloud(NamedTuple):
    """Points (N, 3) in mm, their noise, and the standard deviations beyond which they count as outliers."""

    points: Float[np.ndarray, "n 3"]
    axes: Axes
    farthest_sd: float


class Likelihood(NamedTuple):
    """At one pose.

    Attributes:
        cost: −log likelihood of the cloud but for constants.
        found: the matches.
        places: (N, 3) that are most likely, in the frame of the surface.
        counts: (N,) how far each point counts: 1, but for outliers.
        gradient, matrix: (6,) and (6, 6), of the cost by the twist; the matrix is positive.
    """

    cost: float
    found: Found
    places: Float[np.ndarray, "n 3"]
    counts: Float[np.ndarray, "n"]
    gradient: Float[np.ndarray, "6"]
    matrix: Float[np.ndarray, "6 6"]


class Whitening(NamedTuple):
    """What makes errors white at a misalignment: (N, 3, 3) of points; κ and β of normals (N,)."""

    root: Float[np.ndarray, "n 3 3"]
    straight: Float[np.ndarray, "n"]
    oval: Float[np.ndarray, "n"]


def whitening(axes: Axes, off: Misalignment) -> Whitening:
    """That of the noise with the misalignment added."""
    straight = axes.concentration / (1 + axes.concentration * off.rad2)
    root = axes.turn / np.sqrt(axes.variance + off.mm2)[:, :, None]
    return Whitening(root, straight, 0.5 * axes.eccentricity * straight)


def likelihood(
    tree: Tree, cloud: Cloud, pose: Float[np.ndarray, "4 4"], off: Misalignment, rows: np.ndarray
) -> Likelihood:
    """Of a cloud at `pose` (from the cloud to the surface), matched beginning with the triangles `rows`."""
    white = whitening(cloud.axes, off)
    found = matched(tree, placed(cloud, pose, white), rows)
    v, w = found.weights.T
    corners, turned = tree.corners[found.rows], white.root @ pose[:3, :3].T
    places = np.einsum("nc,nck->nk", np.stack([1 - v - w, v, w], axis=1), corners)
    place = (places - pose[:3, 3]) @ pose[:3, :3]
    residual = np.einsum("nij,nj->ni", white.root, place - cloud.points)
    slope = white.root @ np.concatenate([np.tile(-np.eye(3), (len(place), 1, 1)), _cross(place)], axis=2)
    across = _across(np.einsum("nij,nkj->nki", turned, _sides(corners, v, w)), slope)
    cost, counts = counted(found.costs, cloud.farthest_sd)
    gradient = np.einsum("n,nij,ni->j", counts, slope, residual)
    matrix = np.einsum("n,nij,nik->jk", counts, across, across, optimize=True)
    if white.straight.any():
        of_normals = _of_normals(cloud.axes, white, tree.normals[found.rows] @ pose[:3, :3], counts)
        gradient[3:] += of_normals[0]
        matrix[3:, 3:] += of_normals[1]
    return Likelihood(cost, found, places, counts, gradient, matrix)


def counted(costs: Float[np.ndarray, "n"], farthest_sd: float) -> tuple[float, Float[np.ndarray, "n"]]:
    """The cost of all points, some of which may lie anywhere, and how far each counts."""
    if not np.isfinite(farthest_sd):
        return float(costs.sum()), np.ones(len(costs))
    # −log(exp(−cost) + exp(−limit)), 0 at no cost.
    limit = 0.5 * farthest_sd**2
    softened = np.log1p(np.exp(-limit)) - np.logaddexp(-costs, -limit)
    return float(softened.sum()), 1 / (1 + np.exp(np.minimum(costs - limit, 500.0)))


def placed(cloud: Cloud, pose: Float[np.ndarray, "4 4"], white: Whitening) -> Placed:
    """The cloud where the pose puts it."""
    rotation, shift, axes = pose[:3, :3], pose[:3, 3], cloud.axes
    metric = np.ascontiguousarray(white.root @ rotation.T)
    offset = -np.einsum("nij,nj->ni", white.root, cloud.points + shift @ rotation)
    normal, major, minor = (np.ascontiguousarray(each @ rotation.T) for each in (axes.normal, axes.major, axes.minor))
    least, points = np.square(white.root).sum(axis=2).min(axis=1), cloud.points @ rotation.T + shift
    return Placed(points, metric, offset, least, normal, major, minor, white.straight, white.oval)


def matched(tree: Tree, cloud: Placed, rows: np.ndarray) -> Found:
    """The most likely matches, sought from the triangles `rows`."""
    n = len(rows)
    found = Found(rows.copy(), np.empty((n, 2)), np.empty(n))

    def work(first: int, last: int) -> None:
        match(tree, cloud, found, first, last)

    spread(work, n, pieces=-(-n // PIECE))
    return found


def _sides(
    corners: Float[np.ndarray, "n 3 3"], v: Float[np.ndarray, "n"], w: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 2 3"]:
    """Along what each match can move in its triangle: two sides, the edge it lies on, or nothing at a corner."""
    second, third = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    sides = np.stack([second, third], axis=1)
    first_zero, v_zero, w_zero = v + w >= 1 - 1e-12, v <= 0, w <= 0
    sides[v_zero, 0] = 0
    sides[w_zero, 1] = 0
    sides[first_zero] = 0
    edge = first_zero & ~v_zero & ~w_zero
    sides[edge, 0] = (third - second)[edge]
    return sides


def _across(ways: Float[np.ndarray, "n 2 3"], slope: Float[np.ndarray, "n 3 6"]) -> Float[np.ndarray, "n 3 6"]:
    """The part of derivatives that is at right angles to the ways in which a match can move; those may be 0."""
    left = slope
    first, second = ways[:, 0], ways[:, 1]
    for way in (first, second):
        length2 = (way * way).sum(axis=1, keepdims=True)
        unit = way / np.sqrt(np.maximum(length2, 1e-300))
        left = left - unit[:, :, None] * np.einsum("ni,nij->nj", unit, left)[:, None]
        second -= unit * (unit * second).sum(axis=1, keepdims=True)
    return left


def _of_normals(
    axes: Axes, white: Whitening, normal: Float[np.ndarray, "n 3"], counts: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """The derivatives by the rotation of κ (1 − n·m) − β ((a·m)² − (b·m)²), for normals m of the surface.

    The second keeps what is positive: (κ − 2β) along a and (κ + 2β) along b.
    """
    straight, oval = white.straight, white.oval
    major, minor = ((each * normal).sum(axis=1) for each in (axes.major, axes.minor))
    bent = major[:, None] * axes.major - minor[:, None] * axes.minor
    pull = straight[:, None] * axes.normal + 2 * oval[:, None] * bent
    # The normal moves by −φ × m, so a·m by φ · (a × m).
    gradient = -(counts[:, None] * np.cross(pull, normal)).sum(axis=0)
    by_major, by_minor = np.cross(axes.major, normal), np.cross(axes.minor, normal)
    matrix = np.einsum("n,ni,nj->ij", counts * (straight - 2 * oval), by_major, by_major)
    return gradient, matrix + np.einsum("n,ni,nj->ij", counts * (straight + 2 * oval), by_minor, by_minor)


def _cross(v: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    x, y, z = v.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
