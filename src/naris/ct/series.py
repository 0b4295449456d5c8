"""Which series a folder of DICOM files holds, told from the headers alone.

Only the tags that say what and where an image is are read at all: nothing that names a patient gets into the program.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from pydicom.errors import BytesLengthException, InvalidDicomError
from pydicom.uid import CTImageStorage, EnhancedCTImageStorage, MediaStorageDirectoryStorage

from naris.core.progress import SILENT, Progress
from naris.ct.packed import dicom_header
from naris.ct.scan import SCAN_FILES
from naris.ct.slices import Plane
from naris.errors import ScanError

_NOT_UNDERSTOOD = (
    AttributeError, BytesLengthException, IndexError, KeyError, NotImplementedError, TypeError, ValueError,
)  # fmt: skip
_MOST_PIXELS = 2**14
_TAGS = [
    "SOPClassUID", "SeriesInstanceUID", "SeriesNumber", "Modality", "ImageType", "Rows", "Columns", "NumberOfFrames",
    "ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "RescaleSlope", "RescaleIntercept",
    "PhotometricInterpretation", "SamplesPerPixel", "SharedFunctionalGroupsSequence",
    "PerFrameFunctionalGroupsSequence", "StudyInstanceUID", "FrameOfReferenceUID", "AcquisitionNumber",
    "SliceThickness", "ConvolutionKernel", "GantryDetectorTilt",
]  # fmt: skip
_OTHERS = (
    ".txt", ".md", ".pdf", ".doc", ".docx", ".rtf", ".htm", ".html", ".xml", ".json", ".csv", ".xls", ".xlsx", ".log",
    ".jpg", ".jpeg", ".png", ".gif", ".bmp", ".tif", ".tiff", ".ico", ".mp4", ".avi", ".zip", ".gz", ".7z", ".tar",
    ".exe", ".dll", ".inf", ".ini", ".bat", ".sh", ".jar", ".db", ".css", ".js", ".cfg", ".dat", ".nrrd", ".nii",
    ".mha", ".mhd", ".raw", ".stl", ".ply", ".obj", ".vtp", ".py", ".yml", ".yaml", ".sql", ".part", ".tmp",
)  # fmt: skip


@dataclass(frozen=True)
class Origin:
    """What an image says about the scan that it comes from; None where it says nothing.

    Attributes:
        study, frame_of_reference: eight letters made of the identifiers, to compare and not to tell.
        acquisition: as the scanner counted it.
        thickness_mm: of the slice.
        kernel: letters made of the name of the convolution kernel.
        tilt_deg: of the gantry.
    """

    study: str | None = None
    frame_of_reference: str | None = None
    acquisition: int | None = None
    thickness_mm: float | None = None
    kernel: str | None = None
    tilt_deg: float | None = None


@dataclass(frozen=True, eq=False)
class Image:
    """One image: a file, or one frame of a file with many."""

    path: Path
    frame: int | None
    plane: Plane
    slope: float
    intercept: float
    origin: Origin = Origin()


@dataclass(frozen=True, eq=False)
class Series:
    """The images that say that they belong together.

    Attributes:
        key: eight letters made of the series' identifier, to name it by.
        number: as the scanner counted it, if it says so.
        modality: CT, MR, …
        images: those with a place in the patient; localisers are left out.
        localisers: how many of them there were.
        inverted: whether any image is MONOCHROME1, dark where others are bright.
    """

    key: str
    number: int | None
    modality: str
    images: tuple[Image, ...]
    localisers: int
    inverted: bool

    def told(self) -> str:
        """For people: `3a5b…: CT, 120 images, number 4`."""
        number = "" if self.number is None else f", number {self.number}"
        images = "1 image" if len(self.images) == 1 else f"{len(self.images)} images"
        return f"{self.key}: {self.modality or 'no modality'}, {images}{number}"


@dataclass(frozen=True, eq=False)
class Contents:
    """What a folder holds.

    Attributes:
        series: those with most images first.
        strange: files that are no DICOM and do not look like anything else either: a slice that breaks off at once
            is one.
    """

    series: tuple[Series, ...]
    strange: tuple[Path, ...]


def contents_of(folder: Path, progress: Progress = SILENT) -> Contents:
    """Every series below a folder (or in one file).

    Raises:
        ScanError: if there is no DICOM file, or one breaks off in its header.
    """
    paths = sorted(path for path in folder.rglob("*") if path.is_file()) if folder.is_dir() else [folder]
    found: dict[str, list[Any]] = defaultdict(list)
    strange: list[Path] = []
    with progress.task("headers", len(paths)) as advance:
        for path in paths:
            if not is_dicom(path):
                strange += [path] if _could_be_a_slice(path) else []
            elif (header := _header(path)) is not None:
                found[str(header.SeriesInstanceUID)].append((path, header))
            advance(1)
    if not found:
        raise ScanError(f"DICOM images in {folder}", _no_images(len(paths)), _instead(paths, folder))
    series = [_series(uid, files) for uid, files in found.items()]
    return Contents(tuple(sorted(series, key=lambda one: (-len(one.images), one.key))), tuple(strange))


def _instead(paths: list[Path], folder: Path) -> str:
    """What somebody may have meant who gave a folder without DICOM."""
    if (folder / "anatomy.json").is_file():
        return "this is an anatomy already, for naris anatomy and the other verbs"
    scans = [path for path in paths if path.name.lower().endswith(SCAN_FILES)]
    if not scans or not folder.is_dir():
        return "check the path"
    return f"give the file itself, such as {scans[0].relative_to(folder)}"


def _no_images(files: int) -> str:
    if files == 0:
        return "no file there"
    return "1 file, which is none" if files == 1 else f"{files} files, none of them one"


def is_dicom(path: Path) -> bool:
    """By what stands behind its preamble.

    Raises:
        ScanError: if the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            return file.read(132)[128:] == b"DICM"
    except OSError as error:
        raise _unreadable(path, error) from error


def _could_be_a_slice(path: Path) -> bool:
    """Whether a file that is no DICOM has a name that slices have: none of a document, a picture or a hidden file."""
    name = path.name.lower()
    words = name.split(".")[0] in ("readme", "license", "licence", "version", "dicomdir", "lockfile")
    return not (words or name.startswith((".", "._")) or path.suffix.lower() in _OTHERS)


def _header(path: Path) -> Any | None:
    """The tags that we read of a DICOM file; None for directories of them (DICOMDIR)."""
    try:
        header = pydicom.dcmread(dicom_header(path), stop_before_pixels=True, specific_tags=list(_TAGS))
    except (*_NOT_UNDERSTOOD, InvalidDicomError, EOFError) as error:
        raise ScanError(
            f"a whole DICOM file {path.name}", "one that breaks off in its header", "copy it anew"
        ) from error
    except OSError as error:
        raise _unreadable(path, error) from error
    with _values_understood(path):
        if header.file_meta.get("MediaStorageSOPClassUID") == MediaStorageDirectoryStorage:
            return None
        is_ct = header.get("SOPClassUID") in (CTImageStorage, EnhancedCTImageStorage)
        if header.get("SeriesInstanceUID") is None or (is_ct and not {"Rows", "Columns"} <= set(header.dir())):
            raise _broken_off(path)
    return header


@contextmanager
def _values_understood(path: Path) -> Iterator[None]:
    """Values are turned from bytes when they are first looked at, so that is where a damaged one is found."""
    try:
        yield
    except _NOT_UNDERSTOOD as error:
        raise ScanError(
            f"a DICOM header with numbers where they belong in {path.name}",
            "one with something else",
            "export the series again",
        ) from error


def _unreadable(path: Path, error: OSError) -> ScanError:
    return ScanError(
        f"a readable file {path.name}", error.strerror or "an error", "check the medium and the permissions"
    )


def _broken_off(path: Path) -> ScanError:
    return ScanError(f"a whole DICOM file {path.name}", "one that breaks off early", "copy it anew")


def _series(uid: str, files: Sequence[tuple[Path, Any]]) -> Series:
    first = files[0][1]
    images: list[Image] = []
    localisers, inverted = 0, False
    for path, header in files:
        with _values_understood(path):
            inverted |= str(header.get("PhotometricInterpretation", "")) == "MONOCHROME1"
            kinds = str(header.get("ImageType") or "").upper()
            if "LOCALIZER" in kinds or "SCOUT" in kinds:
                localisers += 1
            else:
                images += _images(path, header)
    with _values_understood(files[0][0]):
        number = first.get("SeriesNumber")
        return Series(
            _letters(uid) or "",
            None if number is None else int(number),
            str(first.get("Modality") or ""),
            tuple(images),
            localisers,
            inverted,
        )


def _images(path: Path, header: Any) -> Iterator[Image]:
    """The images of a file that have a place in the patient: none for a report or a screenshot."""
    if int(header.get("SamplesPerPixel", 1)) != 1 or "Rows" not in header or "Columns" not in header:
        return
    shape = (int(header.Columns), int(header.Rows))
    if max(shape) > _MOST_PIXELS or min(shape) < 1:
        raise ScanError(
            f"slices of at most {_MOST_PIXELS} pixels a side in {path.name}", f"{shape[0]}×{shape[1]}", "check the file"
        )
    shared = _first(header, "SharedFunctionalGroupsSequence")
    frames = header.get("PerFrameFunctionalGroupsSequence")
    for frame, own in [(None, header)] if frames is None else enumerate(frames):
        position = _find("PlanePositionSequence", "ImagePositionPatient", own, shared)
        orientation = _find("PlaneOrientationSequence", "ImageOrientationPatient", own, shared)
        spacing = _find("PixelMeasuresSequence", "PixelSpacing", own, shared)
        if position is None or orientation is None or spacing is None:
            if header.get("SOPClassUID") in (CTImageStorage, EnhancedCTImageStorage):
                raise _broken_off(path)
            continue
        slope = _find("PixelValueTransformationSequence", "RescaleSlope", own, shared)
        intercept = _find("PixelValueTransformationSequence", "RescaleIntercept", own, shared)
        directions = np.array(orientation, dtype=np.float64)
        # Pixel Spacing names the distance between rows first (DICOM PS3.3, 10.7.1.3).
        plane = Plane(
            np.array(position, dtype=np.float64),
            directions[:3],
            directions[3:],
            (float(spacing[1]), float(spacing[0])),
            shape,
        )
        slope, intercept = float(1 if slope is None else slope), float(intercept or 0)
        yield Image(path, frame, plane, slope, intercept, _origin(header, own, shared))


def _origin(header: Any, own: Any, shared: Any | None) -> Origin:
    acquisition = header.get("AcquisitionNumber")
    thickness = _find("PixelMeasuresSequence", "SliceThickness", own, shared)
    tilt = _find("CTGeometrySequence", "GantryDetectorTilt", own, shared)
    return Origin(
        _letters(header.get("StudyInstanceUID")),
        _letters(header.get("FrameOfReferenceUID")),
        None if acquisition is None else int(acquisition),
        None if thickness is None else float(thickness),
        _letters(_find("CTReconstructionSequence", "ConvolutionKernel", own, shared)),
        None if tilt is None else float(tilt),
    )


def _letters(value: Any | None) -> str | None:
    """Eight letters that stand for a value, to compare or to name it without telling it."""
    return hashlib.sha256(str(value).encode()).hexdigest()[:8] if value else None


def _first(item: Any, name: str) -> Any | None:
    sequence = item.get(name) if item is not None else None
    return sequence[0] if sequence else None


def _find(group: str, name: str, own: Any, shared: Any | None) -> Any | None:
    """A value of an image itself, of its own functional group, or of that which all frames share."""
    for item in (own, _first(own, group), _first(shared, group)):
        if item is not None and item.get(name) is not None:
            return item.get(name)
    return None
