"""Which of the cavities that open into a nose are which sinus.

Air is already cut at its narrow places (`naris.airway.basins`), of which an ostium is one. A sinus is told by where the
middle of such a part lies in the nose: how far to the side, how far from the nostrils to the choanae and how high above
the nasal floor, all in units of the depth from nostrils to choanae, so that a small nose is as a large one. Cells of
the ethmoid vary more than any rule; what lies where none is expected stays without a name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8
from scipy.ndimage import center_of_mass

from naris.airway.basins import Basins
from naris.airway.block import Block

SINUSES = (
    "right maxillary sinus",
    "left maxillary sinus",
    "right ethmoid cells",
    "left ethmoid cells",
    "right frontal sinus",
    "left frontal sinus",
    "sphenoid sinus",
)
_MAXILLARY, _ETHMOID, _FRONTAL, _SPHENOID = 0, 2, 4, 6  # the first of a pair is the right one

_MOUTH = -0.05  # below it there is no sinus
_HIGH, _FRONT = 0.73, 0.65  # frontal sinuses lie above the one and before the other
_BEHIND, _ABOVE = 0.92, 0.27  # the sphenoid lies behind the one and above the other
_LOW, _BESIDE = 0.47, 0.2  # maxillary sinuses lie below the one and beside the other
_ROOF, _NEAR = 0.36, 0.3  # ethmoid cells lie above the one and, as the sphenoid, nearer to the middle than the other
_CLEFT_BESIDE = 0.08
_NASAL_ROOF, _CELLS, _CELLS_BESIDE = (
    0.7,
    0.45,
    0.16,
)  # no nasal cavity lies above the first, nor above the second so far


@dataclass(frozen=True)
class Extent:
    """How a nose lies in a scan: what places in it are told by, so that a small nose is as a large one.

    Attributes:
        middle_mm, front_mm, floor_mm: x of its middle, y where it begins and z of its floor, in LPS.
        depth_mm: from there to the choanae.
    """

    middle_mm: float
    front_mm: float
    floor_mm: float
    depth_mm: float

    @staticmethod
    def of(marks: Mapping[str, Float[np.ndarray, "3"]]) -> Extent:
        """From nostrils, choanae and nasal floor of either side."""
        choana = (marks["left.choana"] + marks["right.choana"]) / 2
        front = min(float(marks[f"{side}.nostril"][1]) for side in ("left", "right"))
        floor = min(float(marks[f"{side}.nasal floor"][2]) for side in ("left", "right"))
        return Extent(float(choana[0]), front, floor, max(float(choana[1]) - front, 1.0))

    @property
    def cells_mm(self) -> float:
        """z in LPS above which there are ethmoid cells beside the nose, and below which there are meatuses alone."""
        return self.floor_mm + _ROOF * self.depth_mm

    def places(self, points_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """To the left of the middle, behind the front and above the floor, in units of the depth."""
        return np.asarray((points_mm - [self.middle_mm, self.front_mm, self.floor_mm]) / self.depth_mm)

    def beyond(self, points_mm: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Where there are sinuses and no nasal cavity: above its roof, and to the side of its upper half."""
        beside, _, up = self.places(points_mm).T
        return np.asarray((up > _NASAL_ROOF) | ((up > _CELLS) & (np.abs(beside) > _CELLS_BESIDE)))

    def in_cleft(self, points_mm: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Beside the septum in its upper half, in front of the sphenoid: where the olfactory cleft is."""
        beside, back, up = self.places(points_mm).T
        return np.asarray((np.abs(beside) < _CLEFT_BESIDE) & (back < _BEHIND) & (up > _CELLS) & (up < _NASAL_ROOF))


def named(
    labels: UInt8[np.ndarray, "nx ny nz"],
    attached: int,
    basins: Basins,
    block: Block,
    landmarks_mm: Mapping[str, Float[np.ndarray, "3"]],
) -> UInt8[np.ndarray, "nx ny nz"]:
    """Labels in which each attached part that is a sinus has the label `attached` + 1 + its place in `SINUSES`.

    Args:
        labels: of the air, `attached` where it opens into the nose and is none of it.
        attached: that label; it stays where no sinus is known.
        basins: the parts of the air.
        block: the lattice.
        landmarks_mm: nostrils, choanae and nasal floor of either side.
    """
    part = np.where(labels == attached, basins.part, 0)
    numbers = np.unique(part[part > 0])
    if not len(numbers):
        return labels
    middles = block.points_mm(np.array(center_of_mass(part > 0, part, numbers)))
    table = np.zeros(len(basins.room_mm), dtype=labels.dtype)
    table[numbers] = [attached if one is None else attached + 1 + one for one in _which(middles, landmarks_mm)]
    return np.asarray(np.where(part > 0, table[part], labels), dtype=labels.dtype)


def _which(middles_mm: Float[np.ndarray, "n 3"], marks: Mapping[str, Float[np.ndarray, "3"]]) -> list[int | None]:
    """Places in `SINUSES`, None for what is none of them."""
    found: list[int | None] = []
    for x, y, z in Extent.of(marks).places(middles_mm):
        side, beside = int(x > 0), abs(x)
        if z < _MOUTH:
            found.append(None)
        elif z > _HIGH and y < _FRONT:
            found.append(_FRONTAL + side)
        elif y > _BEHIND and z > _ABOVE and beside < _NEAR:
            found.append(_SPHENOID)
        elif beside > _BESIDE and z < _LOW:
            found.append(_MAXILLARY + side)
        elif beside < _NEAR and z > _ROOF:
            found.append(_ETHMOID + side)
        else:
            found.append(None)
    return found
