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
from naris.core.nasal_frame import NasalFrame
from naris.core.volume import Volume
from naris.ct.scan import Finding
from naris.errors import InputError, ScanError

_CUT_MM2 = 20.0  # of a nasal cavity on the end of the scan; the pharynx may be cut, the nostrils open forwards
_ROOMY_MM, _MORE_HU = 1.5, 200.0  # of the wall the air is that of the room, whatever the scanner blurs
_LEAST_DEPTH_MM, _MOST_DEPTH_MM = 35.0, 110.0  # from a nostril to its choana, from a small child on
_SIDE_ML, _PHARYNX_ML = (1.5, 45.0), 60.0
_UNEVEN, _VERY_UNEVEN = 1.7, 2.5
_CHILD_MM = 48.0
_HEIGHT_PERCENTILES = 0.5, 99.5  # percentiles of its nodes: one of them too high does not make a nose higher
_USUAL_HEIGHT, _POSSIBLE_HEIGHT = (0.6, 0.9), (0.5, 1.0)
"""Of a nose, as a share of its depth; 0.62 to 0.83 in real and drawn ones, and 0.96 to 1.08 in two real ones whose
slices are said to lie half as far again from each other as they do."""
_TRUE_DISTANCES = "the header tells the true distances of slices and pixels"
_BY_HAND = "this may be no whole nose, or one whose septum has a large hole: segment it by hand"
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
        landmarks_mm: nostrils, choanae and the anterior tip.

    Raises:
        ScanError: if it cannot be a whole nose of air.
    """
    ml = block.step_mm**3 / 1000
    for side, cavity in sides.items():
        _check_whole(volume, block, side, cavity, landmarks_mm["anterior tip"])
        depth_mm = float(np.linalg.norm(landmarks_mm[f"{side}.choana"] - landmarks_mm[f"{side}.nostril"]))
        _check_between(f"from the {side} nostril to its choana", "mm", depth_mm, _LEAST_DEPTH_MM, _MOST_DEPTH_MM)
        _check_between(f"in the {side} nasal cavity", "ml", float(cavity.sum()) * ml, *_SIDE_ML)
    _check_between("in the nasopharynx", "ml", float(pharynx.sum()) * ml, 0.0, _PHARYNX_ML)
    findings = _proportions(block, sides["right"] | sides["left"], landmarks_mm)
    roomy = (sides["right"] | sides["left"]) & (wall >= _ROOMY_MM)
    if roomy.any() and (hu := float(np.median(block.hu[roomy]))) > room_hu + _MORE_HU:
        raise ScanError(
            f"air in the nose as in the room, of {room_hu:.0f} HU",
            f"{hu:.0f} HU",
            "it may be packed: segment it by hand",
        )
    return findings + _uneven({side: float(cavity.sum()) * ml for side, cavity in sides.items()})


def _uneven(volumes_ml: Mapping[str, float]) -> list[Finding]:
    less, more = sorted(volumes_ml, key=lambda side: volumes_ml[side])
    if volumes_ml[more] < _UNEVEN * volumes_ml[less]:
        return []
    told = (
        f"the {less} side holds {volumes_ml[less]:.1f} ml of air, the {more} {volumes_ml[more]:.1f}: packed or swollen?"
    )
    very = volumes_ml[more] > _VERY_UNEVEN * volumes_ml[less]
    return [Finding("uneven sides", told, "warning" if very else "notice")]


def _proportions(
    block: Block, cavities: Bool[np.ndarray, "nx ny nz"], landmarks_mm: Mapping[str, Float[np.ndarray, "3"]]
) -> list[Finding]:
    """Whether a nose is as high as one of its depth is; a wrong distance between slices or pixels stretches it.

    Raises:
        ScanError: if no nose is so high or so low.
    """
    try:
        frame = NasalFrame.of(landmarks_mm)
    except InputError as error:
        raise ScanError("two sides of a nose beside each other", "nostrils and choanae on a line", _BY_HAND) from error
    up = frame.coordinates_mm(block.points_mm(np.argwhere(cavities)))[:, 2]
    height_mm = float(np.ptp(np.percentile(up, _HEIGHT_PERCENTILES)))
    share = height_mm / frame.depth_mm
    found = f"{height_mm:.0f} mm high and {frame.depth_mm:.0f} mm deep, {share:.2f} times"
    if not _POSSIBLE_HEIGHT[0] <= share <= _POSSIBLE_HEIGHT[1]:
        expected = f"a nose {_POSSIBLE_HEIGHT[0]:g} to {_POSSIBLE_HEIGHT[1]:g} times as high as it is deep"
        raise ScanError(expected, f"one {found}", f"see that {_TRUE_DISTANCES}")
    findings = []
    if not _USUAL_HEIGHT[0] <= share <= _USUAL_HEIGHT[1]:
        told = f"the nose is {found}, and usually {_USUAL_HEIGHT[0]:g} to {_USUAL_HEIGHT[1]:g}: are the distances of"
        findings.append(Finding("stretched", f"{told} slices and pixels right?", "warning"))
    if frame.depth_mm < _CHILD_MM:
        told = f"the nose is {frame.depth_mm:.0f} mm deep, as a small child's is: are the spacings right?"
        findings.append(Finding("small", told, "warning"))
    return findings


def _check_between(what: str, unit: str, found: float, low: float, high: float) -> None:
    if not low <= found <= high:
        raise ScanError(
            f"{low:g} to {high:g} {unit} {what}",
            f"{found:.1f} {unit}",
            _BY_HAND,
        )


def _check_whole(
    volume: Volume,
    block: Block,
    side: str,
    cavity: Bool[np.ndarray, "nx ny nz"],
    tip_mm: Float[np.ndarray, "3"],
) -> None:
    """Refuses a cavity that the scan ends in, or that reaches further than any."""
    step = block.step_mm
    for axis, names in enumerate(_ENDS):
        for end, name in enumerate(names):
            at_end = abs(_end_mm(block, axis, end) - volume.bounds_mm[end, axis]) < 1.5 * step
            area_mm2 = float(np.take(cavity, -end, axis).sum()) * step**2
            if (axis, end) != _FRONT and at_end:
                _refuse_cut(side, name, area_mm2)
            elif not at_end and area_mm2 > _CUT_MM2:
                far_mm = abs(_end_mm(block, axis, end) - tip_mm[axis])
                raise ScanError(
                    f"a nose that ends within {far_mm:.0f} mm of its tip towards the {name}",
                    f"a {side} nasal cavity that goes on there",
                    f"see that {_TRUE_DISTANCES}",
                )
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
