"""Whether voxels and scan have the size of those of a head, and the unit in which the header's spacings would be.

Files tell spacings without a unit, in millimetres by convention. A head in another unit has the right shape and the
wrong size, so the unit in which it would be a head is likely the one that it was written in.
"""

from __future__ import annotations

from naris.core.volume import Volume
from naris.errors import ScanError

_VOXELS_MM = (0.02, 30.0)
_LEAST_MM, _MOST_MM = 50.0, 820.0
"""No edge of a scan with a whole nose is as short as to be below the first in all three; scanners see no wider than the
second, and only along one axis they go on."""

_HEAD_MM = (60.0, 600.0)  # the longest edge of a scan of a head
_UNITS_MM = {"centimetres": 10.0, "metres": 1000.0, "micrometres": 0.001, "tenths of a millimetre": 0.1, "inches": 25.4}


def check_voxels(volume: Volume) -> None:
    """See that voxels are of a size that scanners make.

    Raises:
        ScanError: if not; the message names the unit that the spacings may have.
    """
    spacing_mm = volume.spacing_mm
    if _VOXELS_MM[0] <= spacing_mm.min() and spacing_mm.max() <= _VOXELS_MM[1]:
        return
    told = "×".join(f"{mm:.3g}" for mm in spacing_mm)
    unit = likely_unit(volume)
    todo = f"are the spacings in {unit}? write them in millimetres" if unit else "check the header's unit"
    raise ScanError(f"voxels of {_VOXELS_MM[0]:g} to {_VOXELS_MM[1]:g} mm", f"{told} mm", todo)


def check_head_size(volume: Volume) -> None:
    """See that a scan is as large as one of a head.

    Raises:
        ScanError: if no nose fits into it, or it is wider than any scanner; the message names the unit that the
            spacings may have.
    """
    _, middle_mm, longest_mm = sorted(_edges_mm(volume))
    if longest_mm >= _LEAST_MM and middle_mm <= _MOST_MM:
        return
    told = "×".join(f"{mm:.0f}" if mm >= 10 else f"{mm:.2g}" for mm in _edges_mm(volume))
    unit = likely_unit(volume)
    todo = f"are the spacings in {unit}? write them in millimetres" if unit else "give a CT of a whole nose"
    expected = f"a scan of a head, {_LEAST_MM:g} mm or more along one edge and at most {_MOST_MM:g} mm wide"
    raise ScanError(expected, f"one of {told} mm", todo)


def likely_unit(volume: Volume) -> str | None:
    """In which the spacings would make a scan of a head; None where no unit does."""
    longest_mm, spacing_mm = max(_edges_mm(volume)), volume.spacing_mm
    for unit, mm in _UNITS_MM.items():
        fits = _HEAD_MM[0] <= longest_mm * mm <= _HEAD_MM[1]
        if fits and _VOXELS_MM[0] <= spacing_mm.min() * mm and spacing_mm.max() * mm <= _VOXELS_MM[1]:
            return unit
    return None


def _edges_mm(volume: Volume) -> list[float]:
    return [float(mm) * count for mm, count in zip(volume.spacing_mm, volume.shape, strict=True)]
