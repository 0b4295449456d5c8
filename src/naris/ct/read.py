"""Any scan by its path, and whether its values can be a CT's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from naris.core.progress import SILENT, Progress
from naris.ct.dicom import read_dicom
from naris.ct.files import read_file
from naris.ct.scan import Scan
from naris.errors import ScanError

_MAGIC = b"DICM"
_SAMPLES = 2_000_000
_AIR_HU = (-1100, -800)
_SOFT_HU = (-150, 250)
_LEAST = 0.002  # share of the voxels of a head that are air, and that are soft tissue, at the very least


def read_scan(path: Path | str, series: str | None = None, progress: Progress = SILENT) -> Scan:
    """A CT from a DICOM folder or file, or from a .nrrd, .nii, .nii.gz, .mha or .mhd file.

    Args:
        path: of the folder or file.
        series: which DICOM series (its number or the letters of its key), where there are several.
        progress: told of files and slices.

    Raises:
        ScanError: if it cannot be read, its geometry is incomplete or contradicts itself, or its values are no CT's.
    """
    path = Path(path)
    if not path.exists():
        raise ScanError(f"a scan at {path}", "nothing there", "check the path")
    if path.is_dir() or _is_dicom(path):
        scan = read_dicom(path, series, progress)
    elif series is not None:
        raise ScanError("a DICOM folder, to choose a series of", path.name, "leave --series out")
    else:
        scan = read_file(path)
    check_values(scan)
    return scan


def check_values(scan: Scan) -> None:
    """See that a scan has both air and soft tissue where Hounsfield units put them.

    Raises:
        ScanError: if it has one value only, or has not: it is no CT, or its rescale was lost.
    """
    hu = scan.volume.hu
    step = max(int(np.cbrt(hu.size / _SAMPLES)), 1)
    values = hu[::step, ::step, ::step]
    low, high = int(values.min()), int(values.max())
    if low == high:
        raise ScanError("a CT of a head", f"a volume of {low} HU throughout", "check the scan")
    air, soft = (float(np.mean((values >= a) & (values <= b))) for a, b in (_AIR_HU, _SOFT_HU))
    if air >= _LEAST and soft >= _LEAST:
        return
    todo = "give a CT in Hounsfield units"
    if low >= 0:
        todo = "give a CT in Hounsfield units: no value is negative, as if the rescale intercept were lost"
    raise ScanError(
        "both air (about −1000 HU) and soft tissue (about 50 HU) in a CT",
        f"{100 * air:.1f} % and {100 * soft:.1f} % of voxels there, values {low} to {high}",
        todo,
    )


def _is_dicom(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(132)[128:] == _MAGIC
    except OSError as error:
        raise ScanError(
            f"a readable file {path.name}", error.strerror or "an error", "check its permissions"
        ) from error
