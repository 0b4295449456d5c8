"""DICOM series: every voxel is where it was put, and a series that is not whole is refused."""

from __future__ import annotations

import contextlib
import logging
import warnings
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydicom.uid import JPEG2000Lossless, RLELossless, generate_uid
from scipy.spatial.transform import Rotation

from naris.ct.dicom import read_dicom
from naris.ct.resample import sampled
from naris.ct.series import contents_of
from naris.errors import ScanError
from tests.ct.dicom_files import INTERCEPT, PATIENT, PROPER, affine, assert_voxels_are_at, grid, images, write


@pytest.mark.parametrize("turn", PROPER, ids=lambda turn: "".join("xyz"[np.abs(c).argmax()] for c in turn.T))
def test_known_voxels_are_found_in_the_patient_for_every_orientation(turn: np.ndarray, tmp_path: Path) -> None:
    hu, matrix = grid(shape=(7, 6, 5)), affine(turn)
    scan = read_dicom(write(tmp_path, images(hu, matrix)))
    assert_voxels_are_at(scan.volume, hu, matrix)
    assert scan.findings == ()
    assert scan.slice_mm == pytest.approx(1.25)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_and_for_oblique_ones(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    hu = grid(seed, (6, 5, 4))
    matrix = affine(Rotation.random(rng=np.random.default_rng(seed)).as_matrix())
    assert_voxels_are_at(read_dicom(write(tmp_path_factory.mktemp("s"), images(hu, matrix))).volume, hu, matrix)


def test_another_library_puts_the_voxels_there_too(tmp_path: Path) -> None:
    hu, matrix = grid(), affine()
    volume = read_dicom(write(tmp_path / "all", images(hu, matrix))).volume
    names = sorted(str(path) for path in (tmp_path / "all").rglob("*") if path.is_file())
    names.sort(key=lambda name: sitk.ReadImage(name).GetOrigin()[2])
    theirs = sitk.ReadImage(names)
    for index in ((0, 0, 0), (23, 19, 11), (5, 17, 2)):
        np.testing.assert_allclose(volume.points_mm(np.array(index)), theirs.TransformIndexToPhysicalPoint(index))
        assert volume.hu[index] == theirs[index]


def test_a_tilted_gantry_is_straightened_through_its_true_geometry(tmp_path: Path) -> None:
    matrix = affine(tilt_deg=12.0)
    shape = (40, 60, 24)
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    places = index @ matrix[:3, :3].T + matrix[:3, 3]
    # A field that is linear in the patient is left as it is by linear interpolation, wherever it is sampled.
    field = np.rint(20 * places[..., 0] + 30 * places[..., 1] + 10 * places[..., 2] - 1000).astype(np.int16)
    scan = read_dicom(write(tmp_path, images(field, matrix)))
    (finding,) = scan.findings
    assert (finding.code, finding.weight) == ("tilt", "warning") and "12.0°" in finding.text
    volume = scan.volume
    assert volume.skew_deg < 1e-6
    inside = (places[1:-1, 1:-1, 1:-1]).reshape(-1, 3)
    expected = 20 * inside[:, 0] + 30 * inside[:, 1] + 10 * inside[:, 2] - 1000
    assert np.abs(sampled(volume, inside) - expected).max() < 40  # half a voxel of nothing beyond the border
    assert np.median(np.abs(sampled(volume, inside) - expected)) < 1.0
    corners = np.array([places[i, j, k] for i in (0, -1) for j in (0, -1) for k in (0, -1)])
    low, high = volume.bounds_mm
    assert (corners >= low - 1e-3).all() and (corners <= high + 1e-3).all()


def test_uneven_slices_are_resampled_and_said_so(tmp_path: Path) -> None:
    hu, matrix = grid(shape=(6, 5, 11)), affine(step=(0.5, 0.5, 1.0))
    ramp = np.broadcast_to(np.arange(11, dtype=np.int16) * 100, hu.shape).copy()
    datasets = images(ramp, matrix)
    for k, dataset in enumerate(datasets):
        moved = matrix[:3, 3] + matrix[:3, 2] * (k if k < 6 else 1.2 * k - 1.0)
        dataset.ImagePositionPatient = [float(x) for x in moved]
    scan = read_dicom(write(tmp_path, datasets))
    assert [finding.code for finding in scan.findings] == ["uneven"]
    depth = scan.volume.points_mm(np.stack([np.zeros(scan.volume.shape[2])] * 2 + [np.arange(scan.volume.shape[2])], 1))
    z = depth[:, 2] - matrix[2, 3]
    expected = 100 * np.where(z <= 5, z, 5 + (z - 5) / 1.2)
    np.testing.assert_allclose(scan.volume.hu[0, 0], expected, atol=0.6)


def test_copies_and_localisers_are_left_out_with_a_word(tmp_path: Path) -> None:
    hu, matrix = grid(), affine()
    datasets = images(hu, matrix)
    copy = images(hu, matrix, datasets[0].SeriesInstanceUID)[3]
    across = images(hu, affine(PROPER[9]), datasets[0].SeriesInstanceUID)[0]
    across.ImageType = ["ORIGINAL", "PRIMARY", "LOCALIZER"]
    scan = read_dicom(write(tmp_path, [*datasets, copy, across]))
    assert {finding.code for finding in scan.findings} == {"copies", "localisers"}
    assert_voxels_are_at(scan.volume, hu, matrix)


@pytest.mark.parametrize("syntax", [RLELossless, JPEG2000Lossless], ids=lambda syntax: syntax.name)
def test_compressed_series_are_those_that_were_not(syntax: str, tmp_path: Path) -> None:
    hu, matrix = grid(), affine()
    datasets = images(hu, matrix)
    for dataset in datasets:
        dataset.RescaleSlope = 1
        if syntax == RLELossless:
            dataset.compress(RLELossless)
        else:
            _compress_with_gdcm(dataset, tmp_path)
    scan = read_dicom(write(tmp_path / "series", datasets))
    assert_voxels_are_at(scan.volume, hu, matrix)


def _compress_with_gdcm(dataset: object, scratch: Path) -> None:
    import pydicom
    from pydicom.encaps import encapsulate, generate_frames

    stored = dataset.pixel_array  # type: ignore[attr-defined]
    writer = sitk.ImageFileWriter()
    writer.UseCompressionOn()
    writer.SetCompressor("JPEG2000")
    writer.SetFileName(str(scratch / "one.dcm"))
    writer.Execute(sitk.GetImageFromArray(stored[None]))
    other = pydicom.dcmread(scratch / "one.dcm")
    assert other.file_meta.TransferSyntaxUID == JPEG2000Lossless
    (frame,) = generate_frames(other.PixelData, number_of_frames=1)
    dataset.PixelData = encapsulate([frame])  # type: ignore[attr-defined]
    dataset["PixelData"].VR = "OB"  # type: ignore[index]
    dataset.file_meta.TransferSyntaxUID = JPEG2000Lossless  # type: ignore[attr-defined]


def test_rescale_is_applied_slice_by_slice(tmp_path: Path) -> None:
    hu, matrix = grid(), affine()
    datasets = images(hu, matrix)
    stored = np.frombuffer(datasets[2].PixelData, "<i2")
    datasets[2].RescaleSlope, datasets[2].RescaleIntercept = 0.5, INTERCEPT + 7
    datasets[2].PixelData = (2 * (stored - 7)).astype("<i2").tobytes()
    assert_voxels_are_at(read_dicom(write(tmp_path, datasets)).volume, hu, matrix)


def test_nothing_of_the_patient_comes_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write(tmp_path, images(grid(), affine()))
    with caplog.at_level(logging.DEBUG):
        (series,) = contents_of(tmp_path).series
        scan = read_dicom(tmp_path)
    assert PATIENT not in repr((series, series.told(), scan)) + caplog.text
    assert "12345678" not in repr((series, series.told(), scan)) + caplog.text


def test_of_several_series_one_has_to_be_named(tmp_path: Path) -> None:
    first, second = grid(1), grid(2)
    one, two = images(first, affine()), images(second, affine())
    for dataset in two:
        dataset.SeriesNumber = 5
    write(tmp_path, one, prefix="a")
    write(tmp_path, two, prefix="b")
    (tmp_path / "README.txt").write_text("not an image")
    with pytest.raises(ScanError, match=r"one CT series.*got 2 .*number 4.*name one of them with --series"):
        read_dicom(tmp_path)
    assert_voxels_are_at(read_dicom(tmp_path, "5").volume, second, affine())
    key = next(series.key for series in contents_of(tmp_path).series if series.number == 4)
    assert_voxels_are_at(read_dicom(tmp_path, key).volume, first, affine())
    with pytest.raises(ScanError, match="'9'"):
        read_dicom(tmp_path, "9")


def test_two_slices_missing(tmp_path: Path) -> None:
    datasets = images(grid(), affine())
    with pytest.raises(ScanError, match=r"slices every 1\.25 mm, got 2 missing, the first between"):
        read_dicom(write(tmp_path, datasets[:5] + datasets[7:]))


def test_two_scans_under_one_name(tmp_path: Path) -> None:
    uid = generate_uid()
    both = [*images(grid(1), affine(), uid), *images(grid(2), affine(), uid)]
    with pytest.raises(ScanError, match="one image in each place, got different ones"):
        read_dicom(write(tmp_path, both))


def test_two_orientations_under_one_name(tmp_path: Path) -> None:
    uid = generate_uid()
    both = [*images(grid(1), affine(), uid), *images(grid(2), affine(PROPER[9]), uid)]
    with pytest.raises(ScanError, match="one orientation, got 2 of 12, 12 images"):
        read_dicom(write(tmp_path, both))


def test_an_mr_is_no_ct(tmp_path: Path) -> None:
    datasets = images(grid(), affine())
    for dataset in datasets:
        dataset.Modality = "MR"
    write(tmp_path, datasets)
    with pytest.raises(ScanError, match=r"a CT series.*MR, 12 images"):
        read_dicom(tmp_path)
    with pytest.raises(ScanError, match="a CT, got modality MR"):
        read_dicom(tmp_path, "4")


def test_a_picture_without_a_place_or_a_class_is_no_slice(tmp_path: Path) -> None:
    hu, matrix = grid(), affine()
    datasets = images(hu, matrix)
    stray = images(hu, matrix, datasets[0].SeriesInstanceUID)[0]
    del stray.SOPClassUID, stray.ImagePositionPatient
    write(tmp_path, datasets)
    path = tmp_path / "stray"
    stray.save_as(path, enforce_file_format=True)
    assert_voxels_are_at(read_dicom(tmp_path).volume, hu, matrix)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5, 0.98])
def test_a_file_that_breaks_off(share: float, tmp_path: Path) -> None:
    write(tmp_path, images(grid(), affine()))
    broken = sorted(path for path in tmp_path.rglob("*") if path.is_file())[4]
    content = broken.read_bytes()
    broken.write_bytes(content[: max(int(share * len(content)), 140)])
    with pytest.raises(ScanError, match=broken.name):
        read_dicom(tmp_path)


def test_a_header_of_sixty_thousand_pixels_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    datasets = images(grid(), affine())
    for dataset in datasets:
        dataset.Rows = dataset.Columns = 60000
    with pytest.raises(ScanError, match="60000×60000"):
        read_dicom(write(tmp_path, datasets))


def test_a_folder_without_images(tmp_path: Path) -> None:
    for count, said in enumerate(("no file there", "1 file, which is none", "2 files, none of them one")):
        with pytest.raises(ScanError, match=f"got {said};"):
            read_dicom(tmp_path)
        (tmp_path / f"{count}.txt").write_text("hello")


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_file_is_read_or_refused_and_nothing_else(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = write(tmp_path_factory.mktemp("s"), images(grid(shape=(8, 8, 4)), affine()))
    path = min(file for file in folder.rglob("*") if file.is_file())
    content, rng = bytearray(path.read_bytes()), np.random.default_rng(seed)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(132, len(content) - 8))
        kept = int(rng.integers(0, 3))
        content[at : at + kept] = rng.integers(256, size=int(rng.integers(0, 3)), dtype=np.uint8).tobytes()
    path.write_bytes(content)
    with warnings.catch_warnings(), contextlib.suppress(ScanError):
        warnings.simplefilter("ignore")
        read_dicom(folder)


def test_a_folder_with_a_scan_that_is_no_dicom_is_told_to_give_the_file(tmp_path: Path) -> None:
    (tmp_path / "scan.nrrd").write_bytes(b"NRRD0004")
    with pytest.raises(ScanError, match=r"give the file itself, such as scan\.nrrd"):
        read_dicom(tmp_path)
