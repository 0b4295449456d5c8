"""The ways in: from each nostril through the nose to the pharynx, and where the two meet behind the septum."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.ndimage import label
from skimage.graph import MCP_Geometric
from skimage.segmentation import watershed

from naris.airway.block import Block
from naris.airway.face import Opening
from naris.airway.near import box_of

_PHARYNX_BEHIND_MM, _PHARYNX_BESIDE_MM = 45.0, 25.0  # of the tip of the nose
_NARROW_MM = 0.25
_JOINED_MM = (2.0, 1.0, 0.0)  # half the width of what joins two sections to one


def pharynx_nodes(
    block: Block, airway: Bool[np.ndarray, "nx ny nz"], tip_mm: Float[np.ndarray, "3"]
) -> Int[np.ndarray, "n 3"]:
    """The lowest nodes of the airway behind the nose and near the middle."""
    x, y = block.axis_mm(0) - tip_mm[0], block.axis_mm(1) - tip_mm[1]
    there = airway & (np.abs(x) < _PHARYNX_BESIDE_MM) & (y > _PHARYNX_BEHIND_MM)
    rows = np.flatnonzero(there.any(axis=(0, 1)))
    if not len(rows):
        return np.zeros((0, 3), dtype=np.int64)
    at = np.argwhere(there[:, :, rows[0]])
    return np.insert(at, 2, rows[0], axis=1)


def ways_in(
    room_mm: Float32[np.ndarray, "nx ny nz"], openings: list[Opening], goals: Int[np.ndarray, "n 3"]
) -> list[Int[np.ndarray, "_ 3"]]:
    """From each opening the way to the pharynx with the most room; openings without a way are left out.

    A step costs its length over the square of the distance to the wall, so that a long wide way beats a short narrow
    one (as the passages of `naris.anatomy.passages`).
    """
    box = box_of(room_mm > 0)
    first, there = np.array([one.start for one in box]), room_mm[box]
    search = MCP_Geometric(np.where(there > 0, 1 / np.maximum(there, _NARROW_MM) ** 2, np.inf))
    reached, _ = search.find_costs((goals - first).tolist())
    ways = []
    for opening in openings:
        nodes = opening.nodes - first
        spent = reached[tuple(nodes.T)]
        if np.isfinite(spent.min()):
            ways.append(np.array(search.traceback(tuple(nodes[int(spent.argmin())].tolist()))) + first)
    return ways


def choana_row(
    nasal: Bool[np.ndarray, "nx ny nz"],
    room_mm: Float32[np.ndarray, "nx ny nz"],
    right: Int[np.ndarray, "n 3"],
    left: Int[np.ndarray, "m 3"],
) -> int:
    """The first coronal row (index along y) behind the septum: from there on the ways share one cross-section.

    Sections count as one where they are joined widely: a septum as thin as a voxel has holes in a scan. In a nose that
    is narrow throughout, less will do.

    Args:
        nasal: the air of the nose.
        room_mm: of each node to the wall.
        right, left: the ways from the pharynx to the nostrils.
    """
    last = min(int(right[:, 1].max()), int(left[:, 1].max()))
    for least_mm in _JOINED_MM:
        row = _first_shared(nasal & (room_mm >= least_mm), right, left)
        if row is not None:
            return row
    return last


def _first_shared(
    air: Bool[np.ndarray, "nx ny nz"], right: Int[np.ndarray, "n 3"], left: Int[np.ndarray, "m 3"]
) -> int | None:
    """The foremost of the rows, in a line from the hindmost on, in which both ways run through one piece of air."""
    first = max(int(right[:, 1].min()), int(left[:, 1].min()))
    last = min(int(right[:, 1].max()), int(left[:, 1].max()))
    row = None
    for candidate in range(last, first - 1, -1):
        parts, _ = label(air[:, candidate, :])
        ours, theirs = (_parts_of(parts, way[way[:, 1] == candidate]) for way in (right, left))
        if not ours.isdisjoint(theirs):
            row = candidate
        elif row is not None and ours and theirs:  # a way that is narrower than asked here tells nothing
            break
    return row


def _parts_of(parts: Int[np.ndarray, "nx nz"], nodes: Int[np.ndarray, "n 3"]) -> set[int]:
    return set(parts[nodes[:, 0], nodes[:, 2]].tolist()) - {0}


def sides(
    cavity: Bool[np.ndarray, "nx ny nz"],
    room_mm: Float32[np.ndarray, "nx ny nz"],
    right: Int[np.ndarray, "n 3"],
    left: Int[np.ndarray, "m 3"],
) -> Int[np.ndarray, "nx ny nz"]:
    """1 right of the septum, 2 left of it, 0 elsewhere: flooded from the ways, narrow places last."""
    seeds = np.zeros(cavity.shape, dtype=np.int32)
    for number, way in ((1, right), (2, left)):
        seeds[tuple(way.T)] = number
    return np.asarray(watershed(-room_mm, np.where(cavity, seeds, 0), mask=cavity), dtype=np.int32)
