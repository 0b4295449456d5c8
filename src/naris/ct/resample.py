"""A scan on a lattice at right angles and equal distances, taken through its true geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float32, Int16
from scipy.ndimage import affine_transform, map_coordinates

from naris.core.volume import Volume
from naris.ct.scan import MOST_VOXELS
from naris.ct.slices import Stack
from naris.errors import ScanError

AIR_HU = -1024
"""What stands where a resampled scan has nothing."""


def even(hu: Int16[np.ndarray, "ni nj nk"], stack: Stack) -> tuple[Int16[np.ndarray, "ni nj nl"], Stack]:
    """Uneven slices (in the order of the stack) interpolated at steps of the usual distance; first and last stay.

    Linear between neighbours; sideways shifts of a tilted gantry are interpolated along with them.
    """
    depth = np.concatenate([[0.0], np.cumsum(stack.gaps_mm)])
    count = max(round(float(depth[-1]) / stack.step_mm), 1) + 1
    wanted = np.linspace(0, depth[-1], count)
    below = np.clip(np.searchsorted(depth, wanted, side="right") - 1, 0, len(depth) - 2)
    share = (wanted - depth[below]) / stack.gaps_mm[below]
    out = np.empty((*hu.shape[:2], count), np.int16)
    for k, (low, part) in enumerate(zip(below.tolist(), share.tolist(), strict=True)):
        mixed = (1 - part) * hu[:, :, low].astype(np.float32) + part * hu[:, :, low + 1].astype(np.float32)
        out[:, :, k] = np.rint(mixed)
    ends = stack.positions_mm[[0, -1]]
    positions = ends[0] + (wanted / depth[-1])[:, None] * (ends[1] - ends[0])
    step = float(depth[-1]) / (count - 1)
    return out, replace(
        stack,
        order=np.arange(count),
        positions_mm=positions,
        step_mm=step,
        gaps_mm=np.full(count - 1, step),
        missing=np.zeros(0, dtype=np.int64),
    )


def upright(volume: Volume) -> Volume:
    """The scan of a tilted gantry on a lattice at right angles that holds all of it.

    The first two axes and their spacing stay; the third becomes their normal. Trilinear through the true matrix. In the
    wedges where the scan has nothing stands the nearest value of its edge: any one value would be a cavity of air or a
    wall that is not there.

    Raises:
        ScanError: if the lattice is larger than any scan.
    """
    axes, spacing = volume.axes.copy(), volume.spacing_mm.copy()
    normal = np.cross(axes[:, 0], axes[:, 1])
    normal *= np.sign(normal @ axes[:, 2]) / np.linalg.norm(normal)
    spacing[2] *= float(normal @ axes[:, 2])
    axes[:, 2] = normal
    corners = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)]) * (np.array(volume.shape) - 1)
    along = volume.points_mm(corners) @ axes / spacing
    low = along.min(axis=0)
    extent = np.ceil(np.round(along.max(axis=0) - low, 6)) + 1
    if not float(np.prod(extent)) <= MOST_VOXELS:
        told = "×".join(f"{n:.0f}" for n in extent)
        raise ScanError(f"a scan of at most {MOST_VOXELS:,} voxels once it is upright", told, "check its geometry")
    shape = tuple(int(n) for n in extent)
    matrix = np.eye(4)
    matrix[:3, :3] = axes * spacing
    matrix[:3, 3] = axes @ (low * spacing)
    old = np.linalg.inv(volume.frame_T_index) @ matrix
    hu = affine_transform(
        volume.hu, old[:3, :3], old[:3, 3], output_shape=shape, order=1, mode="nearest", prefilter=False
    )
    return Volume(hu, matrix, volume.frame)


def sampled(volume: Volume, points_mm: Float[np.ndarray, "*n 3"], outside: float = AIR_HU) -> Float32[np.ndarray, "*n"]:
    """Trilinear values at points (..., 3) in mm; `outside` beyond the voxel centres."""
    index = np.moveaxis(volume.index(points_mm), -1, 0)
    values = map_coordinates(volume.hu, index, np.float32, order=1, mode="constant", cval=outside, prefilter=False)
    return np.asarray(values)
