"""In which region the camera stands by what a network says about its pose.

A network that gives both a region and a pose has been asked the same question twice, and near a border the pose knows
more: to the region head a camera half a millimetre before a border looks like one behind it. Each hypothesis is a
normal distribution of positions; the share of it that lies in each region is what it says about the regions.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri
from scipy.stats import qmc

from naris.core.anatomy import RegionSet

_DRAWN = 256  # a power of two, as Sobol's sequence wants
_FLOOR = 1e-3


def region_shares(
    regions: RegionSet,
    poses: Float[np.ndarray, "n m 4 4"],
    weights: Float[np.ndarray, "n m"],
    covariance: Float[np.ndarray, "n m 6 6"],
) -> Float[np.ndarray, "n k"]:
    """The share of each region in the mixture of the hypotheses' positions.

    Positions in no region are left out: a camera cannot stand there. 0.001 is added to every share, because a normal
    distribution is thinner in its tails than the errors of a network are.

    Args:
        regions: in the frame of the poses.
        poses: `anatomy_T_camera`, mm.
        weights: of the hypotheses.
        covariance: of their twists (mm, rad) in the camera frame.
    """
    count = len(poses)
    axes = poses[..., :3, :3]
    factor = axes @ np.linalg.cholesky(covariance[..., :3, :3])
    points_mm = poses[..., None, :3, 3] + _normal_points() @ factor.swapaxes(-1, -2)
    label = regions.label(points_mm)
    share = np.zeros((count, len(regions.names)))
    for k in range(len(regions.names)):
        share[:, k] = ((label == k).mean(axis=2) * weights).sum(axis=1)
    share += _FLOOR  # before they are made to sum to one: a hypothesis that hardly touches the lumen tells little
    return share / share.sum(axis=1, keepdims=True)


@cache
def _normal_points() -> Float[np.ndarray, "s 3"]:
    """Points spread like a standard normal distribution: Sobol's sequence, not scrambled and so always the same."""
    uniform = qmc.Sobol(3, scramble=False).random(_DRAWN) + 0.5 / _DRAWN
    return np.asarray(ndtri(uniform), dtype=np.float64)
