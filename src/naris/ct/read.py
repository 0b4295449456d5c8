"""Any scan by its path, and whether its values can be a CT's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from naris.core.progress import SILENT, Progress
from naris.ct.dicom import read_dicom
from naris.ct.files import read_file
from naris.ct.scan import Scan
from naris.ct.values import check_values
from naris.errors import ScanError

_MAGIC = b"DICM"


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
    return replace(scan, findings=(*scan.findings, *check_values(scan)))


def _is_dicom(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(132)[128:] == _MAGIC
    except OSError as error:
        raise ScanError(
            f"a readable file {path.name}", error.strerror or "an error", "check its permissions"
        ) from error
