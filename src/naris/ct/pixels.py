"""The pixels of DICOM images in Hounsfield units."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from jaxtyping import Float32, Int16
from pydicom.errors import BytesLengthException

from naris.core.progress import Progress
from naris.ct.packed import dicom_whole
from naris.ct.series import Image
from naris.errors import ScanError

_NOT_READ = (
    AttributeError, BytesLengthException, EOFError, IndexError, KeyError, NotImplementedError, OSError, RuntimeError,
    TypeError, ValueError,
)  # fmt: skip
log = logging.getLogger(__name__)


def hu_of_all(images: Sequence[Image], progress: Progress) -> Int16[np.ndarray, "ni nj nk"]:
    """The images behind each other, in their order.

    Raises:
        ScanError: if the pixels of one cannot be read, or are not as many as its header says.
    """
    ni, nj = images[0].plane.shape
    hu = np.empty((len(images), nj, ni), np.int16)
    opened: tuple[Path, Any] | None = None
    with progress.task("slices", len(images)) as advance:
        for k, image in enumerate(images):
            if image.frame is not None and (opened is None or opened[0] != image.path):
                opened = (image.path, _stored(image.path))
            stored = _stored(image.path) if opened is None or image.frame is None else opened[1]
            hu[k] = _to_hu(_frame(stored, image), image)
            advance(1)
    return hu.transpose(2, 1, 0)


def hu_of(image: Image) -> Int16[np.ndarray, "nj ni"]:
    """One image, rows first."""
    return _to_hu(_frame(_stored(image.path), image), image)


def _frame(stored: np.ndarray, image: Image) -> np.ndarray:
    """The pixels of one image; a file of one frame has no axis for frames."""
    return stored if image.frame is None or stored.ndim == 2 else stored[image.frame]


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
        dataset = pydicom.dcmread(dicom_whole(path))
        if dataset.file_meta.TransferSyntaxUID.is_compressed:
            return _decompressed(path, dataset)
        return np.asarray(dataset.pixel_array)
    except _NOT_READ as error:
        log.debug("%s: %s", path.name, type(error).__name__)
        raise ScanError(
            f"the pixels of {path.name}", "fewer than its header says, or none that can be read", "copy the file anew"
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
