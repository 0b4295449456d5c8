"""Air divided at its narrow places, and which of its parts belong to the nasal cavity.

Air spaces meet at narrow places: ostia, the valve, the slits between turbinates and wall. A watershed of the distance
to the wall (Beucher and Lantuéjoul 1979) cuts there, and nowhere else. What tells a meatus from a sinus is not how wide
the way in is but how wide beside the room behind it: a meatus is as wide as its entrance, a sinus has an ostium. And a
slit may be narrow but is long: a meatus whose turbinate nearly touches the septum is open over a large area, while an
ostium, or the holes that thin bone has in a scan, are small beside the cell behind them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int32
from scipy.ndimage import label, maximum
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from skimage.morphology import h_maxima
from skimage.segmentation import watershed

from naris.airway.block import TOUCHING
from naris.airway.near import box_of, deep_mm

_DEPTH_MM = 0.4  # of a basin, in radius, to be one of its own
_LEVELS = 8  # a mm, of the distances that maxima are sought in

SLIT_MM = 2.9
"""A part with no more room than this, from its middle to the wall, may be a slit between turbinate and wall."""
CLEFT_MM = 2.6
"""The olfactory cleft has no more room than this; posterior cells, which may lie beside it, have."""
_SLIT_NECK, _NECK = 0.4, 0.57  # a part whose way in is narrower than this share of its room has an ostium
_OPEN = 1.1  # a cavity that is open over so many times the section of its largest ball has none


@dataclass(frozen=True, eq=False)
class Basins:
    """Air in parts.

    Attributes:
        part: (nx, ny, nz) number of the part of each node, 0 for none.
        room_mm: (P + 1,) the largest distance to the wall in each part.
        pairs: (E, 2) parts that touch.
        neck_mm: (E,) the largest distance to the wall on the border of each pair.
        area_mm2: (E,) of that border, by the faces between nodes.
        size: (P + 1,) nodes in each part.
    """

    part: Int32[np.ndarray, "nx ny nz"]
    room_mm: Float[np.ndarray, "p1"]
    pairs: Int[np.ndarray, "e 2"]
    neck_mm: Float[np.ndarray, "e"]
    area_mm2: Float[np.ndarray, "e"]
    size: Int[np.ndarray, "p1"]


def wall_mm(air: Bool[np.ndarray, "nx ny nz"], step_mm: float) -> Float32[np.ndarray, "nx ny nz"]:
    """The distance of each node of air to the nearest node that is none."""
    return np.asarray(deep_mm(air, step_mm), dtype=np.float32)


def basins_of(air: Bool[np.ndarray, "nx ny nz"], room_mm: Float32[np.ndarray, "nx ny nz"], step_mm: float) -> Basins:
    """Cut air at its narrow places."""
    box = box_of(air, 1)
    within_mm = room_mm[box]
    levels = np.minimum(np.round(within_mm * _LEVELS), 255).astype(np.uint8)
    peaks, count = label(h_maxima(levels, round(_DEPTH_MM * _LEVELS)), TOUCHING)
    part = np.zeros(air.shape, dtype=np.int32)
    part[box] = watershed(-within_mm, peaks, connectivity=TOUCHING, mask=air[box])
    widest = np.asarray(maximum(within_mm, part[box], np.arange(count + 1)), dtype=np.float64)
    pairs, necks, faces = _borders(part[box], within_mm, count)
    size = np.bincount(part.ravel(), minlength=count + 1)
    return Basins(part, widest, pairs, necks, faces * step_mm**2, size)


def _borders(
    part: Int32[np.ndarray, "nx ny nz"], room_mm: Float32[np.ndarray, "nx ny nz"], count: int
) -> tuple[Int[np.ndarray, "e 2"], Float[np.ndarray, "e"], Int[np.ndarray, "e"]]:
    """The pairs of parts that touch, how wide the border of each is, and of how many faces between nodes."""
    keys, widths = [], []
    for axis in range(3):
        here, there = (np.take(part, np.arange(a, part.shape[axis] + b), axis) for a, b in ((0, -1), (1, 0)))
        cut = (here != there) & (here > 0) & (there > 0)
        low, high = np.minimum(here[cut], there[cut]), np.maximum(here[cut], there[cut])
        keys.append(low.astype(np.int64) * (count + 1) + high)
        one, other = (np.take(room_mm, np.arange(a, part.shape[axis] + b), axis)[cut] for a, b in ((0, -1), (1, 0)))
        widths.append(np.minimum(one, other))
    key, which, faces = np.unique(np.concatenate(keys), return_inverse=True, return_counts=True)
    neck = np.zeros(len(key))
    np.maximum.at(neck, which.reshape(-1), np.concatenate(widths))
    return np.stack(np.divmod(key, count + 1), axis=1), neck, faces


def nasal_parts(
    basins: Basins, through: Int[np.ndarray, "n"], elsewhere: Bool[np.ndarray, "p1"] | None = None
) -> Bool[np.ndarray, "p1"]:
    """Which parts are of the nasal cavity.

    Those that a way in leads `through`, and those that are wide open to one of them: as wide as they are roomy, or, for
    what lies where a nasal cavity can be, over a large area.

    Args:
        basins: the air in parts.
        through: numbers of parts.
        elsewhere: parts that lie where there are sinuses, which a large area says nothing about; None for all.
    """
    nasal = np.zeros(len(basins.room_mm), dtype=bool)
    nasal[through] = True
    nasal[0] = False
    nasal = _as_wide(basins, nasal)
    while elsewhere is not None:
        slits = _open_wide(basins, nasal, elsewhere)
        if not slits.any():
            break
        nasal = _as_wide(basins, nasal | slits)
    return nasal


def _as_wide(basins: Basins, nasal: Bool[np.ndarray, "p1"]) -> Bool[np.ndarray, "p1"]:
    """With all that is as wide at its entrance as its room asks for, one after the other."""
    nasal = nasal.copy()
    least_mm = np.where(basins.room_mm <= SLIT_MM, _SLIT_NECK, _NECK) * basins.room_mm
    a, b = basins.pairs.T
    while True:
        other = np.concatenate([b[nasal[a] & ~nasal[b]], a[nasal[b] & ~nasal[a]]])
        neck = np.concatenate([basins.neck_mm[nasal[a] & ~nasal[b]], basins.neck_mm[nasal[b] & ~nasal[a]]])
        new = other[neck >= least_mm[other]]
        if not len(new):
            return nasal
        nasal[new] = True


def _open_wide(
    basins: Basins, nasal: Bool[np.ndarray, "p1"], elsewhere: Bool[np.ndarray, "p1"]
) -> Bool[np.ndarray, "p1"]:
    """Parts of cavities that are none of the nose yet, and open to it over a large area beside their room.

    A cavity is what hangs together by wide places.
    """
    count = len(nasal)
    a, b = basins.pairs.T
    wide = basins.neck_mm >= _NECK * np.maximum(basins.room_mm[a], basins.room_mm[b])
    within = wide & ~nasal[a] & ~nasal[b]
    graph = coo_array((np.ones(within.sum()), (a[within], b[within])), shape=(count, count))
    cavities, cavity = connected_components(graph, directed=False)
    area_mm2 = np.zeros(cavities)
    for ours, theirs in ((a, b), (b, a)):
        meets = nasal[ours] & ~nasal[theirs]
        np.add.at(area_mm2, cavity[theirs[meets]], basins.area_mm2[meets])
    room_mm = np.zeros(cavities)
    np.maximum.at(room_mm, cavity, np.where(nasal, 0.0, basins.room_mm))
    nodes, apart = (np.bincount(cavity, weights, cavities) for weights in (basins.size, basins.size * elsewhere))
    found = (area_mm2 > _OPEN * np.pi * room_mm**2) & (apart < nodes / 2)
    return np.asarray(found[cavity] & ~nasal & (np.arange(count) > 0))
