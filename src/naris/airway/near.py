"""How far nodes are from others, exact, and sought only in the box where it matters: most of a head is no air."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int32
from scipy.ndimage import distance_transform_edt


def box_of(mask: Bool[np.ndarray, "nx ny nz"], around: int = 0) -> tuple[slice, slice, slice]:
    """The smallest box that holds all of a mask and so many nodes around it, as far as there are any."""
    ends = []
    for axis in range(3):
        there = np.flatnonzero(mask.any(axis=tuple(other for other in range(3) if other != axis)))
        low, high = (int(there[0]) - around, int(there[-1]) + 1 + around) if len(there) else (0, 0)
        ends.append(slice(max(low, 0), min(high, mask.shape[axis])))
    return ends[0], ends[1], ends[2]


def deep_mm(mask: Bool[np.ndarray, "nx ny nz"], step_mm: float) -> Float[np.ndarray, "nx ny nz"]:
    """The distance of each node of a mask to the nearest node that is none of it; 0 elsewhere.

    Nodes beyond the box around the mask are further away than those on its outside.
    """
    found = np.zeros(mask.shape)
    box = box_of(mask, 1)
    inside = mask[box]
    found[box][inside] = _far_mm(inside, step_mm)
    return found


def within_mm(mask: Bool[np.ndarray, "nx ny nz"], most_mm: float, step_mm: float) -> Bool[np.ndarray, "nx ny nz"]:
    """What lies in a mask or no further from it than so many mm."""
    found = mask.copy()
    box = box_of(mask, int(most_mm / step_mm) + 1)
    outside = ~mask[box]
    found[box][outside] = _far_mm(outside, step_mm) <= most_mm
    return found


def _far_mm(free: Bool[np.ndarray, "nx ny nz"], step_mm: float) -> Float[np.ndarray, "n"]:
    """From each free node to the nearest that is not."""
    if not free.any():
        return np.zeros(0)
    nearest: Int32[np.ndarray, "3 nx ny nz"] = distance_transform_edt(free, return_distances=False, return_indices=True)
    squared = sum(
        (to[free] - at.astype(np.int32)) ** 2 for to, at in zip(nearest, np.nonzero(free), strict=True)
    )  # of whole numbers, and exact
    return np.asarray(np.sqrt(squared, dtype=np.float64) * step_mm)
