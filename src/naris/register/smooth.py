"""The smooth relative error of a depth image as a sum of few functions with a prior.

A depth network is off by a few per cent that vary slowly over the picture. As a Gaussian process over directions, with
the covariance σ² exp(−angle² / 2ℓ²), it has few degrees of freedom; they are estimated with the pose, or else the pose
takes them on. The functions are those of a Nyström approximation (Williams and Seeger 2001) on directions that are
spread over the view. Over a picture the error is 0 on average: an error of the whole is one of scale, and
is said there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_APART = 0.8  # of the reach, between the directions of the approximation
_MOST_SITES = 160


class SmoothError(NamedTuple):
    """Functions (N, K), and the precision (K,) of their coefficients."""

    functions: Float[np.ndarray, "n k"]
    precision: Float[np.ndarray, "k"]


def smooth_error(directions: Float[np.ndarray, "n 3"], sd: float, reach_deg: float, most: int) -> SmoothError:
    """For unit directions of one view: the `most` functions at most that carry most of the error of deviation `sd`."""
    reach = np.deg2rad(reach_deg)
    sites = directions[_spread(directions, _APART * reach)]
    of_sites = _covariance(sites, sites, reach) + 1e-6 * np.eye(len(sites))
    root = np.linalg.cholesky(of_sites)
    functions = np.linalg.solve(root, _covariance(sites, directions, reach)).T
    functions -= functions.mean(axis=0)
    # The left singular vectors of `functions`, by the eigenvectors of a matrix of few rows.
    square, turn = np.linalg.eigh(functions.T @ functions)
    kept = np.argsort(square)[::-1][:most]
    size = np.sqrt(np.maximum(square[kept], 1e-12))
    n = len(directions)
    return SmoothError(functions @ turn[:, kept] / size * np.sqrt(n), n / (sd * size) ** 2)


def _covariance(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "m 3"], reach_rad: float) -> Float[np.ndarray, "n m"]:
    angle = np.arccos(np.clip(a @ b.T, -1, 1))
    return np.exp(-0.5 * (angle / reach_rad) ** 2)


def _spread(directions: Float[np.ndarray, "n 3"], apart_rad: float) -> list[int]:
    """Directions each furthest from those before, until none is `apart_rad` away."""
    chosen = [int(np.argmax(directions @ directions.mean(axis=0)))]
    nearest = directions @ directions[chosen[0]]
    while len(chosen) < _MOST_SITES:
        far = int(np.argmin(nearest))
        if nearest[far] > np.cos(apart_rad):
            break
        chosen.append(far)
        nearest = np.maximum(nearest, directions @ directions[far])
    return chosen
