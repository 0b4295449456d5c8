"""Where a scan begins: in the air before the nose, in its tip, or in the nasal cavity itself, which is then cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int
from scipy.ndimage import distance_transform_edt, label

from naris.airway.block import FRONT, WITHIN, Block, sides_of
from naris.airway.face import AIR_HU
from naris.core.volume import Volume
from naris.ct.scan import Finding
from naris.errors import ScanError

_DISC_MM, _CORNER_MM = 6.0, 2.0  # as the ball that tells the room from a nostril, and the corners it does not fill
_CUT_MM2 = 20.0  # of the nasal cavity, as on the other ends of a scan
_CLIPPED_MM2 = 10.0  # of tissue: less may be noise or a cable


@dataclass(frozen=True, eq=False)
class Front:
    """The front of a scan as a picture, seen along the axis of the patient.

    Attributes:
        first: (nx, nz) the row of the first node within the scan.
        tissue: (nx, nz) where the scan begins in tissue; nowhere if it goes on in front of the block.
        enclosed: (nx, nz) where it begins in air that tissue encloses in this picture, as a cut nostril.
    """

    first: Int[np.ndarray, "nx nz"]
    tissue: Bool[np.ndarray, "nx nz"]
    enclosed: Bool[np.ndarray, "nx nz"]


def front_of(volume: Volume, block: Block) -> Front:
    """What a scan begins in."""
    sides = sides_of(volume, block)
    first = (sides == WITHIN).argmax(axis=1)
    before, at = (
        np.take_along_axis(of, row[:, None], axis=1)[:, 0]
        for of, row in ((sides, np.maximum(first - 1, 0)), (block.hu, first))
    )
    begins = (first > 0) & (before == FRONT)
    tissue = begins & (at >= AIR_HU)
    return Front(first, tissue, begins & ~tissue & ~_open(~tissue, block.step_mm))


def check_front(
    front: Front, block: Block, airway: Bool[np.ndarray, "nx ny nz"], room: Bool[np.ndarray, "nx ny nz"]
) -> list[Finding]:
    """What is unusual in how a scan begins.

    Args:
        front: of the scan.
        block: the lattice.
        airway: the air inside the head.
        room: the air of the room; it reaches some way into a cavity that the front cuts.

    Raises:
        ScanError: if the front cuts through the nasal cavity: straight behind enclosed air lies the airway.
    """
    cut_mm2 = float((front.enclosed & _leads_to(airway, room, front.first)).sum()) * block.step_mm**2
    if cut_mm2 > _CUT_MM2:
        raise ScanError(
            "a scan that holds the whole nose",
            "one whose front cuts through the nasal cavity",
            "give one that begins in the air in front of the nose",
        )
    if float(front.tissue.sum()) * block.step_mm**2 <= _CLIPPED_MM2:
        return []
    return [Finding("clipped nose", "the scan begins in the tip of the nose, which is cut", "warning")]


def _open(air: Bool[np.ndarray, "nx nz"], step_mm: float) -> Bool[np.ndarray, "nx nz"]:
    """What a disc of 6 mm reaches through air from around a picture, and the corners next to it."""
    pad = int(_DISC_MM / step_mm) + 2
    around = np.pad(air, pad, constant_values=True)
    fits = np.pad(distance_transform_edt(around) * step_mm > _DISC_MM, 1, constant_values=True)
    parts, _ = label(fits)
    near = distance_transform_edt(parts != parts[0, 0]) * step_mm <= _DISC_MM + _CORNER_MM
    return np.asarray(near[1 + pad : -1 - pad, 1 + pad : -1 - pad] & air)


def _leads_to(
    airway: Bool[np.ndarray, "nx ny nz"], room: Bool[np.ndarray, "nx ny nz"], first: Int[np.ndarray, "nx nz"]
) -> Bool[np.ndarray, "nx nz"]:
    """Where the airway lies straight behind the front, and nothing but air before it."""
    behind = np.arange(airway.shape[1])[None, :, None] >= first[:, None]
    ends = behind & ~room  # the first node that is not the room's is tissue or the airway
    at = ends.argmax(axis=1)[:, None]
    return np.asarray(np.take_along_axis(ends & airway, at, axis=1)[:, 0])
