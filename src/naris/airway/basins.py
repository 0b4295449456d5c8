"""Air divided at its narrow places, and which of its parts belong to the nasal cavity.

Air spaces meet at narrow places: ostia, the valve, the slits between turbinates and wall. A watershed of the distance
to the wall (Beucher and Lantuéjoul 1979) cuts there, and nowhere else. What tells a meatus from a sinus is not how wide
the way in is but how wide beside the room behind it: a meatus is as wide as its entrance, a sinus has an ostium.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32
from scipy.ndimage import distance_transform_edt, label, maximum
from skimage.morphology import h_maxima
from skimage.segmentation import watershed

from naris.airway.block import TOUCHING

_DEPTH_MM = 0.4  # of a basin, in radius, to be one of its own
_LEVELS = 8  # a mm, of the distances that maxima are sought in

SLIT_MM = 2.9
"""A part with no more room than this, from its middle to the wall, may be a slit between turbinate and wall."""
_SLIT_NECK, _NECK = 0.4, 0.57  # a part whose way in is narrower than this share of its room has an ostium


@dataclass(frozen=True, eq=False)
class Basins:
    """Air in parts.

    Attributes:
        part: (nx, ny, nz) number of the part of each node, 0 for none.
        room_mm: (P + 1,) the largest distance to the wall in each part.
        pairs: (E, 2) parts that touch.
        neck_mm: (E,) the largest distance to the wall on the border of each pair.
    """

    part: Int32[np.ndarray, "nx ny nz"]
    room_mm: Float[np.ndarray, "p1"]
    pairs: Int[np.ndarray, "e 2"]
    neck_mm: Float[np.ndarray, "e"]


def wall_mm(air: Bool[np.ndarray, "nx ny nz"], step_mm: float) -> Float32[np.ndarray, "nx ny nz"]:
    """The distance of each node of air to the nearest node that is none."""
    return np.asarray(distance_transform_edt(air) * step_mm, dtype=np.float32)


def basins_of(air: Bool[np.ndarray, "nx ny nz"], room_mm: Float32[np.ndarray, "nx ny nz"]) -> Basins:
    """Cut air at its narrow places."""
    levels = np.minimum(np.round(room_mm * _LEVELS), 255).astype(np.uint8)
    peaks, count = label(h_maxima(levels, round(_DEPTH_MM * _LEVELS)), TOUCHING)
    part = np.asarray(watershed(-room_mm, peaks, connectivity=TOUCHING, mask=air), dtype=np.int32)
    widest = np.asarray(maximum(room_mm, part, np.arange(count + 1)), dtype=np.float64)
    pairs, necks = _borders(part, room_mm, count)
    return Basins(part, widest, pairs, necks)


def _borders(
    part: Int32[np.ndarray, "nx ny nz"], room_mm: Float32[np.ndarray, "nx ny nz"], count: int
) -> tuple[Int[np.ndarray, "e 2"], Float[np.ndarray, "e"]]:
    keys, widths = [], []
    for axis in range(3):
        here, there = (np.take(part, np.arange(a, part.shape[axis] + b), axis) for a, b in ((0, -1), (1, 0)))
        cut = (here != there) & (here > 0) & (there > 0)
        low, high = np.minimum(here[cut], there[cut]), np.maximum(here[cut], there[cut])
        keys.append(low.astype(np.int64) * (count + 1) + high)
        one, other = (np.take(room_mm, np.arange(a, part.shape[axis] + b), axis)[cut] for a, b in ((0, -1), (1, 0)))
        widths.append(np.minimum(one, other))
    key, which = np.unique(np.concatenate(keys), return_inverse=True)
    neck = np.zeros(len(key))
    np.maximum.at(neck, which.reshape(-1), np.concatenate(widths))
    return np.stack(np.divmod(key, count + 1), axis=1), neck


def nasal_parts(basins: Basins, through: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "p1"]:
    """Which parts are of the nasal cavity: those that a way in leads `through`, and those wide open to one of them."""
    nasal = np.zeros(len(basins.room_mm), dtype=bool)
    nasal[through] = True
    nasal[0] = False
    least_mm = np.where(basins.room_mm <= SLIT_MM, _SLIT_NECK, _NECK) * basins.room_mm
    while True:
        a, b = basins.pairs.T
        other = np.concatenate([b[nasal[a] & ~nasal[b]], a[nasal[b] & ~nasal[a]]])
        neck = np.concatenate([basins.neck_mm[nasal[a] & ~nasal[b]], basins.neck_mm[nasal[b] & ~nasal[a]]])
        new = other[neck >= least_mm[other]]
        if not len(new):
            return nasal
        nasal[new] = True
