"""How unlikely a cloud is at a pose, whatever places of the surface its points were seen of."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from naris.errors import InputError
from naris.register.likely_point.average import Nodes, Seen, Sums, average
from naris.register.likely_point.likelihood import (
    ALIGNED,
    PIECE,
    Cloud,
    Likelihood,
    counted,
    matched,
    placed,
    whitening,
)
from naris.register.likely_point.match import Tree
from naris.register.threads import spread

_NODES_APART = 1.5  # in the smallest standard deviation: errors of poses are those at 0.5 to a tenth of a µm
_MOST_PARTS = 32


def nodes_for(tree: Tree, cloud: Cloud) -> Nodes:
    """Nodes in all triangles, close enough together for the sharpest point.

    Raises:
        InputError: if a triangle is larger than 32 standard deviations of it.
    """
    sd_mm = float(np.sqrt(cloud.axes.variance.min()))
    sides = np.linalg.norm(tree.corners - np.roll(tree.corners, 1, axis=1), axis=2).max(axis=1)
    parts = np.maximum(np.ceil(sides / (_NODES_APART * sd_mm)).astype(np.int64), 1)
    if parts.max() > _MOST_PARTS:
        raise InputError(
            f"points with errors of at least {sides.max() / _MOST_PARTS:.3g} mm to average over triangles of up to "
            f"{sides.max():.3g} mm",
            f"errors of {sd_mm:.3g} mm",
            "match each point with its most likely place alone, or cut the surface into smaller triangles",
        )
    weights = [_of_parts(k) for k in range(1, _MOST_PARTS + 1)]
    start = np.concatenate([[0, 0], np.cumsum([len(each) for each in weights])])
    a, b, c = np.moveaxis(tree.corners, 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1) / (3 * parts**2)
    return Nodes(parts, area, start, np.concatenate(weights))


def averaged(tree: Tree, nodes: Nodes, cloud: Cloud, pose: Float[np.ndarray, "4 4"], rows: np.ndarray) -> Likelihood:
    """As `likelihood`, aligned, with the integral over the surface in the place of its most likely point.

    One −log of it is divided by what a flat wall without noise would give, so that outliers are told as before.
    """
    white = whitening(cloud.axes, ALIGNED)
    where = placed(cloud, pose, white)
    found, n = matched(tree, where, rows), len(rows)
    sums = Sums(np.empty(n), np.empty((n, 6)), np.empty((n, 6, 6)), np.empty((n, 6, 6)))
    axes = np.stack([cloud.axes.normal, cloud.axes.major, cloud.axes.minor])
    seen = Seen(where, cloud.points, np.ascontiguousarray(white.root), axes, pose)

    def work(first: int, last: int) -> None:
        average(tree, nodes, seen, found, sums, first, last)

    spread(work, n, pieces=-(-n // PIECE))
    flat = np.log(2 * np.pi) + np.log(cloud.axes.variance).sum(axis=1) / 3
    cost, counts = counted(sums.costs + flat, cloud.farthest_sd)
    mean = np.einsum("n,nij->ij", counts, sums.matrices)
    matrix = mean - np.einsum("n,nij->ij", counts, sums.spreads)
    if np.linalg.eigvalsh(matrix)[0] <= 0:
        matrix = mean  # that of expectation and maximisation, which never steps too far
    corners, (v, w) = tree.corners[found.rows], found.weights.T
    places = np.einsum("nc,nck->nk", np.stack([1 - v - w, v, w], axis=1), corners)
    return Likelihood(cost, found, places, counts, counts @ sums.gradients, matrix)


def _of_parts(parts: int) -> Float[np.ndarray, "m 2"]:
    """Barycentric weights of three nodes in each of parts² triangles of one shape."""
    three = np.array([[1.0, 1.0], [4.0, 1.0], [1.0, 4.0]]) / 6
    corners = [(i, j) for i in range(parts) for j in range(parts - i)]
    upright = [np.array(corner) + three for corner in corners]
    turned = [np.array([i + 1, j + 1]) - three for i, j in corners if i + j < parts - 1]
    return np.concatenate(upright + turned) / parts
