"""What cannot be a whole nose of air is refused with the reason: cut, packed, of no size; what is unusual is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.airway.block import Block
from naris.airway.plausible import check_plausible
from naris.airway.segment import segment_airway
from naris.core.volume import Volume
from naris.errors import ScanError
from tests import simulated_head

COARSE_MM = 0.8
NOSTRILS = {"right": np.array([-8.0, 10.0, 20.0]), "left": np.array([8.0, 10.0, 20.0])}


def cropped(volume: Volume, low_mm: tuple[float, float, float], high_mm: tuple[float, float, float]) -> Volume:
    """What lies between two corners; an infinite one leaves its side as it is."""
    corners = np.stack([volume.index(np.clip(one, *volume.bounds_mm)) for one in (low_mm, high_mm)])
    first, last = np.rint(corners).astype(int)
    matrix = volume.frame_T_index.copy()
    matrix[:3, 3] = volume.points_mm(first.astype(float))
    part = tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))
    return Volume(volume.hu[part], matrix)


@pytest.mark.parametrize(
    ("low_mm", "high_mm", "end"),
    [
        ((-np.inf, -np.inf, -np.inf), (9.0, np.inf, np.inf), "left"),
        ((-np.inf, -np.inf, -np.inf), (np.inf, np.inf, -4.0), "top"),
        ((-9.0, -np.inf, -np.inf), (np.inf, np.inf, np.inf), "right"),
        ((-np.inf, -43.0, -np.inf), (np.inf, np.inf, np.inf), "front"),
        ((-np.inf, -34.0, -np.inf), (np.inf, np.inf, np.inf), "front"),
    ],
)
def test_a_scan_that_ends_in_a_cavity_is_refused(low_mm, high_mm, end: str) -> None:
    with pytest.raises(ScanError, match=f"one whose {end} cuts through the"):
        segment_airway(cropped(simulated_head.scan(), low_mm, high_mm), COARSE_MM)


def test_gauze_is_no_air() -> None:
    scan = simulated_head.scan()
    airway = simulated_head.airway()
    nose = np.argwhere(airway.labels > 0)
    hu = scan.hu.copy()
    at = np.rint(scan.index(airway.block.points_mm(nose))).astype(int)
    hu[tuple(at.T)] = np.maximum(hu[tuple(at.T)], -500)
    with pytest.raises(ScanError, match="packed"):
        segment_airway(replace(scan, hu=hu), COARSE_MM)


@pytest.mark.parametrize(("scale", "offset"), [(0.85, 150), (1.0, 250)])
def test_values_that_are_off_as_a_whole_are_no_packing(scale: float, offset: float) -> None:
    """As a cone-beam CT may have them: air in the nose is as the air of the room."""
    scan = simulated_head.scan()
    hu = np.rint(scan.hu * scale + offset).astype(np.int16)
    assert segment_airway(replace(scan, hu=hu), COARSE_MM).volume_ml(1) > 5


def test_a_head_full_of_air_is_none() -> None:
    """As an MR has it where bone is dark: the hollow of a skull, with openings to the front."""
    x, y, z = np.meshgrid(*[np.arange(-60.0, 61.0, 1.5)] * 3, indexing="ij")
    skull = np.sqrt(x**2 + y**2 + z**2)
    hu = np.where((skull < 55) & (skull > 48), 40, -1000)
    hu[(np.abs(np.abs(x) - 8) < 3) & (np.abs(z) < 3) & (y < 0)] = -1000
    matrix = np.diag([1.5, 1.5, 1.5, 1.0])
    matrix[:3, 3] = -60
    with pytest.raises(ScanError, match="ml of air inside the head"):
        segment_airway(Volume(hu.astype(np.int16), matrix), COARSE_MM)


def box(depth: int) -> Block:
    return Block(np.full((40, depth, 40), -1000, np.float32), np.array([-20.0, 0.0, 0.0]), 1.0)


def judged(left: slice, right: slice, depth_mm: float = 60.0, pharynx: int = 10) -> list[str]:
    """What is said of two boxes of air, 60 mm long, in a large scan."""
    block = box(160)
    volume = Volume(
        np.full((80, 200, 80), 40, np.int16), np.diag([1.0, 1, 1, 1]) + np.array([[0, 0, 0, -40]] * 3 + [[0] * 4])
    )
    masks = {side: np.zeros(block.hu.shape, bool) for side in ("right", "left")}
    masks["left"][22:30, 10:70, left] = True
    masks["right"][10:18, 10:70, right] = True
    throat = np.zeros(block.hu.shape, bool)
    throat[2:38, 70 : 70 + pharynx, 5:35] = True
    marks = {f"{side}.nostril": at for side, at in NOSTRILS.items()}
    marks |= {f"{side}.choana": at + [0, depth_mm, 0] for side, at in NOSTRILS.items()}
    marks["anterior tip"] = np.array([0.0, 5.0, 20.0])
    wall = np.full(block.hu.shape, 2.0, np.float32)
    return [one.code for one in check_plausible(volume, block, masks, throat, wall, -1000.0, marks)]


def test_what_is_unusual_is_told_and_what_cannot_be_is_refused() -> None:
    whole, thin = slice(2, 34), slice(2, 15)
    assert judged(whole, whole) == []
    assert judged(whole, thin) == judged(thin, whole) == ["uneven sides"]
    with pytest.raises(ScanError, match="right nostril to its choana"):
        judged(whole, whole, depth_mm=20.0)
    with pytest.raises(ScanError, match="in the left nasal cavity"):
        judged(slice(5, 7), whole)
    with pytest.raises(ScanError, match="nasopharynx"):
        judged(whole, whole, pharynx=85)


@pytest.mark.parametrize(
    ("stretch", "told"),
    [
        ((1.0, 1.0, 3.0), "refused"),
        ((1.0, 1.0, 0.8), "stretched"),
        ((1.0, 1.0, 1.0), ""),
        ((1.0, 1.0, 0.6), "refused"),
        ((0.65, 0.65, 0.65), "small"),
    ],
)
def test_a_header_that_stretches_or_shrinks_a_nose_is_noticed(stretch: tuple[float, ...], told: str) -> None:
    """The same voxels under a header that tells other distances between slices or pixels."""
    scan = simulated_head.scan()
    matrix = np.diag([*stretch, 1.0]) @ scan.frame_T_index
    try:
        found = {one.code for one in segment_airway(replace(scan, frame_T_index=matrix), COARSE_MM).findings}
    except ScanError as error:
        assert told == "refused", error
        assert "see that the header tells the true distances of slices" in str(error)
    else:
        assert found & {"stretched", "small"} == ({told} - {""})
