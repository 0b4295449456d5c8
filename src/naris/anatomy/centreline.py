"""From a way over grid nodes to a smooth centreline that is sure to stay inside."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from naris.anatomy.centreline_kernels import relax
from naris.anatomy.distance import SignedDistance

STEP_MM = 0.5
_ROUNDS = 300
_SMOOTHING = 0.4
_CENTRING_MM = 0.04
_KEPT_CLEARANCE = 0.6
_AMPLE_MM = 2.0


def centreline(
    way_mm: Float[np.ndarray, "m 3"], distance: SignedDistance
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
    """Points about 0.5 mm apart along a way through the lumen, and their exact clearance in mm.

    The way is smoothed and drawn to the middle, but a point keeps at least 60 % of its clearance
    (or of 2 mm, where there is more). Where the free balls around neighbouring points would no longer touch (so that
    a wall could pass between them), the way as it came is kept.
    """
    start = resample(way_mm, STEP_MM)
    points = start.copy()
    least = _KEPT_CLEARANCE * np.minimum(distance(start), _AMPLE_MM)
    lattice = (distance.values_mm, distance.origin_mm, distance.spacing_mm)
    relax(points, least, lattice, _ROUNDS, _SMOOTHING, _CENTRING_MM, _AMPLE_MM)
    for candidate in (resample(points, STEP_MM), start):
        clearance = distance.exact(candidate)
        if _surely_inside(candidate, clearance):
            return candidate, clearance
    return way_mm, distance.exact(way_mm)


def resample(points_mm: Float[np.ndarray, "m 3"], step_mm: float) -> Float[np.ndarray, "n 3"]:
    """Points on a polyline, evenly spaced by about `step_mm` of its length; both ends stay."""
    steps = np.linalg.norm(np.diff(points_mm, axis=0), axis=1)
    kept = np.append(True, steps > 0)
    along, points = np.append(0.0, np.cumsum(steps))[kept], points_mm[kept]
    wanted = np.linspace(0.0, along[-1], max(round(float(along[-1]) / step_mm), 1) + 1)
    return np.stack([np.interp(wanted, along, points[:, k]) for k in range(3)], axis=1)


def _surely_inside(points: Float[np.ndarray, "n 3"], clearance: Float[np.ndarray, "n"]) -> bool:
    gap = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return bool((clearance > 0).all() and (clearance[1:] + clearance[:-1] >= gap).all())
