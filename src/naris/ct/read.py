"""Any scan by its path, and whether its values can be a CT's."""

from __future__ import annotations

import logging
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from naris.core.progress import SILENT, Progress
from naris.ct.dicom import read_dicom
from naris.ct.files import read_file
from naris.ct.scan import Scan
from naris.ct.series import is_dicom
from naris.ct.values import check_values
from naris.errors import OutOfMemory, ScanError

log = logging.getLogger(__name__)


def read_scan(path: Path | str, series: str | None = None, progress: Progress = SILENT) -> Scan:
    """A CT from a DICOM folder or file, or from a .nrrd, .nii, .nii.gz, .mha or .mhd file.

    Args:
        path: of the folder or file.
        series: which DICOM series (its number or the letters of its key), where there are several.
        progress: told of files and slices.

    Raises:
        ScanError: if it cannot be read, its geometry is incomplete or contradicts itself, or its values are no CT's.
        OutOfMemory: if it does not fit.
    """
    path = Path(path)
    try:
        with _without_chatter():
            return _read(path, series, progress)
    except MemoryError as error:
        raise OutOfMemory.of(f"to read {path.name}", error) from error


def _read(path: Path, series: str | None, progress: Progress) -> Scan:
    if not path.exists():
        raise ScanError(f"a scan at {path}", "nothing there", "check the path")
    if path.is_dir() or is_dicom(path):
        scan = read_dicom(path, series, progress)
    elif series is not None:
        raise ScanError("a DICOM folder, to choose a series of", path.name, "leave --series out")
    else:
        scan = read_file(path)
    return replace(scan, findings=(*scan.findings, *check_values(scan)))


@contextmanager
def _without_chatter() -> Iterator[None]:
    """Warnings of libraries are only counted, at debug level: some of their texts quote the patient's header."""
    with warnings.catch_warnings(record=True) as told:
        yield
    for kind, count in Counter(one.category.__name__ for one in told).items():
        log.debug("libraries warned while reading: %s, %d times", kind, count)
