"""The air of the room, the tip of the nose, and where the nostrils open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_dilation, label, percentile_filter

from naris.airway.block import BEYOND, TOUCHING, WITHIN, Block, block_of, sides_of
from naris.airway.near import deep_mm, within_mm
from naris.core.volume import Volume
from naris.errors import ScanError

AIR_HU = -400.0
"""Below this a voxel is air, above it tissue: half-way between the two, but for mucosa that fills part of a voxel."""

_COARSE_MM = 2.0
_BALL_MM = 6.0  # a ball of this radius does not fit into a nostril: where it cannot come from the front is not the room
_CORNER_MM = 2.0  # it does not fill corners either, so far they are filled up
_TIP_MM = 1.5
_BESIDE_MM, _BEHIND_MM, _ABOVE_MM, _BELOW_MM = 20.0, 30.0, 6.0, 30.0  # of the tip of the nose, nostrils open there
_LEAST_OPENING_MM2 = 4.0
_MOST_SHARE = 0.9
_INWARDS_MM = 8.0
_REACH_MM = 2.5  # of the room into a nostril, beyond a millimetre: 2 of the corner and 1 to 2 of the ball


@dataclass(frozen=True, eq=False)
class Opening:
    """Where a nostril meets the room.

    Attributes:
        nodes: (N, 3) of the airway that touch the room.
        middle: (3,) their mean.
    """

    nodes: Int[np.ndarray, "n 3"]
    middle: Float[np.ndarray, "3"]


def nose_tip_mm(volume: Volume) -> Float[np.ndarray, "3"]:
    """The most anterior place of the head in a scan, LPS, to about 2 mm.

    Raises:
        ScanError: if there is no head with the room in front of it.
    """
    block = block_of(volume, _COARSE_MM)
    sides = sides_of(volume, block)
    known = sides == WITHIN
    head = known & ~room_air(block) & (block.hu >= AIR_HU)
    first = head.argmax(axis=1)
    there = head.any(axis=1)
    cut = there & (first == known.argmax(axis=1))  # where the scan begins in tissue
    if not there.any() or cut.sum() > _MOST_SHARE * known.any(axis=1).sum():
        raise ScanError(
            "a head with air in front of the face",
            "none" if not there.any() else "tissue up to the front of the scan",
            "give a CT that holds the whole nose",
        )
    beside = np.take_along_axis(sides, np.maximum(first - 1, 0)[:, None], axis=1)[:, 0] == BEYOND
    front = np.where(there & ~(cut & beside), first, head.shape[1])
    even = percentile_filter(front, 20, size=5)  # single voxels of noise or a cable are no nose
    foremost = np.argwhere(even * _COARSE_MM <= even.min() * _COARSE_MM + _TIP_MM)
    x, z = foremost.mean(axis=0)
    return np.asarray(block.points_mm(np.array([x, float(even.min()), z])))


def room_air(block: Block) -> Bool[np.ndarray, "nx ny nz"]:
    """The air that a ball of 6 mm reaches from in front of the block (low y), and the corners next to it."""
    pad = int(_BALL_MM / block.step_mm) + 2
    air = np.pad(block.hu < AIR_HU, ((0, 0), (pad, 0), (0, 0)), constant_values=True)
    fits = deep_mm(air, block.step_mm) > _BALL_MM
    fits[:, :pad] = True
    parts, _ = label(fits)
    reached = within_mm(parts == parts[0, 0, 0], _BALL_MM + _CORNER_MM, block.step_mm)
    return np.asarray((reached & air)[:, pad:])


def nostrils(
    block: Block,
    airway: Bool[np.ndarray, "nx ny nz"],
    room: Bool[np.ndarray, "nx ny nz"],
    tip_mm: Float[np.ndarray, "3"],
) -> list[Opening]:
    """Where the airway touches the room near the tip of the nose, largest first."""
    x, y, z = (block.axis_mm(axis) - tip_mm[axis] for axis in range(3))
    near = (np.abs(x) < _BESIDE_MM) & (y < _BEHIND_MM) & (z < _ABOVE_MM) & (z > -_BELOW_MM)
    touching = airway & binary_dilation(room, TOUCHING) & near
    parts, count = label(touching, TOUCHING)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)
    least = _LEAST_OPENING_MM2 / block.step_mm**2
    order = [part for part in np.argsort(-sizes[1:], kind="stable") + 1 if sizes[part] >= least]
    nodes = [np.argwhere(parts == part) for part in order]
    return [Opening(one, one.mean(axis=0)) for one in nodes]


def nostril_mm(opening: Opening, way: Int[np.ndarray, "n 3"], block: Block) -> Float[np.ndarray, "3"]:
    """The middle of a nostril in LPS, about a millimetre inside its rim.

    The room reaches further in, where the opening was found: as deep as the ball sags into a hole of that size, and by
    the corner that is filled.

    Args:
        opening: where the room meets the airway.
        way: from the pharynx to this opening.
        block: whose nodes both are.
    """
    inside = way[max(len(way) - 1 - round(_INWARDS_MM / block.step_mm), 0)]
    across = np.linalg.svd(opening.nodes - opening.middle, full_matrices=False)[2][2]
    outwards = across if across @ (opening.middle - inside) > 0 else -across
    return block.points_mm(opening.middle) + _REACH_MM * outwards
