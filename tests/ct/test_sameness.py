"""What headers say against one scan is told, and refused where nothing else can be meant."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydicom.uid import generate_uid

from naris.ct.dicom import read_dicom
from naris.ct.series import contents_of
from naris.errors import ScanError
from tests.ct.dicom_files import affine, images, write
from tests.ct.test_continuity import head

HU = head(0, (32, 36, 20))


def series(change: Callable[[int, Any], None], matrix: np.ndarray | None = None) -> list[Any]:
    datasets = images(HU, affine() if matrix is None else matrix)
    for k, dataset in enumerate(datasets):
        dataset.StudyInstanceUID, dataset.FrameOfReferenceUID = "1.2.3", "1.2.4"
        dataset.SliceThickness, dataset.AcquisitionNumber, dataset.ConvolutionKernel = 1.25, 1, "H30s"
        change(k, dataset)
    return datasets


def told(folder: Path, change: Callable[[int, Any], None], matrix: np.ndarray | None = None) -> list[str]:
    return [finding.code for finding in read_dicom(write(folder, series(change, matrix))).findings]


@pytest.mark.parametrize("name", ["StudyInstanceUID", "FrameOfReferenceUID"])
def test_one_series_is_of_one_study_and_frame_of_reference(name: str, tmp_path: Path) -> None:
    def mix(k: int, dataset: Any) -> None:
        setattr(dataset, name, "1.2.5" if k < 8 else "1.2.6")

    with pytest.raises(ScanError, match=r"that name one (study|frame of reference), got 2 of 12, 8 images") as caught:
        read_dicom(write(tmp_path / "a", series(mix)))
    assert "1.2.5" not in str(caught.value)
    codes = told(tmp_path / "b", lambda _, dataset: setattr(dataset, name, generate_uid()))
    assert codes in (["study"], ["frame of reference"])


@pytest.mark.parametrize("name", ["StudyInstanceUID", "FrameOfReferenceUID"])
def test_an_image_that_names_none_says_nothing(name: str, tmp_path: Path) -> None:
    assert told(tmp_path, lambda k, dataset: delattr(dataset, name) if k == 3 else None) == []


@pytest.mark.parametrize(
    ("number", "codes"),
    [
        (lambda k: 1, []),
        (lambda k: 1 + k // 5, []),
        (lambda k: k, []),
        (lambda k: 1 + k % 2, ["acquisitions"]),
        (lambda k: None if k in (5, 6) else 1, ["acquisitions"]),
    ],
    ids=["one", "stations", "a slice each", "in turn", "some"],
)
def test_acquisitions_may_follow_each_other(
    number: Callable[[int], int | None], codes: list[str], tmp_path: Path
) -> None:
    assert told(tmp_path, lambda k, dataset: setattr(dataset, "AcquisitionNumber", number(k))) == codes


def test_kernels_and_thicknesses_that_differ(tmp_path: Path) -> None:
    def mix(k: int, dataset: Any) -> None:
        dataset.ConvolutionKernel = "H30s" if k < 8 else "H60s"
        dataset.SliceThickness = 1.25 if k < 8 else 2.5

    assert set(told(tmp_path, mix)) == {"kernels", "thicknesses"}


def test_every_second_slice_removed(tmp_path: Path) -> None:
    datasets = series(lambda k, dataset: None)
    assert read_dicom(write(tmp_path / "whole", datasets)).findings == ()
    (finding,) = read_dicom(write(tmp_path / "half", datasets[::2])).findings
    assert (finding.code, finding.weight) == ("gaps", "warning")
    assert "1.25 mm thick lie 2.5 mm apart" in finding.text


@pytest.mark.parametrize(
    ("header_deg", "true_deg", "codes"),
    [(0, 0, []), (12, 0, ["tilt told"]), (-12, 12, ["tilt"]), (12, 12.4, ["tilt"]), (0, 12, ["tilt told", "tilt"])],
)
def test_a_tilt_that_the_positions_deny(header_deg: float, true_deg: float, codes: list[str], tmp_path: Path) -> None:
    matrix = affine(tilt_deg=true_deg)
    assert told(tmp_path, lambda _, dataset: setattr(dataset, "GantryDetectorTilt", header_deg), matrix) == codes


def test_a_first_slice_that_breaks_off_at_once_is_told_and_documents_are_not(tmp_path: Path) -> None:
    write(tmp_path, series(lambda k, dataset: None))
    for name in ("DICOMDIR", "README", "notes.txt", ".DS_Store", "Thumbs.db", "viewer.exe"):
        (tmp_path / name).write_bytes(b"something else")
    assert read_dicom(tmp_path).findings == ()
    first = min(path for path in tmp_path.rglob("*") if path.parent != tmp_path)
    lowest = min(contents_of(tmp_path).series[0].images, key=lambda image: image.plane.position_mm[2])
    lowest.path.write_bytes(first.read_bytes()[:100])
    (finding,) = read_dicom(tmp_path).findings
    assert (finding.code, finding.weight) == ("no dicom", "warning") and lowest.path.name in finding.text
    (tmp_path / "other.dcm").write_bytes(b"")
    (finding,) = read_dicom(tmp_path).findings
    assert "2 files" in finding.text


def test_words_where_numbers_belong(tmp_path: Path) -> None:
    path = write(tmp_path, series(lambda k, dataset: None))
    broken = min(file for file in path.rglob("*") if file.is_file())
    content = broken.read_bytes()
    assert b"1.25" in content
    broken.write_bytes(content.replace(b"1.25", b"wide"))
    with pytest.raises(ScanError, match=f"numbers where they belong in {broken.name}"):
        read_dicom(path)
