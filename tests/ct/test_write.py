"""Volumes that were written read back the same, in our reader and in SimpleITK's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pydicom
import pytest
import SimpleITK as sitk
from scipy.spatial.transform import Rotation

from naris.core.volume import Volume
from naris.ct.read import read_scan
from naris.ct.write import write_dicom, write_nrrd
from naris.errors import ScanError
from tests.ct.dicom_files import affine, grid

TURNED = Rotation.from_euler("xyz", [20, -35, 70], degrees=True).as_matrix()


def with_both_tissues(seed: int = 0) -> np.ndarray:
    """Noise, and enough air and soft tissue to pass for a CT."""
    hu = grid(seed)
    hu[:8] = -1000
    hu[8:12] = 40
    return hu


@pytest.mark.parametrize("turn", [np.eye(3), TURNED], ids=["upright", "turned"])
@pytest.mark.parametrize("kind", ["nrrd", "dicom"])
def test_a_written_volume_reads_back_voxel_for_voxel(tmp_path: Path, turn: np.ndarray, kind: str) -> None:
    volume = Volume(with_both_tissues(), affine(turn))
    path = tmp_path / ("scan.nrrd" if kind == "nrrd" else "scan")
    if kind == "nrrd":
        write_nrrd(volume, path)
    else:
        write_dicom(volume, path, "a nose")
    scan = read_scan(path)
    assert not scan.findings
    read = scan.volume
    corners = np.array([[0, 0, 0], [23, 0, 0], [0, 19, 0], [0, 0, 11], [23, 19, 11], [5, 7, 3]])
    there = volume.points_mm(corners)
    index = np.rint(read.index(there)).astype(int)
    assert np.allclose(read.points_mm(index), there, atol=1e-4)
    assert np.array_equal(read.hu[tuple(index.T)], volume.hu[tuple(corners.T)])
    assert read.hu.size == volume.hu.size


def test_simple_itk_reads_both_the_same(tmp_path: Path) -> None:
    volume = Volume(with_both_tissues(), affine(TURNED))
    write_nrrd(volume, tmp_path / "scan.nrrd")
    write_dicom(volume, tmp_path / "scan", "a nose")
    reader = sitk.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(tmp_path / "scan")))
    for image in (sitk.ReadImage(str(tmp_path / "scan.nrrd")), reader.Execute()):
        assert np.array_equal(sitk.GetArrayFromImage(image).transpose(2, 1, 0), volume.hu)
        for voxel in ([0, 0, 0], [23, 19, 11]):
            assert np.allclose(image.TransformIndexToPhysicalPoint(voxel), volume.points_mm(np.array(voxel)), atol=1e-4)


def test_a_tilted_gantry_is_written_as_one(tmp_path: Path) -> None:
    volume = Volume(with_both_tissues(), affine(tilt_deg=10.0))
    write_dicom(volume, tmp_path / "scan", "tilted")
    scan = read_scan(tmp_path / "scan")
    assert [finding.code for finding in scan.findings] == ["tilt"]
    assert "10.0°" in scan.findings[0].text


def test_the_same_volume_gives_the_same_bytes_and_nobody_s_name(tmp_path: Path) -> None:
    volume = Volume(with_both_tissues(), affine())
    for name in ("a", "b"):
        write_dicom(volume, tmp_path / name, "a nose")
    files = {path.name: path.read_bytes() for path in (tmp_path / "a").iterdir()}
    assert files == {path.name: path.read_bytes() for path in (tmp_path / "b").iterdir()}
    one = pydicom.dcmread(tmp_path / "a" / "0000.dcm")
    assert (one.PatientName, one.PatientID, one.PatientIdentityRemoved) == ("VIRTUAL", "VIRTUAL", "YES")


def test_what_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("")
    with pytest.raises(ScanError, match="new or empty folder"):
        write_dicom(Volume(grid(), affine()), tmp_path, "a nose")
    sheared = affine()
    sheared[0, 1] = 0.3
    with pytest.raises(ScanError, match="right angles"):
        write_dicom(Volume(grid(), sheared), tmp_path / "scan", "a nose")
    with pytest.raises(ScanError, match="in LPS"):
        write_nrrd(Volume(grid(), affine(), "RAS"), tmp_path / "scan.nrrd")
