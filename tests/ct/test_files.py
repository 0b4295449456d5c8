"""Scans in one file: SimpleITK, which turns everything to LPS by itself, is the oracle for where voxels are."""

from __future__ import annotations

from pathlib import Path

import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK as sitk
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from naris.ct.files import read_file
from naris.errors import ScanError
from tests.ct.dicom_files import PROPER, assert_voxels_are_at, grid
from tests.ct.dicom_files import affine as along_axes

TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


def affine(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(rng=rng).as_matrix() @ np.diag(rng.choice([-1, 1], 3)) * rng.uniform(0.3, 2, 3)
    matrix[:3, 3] = rng.normal(size=3) * 50
    return matrix


def write(path: Path, hu: np.ndarray, matrix: np.ndarray) -> Path:
    """A scan whose voxels lie where the LPS matrix puts them, in the format that the name says."""
    if ".nii" in path.name:
        image = nibabel.Nifti1Image(hu, TURN @ matrix)
        image.set_sform(TURN @ matrix, code=1)
        image.set_qform(TURN @ matrix, code=1)
        image.header.set_xyzt_units("mm")
        nibabel.save(image, path)
    elif path.suffix == ".nrrd":
        header = {
            "space": "left-posterior-superior",
            "space directions": matrix[:3, :3].T,
            "space origin": matrix[:3, 3],
        }
        nrrd.write(str(path), hu, header)
    else:
        image = sitk.GetImageFromArray(hu.transpose(2, 1, 0))
        spacing = np.linalg.norm(matrix[:3, :3], axis=0)
        image.SetSpacing(spacing.tolist())
        image.SetDirection((matrix[:3, :3] / spacing).ravel().tolist())
        image.SetOrigin(matrix[:3, 3].tolist())
        sitk.WriteImage(image, str(path))
    return path


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha", "a.mhd"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_voxel_is_where_it_was_put_and_where_simpleitk_finds_it(
    name: str, seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    hu, matrix = grid(seed, (7, 6, 5)), affine(seed)
    path = write(tmp_path_factory.mktemp("s") / name, hu, matrix)
    scan = read_file(path)
    assert scan.findings == ()
    np.testing.assert_array_equal(scan.volume.hu, hu)
    np.testing.assert_allclose(scan.volume.frame_T_index, matrix, atol=1e-4)
    theirs = sitk.ReadImage(str(path))
    index = (5, 2, 3)
    np.testing.assert_allclose(
        scan.volume.points_mm(np.array(index)), theirs.TransformIndexToPhysicalPoint(index), atol=1e-3
    )
    assert scan.volume.hu[index] == theirs[index]


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha", "a.mhd"])
@pytest.mark.parametrize("turn", PROPER, ids=lambda turn: "".join("xyz"[np.abs(c).argmax()] for c in turn.T))
def test_known_voxels_are_found_in_the_patient_for_every_orientation(
    turn: np.ndarray, name: str, tmp_path: Path
) -> None:
    hu, matrix = grid(shape=(7, 6, 5)), along_axes(turn)
    assert_voxels_are_at(read_file(write(tmp_path / name, hu, matrix)).volume, hu, matrix)


def test_a_meta_header_may_end_without_a_line_break(tmp_path: Path) -> None:
    hu, matrix = grid(0, (7, 6, 5)), affine(0)
    path = write(tmp_path / "a.mhd", hu, matrix)
    path.write_bytes(path.read_bytes().rstrip(b"\r\n"))
    np.testing.assert_array_equal(read_file(path).volume.hu, hu)


@pytest.mark.parametrize("name", ["a.nii", "a.nrrd", "a.mha"])
@pytest.mark.parametrize("seed", range(8))
def test_and_for_oblique_ones(seed: int, name: str, tmp_path: Path) -> None:
    hu, matrix = grid(seed, (7, 6, 5)), affine(seed)
    assert_voxels_are_at(read_file(write(tmp_path / name, hu, matrix)).volume, hu, matrix)


@pytest.mark.parametrize(
    ("space", "signs"),
    [
        ("right-anterior-superior", (-1, -1, 1)),
        ("RAS", (-1, -1, 1)),
        ("left-anterior-superior", (1, -1, 1)),
        ("LPS", (1, 1, 1)),
    ],
)
def test_nrrd_frames_are_turned_to_lps(space: str, signs: tuple[int, int, int], tmp_path: Path) -> None:
    directions, origin = np.diag([0.5, 0.6, 2.0]), np.array([3.0, 5.0, 7.0])
    header = {"space": space, "space directions": directions, "space origin": origin}
    nrrd.write(str(tmp_path / "a.nrrd"), grid(), header)
    volume = read_file(tmp_path / "a.nrrd").volume
    np.testing.assert_allclose(volume.points_mm(np.array([2, 3, 4])), np.array([4.0, 6.8, 15.0]) * signs)


def test_a_sheared_nrrd_is_straightened(tmp_path: Path) -> None:
    directions = np.array([[0.5, 0, 0], [0, 0.5, 0], [0, 0.3, 1.0]])
    header = {"space": "LPS", "space directions": directions, "space origin": np.zeros(3)}
    hu = np.broadcast_to(np.arange(0, 400, 10, dtype=np.int16)[:, None, None], (40, 30, 12)).copy()
    nrrd.write(str(tmp_path / "a.nrrd"), hu, header)
    scan = read_file(tmp_path / "a.nrrd")
    assert [finding.code for finding in scan.findings] == ["tilt"]
    assert scan.volume.skew_deg < 1e-6
    middle = scan.volume.hu[10, 20, 5]
    assert middle == 100


def test_real_valued_scans_are_rounded_and_kept_in_range(tmp_path: Path) -> None:
    hu = grid().astype(np.float32) + 0.3
    hu[0, 0, 0], hu[1, 0, 0] = 1e9, np.nan
    path = write(tmp_path / "a.nii.gz", hu, affine(1))
    values = read_file(path).volume.hu
    assert values[0, 0, 0] == 32767 and values[1, 0, 0] == -1024
    np.testing.assert_array_equal(values[2:], grid()[2:])


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
def test_a_scaled_nifti_is_read_as_simpleitk_reads_it(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    image = nibabel.Nifti1Image(grid() * 0.5 - 100, TURN @ affine(5))
    image.set_sform(TURN @ affine(5), code=1)
    image.set_data_dtype(np.int16)
    image.header.set_slope_inter(0.5, -1024)
    nibabel.save(image, path)
    theirs = sitk.GetArrayFromImage(sitk.ReadImage(str(path))).transpose(2, 1, 0)
    assert np.unique(theirs % 1).tolist() == [0, 0.5]
    np.testing.assert_array_equal(read_file(path).volume.hu, np.rint(theirs).astype(np.int16))


def test_nifti_in_metres_is_brought_to_mm_and_one_without_a_unit_says_so(tmp_path: Path) -> None:
    path = write(tmp_path / "a.nii", grid(), affine(2))
    image = nibabel.load(path)
    image.header.set_xyzt_units("meter")
    nibabel.save(image, tmp_path / "b.nii")
    np.testing.assert_allclose(
        read_file(tmp_path / "b.nii").volume.spacing_mm, 1000 * read_file(path).volume.spacing_mm
    )
    image.header.set_xyzt_units("unknown")
    nibabel.save(image, tmp_path / "c.nii")
    assert [finding.code for finding in read_file(tmp_path / "c.nii").findings] == ["unit"]


def test_two_geometries_in_one_nifti_are_told(tmp_path: Path) -> None:
    image = nibabel.load(write(tmp_path / "a.nii", grid(), affine(3)))
    image.set_qform(TURN @ affine(4), code=1)
    nibabel.save(image, tmp_path / "b.nii")
    scan = read_file(tmp_path / "b.nii")
    assert [finding.code for finding in scan.findings] == ["two geometries"]
    np.testing.assert_allclose(scan.volume.frame_T_index, affine(3), atol=1e-4)


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.9])
def test_files_that_break_off(name: str, share: float, tmp_path: Path) -> None:
    path = write(tmp_path / name, grid(), affine(0))
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ScanError, match=name):
        read_file(path)


@pytest.mark.parametrize("name", ["a.nii.gz", "a.nrrd", "a.mha"])
def test_voxels_that_are_no_numbers_are_counted(name: str, tmp_path: Path) -> None:
    hu = np.full((12, 10, 8), 40.0, np.float32)
    hu[:3, :, 5:7] = np.nan
    told = {one.code: one for one in read_file(write(tmp_path / name, hu, np.eye(4))).findings}
    assert told["no numbers"].weight == "warning"
    assert told["no numbers"].text.startswith("60 voxels")
    hu[:, :, 4] = np.nan
    with pytest.raises(ScanError, match="1 of 8 planes without, number 4 among them"):
        read_file(write(tmp_path / name, hu, np.eye(4)))
    hu[:] = 40.0
    hu[7] = np.nan
    with pytest.raises(ScanError, match="1 of 12 planes without, number 7 among them"):
        read_file(write(tmp_path / name, hu, np.eye(4)))
    hu[:] = np.nan
    with pytest.raises(ScanError, match="12 of 12 planes without"):
        read_file(write(tmp_path / name, hu, np.eye(4)))


def test_planes_without_numbers_at_the_sides_are_left_out_and_the_rest_stays_where_it_is(tmp_path: Path) -> None:
    """As a scan that was turned has them."""
    hu, matrix = grid().astype(np.float32), affine(3)
    hu[:, :, :2] = hu[:, :, -1] = hu[0] = hu[:, -1] = np.nan
    found = read_file(write(tmp_path / "a.nrrd", hu, matrix))
    assert "5 planes at the sides" in {one.code: one.text for one in found.findings}["no numbers"]
    np.testing.assert_array_equal(found.volume.hu, grid()[1:, :-1, 2:-1])
    np.testing.assert_allclose(found.volume.points_mm(np.zeros(3)), (matrix @ [1, 0, 2, 1])[:3], atol=1e-4)
