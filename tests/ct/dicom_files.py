"""Series of DICOM files for tests, with every fault that scanners and archives have."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pydicom
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

from naris.core.volume import Volume

PATIENT = "Doe^Jane"
INTERCEPT = -1024
UPRIGHT = [
    np.array([np.eye(3)[axis] * sign for axis, sign in zip(order, signs, strict=True)]).T
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1, -1), repeat=3)
]
PROPER = [turn for turn in UPRIGHT if np.linalg.det(turn) > 0]


def grid(seed: int = 0, shape: tuple[int, int, int] = (24, 20, 12)) -> np.ndarray:
    """(ni, nj, nk) Hounsfield units, no two voxels alike nearby."""
    rng = np.random.default_rng(seed)
    return rng.integers(-1000, 2000, shape).astype(np.int16)


def affine(
    turn: np.ndarray | None = None, step: tuple[float, float, float] = (0.4, 0.6, 1.25), tilt_deg: float = 0.0
) -> np.ndarray:
    """(4, 4) of slices in that orientation (its columns are row, column and normal), sheared by a tilt."""
    turn = np.eye(3) if turn is None else turn
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(step)
    matrix[:3, 2] += step[2] * np.tan(np.deg2rad(tilt_deg)) * turn[:, 1]
    matrix[:3, 3] = [-31.5, 12.25, 100.0]
    return matrix


def image(
    hu: np.ndarray, matrix: np.ndarray, k: int, series_uid: str, position_mm: np.ndarray | None = None
) -> FileDataset:
    """Slice k of a scan, as a scanner writes it."""
    meta = FileMetaDataset()
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    meta.MediaStorageSOPClassUID = CTImageStorage
    meta.MediaStorageSOPInstanceUID = generate_uid()
    dataset = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
    spacing = np.linalg.norm(matrix[:3, :2], axis=0)
    where = matrix[:3, 3] + k * matrix[:3, 2] if position_mm is None else position_mm
    tags: dict[str, Any] = {
        "SOPClassUID": CTImageStorage,
        "SOPInstanceUID": meta.MediaStorageSOPInstanceUID,
        "SeriesInstanceUID": series_uid,
        "SeriesNumber": 4,
        "PatientName": PATIENT,
        "PatientID": "12345678",
        "Modality": "CT",
        "ImageType": ["ORIGINAL", "PRIMARY", "AXIAL"],
        "Rows": hu.shape[1],
        "Columns": hu.shape[0],
        "ImagePositionPatient": [float(x) for x in np.round(where, 6)],
        "ImageOrientationPatient": [float(x) for x in np.round((matrix[:3, :2] / spacing).T.ravel(), 8)],
        "PixelSpacing": [float(spacing[1]), float(spacing[0])],
        "RescaleSlope": 1,
        "RescaleIntercept": INTERCEPT,
        "SamplesPerPixel": 1,
        "PhotometricInterpretation": "MONOCHROME2",
        "BitsAllocated": 16,
        "BitsStored": 16,
        "HighBit": 15,
        "PixelRepresentation": 1,
        "InstanceNumber": k + 1,
    }
    for name, value in tags.items():
        setattr(dataset, name, value)
    dataset.PixelData = np.ascontiguousarray(hu[:, :, k].T - INTERCEPT).astype("<i2").tobytes()
    return dataset


def images(hu: np.ndarray, matrix: np.ndarray, uid: str | None = None) -> list[FileDataset]:
    """All slices of a scan."""
    uid = uid or generate_uid()
    return [image(hu, matrix, k, uid) for k in range(hu.shape[2])]


def write(folder: Path, datasets: list[FileDataset], seed: int = 0, prefix: str = "") -> Path:
    """In nested folders, under names that say nothing of their order."""
    names = np.random.default_rng(seed).permutation(len(datasets))
    for name, dataset in zip(names.tolist(), datasets, strict=True):
        path = folder / f"{prefix}part{name % 3}" / f"{prefix}{name:04d}"
        path.parent.mkdir(parents=True, exist_ok=True)
        pydicom.dcmwrite(path, dataset, enforce_file_format=True)
    return folder


def assert_voxels_are_at(volume: Volume, hu: np.ndarray, matrix: np.ndarray) -> None:
    """Each voxel of `hu`, put into the patient by `matrix`, is found there in the volume."""
    index = np.stack(np.meshgrid(*map(np.arange, hu.shape), indexing="ij"), axis=-1).reshape(-1, 3)
    places = index @ matrix[:3, :3].T + matrix[:3, 3]
    there = np.rint(volume.index(places)).astype(int)
    np.testing.assert_allclose(volume.points_mm(there), places, atol=1e-3)
    np.testing.assert_array_equal(volume.hu[tuple(there.T)], hu.reshape(-1))
