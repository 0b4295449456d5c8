"""A scan with what had to be said about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from naris.core.volume import Volume

MOST_VOXELS = 2**29
MOST_BYTES = 2**31
SCAN_FILES = (".nrrd", ".nii", ".nii.gz", ".mha", ".mhd")
"""What names of scans in one file end in."""
Weight = Literal["notice", "warning"]


@dataclass(frozen=True)
class Finding:
    """Something about a scan that its user should know.

    Attributes:
        code: for machines, such as `tilt`.
        text: for people, one clause.
        weight: a `warning` may have made the scan worse; a `notice` has not.
    """

    code: str
    text: str
    weight: Weight = "notice"

    def to_json(self) -> dict[str, Any]:
        """`code`, `text` and `weight`."""
        return {"code": self.code, "text": self.text, "weight": self.weight}


@dataclass(frozen=True, eq=False)
class Scan:
    """A volume as it was read.

    Attributes:
        volume: in Hounsfield units, at right angles.
        format: DICOM, NRRD, NIfTI or MetaImage.
        slice_mm: distance of the slices as they were acquired, before any resampling.
        findings: what was noticed or mended on the way.
    """

    volume: Volume
    format: str
    slice_mm: float
    findings: tuple[Finding, ...] = ()
