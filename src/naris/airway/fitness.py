"""What a scan is and whether it will do: how much of the nose it holds, how coarse it is, metal, an open mouth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from naris.airway.face import nose_tip_mm
from naris.airway.segment import ATTACHED, SEGMENTS, Airway
from naris.airway.segment import STEP_MM as FINE_MM
from naris.airway.turned import airway_in
from naris.core.volume import Volume
from naris.ct.scan import Finding, Scan
from naris.ct.size import check_head_size
from naris.errors import ScanError

STEP_MM = 0.8
"""Of the lattice that a first look is taken on; an anatomy is made on a finer one."""

METAL_HU = 2800
_METAL_ML = 0.02
_COARSE_MM = 1.6
_SQUARE = 1.02
_NEEDED_MM = {"behind": 85.0, "above": 40.0, "below": 12.0, "left": 20.0, "right": 20.0}
"""How far beyond the tip of the nose a whole nasal cavity reaches, to its choanae, roof, nostrils and either side."""
_PALATE_MM = 5.0
_MOUTH_BEHIND_MM, _MOUTH_BESIDE_MM, _MOUTH_ML = 10.0, 12.0, 1.0  # further to the side lie the sinuses of the cheeks


@dataclass(frozen=True, eq=False)
class Fitness:
    """What came of a first look at a scan.

    Attributes:
        reason: why no nasal airway can be found in it; None where one can.
        reach_mm: how far it goes beyond the tip of the nose, by direction; empty where it shows no tip.
        volume_ml: of each segment that was found.
        step_mm: of the lattice that it was found on; None where nothing was.
        metal_ml: what is brighter than any bone.
        mouth_ml: air below the palate that is joined to the pharynx, and was cut off.
        findings: of reading it and of this look.
    """

    reason: str | None
    reach_mm: dict[str, float]
    volume_ml: dict[str, float]
    step_mm: float | None
    metal_ml: float
    mouth_ml: float
    findings: tuple[Finding, ...]

    @property
    def usable(self) -> bool:
        return self.reason is None

    def to_json(self) -> dict[str, Any]:
        """All of it, as `naris anatomy inspect --json` tells it."""
        return {
            "usable": self.usable,
            "reason": self.reason,
            "reach_mm": self.reach_mm,
            "volume_ml": self.volume_ml,
            "step_mm": self.step_mm,
            "metal_ml": self.metal_ml,
            "mouth_ml": self.mouth_ml,
            "findings": [one.to_json() for one in self.findings],
        }


def inspect_scan(scan: Scan, step_mm: float = STEP_MM) -> Fitness:
    """Look at a scan and try to find the airway in it; a scan that will not do is an answer, no error."""
    try:
        found = airway_in(scan.volume, sorted({step_mm, min(step_mm, FINE_MM)}, reverse=True))
    except ScanError as error:
        look = look_at(scan)
        return Fitness(str(error), look.reach_mm, {}, None, look.metal_ml, look.mouth_ml, look.findings)
    look = look_at(scan, found)
    volumes = {name: round(found.volume_ml(number + 1), 2) for number, name in enumerate(SEGMENTS)}
    return Fitness(None, look.reach_mm, volumes, found.block.step_mm, look.metal_ml, look.mouth_ml, look.findings)


@dataclass(frozen=True)
class Look:
    """What is seen of a scan; its attributes are those of `Fitness`."""

    reach_mm: dict[str, float]
    metal_ml: float
    mouth_ml: float
    findings: tuple[Finding, ...]


def look_at(scan: Scan, airway: Airway | None = None) -> Look:
    """What the user of a scan should know.

    Args:
        scan: as it was read.
        airway: what was found in it, if anything.
    """
    findings = [*scan.findings, *_coarse(scan), *_oblong(scan.volume)]
    metal_ml, highest_mm = _metal(scan.volume)
    try:
        if airway is None:
            check_head_size(scan.volume)
        tip_mm = nose_tip_mm(scan.volume) if airway is None else airway.landmarks_mm["anterior tip"]
    except ScanError:
        return Look({}, metal_ml, 0.0, (*findings, *_metal_told(metal_ml, highest_mm, None)))
    reach_mm = _reach_mm(scan.volume, tip_mm)
    findings += _cut_off(reach_mm)
    if airway is None:
        return Look(reach_mm, metal_ml, 0.0, (*findings, *_metal_told(metal_ml, highest_mm, None)))
    floor_mm = _floor_mm(airway)
    findings += _metal_told(metal_ml, highest_mm, floor_mm)
    mouth_ml = _mouth_ml(airway, floor_mm, tip_mm)
    if mouth_ml > _MOUTH_ML:
        told = f"an open mouth: {mouth_ml:.0f} ml of air below the palate, joined to the pharynx, were cut off"
        findings.append(Finding("open mouth", told))
    known = {one.code for one in findings}
    return Look(reach_mm, metal_ml, mouth_ml, (*findings, *(one for one in airway.findings if one.code not in known)))


def _floor_mm(airway: Airway) -> float:
    return min(float(airway.landmarks_mm[f"{side}.nasal floor"][2]) for side in ("left", "right"))


def _coarse(scan: Scan) -> list[Finding]:
    if scan.slice_mm <= _COARSE_MM:
        return []
    told = f"slices {scan.slice_mm:.2g} mm apart: slits thinner than that close, and walls merge"
    return [Finding("coarse slices", told, "warning")]


def _oblong(volume: Volume) -> list[Finding]:
    """Where no two axes have one spacing: the pixels of CT slices are square."""
    low, middle, high = sorted(volume.spacing_mm.tolist())
    if middle <= _SQUARE * low or high <= _SQUARE * middle:
        return []
    told = "×".join(f"{mm:.3g}" for mm in volume.spacing_mm)
    return [Finding("pixels", f"voxels of {told} mm: the pixels of a CT are square; is a spacing wrong?", "warning")]


def _metal(volume: Volume) -> tuple[float, float]:
    """Its volume, and the height (z) below which nearly all of it lies."""
    bright = np.argwhere(volume.hu >= METAL_HU)
    if not len(bright):
        return 0.0, -np.inf
    heights = volume.points_mm(bright)[:, 2]
    return round(len(bright) * float(np.prod(volume.spacing_mm)) / 1000, 3), float(np.percentile(heights, 95))


def _metal_told(metal_ml: float, highest_mm: float, floor_mm: float | None) -> list[Finding]:
    if metal_ml < _METAL_ML:
        return []
    if floor_mm is not None and highest_mm < floor_mm:
        return [Finding("metal", f"{metal_ml:.2g} ml of metal below the nasal floor, as fillings in teeth are")]
    told = f"{metal_ml:.2g} ml of metal: its streaks may cross the nose"
    return [Finding("metal", told, "warning")]


def _reach_mm(volume: Volume, tip_mm: Float[np.ndarray, "3"]) -> dict[str, float]:
    (x0, y0, z0), (x1, y1, z1) = volume.bounds_mm.tolist()
    x, y, z = tip_mm.tolist()
    found = {"before": y - y0, "behind": y1 - y, "above": z1 - z, "below": z - z0, "left": x1 - x, "right": x - x0}
    return {name: round(value, 1) for name, value in found.items()}


def _cut_off(reach_mm: dict[str, float]) -> list[Finding]:
    """Where the scan ends before the nose does."""
    return [
        Finding(
            f"ends {name}",
            f"the scan ends {reach_mm[name]:.0f} mm {name} the tip of the nose"
            if name in ("behind", "above", "below")
            else f"the scan ends {reach_mm[name]:.0f} mm to the {name} of the tip of the nose",
            "warning",
        )
        for name, needed in _NEEDED_MM.items()
        if reach_mm[name] < needed
    ]


def _mouth_ml(airway: Airway, floor_mm: float, tip_mm: Float[np.ndarray, "3"]) -> float:
    """Attached air below the palate and in front of the pharynx."""
    block = airway.block
    x, y, z = (block.axis_mm(axis) for axis in range(3))
    choana_mm = max(float(airway.landmarks_mm[f"{side}.choana"][1]) for side in ("left", "right"))
    there = (z < floor_mm - _PALATE_MM) & (y > tip_mm[1]) & (y < choana_mm + _MOUTH_BEHIND_MM)
    there = there & (np.abs(x - tip_mm[0]) < _MOUTH_BESIDE_MM)
    return round(float(((airway.labels == ATTACHED) & there).sum()) * block.step_mm**3 / 1000, 2)
