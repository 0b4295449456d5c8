"""Slices of another scan are found by their pixels, and scans that are whole raise no alarm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from naris.ct.continuity import check_continuity
from naris.ct.dicom import read_dicom
from naris.ct.files import read_file
from naris.errors import ScanError
from tests.ct.dicom_files import affine, images, write
from tests.ct.test_files import write as write_file
from tests.ct.test_read import REAL


def head(seed: int, shape: tuple[int, int, int] = (64, 72, 40), noise_hu: float = 20.0) -> np.ndarray:
    """A ball of tissue with cavities and bone inside, each head its own."""
    rng = np.random.default_rng(seed)
    texture = gaussian_filter(rng.normal(size=shape), 4)
    hu = np.where(texture > 1.2 * texture.std(), 700.0, np.where(texture < -1.2 * texture.std(), -1000.0, 40.0))
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    half = np.array(shape) / 2
    away = np.linalg.norm((index - half - rng.uniform(-4, 4, 3)) / (half * [0.8, 0.8, 1.6]), axis=-1)
    hu[away > 1] = -1000
    return np.rint(gaussian_filter(hu, 1.0) + rng.normal(0, noise_hu, shape)).astype(np.int16)


@pytest.mark.parametrize("noise_hu", [0.0, 30.0, 150.0])
@pytest.mark.parametrize("every", [1, 2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_one_scan_is_no_two(seed: int, every: int, noise_hu: float) -> None:
    assert check_continuity(head(seed, noise_hu=noise_hu)[:, :, ::every]) == ()


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.name)
def test_real_scans_are_one_each_even_thinned_and_noisy(path: Path) -> None:
    if not path.is_file():
        pytest.skip(f"{path.name} of the shared data is not here")
    hu = read_file(path).volume.hu
    for every in (1, 2, 3, 4):
        assert check_continuity(hu[:, :, ::every]) == ()
    noise = np.random.default_rng(0).normal(0, 150, hu.shape)
    assert check_continuity(np.rint(hu + noise).astype(np.int16)) == ()
    mixed = hu.copy()
    mixed[:, :, 10:20] = hu[::-1, ::-1, 10:20]
    with pytest.raises(ScanError, match="slice 9 and slice 10, slice 19 and slice 20"):
        check_continuity(mixed)


@pytest.mark.parametrize(("first", "last"), [(15, 25), (20, 21), (0, 12), (28, 40)])
def test_slices_of_another_head(first: int, last: int, tmp_path: Path) -> None:
    hu = head(1)
    hu[:, :, first:last] = head(2)[:, :, first:last]
    with pytest.raises(ScanError, match="slices that resemble their neighbours, as those of one scan do"):
        read_file(write_file(tmp_path / "a.nrrd", hu, affine()))


def test_slices_thinner_than_their_pixels_are_looked_at_as_well(tmp_path: Path) -> None:
    hu = head(1)
    hu[:, :, 15:25] = head(2)[:, :, 15:25]
    with pytest.raises(ScanError, match="slices that resemble their neighbours"):
        read_file(write_file(tmp_path / "a.nrrd", hu, np.diag([0.5, 0.5, 0.4, 1.0])))
    assert read_file(write_file(tmp_path / "b.nrrd", head(1), np.diag([0.5, 0.5, 0.4, 1.0]))).findings == ()


def test_two_scans_that_alternate_half_a_step_apart(tmp_path: Path) -> None:
    matrix = affine()
    one = images(head(0), matrix)
    two = images(head(1), matrix, one[0].SeriesInstanceUID)
    for k, dataset in enumerate(two):
        dataset.ImagePositionPatient = [float(x) for x in matrix[:3, 3] + (k + 0.5) * matrix[:3, 2]]
    with pytest.raises(ScanError, match="two scans that alternate"):
        read_dicom(write(tmp_path, [*one, *two]))


def test_a_patient_who_moved_is_told(tmp_path: Path) -> None:
    hu = head(2, noise_hu=0)
    hu[:, :, 20:] = np.roll(hu[:, :, 20:], 2, axis=0)
    (finding,) = read_dicom(write(tmp_path, images(hu, affine()))).findings
    assert (finding.code, finding.weight) == ("unlike", "warning")
    assert "differ up to" in finding.text


def test_slices_of_nothing_at_an_end_are_no_fault() -> None:
    hu = head(3)
    hu[:, :, :2] = hu[:, :, -1:] = -1024
    assert check_continuity(hu) == ()


def test_what_streaks_of_metal_do_is_told_and_not_refused() -> None:
    rng = np.random.default_rng(0)
    plain, streaky = head(1, noise_hu=0), head(1, noise_hu=0)
    streaky[:, :, 18:23] = np.clip(streaky[:, :, 18:23] + rng.normal(0, 160, (64, 72, 1)), -1024, 3071)
    with pytest.raises(ScanError, match="resemble their neighbours"):
        check_continuity(streaky)
    plain[30:34, 30:34, 18:23] = streaky[30:34, 30:34, 18:23] = 3071
    assert check_continuity(plain) == ()
    (finding,) = check_continuity(streaky)
    assert "metal" in finding.text
