"""Where the septum stands, also where a scan does not show it, and what of the air lies on which side of it.

Where it is thinner than a voxel both clefts beside it look like one. But a septum goes on as it stands around: a
smooth surface x = s(y, z) through the middles of the tissue that is seen between the sides tells the clefts apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Integer, UInt8
from scipy.ndimage import binary_dilation, distance_transform_edt, label, map_coordinates
from scipy.sparse import csc_array, dia_array, diags_array, eye_array, kron
from scipy.sparse.linalg import spsolve

from naris.airway.basins import Basins
from naris.airway.block import TOUCHING
from naris.airway.near import deep_mm, within_mm

_MOST_MM = 10.0  # a septum is thick, with its columella and spurs
_CELL_MM = 1.0  # of the lattice that its surface is sought on
_STIFFNESS = (600.0, 60.0, 20.0, 20.0)  # one fit after the other; at the last, bends of some mm are followed
_STRAY_MM = 1.0  # from the fit before, a middle counts a quarter: it may be that of a turbinate
_SURELY_MM = 0.25  # beyond the surface the side is sure
_NEAR_MM = 15.0  # from where it is seen
_MIRRORED, _MIRRORED_MM = 0.5, 1.0  # share of a part, and how near to the nose of the other side
_SLIT_MM, _FEWEST = 1.5, 20  # half the width of a slit, and nodes
_OPEN_HU = -800.0  # air that no tissue dims: a hole, and no septum thinner than a voxel


@dataclass(frozen=True, eq=False)
class Septum:
    """The surface of a septum over a lattice.

    Attributes:
        index: (ny, nz) along x, in nodes.
        seen_mm: (ny, nz) from there to where it is seen between air of both sides.
        step_mm: of the lattice.
    """

    index: Float[np.ndarray, "ny nz"]
    seen_mm: Float[np.ndarray, "ny nz"]
    step_mm: float

    def beyond_mm(self, size: int) -> Float[np.ndarray, "nx ny nz"]:
        """How far to the left of the septum each node of a lattice of so many sections lies."""
        return np.asarray((np.arange(size)[:, None, None] - self.index) * self.step_mm)


def septum_of(labels: Integer[np.ndarray, "nx ny nz"], step_mm: float) -> Septum | None:
    """The septum between air labelled 1 (right) and 2 (left); None where no line of nodes runs from one to the other.

    Args:
        labels: 0 for tissue, 3 and more for what else there is.
        step_mm: of the lattice.
    """
    seen, middle = _seen(labels, step_mm)
    if not seen.any():
        return None
    every = max(round(_CELL_MM / step_mm), 1)
    coarse = _robust(*_in_cells(seen, middle, every), step_mm)
    nodes = np.indices(seen.shape) / every - (every - 1) / (2 * every)
    index = map_coordinates(coarse, nodes, order=1, mode="nearest")
    return Septum(np.asarray(index), np.asarray(distance_transform_edt(~seen) * step_mm), step_mm)


def _seen(
    labels: Integer[np.ndarray, "nx ny nz"], step_mm: float
) -> tuple[Bool[np.ndarray, "ny nz"], Float[np.ndarray, "ny nz"]]:
    """Where tissue alone lies between air of the right and of the left side, and its middle along x."""
    at = np.arange(len(labels), dtype=np.int32)[:, None, None]
    last = np.full(labels.shape, -1, dtype=np.int32)  # air before a node
    last[1:] = np.maximum.accumulate(np.where(labels > 0, at, -1), axis=0)[:-1]
    after = np.take_along_axis(labels, np.maximum(last, 0), axis=0)
    gap = at - last
    between = (labels == 2) & (last >= 0) & (after == 1) & (gap > 1) & (gap * step_mm <= _MOST_MM)
    count = between.sum(axis=0)
    middle = np.where(between, (at + last) / 2, 0.0).sum(axis=0) / np.maximum(count, 1)
    return count > 0, middle


def _in_cells(
    seen: Bool[np.ndarray, "ny nz"], middle: Float[np.ndarray, "ny nz"], every: int
) -> tuple[Float[np.ndarray, "my mz"], Float[np.ndarray, "my mz"]]:
    """What share of each cell of so many nodes sees the septum, and the middle there."""
    pad = [(0, -n % every) for n in seen.shape]
    rows, columns = ((n + p) // every for n, (_, p) in zip(seen.shape, pad, strict=True))
    cells = [
        np.pad(values, pad).reshape(rows, every, columns, every).sum(axis=(1, 3))
        for values in (seen.astype(np.float64), np.where(seen, middle, 0.0))
    ]
    return cells[0] / every**2, cells[1] / np.maximum(cells[0], 1.0)


def _robust(
    share: Float[np.ndarray, "my mz"], middle: Float[np.ndarray, "my mz"], step_mm: float
) -> Float[np.ndarray, "my mz"]:
    """The smooth surface that most middles lie near: where a cleft is given to the wrong side, they are turbinates'."""
    bending, trust = _bending(share.shape), share
    for stiffness in _STIFFNESS:
        system = diags_array(trust.ravel()) + stiffness * bending
        fitted = spsolve(system.tocsc(), (trust * middle).ravel()).reshape(share.shape)
        trust = share / (1 + ((fitted - middle) * step_mm / _STRAY_MM) ** 2) ** 2
    return np.asarray(fitted)


def _bending(shape: tuple[int, ...]) -> csc_array:
    """The energy of a thin plate (Duchon 1977) over a lattice, as a matrix."""
    rows, columns = shape
    along = kron(_differences(rows, 2), eye_array(columns))
    up = kron(eye_array(rows), _differences(columns, 2))
    twist = kron(_differences(rows, 1), _differences(columns, 1))
    return csc_array(along.T @ along + up.T @ up + 2 * twist.T @ twist)


def _differences(size: int, order: int) -> dia_array:
    """Of neighbouring values, of the first or second order."""
    weights = [-1.0, 1.0] if order == 1 else [1.0, -2.0, 1.0]
    return diags_array(weights, offsets=list(range(order + 1)), shape=(max(size - order, 0), size))


def given_back(labels: UInt8[np.ndarray, "nx ny nz"], septum: Septum) -> UInt8[np.ndarray, "nx ny nz"]:
    """Labels in which air beyond the septum is of the side that it lies on, where it hangs together with that side."""
    beyond_mm = septum.beyond_mm(len(labels))
    near = septum.seen_mm <= _NEAR_MM
    given = labels.copy()
    for one, other, sign in ((1, 2, 1), (2, 1, -1)):
        given[(labels == one) & (sign * beyond_mm > _SURELY_MM) & near] = other
    for side in (1, 2):
        parts, _ = label(given == side, TOUCHING)
        sizes = np.bincount(parts.ravel())
        sizes[0] = 0
        stray = (given == side) & (labels != side) & (parts != sizes.argmax())
        given[stray] = labels[stray]
    return given


@dataclass(frozen=True, eq=False)
class Seam:
    """Where air of the right side meets air of the left.

    Attributes:
        wall: (nx, ny, nz) nodes where a septum must stand that the scan hardly shows.
        wall_mm2: its area.
        hole_mm2: the area of clear air between the sides, which is left open.
    """

    wall: Bool[np.ndarray, "nx ny nz"]
    wall_mm2: float
    hole_mm2: float


def seam_of(
    labels: UInt8[np.ndarray, "nx ny nz"], hu: Float32[np.ndarray, "nx ny nz"], pharynx: int, step_mm: float
) -> Seam:
    """Where labels 1 and 2 meet in front of the `pharynx`, and where of that a wall is missing.

    A septum thinner than a voxel leaves grey values between air and tissue; where there is air alone there is a hole.
    """
    touching = (labels == 2) & binary_dilation(labels == 1, TOUCHING)
    parts, count = label(touching, TOUCHING)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    behind = np.bincount(parts[binary_dilation(labels == pharynx, TOUCHING)], minlength=count + 1) > 0
    clear = np.bincount(parts[touching & (hu < _OPEN_HU)], minlength=count + 1) > sizes / 2
    wall = ~behind & ~clear & (np.arange(count + 1) > 0)
    hole = ~behind & clear & (np.arange(count + 1) > 0)
    return Seam(wall[parts], float(sizes[wall].sum()) * step_mm**2, float(sizes[hole].sum()) * step_mm**2)


def mirrored_parts(
    labels: UInt8[np.ndarray, "nx ny nz"], doubtful: Bool[np.ndarray, "nx ny nz"], basins: Basins, septum: Septum
) -> UInt8[np.ndarray, "nx ny nz"]:
    """Labels in which slits that lie as the nose of the other side does are of the nose.

    A turbinate that touches wall and floor shuts its meatus off, and holes of thin bone may join that to a sinus. But
    noses are alike on both sides: what is narrow, touches the nose and lies where the other side is nose, is a meatus.

    Args:
        labels: 1 right, 2 left.
        doubtful: air that is neither, as low as there are meatuses and no ethmoid cells.
        basins: the air in parts.
        septum: between the sides.
    """
    side, alike = _alike(labels, septum)
    size = len(basins.room_mm)
    nodes, hits = (np.bincount(basins.part[mask], minlength=size) for mask in (doubtful, doubtful & alike))
    slits = (hits >= _MIRRORED * np.maximum(nodes, 1)) & (basins.room_mm <= 2 * _SLIT_MM)
    roomy = doubtful & ~slits[basins.part] & (deep_mm(doubtful, septum.step_mm) > _SLIT_MM)
    sinus = within_mm(roomy, _SLIT_MM, septum.step_mm)
    found = doubtful & (slits[basins.part] | (alike & ~sinus))
    out = labels.copy()
    for number in (1, 2):
        parts, count = label(found & (side == number), TOUCHING)
        touched = np.bincount(parts[binary_dilation(labels == number, TOUCHING)], minlength=count + 1) > 0
        touched &= np.bincount(parts.ravel(), minlength=count + 1) >= _FEWEST
        touched[0] = False
        out[touched[parts]] = number
    return out


def _alike(
    labels: UInt8[np.ndarray, "nx ny nz"], septum: Septum
) -> tuple[UInt8[np.ndarray, "nx ny nz"], Bool[np.ndarray, "nx ny nz"]]:
    """The side that each node lies on, and whether its mirror image lies in or at the nose of the other side."""
    at = np.arange(len(labels))[:, None, None]
    image = np.rint(2 * septum.index - at).astype(np.int64)
    within = (image >= 0) & (image < len(labels)) & (septum.seen_mm <= _NEAR_MM)
    side = np.where(at < septum.index, 1, 2).astype(np.uint8)
    alike = np.zeros(labels.shape, dtype=bool)
    for number in (1, 2):
        near = within_mm(labels == 3 - number, _MIRRORED_MM, septum.step_mm)
        alike |= (side == number) & within & np.take_along_axis(near, np.clip(image, 0, len(labels) - 1), axis=0)
    return side, alike
