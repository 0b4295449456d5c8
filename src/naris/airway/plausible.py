"""Whether what was found in a scan can be a nose: it is not cut by the end of the scan, holds air, and has its size.

An anatomy that looks fine and is wrong is worse than none, so what cannot be is refused with the reason, and what is
merely unusual is told.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from scipy.ndimage import binary_dilation

from naris.airway.block import WITHIN, Block, sides_of
from naris.core.volume import Volume
from naris.ct.scan import Finding
from naris.errors import ScanError

_CUT_MM2 = 20.0  # of a nasal cavity on the end of the scan; the pharynx may be cut, the nostrils open forwards
_ROOMY_MM, _MORE_HU = 1.5, 200.0  # of the wall the air is that of the room, whatever the scanner blurs
_LEAST_DEPTH_MM, _MOST_DEPTH_MM = 35.0, 110.0  # from a nostril to its choana, from a small child on
_SIDE_ML, _PHARYNX_ML = (1.5, 45.0), 60.0
_UNEVEN, _VERY_UNEVEN = 1.7, 2.5
_ENDS = (("right", "left"), ("front", "back"), ("bottom", "top"))
_FRONT = (1, 0)


def check_plausible(
    volume: Volume,
    block: Block,
    sides: Mapping[str, Bool[np.ndarray, "nx ny nz"]],
    pharynx: Bool[np.ndarray, "nx ny nz"],
    wall: Float32[np.ndarray, "nx ny nz"],
    room_hu: float,
    landmarks_mm: Mapping[str, Float[np.ndarray, "3"]],
) -> list[Finding]:
    """What is unusual in what was found.

    Args:
        volume: the scan.
        block: the lattice.
        sides: the `right` and the `left` nasal cavity.
        pharynx: the nasopharynx.
        wall: distances to the wall in mm.
        room_hu: of the air in front of the face.
        landmarks_mm: nostrils and choanae.

    Raises:
        ScanError: if it cannot be a whole nose of air.
    """
    ml = block.step_mm**3 / 1000
    for side, cavity in sides.items():
        _check_whole(volume, block, side, cavity)
        depth_mm = float(np.linalg.norm(landmarks_mm[f"{side}.choana"] - landmarks_mm[f"{side}.nostril"]))
        _check_between(f"from the {side} nostril to its choana", "mm", depth_mm, _LEAST_DEPTH_MM, _MOST_DEPTH_MM)
        _check_between(f"in the {side} nasal cavity", "ml", float(cavity.sum()) * ml, *_SIDE_ML)
    _check_between("in the nasopharynx", "ml", float(pharynx.sum()) * ml, 0.0, _PHARYNX_ML)
    roomy = (sides["right"] | sides["left"]) & (wall >= _ROOMY_MM)
    if roomy.any() and (hu := float(np.median(block.hu[roomy]))) > room_hu + _MORE_HU:
        raise ScanError(
            f"air in the nose as in the room, of {room_hu:.0f} HU",
            f"{hu:.0f} HU",
            "it may be packed: segment it by hand",
        )
    volumes = {side: float(cavity.sum()) * ml for side, cavity in sides.items()}
    less, more = sorted(volumes, key=lambda side: volumes[side])
    if volumes[more] < _UNEVEN * volumes[less]:
        return []
    told = f"the {less} side holds {volumes[less]:.1f} ml of air, the {more} {volumes[more]:.1f}: packed or swollen?"
    return [Finding("uneven sides", told, "warning" if volumes[more] > _VERY_UNEVEN * volumes[less] else "notice")]


def _check_between(what: str, unit: str, found: float, low: float, high: float) -> None:
    if not low <= found <= high:
        raise ScanError(
            f"{low:g} to {high:g} {unit} {what}",
            f"{found:.1f} {unit}",
            "this may be no whole nose, or one whose septum has a large hole: segment it by hand",
        )


def _check_whole(volume: Volume, block: Block, side: str, cavity: Bool[np.ndarray, "nx ny nz"]) -> None:
    """Refuses a cavity that the scan ends in."""
    step = block.step_mm
    for axis, names in enumerate(_ENDS):
        for end, name in enumerate(names):
            at_end = abs(_end_mm(block, axis, end) - volume.bounds_mm[end, axis]) < 1.5 * step
            if (axis, end) != _FRONT and at_end:
                _refuse_cut(side, name, float(np.take(cavity, -end, axis).sum()) * step**2)
    codes: UInt8[np.ndarray, "nx ny nz"] = sides_of(volume, block)
    if (codes != WITHIN).any():
        edge = cavity & binary_dilation(codes != WITHIN)
        _refuse_cut(side, "oblique edge", float(edge.sum()) * step**2)


def _end_mm(block: Block, axis: int, end: int) -> float:
    return float(block.origin_mm[axis] + end * (block.hu.shape[axis] - 1) * block.step_mm)


def _refuse_cut(side: str, end: str, area_mm2: float) -> None:
    if area_mm2 > _CUT_MM2:
        raise ScanError(
            "a scan that holds the whole nose",
            f"one whose {end} cuts through the {side} nasal cavity",
            "give one with some tissue around the nose on all sides",
        )
