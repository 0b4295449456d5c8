"""A part of a scan on an even lattice along the axes of the patient, which every step of the segmentation works on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int, Num, UInt8
from scipy.ndimage import affine_transform, gaussian_filter

from naris.core.volume import Volume

BEYOND_HU, ROOM_HU = 40, -1000
"""What stands where the scan has nothing: soft tissue, so that no air is made up, but in front of it the air of the
room."""

TOUCHING = np.ones((3, 3, 3), dtype=bool)
"""Nodes that share a corner touch: slits of one node across stay whole."""

WITHIN, FRONT, BEYOND = 0, 1, 2
_EDGE = 1e-6  # of a voxel: a node nearer to the end of the scan may have its value or not, as numbers are rounded


@dataclass(frozen=True, eq=False)
class Block:
    """Hounsfield units on a lattice whose axes are x (to the left), y (backwards) and z (upwards).

    Attributes:
        hu: (nx, ny, nz).
        origin_mm: (3,) where node (0, 0, 0) lies in LPS.
        step_mm: between nodes.
    """

    hu: Float32[np.ndarray, "nx ny nz"]
    origin_mm: Float[np.ndarray, "3"]
    step_mm: float

    @property
    def frame_T_index(self) -> Float[np.ndarray, "4 4"]:
        """From lattice coordinates to mm in LPS."""
        matrix = np.diag([self.step_mm, self.step_mm, self.step_mm, 1.0])
        matrix[:3, 3] = self.origin_mm
        return matrix

    def points_mm(self, index: Num[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Where nodes (..., 3) lie in LPS."""
        return np.asarray(self.origin_mm + self.step_mm * np.asarray(index))

    def index(self, point_mm: Num[np.ndarray, "3"]) -> Int[np.ndarray, "3"]:
        """The node nearest to a point, within the lattice."""
        nearest = np.rint((np.asarray(point_mm) - self.origin_mm) / self.step_mm).astype(np.int64)
        return np.clip(nearest, 0, np.array(self.hu.shape) - 1)

    def axis_mm(self, axis: int) -> Float[np.ndarray, "*n"]:
        """Coordinates of the nodes along an axis, shaped to be broadcast over the block."""
        shape = [1, 1, 1]
        shape[axis] = self.hu.shape[axis]
        values = self.origin_mm[axis] + self.step_mm * np.arange(self.hu.shape[axis])
        return np.asarray(values.reshape(shape))


def block_of(
    volume: Volume,
    step_mm: float,
    low_mm: Float[np.ndarray, "3"] | None = None,
    high_mm: Float[np.ndarray, "3"] | None = None,
) -> Block:
    """The scan between two corners (or all of it), trilinear; where a step is wider than a voxel it is smoothed first.

    Nodes beyond the scan, as at the corners of one that lies at an angle, get `BEYOND_HU`, those before its front
    `ROOM_HU`.
    """
    bounds = volume.bounds_mm
    low = bounds[0] if low_mm is None else np.maximum(low_mm, bounds[0])
    high = bounds[1] if high_mm is None else np.minimum(high_mm, bounds[1])
    shape = tuple(int(n) for n in np.maximum(np.floor((high - low) / step_mm + 1e-6), 1) + 1)
    values = volume.hu
    wide = step_mm / volume.spacing_mm
    if wide.max() > 1.5:
        values = gaussian_filter(values.astype(np.float32), np.where(wide > 1.5, 0.35 * wide, 0.0))
    matrix = np.diag([step_mm, step_mm, step_mm, 1.0])
    matrix[:3, 3] = low
    to_old = np.linalg.inv(volume.frame_T_index) @ matrix
    hu = affine_transform(
        values, to_old[:3, :3], to_old[:3, 3], shape, np.float32, 1, mode="constant", cval=BEYOND_HU, prefilter=False
    )
    if not _upright(to_old):
        hu[_sides_of(to_old, volume, shape) == FRONT] = ROOM_HU
    return Block(np.asarray(hu), low, step_mm)


def sides_of(volume: Volume, block: Block) -> UInt8[np.ndarray, "nx ny nz"]:
    """Which nodes of a block lie in the scan (`WITHIN`), straight in front of it (`FRONT`) or elsewhere (`BEYOND`)."""
    return _sides_of(np.linalg.inv(volume.frame_T_index) @ block.frame_T_index, volume, block.hu.shape)


def _upright(to_old: Float[np.ndarray, "4 4"]) -> bool:
    """Whether the axes of the scan are those of the patient, so that a block within its bounds lies within it."""
    axes = np.abs(to_old[:3, :3])
    return bool((axes > 1e-6 * axes.max()).sum() == 3)


def _sides_of(
    to_old: Float[np.ndarray, "4 4"], volume: Volume, shape: tuple[int, ...]
) -> UInt8[np.ndarray, "nx ny nz"]:
    backwards = int(np.abs(to_old[:3, 1] * volume.spacing_mm).argmax())  # in mm: slices may be thick
    to_back = bool(to_old[backwards, 1] > 0)
    nodes = np.ogrid[tuple(slice(n) for n in shape)]
    beside, before, behind = (np.zeros(shape, bool) for _ in range(3))
    for axis, size in enumerate(volume.shape):
        at = sum(to_old[axis, k] * nodes[k] for k in range(3)) + to_old[axis, 3]
        low, high = at < _EDGE, at > size - 1 - _EDGE
        if axis == backwards:
            before, behind = (low, high) if to_back else (high, low)
        else:
            beside |= low | high
    side = np.where(beside | behind, BEYOND, WITHIN).astype(np.uint8)
    side[before & ~beside] = FRONT
    side[before & beside] = BEYOND
    return side
