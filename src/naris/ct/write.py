"""A volume as a file: NRRD, or a DICOM series as a scanner would write it, of a patient who does not exist."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import nrrd
import numpy as np
import pydicom
from jaxtyping import Int16
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

from naris.core.atomic import replacing
from naris.core.progress import SILENT, Progress
from naris.core.volume import LPS, Volume
from naris.errors import ScanError

PATIENT = "VIRTUAL"
_INTERCEPT = -1024
_SERIES_NUMBER = 1
_ABOUT = "simulated, not a patient"


def write_nrrd(volume: Volume, path: Path) -> None:
    """A gzip-packed NRRD file in LPS, as 3D Slicer reads it; axes that are not at right angles are kept.

    Raises:
        ScanError: if the volume is not in LPS.
        DiskFull: if there is no room.
    """
    _check_frame(volume)
    header = {
        "space": "left-posterior-superior",
        "kinds": ["domain"] * 3,
        "space directions": volume.frame_T_index[:3, :3].T,
        "space origin": volume.frame_T_index[:3, 3],
        "encoding": "gzip",
    }
    with replacing(path) as part:
        nrrd.write(str(part), np.asarray(volume.hu), header, compression_level=6)
        _without_comments(part)


def _without_comments(path: Path) -> None:
    """Takes out the header's comments, which tell the second of writing: the same volume shall be the same bytes."""
    head, end, values = path.read_bytes().partition(b"\n\n")
    kept = [line for line in head.split(b"\n") if not line.startswith(b"#")]
    path.write_bytes(b"\n".join(kept) + end + values)


def write_dicom(volume: Volume, folder: Path, name: str, progress: Progress = SILENT) -> None:
    """A CT series, a file a slice (axis k of the volume), in a folder that is new or empty.

    Its identifiers follow from the values and the name: the same volume gives the same bytes. A volume whose axes are
    not at right angles becomes the series of a tilted gantry.

    Args:
        volume: in LPS; axes i and j at right angles, as the rows and columns of a slice must be.
        folder: made if need be.
        name: of the series, free text for its description.
        progress: told of every slice.

    Raises:
        ScanError: if the folder holds files, or rows and columns are not at right angles.
        DiskFull: if there is no room.
    """
    _check_frame(volume)
    across = float(volume.axes[:, 0] @ volume.axes[:, 1])
    if abs(across) > 1e-4:
        raise ScanError("rows and columns at right angles", f"a cosine of {across:.4f}", "resample the volume")
    check_series_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    hu = np.clip(np.rint(volume.hu), _INTERCEPT, np.iinfo(np.int16).max + _INTERCEPT).astype(np.int16)
    key = hashlib.sha256(hu.tobytes() + volume.frame_T_index.tobytes() + name.encode()).hexdigest()
    with progress.task("slices", volume.shape[2]) as advance:
        for k in range(volume.shape[2]):
            path = folder / f"{k:04d}.dcm"
            with replacing(path, durable=False) as part:
                pydicom.dcmwrite(part, _slice(volume, hu, k, key, name), enforce_file_format=True)
            advance(1)


def check_series_folder(folder: Path) -> None:
    """See that a series can be written to a folder: it is new or empty, but for hidden files.

    Raises:
        ScanError: if it is not; a slice of another series in it would be read as one of this.
    """
    if folder.exists() and (not folder.is_dir() or any(not p.name.startswith(".") for p in folder.iterdir())):
        raise ScanError(f"a new or empty folder at {folder}", "files", "give another folder")


def _slice(volume: Volume, hu: Int16[np.ndarray, "ni nj nk"], k: int, key: str, name: str) -> FileDataset:
    meta: Any = FileMetaDataset()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = CTImageStorage
    meta.MediaStorageSOPInstanceUID = _uid(key, f"slice {k}")
    dataset: Any = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
    where = volume.points_mm(np.array([0.0, 0.0, k]))
    normal = np.cross(volume.axes[:, 0], volume.axes[:, 1])
    tags: dict[str, Any] = {
        "SOPClassUID": CTImageStorage,
        "SOPInstanceUID": meta.MediaStorageSOPInstanceUID,
        "StudyInstanceUID": _uid(key, "study"),
        "SeriesInstanceUID": _uid(key, "series"),
        "FrameOfReferenceUID": _uid(key, "frame"),
        "SeriesNumber": _SERIES_NUMBER,
        "SeriesDescription": name[:64],
        "PatientName": PATIENT,
        "PatientID": PATIENT,
        "PatientIdentityRemoved": "YES",
        "DeidentificationMethod": _ABOUT,
        "Modality": "CT",
        "Manufacturer": "naris",
        "ImageType": ["DERIVED", "SECONDARY", "AXIAL"],
        "Rows": hu.shape[1],
        "Columns": hu.shape[0],
        "ImagePositionPatient": [f"{x:.9g}" for x in where],
        "ImageOrientationPatient": [f"{x:.10g}" for x in volume.axes[:, :2].T.ravel()],
        "PixelSpacing": [f"{volume.spacing_mm[1]:.9g}", f"{volume.spacing_mm[0]:.9g}"],
        "SliceThickness": f"{abs(float(normal @ volume.frame_T_index[:3, 2])):.9g}",
        "RescaleSlope": 1,
        "RescaleIntercept": _INTERCEPT,
        "RescaleType": "HU",
        "SamplesPerPixel": 1,
        "PhotometricInterpretation": "MONOCHROME2",
        "BitsAllocated": 16,
        "BitsStored": 16,
        "HighBit": 15,
        "PixelRepresentation": 0,
        "InstanceNumber": k + 1,
    }
    for tag, value in tags.items():
        setattr(dataset, tag, value)
    dataset.PixelData = np.ascontiguousarray(hu[:, :, k].T - np.int16(_INTERCEPT)).astype("<u2").tobytes()
    return dataset


def _uid(key: str, what: str) -> str:
    return str(generate_uid(entropy_srcs=[key, what]))


def _check_frame(volume: Volume) -> None:
    if volume.frame != LPS:
        raise ScanError("a volume in LPS", f"one in {volume.frame}", "turn it into LPS first")
