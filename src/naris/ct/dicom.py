"""CT series from folders of DICOM files, nested, mixed and unsorted as they come.

Geometry is read from the header of every image and checked by `naris.ct.slices`. Only the tags that say what and where
an image is are read at all: nothing that names a patient gets into the program.
"""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from jaxtyping import Float32, Int16
from pydicom.errors import InvalidDicomError
from pydicom.uid import CTImageStorage, EnhancedCTImageStorage, MediaStorageDirectoryStorage

from naris.core.progress import SILENT, Progress
from naris.core.volume import Volume
from naris.ct.resample import even, upright
from naris.ct.scan import Finding, Scan
from naris.ct.slices import FEWEST, SAME_DIRECTION_RAD, SAME_PLACE_MM, Plane, Stack, stacked
from naris.errors import ScanError

MOST_VOXELS = 2**29
_MOST_PIXELS = 2**14
_TAGS = [
    "SOPClassUID", "SeriesInstanceUID", "SeriesNumber", "Modality", "ImageType", "Rows", "Columns", "NumberOfFrames",
    "ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "RescaleSlope", "RescaleIntercept",
    "PhotometricInterpretation", "SamplesPerPixel", "SharedFunctionalGroupsSequence",
    "PerFrameFunctionalGroupsSequence",
]  # fmt: skip
_STRAY = 0.1  # share of a series' images in other orientations that may be left out as stray localisers
_WIDEST_MM = 3.0  # gap between slices that linear interpolation may bridge


@dataclass(frozen=True, eq=False)
class Image:
    """One image: a file, or one frame of a file with many."""

    path: Path
    frame: int | None
    plane: Plane
    slope: float
    intercept: float


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
        return f"{self.key}: {self.modality or 'no modality'}, {len(self.images)} images{number}"


def find_series(folder: Path, progress: Progress = SILENT) -> list[Series]:
    """Every series below a folder (or in one file), those with most images first.

    Raises:
        ScanError: if there is no DICOM file, or one breaks off in its header.
    """
    paths = sorted(path for path in folder.rglob("*") if path.is_file()) if folder.is_dir() else [folder]
    found: dict[str, list[Any]] = defaultdict(list)
    with progress.task("headers", len(paths)) as advance:
        for path in paths:
            header = _header(path)
            if header is not None:
                found[str(header.SeriesInstanceUID)].append((path, header))
            advance(1)
    if not found:
        raise ScanError(f"DICOM images in {folder}", f"{len(paths)} files, none of them one", "check the path")
    series = [_series(uid, files) for uid, files in found.items()]
    return sorted(series, key=lambda one: (-len(one.images), one.key))


def read_dicom(folder: Path, series: str | None = None, progress: Progress = SILENT) -> Scan:
    """The CT of a folder.

    Args:
        folder: with DICOM files in it or below it; or one multi-frame file.
        series: the key or the number of one of its series, needed where several would do.
        progress: told of headers and slices.

    Raises:
        ScanError: if there is no CT, several would do, or its geometry is incomplete or contradicts itself.
    """
    chosen = _chosen(find_series(folder, progress), series, folder)
    findings: list[Finding] = []
    if chosen.localisers:
        findings.append(Finding("localisers", f"{chosen.localisers} localiser images were left out"))
    images = _without_copies(_of_one_orientation(chosen, findings), findings)
    stack = stacked([image.plane for image in images])
    _check_gaps(stack, images)
    ordered = [images[number] for number in stack.order]
    hu = _pixels(ordered, progress)
    if chosen.inverted:
        findings.append(Finding("monochrome1", "MONOCHROME1: shown inverted, the values are read as they are"))
    slice_mm = stack.step_mm
    if not stack.is_even:
        low, high = stack.gaps_mm.min(), stack.gaps_mm.max()
        text = f"slices {low:.2f} to {high:.2f} mm apart were resampled at {stack.step_mm:.2f} mm"
        findings.append(Finding("uneven", text, "warning"))
        hu, stack = even(hu, stack)
    volume = Volume(hu, stack.frame_T_index())
    if not stack.is_upright:
        text = f"the gantry was tilted by {stack.tilt_deg:.1f}°; the scan was resampled at right angles"
        findings.append(Finding("tilt", text, "warning"))
        volume = upright(volume)
    return Scan(volume, "DICOM", slice_mm, tuple(findings))


def _header(path: Path) -> Any | None:
    """The tags that we read of a DICOM file; None for other files and for directories of them (DICOMDIR)."""
    try:
        with path.open("rb") as file:
            if file.read(132)[128:] != b"DICM":
                return None
        header = pydicom.dcmread(path, stop_before_pixels=True, specific_tags=list(_TAGS))
    except (InvalidDicomError, EOFError, ValueError, KeyError, NotImplementedError) as error:
        raise ScanError(
            f"a whole DICOM file {path.name}", "one that breaks off in its header", "copy it anew"
        ) from error
    except OSError as error:
        raise ScanError(
            f"a readable file {path.name}", error.strerror or "an error", "check the medium and the permissions"
        ) from error
    if header.file_meta.get("MediaStorageSOPClassUID") == MediaStorageDirectoryStorage:
        return None
    is_ct = header.get("SOPClassUID") in (CTImageStorage, EnhancedCTImageStorage)
    if "SeriesInstanceUID" not in header or (is_ct and not {"Rows", "Columns"} <= set(header.dir())):
        raise _broken_off(path)
    return header


def _broken_off(path: Path) -> ScanError:
    return ScanError(f"a whole DICOM file {path.name}", "one that breaks off early", "copy it anew")


def _series(uid: str, files: Sequence[tuple[Path, Any]]) -> Series:
    first = files[0][1]
    images: list[Image] = []
    localisers = 0
    for path, header in files:
        if {"LOCALIZER", "SCOUT"} & {str(kind).upper() for kind in header.get("ImageType", [])}:
            localisers += 1
            continue
        images += _images(path, header)
    number = first.get("SeriesNumber")
    inverted = any(str(header.get("PhotometricInterpretation", "")) == "MONOCHROME1" for _, header in files)
    return Series(
        hashlib.sha256(uid.encode()).hexdigest()[:8],
        None if number is None else int(number),
        str(first.get("Modality", "")),
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
        yield Image(path, frame, plane, float(1 if slope is None else slope), float(intercept or 0))


def _first(item: Any, name: str) -> Any | None:
    sequence = item.get(name) if item is not None else None
    return sequence[0] if sequence else None


def _find(group: str, name: str, own: Any, shared: Any | None) -> Any | None:
    """A value of an image itself, of its own functional group, or of that which all frames share."""
    for item in (own, _first(own, group), _first(shared, group)):
        if item is not None and item.get(name) is not None:
            return item.get(name)
    return None


def _chosen(found: Sequence[Series], wanted: str | None, folder: Path) -> Series:
    listed = "; ".join(one.told() for one in found[:8])
    if wanted is not None:
        matching = [one for one in found if wanted in (one.key, str(one.number))]
        if len(matching) != 1:
            raise ScanError(
                f"one of the series in {folder}", repr(wanted), f"name one of those by its letters: {listed}"
            )
        usable = matching
    else:
        usable = [one for one in found if one.modality in ("CT", "") and len(one.images) >= FEWEST]
        if not usable:
            raise ScanError(f"a CT series of {FEWEST} images or more in {folder}", listed, "give the folder of a CT")
        if len(usable) > 1:
            raise ScanError(f"one CT series in {folder}", f"{len(usable)} ({listed})", "name one of them with --series")
    (series,) = usable
    if series.modality not in ("CT", ""):
        raise ScanError("a CT", f"modality {series.modality}", "give a CT: its values are Hounsfield units")
    return series


def _of_one_orientation(series: Series, findings: list[Finding]) -> tuple[Image, ...]:
    """The images of the usual orientation; a few others are stray localisers, many are another scan."""
    groups: list[list[Image]] = []
    for image in series.images:
        for group in groups:
            if image.plane.turned_rad(group[0].plane) <= SAME_DIRECTION_RAD:
                group.append(image)
                break
        else:
            groups.append([image])
    groups.sort(key=len, reverse=True)
    others = sum(len(group) for group in groups[1:])
    if others > _STRAY * len(series.images):
        raise ScanError(
            "a series in one orientation",
            f"{len(groups)} of {', '.join(str(len(group)) for group in groups[:5])} images",
            "give each orientation as a series of its own",
        )
    if others:
        text = f"{others} images in other orientations were left out"
        findings.append(Finding("stray", text, "warning"))
    return tuple(groups[0])


def _without_copies(images: Sequence[Image], findings: list[Finding]) -> list[Image]:
    """Images in the place of another left out where their pixels are the same; else they are two scans in one.

    Raises:
        ScanError: if two different images claim one place.
    """
    normal = images[0].plane.normal
    depth = np.array([image.plane.position_mm @ normal for image in images])
    kept: list[Image] = []
    last = -np.inf
    copies = 0
    for number in np.argsort(depth, kind="stable"):
        image = images[number]
        if depth[number] - last > SAME_PLACE_MM:
            kept.append(image)
            last = depth[number]
        elif np.array_equal(_hu_of(image), _hu_of(kept[-1])):
            copies += 1
        else:
            raise ScanError(
                "one image in each place",
                f"different ones, such as {image.path.name} and {kept[-1].path.name}",
                "separate the two scans that are mixed here",
            )
    if copies:
        findings.append(Finding("copies", f"{copies} copies of slices were left out"))
    return kept


def _check_gaps(stack: Stack, images: Sequence[Image]) -> None:
    if stack.slices_missing:
        first = int(stack.missing[0])
        before, after = (images[stack.order[first + k]].path.name for k in (0, 1))
        raise ScanError(
            f"slices every {stack.step_mm:.3g} mm",
            f"{stack.slices_missing} missing, the first between {before} and {after}",
            "give the whole series",
        )
    if not stack.is_even and stack.gaps_mm.max() > _WIDEST_MM:
        raise ScanError(
            f"slices at equal distances, or nowhere more than {_WIDEST_MM} mm apart",
            f"{stack.gaps_mm.min():.3g} to {stack.gaps_mm.max():.3g} mm",
            "give a thinner reconstruction",
        )
    voxels = len(images) * images[0].plane.shape[0] * images[0].plane.shape[1]
    if voxels > MOST_VOXELS:
        raise ScanError(f"a scan of at most {MOST_VOXELS:,} voxels", f"{voxels:,}", "crop it or take fewer slices")


def _pixels(images: Sequence[Image], progress: Progress) -> Int16[np.ndarray, "ni nj nk"]:
    ni, nj = images[0].plane.shape
    hu = np.empty((len(images), nj, ni), np.int16)
    opened: tuple[Path, Any] | None = None
    with progress.task("slices", len(images)) as advance:
        for k, image in enumerate(images):
            if image.frame is not None and (opened is None or opened[0] != image.path):
                opened = (image.path, _stored(image.path))
            stored = _stored(image.path) if opened is None or image.frame is None else opened[1][image.frame]
            hu[k] = _to_hu(stored, image)
            advance(1)
    return hu.transpose(2, 1, 0)


def _hu_of(image: Image) -> Int16[np.ndarray, "nj ni"]:
    stored = _stored(image.path)
    return _to_hu(stored if image.frame is None else stored[image.frame], image)


def _to_hu(stored: np.ndarray, image: Image) -> Int16[np.ndarray, "nj ni"]:
    ni, nj = image.plane.shape
    if stored.shape != (nj, ni):
        raise ScanError(f"{ni}×{nj} pixels in {image.path.name}", f"an array of shape {stored.shape}", "copy it anew")
    values: Float32[np.ndarray, "nj ni"] = stored.astype(np.float32) * np.float32(image.slope)
    values += np.float32(image.intercept)
    limits = np.iinfo(np.int16)
    return np.rint(np.clip(values, limits.min, limits.max)).astype(np.int16)


def _stored(path: Path) -> np.ndarray:
    """The stored values of a file before the rescale to Hounsfield units, (nj, ni) or (frames, nj, ni)."""
    try:
        dataset = pydicom.dcmread(path)
        if dataset.file_meta.TransferSyntaxUID.is_compressed:
            return _decompressed(path, dataset)
        return np.asarray(dataset.pixel_array)
    except (AttributeError, EOFError, KeyError, NotImplementedError, OSError, RuntimeError, ValueError) as error:
        raise ScanError(
            f"the pixels of {path.name}", f"none that can be read ({_clause(error)})", "copy the file anew"
        ) from error


def _decompressed(path: Path, dataset: Any) -> np.ndarray:
    """By pydicom where it can (RLE); else by GDCM in SimpleITK, which applies the rescale, so that it is taken back."""
    import SimpleITK as sitk

    try:
        return np.asarray(dataset.pixel_array)
    except (AttributeError, NotImplementedError, RuntimeError, ValueError):
        sitk.ProcessObject.SetGlobalWarningDisplay(False)
        values = sitk.GetArrayFromImage(sitk.ReadImage(str(path))).astype(np.float64)
        slope = float(dataset.get("RescaleSlope", 1) or 1)
        stored = (values - float(dataset.get("RescaleIntercept", 0) or 0)) / slope
        return stored[0] if stored.shape[0] == 1 else stored


def _clause(error: Exception) -> str:
    return str(error).split("\n", 1)[0].rstrip(".")[:120] or type(error).__name__
